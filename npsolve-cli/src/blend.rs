//! `npsolve blend`: one patch into one background.

use std::fmt::Write as _;
use std::time::Instant;

use anyhow::{Result, bail};
use signal_io::{Format, Image, SampleType, WriteOptions, WriteReport};

use crate::args::{BlendArgs, ObjectiveName};
use crate::progress::Progress;
use crate::report::{BlendReport, Context, Seconds, count};
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
    files::check_write(&args.output, &like, &write_options)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args, &like);
    let with_metrics = args.json || args.metrics.is_some();
    let mut progress = Progress::new(quiet);
    let mut solution =
        solve_scene(&scene, &settings, with_metrics, &mut |share| progress.update(share))?;
    drop(progress);

    let start = Instant::now();
    let picture = scene.picture(std::mem::take(&mut solution.planes), true)?;
    let written = files::write(&args.output, &picture, &write_options)?;
    let write = start.elapsed().as_secs_f64();

    let done = Done {
        args,
        scene: &scene,
        settings: &settings,
        warnings: all_warnings(&scene, &solution, &written),
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written,
    };
    done.tell(quiet)
}

/// Everything about the targets that can be known before the work.
fn check_targets(args: &BlendArgs) -> Result<()> {
    files::check_picture(&args.output, args.force)?;
    let Some(metrics) = &args.metrics else { return Ok(()) };
    files::check_text(metrics, args.force)?;
    if *metrics == args.output {
        bail!("-o and --metrics both name {}; choose two files", metrics.display());
    }
    Ok(())
}

fn settings(args: &BlendArgs, like: &Image) -> Settings {
    let wanted = args.depth.map(|d| d.sample_type());
    let stored = files::stored_type(&args.output, like, wanted);
    let tolerance = if stored == SampleType::U8 { TOLERANCE_8_BIT } else { TOLERANCE };
    Settings {
        guidance: args.solve.guidance,
        options: args.solve.options(args.objective, tolerance),
    }
}

fn all_warnings(scene: &Scene, solution: &Solution, written: &WriteReport) -> Vec<String> {
    let mut warnings = scene.warnings.clone();
    warnings.extend(solution.report.warnings.iter().cloned());
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
    written: WriteReport,
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
            solver: format!("spline-{}", self.objective()),
            guidance: self.settings.guidance.to_string(),
            seconds: self.seconds,
            clipped_fraction: clipped_fraction(&self.written),
            warnings: &self.warnings,
            size: [background.width(), background.height()],
            channels: self.scene.channels(),
            offset: self.scene.offset,
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
        let (clipped, samples) = (self.written.clipped, self.written.samples);
        let _ = writeln!(
            text,
            "Wrote {} ({} {}); {clipped} of {samples} samples were clipped to fit.",
            self.args.output.display(),
            self.written.sample.name(),
            self.written.format.name()
        );
        text
    }
}
