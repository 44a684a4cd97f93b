//! `npsolve blend` with a network as the result.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use inr_core::{
    Architecture, Checkpoint, Domain, Encoding, Field, Frame, Interpolation, Network, Output,
    Samples, Spline, TrainOptions, Trainer,
};
use poisson_loss::{
    Blend, Metrics, NeuralOptions, PaperOptions, PaperWeights, Patch, Problem, insert, measure,
    neural_box, solve_with_progress, train_blend, train_paper,
};

use crate::args::{BlendArgs, ObjectiveName};
use crate::channels::{self, ChannelJob, with_channels};
use crate::field_kind::{FieldKind, FieldOptions};
use crate::picture_kind::PictureKind;
use crate::progress::Progress;
use crate::report::NetworkReport;
use crate::scene::{Scene, samples_of};
use crate::solve::{Settings, Solution, explain};

/// Root mean square distance to the exact solution at which a training ends: a quarter of a grey level.
const TOLERANCE: f32 = 1e-3;
/// Steps of a training without any limit of its own.
const STEPS: u64 = 2000;
/// Samples over which a network fades into the background at the border of the solved box.
const FADE: usize = 8;

/// Which field the result is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// The exact spline.
    Spline,
    /// The background's own network, trained on.
    Background,
    /// A new network.
    New(FieldKind),
}

/// What the options and files ask for.
pub fn wanted(args: &BlendArgs, scene: &Scene) -> Wanted {
    let is_file = crate::field_file::is_network_name(&args.output);
    match args.field {
        Some(crate::args::BlendField::Spline) => Wanted::Spline,
        Some(field) => field.kind().map_or(Wanted::Spline, Wanted::New),
        None if scene.networks[0].is_some() => Wanted::Background,
        None if is_file => Wanted::New(FieldKind::Grid),
        None => Wanted::Spline,
    }
}

/// A blend as a network.
pub struct NeuralSolution {
    /// The picture, and what the exact solver did before.
    pub solution: Solution,
    /// What the training did.
    pub report: NetworkReport,
    /// The checkpoint.
    pub file: Vec<u8>,
}

/// Trains a network to be the blend.
pub fn solve_scene(
    args: &BlendArgs,
    scene: &Scene,
    settings: &Settings,
    wanted: Wanted,
    quiet: bool,
) -> Result<NeuralSolution> {
    let (n, most) = (scene.channels(), channels::MOST);
    with_channels::<2, _>(n, Job { args, scene, settings, wanted, quiet }).unwrap_or_else(|| {
        bail!("{} has {n} channels, a network 1 to {most}; use --field spline", scene.names[0])
    })
}

struct Job<'a> {
    args: &'a BlendArgs,
    scene: &'a Scene,
    settings: &'a Settings,
    wanted: Wanted,
    quiet: bool,
}

impl ChannelJob for Job<'_> {
    type Output = Result<NeuralSolution>;

    fn run<const C: usize>(self) -> Result<NeuralSolution> {
        let scene = self.scene;
        let background = samples_of::<C>(&scene.background, 0)?;
        let patch = samples_of::<C>(&scene.patch, 0)?;
        let patch_network = scene.network::<C>(1)?;
        let offset = scene.offset;
        let region = scene.region();
        let problem = Problem {
            background: &background,
            patch: match &patch_network {
                Some(field) => Patch::Field { field, offset },
                None => Patch::Samples { samples: &patch, offset },
            },
            region: &region,
            guidance: self.settings.guidance.to_guidance::<2, C>(),
            options: self.settings.options,
        };
        let begin = Instant::now();
        let paper = self.args.objective == ObjectiveName::Paper;
        let made = if paper && self.wanted == Wanted::New(FieldKind::Diner) {
            self.paper(&problem)?
        } else {
            let mut progress = Progress::new(self.quiet);
            let exact = solve_with_progress(&problem, &mut |share| progress.update(share))
                .map_err(|e| explain(e, &scene.names))?;
            drop(progress);
            self.train(&problem, exact)?
        };
        let seconds = begin.elapsed().as_secs_f64();
        let metrics = (self.args.json || self.args.metrics.is_some())
            .then(|| measure(&problem, &made.samples, made.exact.as_ref().map(|e| &e.samples)))
            .transpose()
            .map_err(|e| explain(e, &scene.names))?;
        self.finish(made, metrics, seconds)
    }
}

/// A network and its picture.
struct Made<const C: usize> {
    network: Network<2, C>,
    samples: Samples<2, C>,
    exact: Option<Blend<2, C>>,
    report: NetworkReport,
    solver: poisson_loss::Report,
}

impl Job<'_> {
    /// The paper's own solver, on the whole picture as published.
    fn paper<const C: usize>(&self, problem: &Problem<'_, 2, C>) -> Result<Made<C>> {
        let lambda = self.args.solve.lambda;
        let usual = PaperOptions::default();
        let options = PaperOptions {
            steps: self.args.steps.unwrap_or(usual.steps),
            weights: lambda.map_or(usual.weights, PaperWeights::Lambda),
            ..usual
        };
        let on = *problem.background.domain();
        let (mut progress, begin) = (Progress::of("training", self.quiet), Instant::now());
        let budget = self.args.budget;
        let blend = train_paper(problem, &on, &options, |now| {
            let share = now.step as f32 / options.steps as f32;
            progress.update_with(share, || format!("loss {:.3}", now.loss.total));
            budget.is_none_or(|b| begin.elapsed() < b)
        })
        .map_err(|e| explain(e, &self.scene.names))?;
        let solver = poisson_loss::Report {
            iterations: 0,
            residual: 0.0,
            excess: 0.0,
            box_start: vec![0; 2],
            box_shape: on.shape().to_vec(),
            region_samples: 0.0,
            length: None,
            warnings: Vec::new(),
        };
        let report = NetworkReport {
            field: "diner (paper)".to_owned(),
            parameters: blend.network.parameter_count(),
            steps: blend.steps,
            loss: blend.loss.total,
            distance: None,
            seconds: blend.seconds,
        };
        Ok(Made { network: blend.network, samples: blend.samples, exact: None, report, solver })
    }

    /// A network that follows the exact solution and then the objective.
    fn train<const C: usize>(
        &self,
        problem: &Problem<'_, 2, C>,
        exact: Blend<2, C>,
    ) -> Result<Made<C>> {
        let (args, scene) = (self.args, self.scene);
        let whole = *problem.background.domain();
        let boxed = neural_box(problem, &exact);
        let is_file = crate::field_file::is_network_name(&args.output);
        let on = if is_file || self.wanted == Wanted::Background { whole } else { boxed };
        let (network, train, distill) = self.begin(&exact, &on)?;
        let mut trainer = Trainer::new(network, train);
        let options = NeuralOptions {
            steps: args.steps.unwrap_or(if args.budget.is_some() { u64::MAX } else { STEPS }),
            budget: args.budget,
            tolerance: Some(f64::from(args.solve.tolerance.unwrap_or(TOLERANCE))),
            distill,
        };
        let mut progress = Progress::of("training", self.quiet);
        let result = train_blend(problem, &exact, &on, &mut trainer, &options, |now| {
            progress.update_with(now.progress as f32, || {
                let levels = 255.0 * now.distance;
                format!(
                    "loss {:.1e}, residual {:.1e}, {levels:.2} levels from exact",
                    now.loss, now.residual
                )
            });
            true
        });
        drop(progress);
        let last = result.map_err(|e| explain(e, &scene.names))?.last;
        let samples = insert(problem.background, &trainer.network, &boxed, FADE);
        let report = NetworkReport {
            field: self.name(),
            parameters: trainer.network.parameter_count(),
            steps: trainer.steps(),
            loss: last.loss,
            distance: Some(last.distance),
            seconds: last.seconds,
        };
        let solver = exact.report.clone();
        Ok(Made { network: trainer.network, samples, exact: Some(exact), report, solver })
    }

    /// The network before its training, how it is trained, and which share of that follows the exact solution.
    fn begin<const C: usize>(
        &self,
        exact: &Blend<2, C>,
        on: &Domain<2>,
    ) -> Result<(Network<2, C>, TrainOptions, f64)> {
        let usual = NeuralOptions::default().distill;
        let values = exact.samples.as_planar();
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let output = Output::of_range(low, if high > low { high } else { low + 1.0 });
        match self.wanted {
            Wanted::Background => {
                let network = self
                    .scene
                    .network::<C>(0)?
                    .ok_or_else(|| anyhow!("no network to begin with"))?;
                let tables = matches!(network.architecture().encoding, Encoding::Grid(_));
                // It is near its goal everywhere but in the region: a third of the usual rates.
                let (rate, table_rate) = if tables { (3e-3, 1e-2) } else { (3e-4, 0.0) };
                Ok((network, TrainOptions { rate, table_rate, ..TrainOptions::default() }, usual))
            }
            // A grid that holds the exact solution from the beginning: small steps on the objective, if any.
            Wanted::New(FieldKind::Grid) if self.args.table_rows.is_none() => {
                let architecture = Architecture::spline_grid(&on.shape(), C);
                let mut network = Network::new(architecture, Frame::of_samples(on), output, 1)?;
                network.load_spline(&Spline::interpolate(&exact.samples))?;
                Ok((
                    network,
                    TrainOptions { rate: 1e-4, table_rate: 1e-5, ..TrainOptions::default() },
                    0.0,
                ))
            }
            Wanted::New(kind) => {
                // The default table of a sample per row has no gradient.
                let interpolation = (kind == FieldKind::Diner).then_some(Interpolation::Cubic);
                let table_rows = self.args.table_rows;
                let given = FieldOptions { interpolation, table_rows, ..FieldOptions::default() };
                let options = kind.resolve(&given).map_err(|message| anyhow!(message))?;
                let architecture = kind.architecture(&on.shape(), &options);
                let network = Network::new(architecture, Frame::of_cells(on), output, 1)?;
                Ok((network, kind.train_options(&options, 1), usual))
            }
            Wanted::Spline => bail!("a spline is not trained"),
        }
    }

    fn name(&self) -> String {
        match self.wanted {
            Wanted::New(kind) => kind.name().to_owned(),
            Wanted::Background => "the background's network".to_owned(),
            Wanted::Spline => "spline".to_owned(),
        }
    }

    fn finish<const C: usize>(
        &self,
        made: Made<C>,
        metrics: Option<Metrics>,
        seconds: f64,
    ) -> Result<NeuralSolution> {
        let values = made.samples.as_planar();
        let range = [
            values.iter().copied().fold(f32::INFINITY, f32::min),
            values.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        ];
        let checkpoint = Checkpoint {
            network: made.network,
            domain: *made.samples.domain(),
            notes: PictureKind::of(&self.scene.background).to_notes(),
            range,
            training: None,
        };
        let file = checkpoint.to_bytes()?;
        let planes = made.samples.as_planar().to_vec();
        let solution = Solution { planes, report: made.solver, metrics, seconds };
        Ok(NeuralSolution { solution, report: made.report, file })
    }
}

/// A few lines about a network that became the result.
pub fn summary(report: &NetworkReport, output: &Path, bytes: Option<usize>) -> String {
    let mut text = format!(
        "Network {}: {} parameters, {} steps in {:.1} s, loss {:.2e}",
        report.field, report.parameters, report.steps, report.seconds, report.loss
    );
    if let Some(distance) = report.distance {
        let _ = write!(text, ", {:.2} grey levels from the exact solution", 255.0 * distance);
    }
    text.push_str(".\n");
    if let Some(bytes) = bytes {
        let _ = writeln!(text, "Wrote {} ({:.1} MB).", output.display(), bytes as f64 * 1e-6);
    }
    text
}

/// Samples of a network on a lattice, one plane per channel.
pub fn sampled<const D: usize, const C: usize>(
    network: &Network<D, C>,
    domain: &Domain<D>,
) -> Vec<f32> {
    const CHUNK: usize = 1 << 16;
    let n = domain.len();
    let mut planes = vec![0.0; C * n];
    let (mut x, mut y) = (Vec::new(), vec![[0.0; C]; CHUNK.min(n)]);
    for start in (0..n).step_by(CHUNK) {
        let end = (start + CHUNK).min(n);
        x.clear();
        x.extend((start..end).map(|k| domain.position(domain.unflatten(k))));
        network.eval(&x, &mut y[..end - start]);
        for (k, values) in y[..end - start].iter().enumerate() {
            (0..C).for_each(|c| planes[c * n + start + k] = values[c]);
        }
    }
    planes
}
