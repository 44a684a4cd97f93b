//! `npsolve blend`: one patch into one background.

use std::time::Instant;

use anyhow::{Result, bail};
use signal_io::{Format, Image, SampleType, WriteOptions, WriteReport};

use crate::args::BlendArgs;
use crate::field_file::is_network_name;
use crate::kind::{self, SignalKind};
use crate::neural::{self, NeuralSolution, Wanted};
use crate::outcome::{Outcome, Written};
use crate::progress::Progress;
use crate::report::{Extras, Seconds};
use crate::scene::Scene;
use crate::solve::{Settings, Solution, solve_scene};
use crate::value_domain::Mapping;
use crate::{files, large, problem_layers, signals};

/// Default tolerances: 0.02 grey levels RMS are invisible in 8 bits; the other is f32 accuracy.
pub const TOLERANCE_8_BIT: f32 = 1e-4;
pub const TOLERANCE: f32 = 1e-6;

/// Runs the command.
pub fn run(args: &BlendArgs, quiet: bool) -> Result<()> {
    if let Some(limit) = args.max_memory {
        return large::run(args, limit, quiet);
    }
    let kind = args.scene.kind.unwrap_or_else(|| kind::of(&args.background));
    match kind {
        SignalKind::Image => picture(args, quiet),
        _ => signals::blend(kind, args, quiet),
    }
}

fn picture(args: &BlendArgs, quiet: bool) -> Result<()> {
    if args.scene.from.is_some() || args.scene.to.is_some() {
        bail!("--from and --to are for sound; choose a part of the patch with --mask or --region");
    }
    check_targets(args)?;
    problem_layers::check(&args.output, &args.with)?;
    let write_options = WriteOptions {
        force: args.force,
        sample: args.depth.map(|d| d.sample_type()).transpose()?,
        ..WriteOptions::default()
    };

    if !quiet {
        large::warn_if_larger_than_memory(args);
    }
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
    if wanted != Wanted::Spline && scene.mapping != Mapping::Identity {
        bail!("networks blend the values of the files; add --domain stored, or linear for light");
    }
    let settings = settings(args, &like, wanted, write_options.sample);
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
        let planes = std::mem::take(&mut solution.planes);
        let picture = scene.picture(planes.clone(), true)?;
        let picture = problem_layers::add(picture, &scene, &settings, &planes, &args.with)?;
        Some(files::write(&args.output, &picture, &write_options)?)
    };
    let write = start.elapsed().as_secs_f64();

    let warnings = all_warnings(&scene, &solution, written.as_ref());
    let of = |image: &Image| vec![image.width(), image.height()];
    let outcome = Outcome {
        args,
        kind: SignalKind::Image,
        names: &scene.names,
        sizes: [of(&scene.background), of(&scene.patch)],
        channels: scene.channels(),
        place: scene.offset.map(f64::from).to_vec(),
        domain: scene.mapping,
        settings: &settings,
        solution: &solution,
        written: written.map(Written::from),
        network,
        bytes: to_field.then_some(file.len()),
        warnings,
        seconds: Seconds { read, solve: solution.seconds, write },
        extras: Extras::new(),
        remarks: String::new(),
    };
    outcome.tell(quiet)
}

/// Everything about the targets that can be known before the work.
fn check_targets(args: &BlendArgs) -> Result<()> {
    if is_network_name(&args.output) {
        files::check_text(&args.output, args.force)?;
    } else {
        files::check_picture(&args.output, args.force)?;
    }
    check_metrics(args)
}

/// The same for the file of `--metrics`.
pub fn check_metrics(args: &BlendArgs) -> Result<()> {
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

fn settings(
    args: &BlendArgs,
    like: &Image,
    wanted: Wanted,
    sample: Option<SampleType>,
) -> Settings {
    let mut options = args.solve.options(args.objective, TOLERANCE);
    if wanted != Wanted::Spline {
        // Of a network the option says how near to the exact solution it has to come.
        options.tolerance = TOLERANCE_8_BIT;
    } else if args.solve.tolerance.is_none() {
        let stored = files::stored_type(&args.output, like, sample);
        options.tolerance = if stored == SampleType::U8 { TOLERANCE_8_BIT } else { TOLERANCE };
    }
    Settings { guidance: args.solve.guidance, options }
}

fn all_warnings(scene: &Scene, solution: &Solution, written: Option<&WriteReport>) -> Vec<String> {
    let mut warnings = scene.warnings.clone();
    warnings.extend(solution.report.warnings.iter().cloned());
    warnings.extend(written.into_iter().flat_map(written_warning));
    warnings
}

/// What to say of a file that holds less than the blend.
pub fn written_warning(written: &WriteReport) -> Vec<String> {
    let mut warnings = Vec::new();
    let share = written.clipped as f64 / written.samples.max(1) as f64;
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
