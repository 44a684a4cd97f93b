//! `npsolve blend --max-memory`: pictures larger than memory, solved in blocks from file to file.

mod advice;
mod input;
mod limits;
mod pace;
mod region;
mod result;
mod scratch;
mod summary;

use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use poisson_loss::{
    BlockOptions, BlockProblem, BlockProgress, BlockReport, BlockSource, BlockStage, Error,
    PlaneFile, solve_in_blocks,
};
use signal_io::{ReadOptions, RowReader, RowWriter, SampleType, WriteOptions};

use crate::args::{BlendArgs, ObjectiveName};
use crate::blend::{TOLERANCE, TOLERANCE_8_BIT};
use crate::channels::{ChannelJob, MOST, with_channels};
use crate::progress::Progress;
use crate::solve::{Settings, explain};
use crate::{console, files};
use input::{Conversion, Streamed};
use pace::Pace;
use region::Weights;
use result::RowSink;
use scratch::{Scratch, Stop};
use summary::Summary;

pub use advice::warn_if_larger_than_memory;

/// Change of the last sweep, as a share of the values' range: far below a step of 8 bits, and of 16 bits.
const SWEEP_TOLERANCE_8_BIT: f32 = 1e-4;
const SWEEP_TOLERANCE: f32 = 1e-5;
/// Below this sums of 32-bit floats do not settle.
const LEAST_SWEEP_TOLERANCE: f32 = 2e-6;

/// Runs the command within `limit` bytes.
pub fn run(args: &BlendArgs, limit: u64, quiet: bool) -> Result<()> {
    limits::check_options(args)?;
    files::check_picture(&args.output, args.force)?;
    let start = Instant::now();
    let paths = [&args.background, &args.patch];
    let names = paths.map(|p| p.display().to_string());
    let read_options = ReadOptions {
        limit_bytes: limit.saturating_sub(limits::PROGRAM) / 4,
        ..ReadOptions::default()
    };
    let open = |path| RowReader::open(path, &read_options).map_err(files::in_our_words);
    let infos = [open(paths[0])?.info().clone(), open(paths[1])?.info().clone()];
    let conversion = Conversion::new(&infos, &args.scene, &names)?;
    let offset = limits::whole_offset(&infos, &args.scene, &names)?;
    let write_options = WriteOptions {
        force: args.force,
        sample: args.depth.map(|d| d.sample_type()).transpose()?,
        ..WriteOptions::default()
    };
    let info = conversion.result(&infos[0]);
    RowWriter::check(&args.output, &info, &write_options).map_err(files::in_our_words)?;
    let channels = conversion.channels();
    if channels > MOST {
        bail!("{} has {channels} channels; --max-memory works up to {MOST}", names[0]);
    }
    let shape = [info.width, info.height];
    let mut block_options = BlockOptions { whole_rows: true, ..BlockOptions::default() };
    block_options.max_memory = limits::for_blocks(limit, &info, &block_options, channels)?;

    let stop = Stop::install();
    let mut scratch = Scratch::new(&args.output)?;
    let mut reading = Progress::of("reading", quiet);
    let mut read = |which: usize, name| -> Result<Streamed> {
        let path = scratch.make(name);
        let mut tell = |share: f32| reading.update(0.5 * (which as f32 + share));
        input::stream(
            open(paths[which])?,
            which,
            &conversion,
            &names[which],
            &path,
            &stop,
            &mut tell,
        )
    };
    let background = read(0, "background")?;
    limits::check_domain(args, &infos[0], &background, &names[0])?;
    let patch = read(1, "patch")?;
    let weights = Weights::open(args, &patch, &names[1], &read_options, &mut scratch, &stop)?;
    drop(reading);
    let mut warnings = conversion.warnings.clone();
    warnings.extend(weights.warning.clone());
    let read_seconds = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let eight_bits = write_options.sample.unwrap_or(info.sample) == SampleType::U8;
    let (in_memory, sweep) = match eight_bits {
        true => (TOLERANCE_8_BIT, SWEEP_TOLERANCE_8_BIT),
        false => (TOLERANCE, SWEEP_TOLERANCE),
    };
    let settings = Settings {
        guidance: args.solve.guidance,
        options: args.solve.options(ObjectiveName::Screened, in_memory),
    };
    let range = background.high.max(patch.high) - background.low.min(patch.low);
    let share = args.solve.tolerance.map_or(sweep, |t| t.max(LEAST_SWEEP_TOLERANCE));
    block_options.tolerance = share * if range > 0.0 { range } else { 1.0 };
    let words = format!("{offset:?} {settings:?} {}", env!("CARGO_PKG_VERSION"));
    block_options.fingerprint =
        input::hash_bytes([background.hash, patch.hash, weights.hash], words.as_bytes());

    let scratch_bytes = scratch.bytes();
    let state = scratch.state();
    let mut sink = RowSink::new(&args.output, info, write_options, background.alpha_file()?);
    let mut pace = Pace::new(block_options.tolerance);
    let (mut solving, mut writing) = (Progress::new(quiet), Progress::of("writing", quiet));
    let mut begun = false;
    let job = Job {
        background: &background.color_file()?,
        patch: &patch.color_file()?,
        weights: &weights,
        offset,
        settings: &settings,
        options: &block_options,
        state: &state,
        sink: &mut sink,
        progress: &mut |at: &BlockProgress| {
            begun = true;
            match at.stage {
                BlockStage::Result => writing.update(at.block as f32 / at.blocks as f32),
                _ => solving.update_with(pace.share(at), || pace.note(at)),
            }
            !stop.is_asked_for()
        },
    };
    let report = with_channels::<2, _>(channels, job)
        .ok_or_else(|| anyhow!("{} has no channels to blend", names[0]))?;
    drop((solving, writing));
    let report = match report {
        Ok(report) => report,
        Err(error) => {
            let keeps = matches!(error, Error::Stopped | Error::Storage { .. });
            scratch.keep_state = keeps && begun && state.exists();
            return Err(failure(
                error,
                &mut sink,
                &names,
                limit,
                scratch.keep_state.then_some(state),
            ));
        }
    };
    let (write_seconds, written) = sink.finish()?;
    drop(scratch);
    warnings.extend(crate::blend::written_warning(&written));
    let solve_seconds = start.elapsed().as_secs_f64() - write_seconds;
    let state_bytes = 4 * (channels * report.box_shape.iter().product::<usize>()) as u64;
    let summary = Summary {
        args,
        names: &names,
        sizes: [shape, [infos[1].width, infos[1].height]],
        channels,
        offset,
        limit,
        report: &report,
        written: &written,
        tolerance: block_options.tolerance,
        scratch_bytes: scratch_bytes + state_bytes,
        seconds: [read_seconds, solve_seconds, write_seconds],
        warnings: &warnings,
    };
    if args.json {
        console::print(&summary.to_json()?)?;
    }
    if !quiet {
        console::warn(&warnings);
        if !args.json {
            console::print(&summary.to_text())?;
        }
    }
    Ok(())
}

/// What went wrong, and how to go on.
fn failure(
    error: Error,
    sink: &mut RowSink,
    names: &[String; 2],
    limit: u64,
    state: Option<std::path::PathBuf>,
) -> anyhow::Error {
    let what = match (sink.take_error(), error) {
        (Some(own), _) => own,
        (None, Error::Stopped) => anyhow!("stopped before the end"),
        (None, Error::Storage { what, reason }) => {
            anyhow!("{what}: {reason}; check the free space beside the result")
        }
        (None, Error::Memory { needed, .. }) => limits::too_little(limit, needed),
        (None, other) => explain(other, names),
    };
    match state {
        Some(state) => anyhow!(
            "{what:#}. The same command goes on from there; to give it up remove {}",
            state.display()
        ),
        None => what,
    }
}

/// The blend for a number of channels known at run time.
struct Job<'a> {
    background: &'a PlaneFile<2>,
    patch: &'a PlaneFile<2>,
    weights: &'a Weights,
    offset: [isize; 2],
    settings: &'a Settings,
    options: &'a BlockOptions,
    state: &'a std::path::Path,
    sink: &'a mut RowSink,
    progress: &'a mut dyn FnMut(&BlockProgress) -> bool,
}

impl ChannelJob for Job<'_> {
    type Output = poisson_loss::Result<BlockReport>;

    fn run<const C: usize>(self) -> Self::Output {
        let problem = BlockProblem::<2, C> {
            background: self.background,
            patch: self.patch,
            mask: self.weights as &dyn BlockSource<2>,
            offset: self.offset,
            guidance: self.settings.guidance.to_guidance::<2, C>(),
            options: self.settings.options,
        };
        solve_in_blocks(&problem, self.options, self.state, self.sink, self.progress)
    }
}
