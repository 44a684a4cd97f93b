//! `npsolve blend`: one patch into one background.

use std::fmt::Write as _;
use std::time::Instant;

use anyhow::{Result, bail};
use signal_io::{Format, Image, SampleType, WriteOptions, WriteReport};

use crate::args::{BlendArgs, ObjectiveName};
use crate::field_file::is_network_name;
use crate::neural::{self, NeuralSolution, Wanted};
use crate::progress::Progress;
use crate::report::{BlendReport, Context, NetworkReport, Seconds, count};
use crate::scene::Scene;
use crate::solve::{Settings, Solution, solve_scene};
use crate::{console, files};

/// Default tolerances: 0.02 grey levels RMS are invisible in 8 bits; the other is f32 accuracy.
const TOLERANCE_8_BIT: f32 = 1e-4;
const TOLERANCE: f32 = 1e-6;

/// Runs the command.
pub fn run(args: &BlendArgs, quiet: bool) -> Result<()> {
    check_targets(args)?;
    let write_options = WriteOptions {
        force: args.force,
        sample: args.depth.map(|d| d.sample_type()),
        ..WriteOptions::default()
    };

    let start = Instant::now();
    let scene = Scene::read(&args.background, &args.patch, &args.scene)?;
    let like = scene.picture(scene.background.as_planar().to_vec(), true)?;
    let to_field = is_network_name(&args.output);
    if !to_field {
        files::check_write(&args.output, &like, &write_options)?;
    }
    let read = start.elapsed().as_secs_f64();

    let wanted = neural::wanted(args, &scene);
    check_field(args, wanted)?;
    let settings = settings(args, &like, wanted);
    let with_metrics = args.json || args.metrics.is_some();
    let (mut solution, network, file) = if wanted == Wanted::Spline {
        let mut progress = Progress::new(quiet);
        let solution =
            solve_scene(&scene, &settings, with_metrics, &mut |share| progress.update(share))?;
        (solution, None, Vec::new())
    } else {
        let NeuralSolution { solution, report, file } =
            neural::solve_scene(args, &scene, &settings, wanted, quiet)?;
        (solution, Some(report), file)
    };

    let start = Instant::now();
    let written = if to_field {
        files::write_bytes(&args.output, &file, args.force)?;
        None
    } else {
        let picture = scene.picture(std::mem::take(&mut solution.planes), true)?;
        Some(files::write(&args.output, &picture, &write_options)?)
    };
    let write = start.elapsed().as_secs_f64();

    let done = Done {
        args,
        scene: &scene,
        settings: &settings,
        warnings: all_warnings(&scene, &solution, written.as_ref()),
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written,
        network,
        bytes: to_field.then_some(file.len()),
    };
    done.tell(quiet)
}

/// Everything about the targets that can be known before the work.
fn check_targets(args: &BlendArgs) -> Result<()> {
    if is_network_name(&args.output) {
        files::check_text(&args.output, args.force)?;
    } else {
        files::check_picture(&args.output, args.force)?;
    }
    let Some(metrics) = &args.metrics else { return Ok(()) };
    files::check_text(metrics, args.force)?;
    if *metrics == args.output {
        bail!("-o and --metrics both name {}; choose two files", metrics.display());
    }
    Ok(())
}

/// Options that the chosen field does not have.
fn check_field(args: &BlendArgs, wanted: Wanted) -> Result<()> {
    if wanted != Wanted::Spline {
        return Ok(());
    }
    if is_network_name(&args.output) {
        bail!(
            "{}: a spline is written as a picture; choose --field grid, or an output like .exr",
            args.output.display()
        );
    }
    if args.budget.is_some() || args.steps.is_some() || args.table_rows.is_some() {
        bail!(
            "--budget, --steps and --table-rows belong to networks; choose one with --field, for example grid"
        );
    }
    Ok(())
}

fn settings(args: &BlendArgs, like: &Image, wanted: Wanted) -> Settings {
    let mut options = args.solve.options(args.objective, TOLERANCE);
    if wanted != Wanted::Spline {
        // Of a network the option says how near to the exact solution it has to come.
        options.tolerance = TOLERANCE_8_BIT;
    } else if args.solve.tolerance.is_none() {
        let stored = files::stored_type(&args.output, like, args.depth.map(|d| d.sample_type()));
        options.tolerance = if stored == SampleType::U8 { TOLERANCE_8_BIT } else { TOLERANCE };
    }
    Settings { guidance: args.solve.guidance, options }
}

fn all_warnings(scene: &Scene, solution: &Solution, written: Option<&WriteReport>) -> Vec<String> {
    let mut warnings = scene.warnings.clone();
    warnings.extend(solution.report.warnings.iter().cloned());
    let Some(written) = written else { return warnings };
    let share = clipped_fraction(written);
    if share > 0.01 {
        warnings.push(format!(
            "{:.1} % of the samples did not fit {} samples and were clipped; write floats (.exr, \
             .tif or .npy with --depth f32), or try --guidance mix or --keep",
            100.0 * share,
            written.sample.name()
        ));
    }
    if written.format == Format::Jpeg {
        let what =
            "JPEG loses detail everywhere, also outside the region; write .png to avoid that";
        warnings.push(what.to_owned());
    }
    warnings
}

fn clipped_fraction(written: &WriteReport) -> f64 {
    written.clipped as f64 / written.samples.max(1) as f64
}

/// A finished blend.
struct Done<'a> {
    args: &'a BlendArgs,
    scene: &'a Scene,
    settings: &'a Settings,
    solution: &'a Solution,
    /// What became of the picture, if the result is one.
    written: Option<WriteReport>,
    /// The training, and the size of the file, if the result is a network.
    network: Option<NetworkReport>,
    bytes: Option<usize>,
    warnings: Vec<String>,
    seconds: Seconds,
}

impl Done<'_> {
    fn tell(&self, quiet: bool) -> Result<()> {
        if let Some(report) = self.report() {
            let json = files::to_json(&report)?;
            if let Some(path) = &self.args.metrics {
                files::write_text(path, &json, self.args.force)?;
            }
            if self.args.json {
                console::print(&json)?;
            }
        }
        if !quiet {
            console::warn(&self.warnings);
        }
        if !quiet && !self.args.json {
            console::print(&self.summary())?;
        }
        Ok(())
    }

    fn report(&self) -> Option<BlendReport> {
        let background = &self.scene.background;
        let context = Context {
            solver: format!(
                "{}-{}",
                self.network.as_ref().map_or("spline", |n| &n.field),
                self.objective()
            ),
            guidance: self.settings.guidance.to_string(),
            seconds: self.seconds,
            clipped_fraction: self.written.as_ref().map_or(0.0, clipped_fraction),
            warnings: &self.warnings,
            size: [background.width(), background.height()],
            channels: self.scene.channels(),
            offset: self.scene.offset,
            network: self.network.clone(),
        };
        let metrics = self.solution.metrics.as_ref()?;
        Some(BlendReport::new(metrics, &self.solution.report, context))
    }

    fn objective(&self) -> &'static str {
        match self.args.objective {
            ObjectiveName::Screened => "screened",
            ObjectiveName::Paper => "paper",
            ObjectiveName::Dirichlet => "dirichlet",
        }
    }

    fn summary(&self) -> String {
        let (scene, report) = (self.scene, &self.solution.report);
        let (b, p, [x, y]) = (&scene.background, &scene.patch, scene.offset);
        let [background, patch] = &scene.names;
        let mut text = format!(
            "Blended {patch} ({} x {}) into {background} ({} x {}, {}) at {x},{y}.\n",
            p.width(),
            p.height(),
            b.width(),
            b.height(),
            count(scene.channels(), "channel")
        );
        let length = report.length.map_or(String::new(), |l| format!(", length {l:.1} px"));
        let (region, guidance) = (report.region_samples, self.settings.guidance);
        let _ = writeln!(
            text,
            "Region {region:.0} pixels; guidance {guidance}; {} objective{length}.",
            self.objective()
        );
        let Seconds { read, solve, write } = self.seconds;
        let _ = writeln!(
            text,
            "{}, residual {:.1e}; read {read:.2} s, solve {solve:.2} s, write {write:.2} s.",
            count(report.iterations, "iteration"),
            report.residual
        );
        if let Some(network) = &self.network {
            text += &neural::summary(network, &self.args.output, self.bytes);
        }
        if let Some(written) = &self.written {
            let _ = writeln!(
                text,
                "Wrote {} ({} {}); {} of {} samples were clipped to fit.",
                self.args.output.display(),
                written.sample.name(),
                written.format.name(),
                written.clipped,
                written.samples
            );
        }
        text
    }
}
