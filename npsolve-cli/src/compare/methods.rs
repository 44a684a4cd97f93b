//! The methods that are compared, run on one problem and measured in one operator.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, anyhow};
use inr_core::Samples;
use poisson_loss::{
    Baseline, Metrics, Objective, Options, Patch, Problem, Report, measure, solve, solve_baseline,
};

use crate::args::{CompareArgs, DEFAULT_LAMBDA};
use crate::channels::{self, Axes, ChannelJob, Channels, with_channels};
use crate::solve::{Planes, Settings, Setup, explain};
use crate::values::GuidanceName;

/// f32 accuracy: all excesses are measured against our own solution.
pub const TOLERANCE: f32 = 1e-6;

/// One problem with everything that is to be compared on it.
pub struct Case<'a, const D: usize> {
    /// Name in a list of cases; empty when there is one only.
    pub name: String,
    /// Signals, region and place.
    pub setup: Setup<'a, D>,
    /// What the user should know about them.
    pub warnings: Vec<String>,
    /// The gradient to follow.
    pub guidance: GuidanceName,
    /// The screened problem in which everything is measured.
    pub options: Options,
    keep: Option<f32>,
    lambda: f32,
    others: Vec<(PathBuf, Vec<f32>)>,
}

/// A method by name.
#[derive(Debug, Clone)]
pub struct Method {
    /// For tables and labels.
    pub label: String,
    /// For file names.
    pub slug: String,
    kind: Kind,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    Baseline(Baseline),
    Spline(Options),
    /// Index of somebody else's picture.
    Other(usize),
}

/// What a method did.
pub struct Row {
    /// Which one.
    pub method: Method,
    /// Time of the solver; none for pictures from elsewhere.
    pub seconds: Option<f64>,
    /// What the solver says; none for pictures from elsewhere.
    pub report: Option<Report>,
    /// Scores in the screened operator.
    pub metrics: Option<Metrics>,
    /// The result, unless it failed.
    pub planes: Option<Vec<f32>>,
    /// Why it failed.
    pub error: Option<String>,
}

/// The slug of the solution everything is compared with.
const OURS: &str = "screened";

/// The planes of our own solution.
pub fn ours(rows: &[Row]) -> Result<&[f32]> {
    rows.iter()
        .find(|r| r.method.slug == OURS)
        .and_then(|r| r.planes.as_deref())
        .ok_or_else(|| anyhow!("the screened solution is missing from the comparison"))
}

impl<'a, const D: usize> Case<'a, D> {
    /// A case whose lengths are in units of the lattice. `others` are somebody else's results.
    pub fn new(
        setup: Setup<'a, D>,
        warnings: &[String],
        settings: &Settings,
        args: &CompareArgs,
        others: Vec<(PathBuf, Vec<f32>)>,
    ) -> Self {
        let Settings { guidance, mut options } = *settings;
        let (mut length, mut keep) = (None, None);
        if let Objective::Screened { length: l, keep: k } = options.objective {
            (length, keep) = (l, k);
        }
        options.objective = Objective::Screened { length, keep: None };
        let lambda = args.solve.lambda.unwrap_or(DEFAULT_LAMBDA);
        let (name, warnings) = (String::new(), warnings.to_vec());
        Self { name, setup, warnings, guidance, options, keep, lambda, others }
    }

    /// All methods in the order of the table.
    pub fn methods(&self) -> Vec<Method> {
        let lambda = self.lambda;
        let method =
            |label: &str, slug: &str, kind| Method { label: label.into(), slug: slug.into(), kind };
        let spline = |objective| Kind::Spline(Options { objective, ..self.options });
        let mut all = vec![
            method("copy and paste", "paste", Kind::Baseline(Baseline::Paste)),
            method("PIE on links", "pie", Kind::Baseline(Baseline::Pie)),
            method("Neumann (DCT)", "neumann", Kind::Baseline(Baseline::Neumann)),
            method("paper on links", "paper-links", {
                Kind::Baseline(Baseline::PaperLinks { lambda })
            }),
            method("paper, spline", "paper-spline", spline(Objective::Paper { lambda })),
            method("Dirichlet, spline", "dirichlet", spline(Objective::Dirichlet)),
            method("screened (ours)", OURS, Kind::Spline(self.options)),
        ];
        if let (Some(keep), Objective::Screened { length, .. }) =
            (self.keep, self.options.objective)
        {
            let objective = Objective::Screened { length, keep: Some(keep) };
            all.push(method(&format!("screened, keep {keep}"), "keep", spline(objective)));
        }
        for (k, (path, _)) in self.others.iter().enumerate() {
            let slug = format!("other-{}-{}", k + 1, stem(path));
            all.push(method(&stem(path), &slug, Kind::Other(k)));
        }
        all
    }
}

impl<const D: usize> Case<'_, D>
where
    Axes<D>: Channels,
{
    /// Runs and measures all methods. A method that fails becomes a row that says why; without our
    /// own solution there is nothing to compare with.
    pub fn run(&self, progress: &mut (dyn FnMut(f32) + Send)) -> Result<Vec<Row>> {
        let n = self.setup.background.channels();
        with_channels::<D, _>(n, Comparison { case: self, progress }).ok_or_else(|| {
            let (name, counts) = (&self.setup.names[0], channels::in_words::<D>());
            anyhow!("{name} has {n} channels; compare works with {counts}, so use blend --metrics")
        })?
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

struct Comparison<'a, const D: usize> {
    case: &'a Case<'a, D>,
    progress: &'a mut (dyn FnMut(f32) + Send),
}

impl<const D: usize> ChannelJob for Comparison<'_, D>
where
    Axes<D>: Channels,
{
    type Output = Result<Vec<Row>>;

    fn run<const C: usize>(self) -> Result<Vec<Row>> {
        let (case, setup) = (self.case, &self.case.setup);
        let (background, patch) = (setup.background.samples::<C>(0)?, setup.patch.samples::<C>(0)?);
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: setup.offset },
            region: setup.region,
            guidance: case.guidance.to_guidance::<D, C>(),
            options: case.options,
        };
        let exact = solve(&problem).map_err(|e| explain(e, setup.names))?.samples;
        let methods = case.methods();
        let count = methods.len() as f32;
        let mut rows = Vec::new();
        for (k, method) in methods.into_iter().enumerate() {
            (self.progress)(k as f32 / count);
            let result = case.solve(&problem, &method);
            rows.push(measured(&problem, method, result, &exact, setup.names));
        }
        Ok(rows)
    }
}

/// Samples with the time they took and the solver's report, where there are these.
type Outcome<const D: usize, const C: usize> = Result<(Samples<D, C>, Option<f64>, Option<Report>)>;

impl<const D: usize> Case<'_, D>
where
    Axes<D>: Channels,
{
    fn solve<const C: usize>(&self, problem: &Problem<'_, D, C>, method: &Method) -> Outcome<D, C> {
        let start = Instant::now();
        let blend = match method.kind {
            Kind::Other(k) => {
                let planes = Planes { values: &self.others[k].1, ..self.setup.background };
                return Ok((planes.samples::<C>(0)?, None, None));
            }
            Kind::Baseline(baseline) => solve_baseline(problem, baseline),
            Kind::Spline(options) => solve(&Problem { options, ..problem.clone() }),
        };
        let blend = blend.map_err(|e| explain(e, self.setup.names))?;
        Ok((blend.samples, Some(start.elapsed().as_secs_f64()), Some(blend.report)))
    }
}

fn measured<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    method: Method,
    result: Outcome<D, C>,
    exact: &Samples<D, C>,
    names: &[String; 2],
) -> Row {
    let failed = |method, error: anyhow::Error| Row {
        method,
        seconds: None,
        report: None,
        metrics: None,
        planes: None,
        error: Some(format!("{error:#}")),
    };
    let (samples, seconds, report) = match result {
        Ok(outcome) => outcome,
        Err(error) => return failed(method, error),
    };
    match measure(problem, &samples, Some(exact)) {
        Err(error) => failed(method, explain(error, names)),
        Ok(mut metrics) => {
            if let (OURS, Some(report)) = (method.slug.as_str(), &report) {
                // Against itself it would be zero; the solver knows how far it may be off.
                metrics.excess_energy = Some(report.excess / metrics.objective);
            }
            let planes = Some(samples.as_planar().to_vec());
            Row { method, seconds, report, metrics: Some(metrics), planes, error: None }
        }
    }
}
