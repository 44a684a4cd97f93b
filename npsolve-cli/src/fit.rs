//! `npsolve fit`: a signal becomes a network.

mod file;
mod recipe;
mod report;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use inr_core::{
    Domain, Error, FitProgress, FitReport, Frame, Network, Output, Samples, Trainer, fit,
};
use signal_io::Image;

pub use file::{FINISHED, RECIPE};
pub use report::size as bytes_in_words;

use crate::args::FitArgs;
use crate::channels::{self, Axes, ChannelJob, Channels, with_channels};
use crate::kind::SignalKind;
use crate::outcome::size;
use crate::picture_kind::PictureKind;
use crate::progress::Progress;
use crate::signals::{self, audio, field, light_field, video, volume};
use crate::{console, field_file, field_words, files, kind};
use file::{TrainingFile, Unfinished};
use recipe::{Recipe, fingerprint};
use report::{Report, Surroundings};

/// Runs the command.
pub fn run(args: &FitArgs, quiet: bool) -> Result<()> {
    check_target(args)?;
    let path = &args.signal;
    let kind = if args.lenslet.is_some() { Some(SignalKind::Lightfield) } else { args.kind };
    match kind.unwrap_or_else(|| kind::of(path)) {
        SignalKind::Image => {
            let image = without_opaque_alpha(files::read(path)?);
            let signal = Signal {
                domain: image.domain(),
                values: image.as_planar(),
                notes: PictureKind::of(&image).to_notes(),
                numbers: signals::number_type(image.sample),
                noun: "pixels",
            };
            fit_channels(args, &signal, quiet)
        }
        SignalKind::Audio => fit_signal(SignalKind::Audio, &audio::read(path)?, args, quiet),
        SignalKind::Volume => fit_signal(SignalKind::Volume, &volume::read(path)?, args, quiet),
        SignalKind::Video => fit_signal(SignalKind::Video, &video::read(path, 1.0)?, args, quiet),
        SignalKind::Lightfield => {
            let field = light_field::read(path, args.lenslet, light_field::ANGULAR_PITCH)?;
            fit_signal(SignalKind::Lightfield, &field, args, quiet)
        }
    }
}

/// What a field is fitted to.
struct Signal<'a, const D: usize> {
    domain: Domain<D>,
    /// A plane per channel.
    values: &'a [f32],
    /// What the field's file says about it.
    notes: BTreeMap<String, String>,
    /// Number type of its file, and bytes of one.
    numbers: (&'static str, usize),
    /// What its samples are called.
    noun: &'static str,
}

fn fit_signal<S: signals::Signal<D>, const D: usize>(
    kind: SignalKind,
    signal: &S,
    args: &FitArgs,
    quiet: bool,
) -> Result<()>
where
    Axes<D>: Channels,
{
    let plain = signal.plain()?;
    signals::check_finite(&plain, &args.signal.display().to_string())?;
    let signal = Signal {
        domain: plain.domain,
        values: &plain.values,
        notes: field::notes_of(kind, signal.notes()),
        numbers: signal.number_type(),
        noun: kind.samples(),
    };
    fit_channels(args, &signal, quiet)
}

fn fit_channels<const D: usize>(args: &FitArgs, signal: &Signal<'_, D>, quiet: bool) -> Result<()>
where
    Axes<D>: Channels,
{
    let n = signal.values.len() / signal.domain.len();
    with_channels::<D, _>(n, Job { args, signal, quiet }).unwrap_or_else(|| {
        let (file, counts) = (args.signal.display(), channels::in_words::<D>());
        bail!("{file} has {n} channels, a field of this kind {counts}; choose some of them")
    })
}

/// Everything about the target that can be known before the work.
fn check_target(args: &FitArgs) -> Result<()> {
    let path = args.output.display();
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case(field_file::EXTENSION)) {
        bail!("{path}: fields are .{} files; end the name with that", field_file::EXTENSION);
    }
    if args.resume && !args.output.exists() {
        bail!("{path} does not exist, so there is nothing to go on with; leave out --resume");
    }
    files::check_text(&args.output, args.force || args.resume)
}

/// Alpha that says nothing is not worth learning.
fn without_opaque_alpha(image: Image) -> Image {
    match image.alpha() {
        Some(alpha) if image.color_count() > 0 && alpha.iter().all(|a| *a == 1.0) => {
            image.split_alpha().0
        }
        _ => image,
    }
}

struct Job<'a, const D: usize> {
    args: &'a FitArgs,
    signal: &'a Signal<'a, D>,
    quiet: bool,
}

impl<const D: usize> ChannelJob for Job<'_, D> {
    type Output = Result<()>;

    fn run<const C: usize>(self) -> Result<()> {
        let Signal { domain, values, .. } = self.signal;
        let samples = Samples::<D, C>::from_planar(*domain, values.to_vec())?;
        let range = range(&samples);
        let peak = peak(&self.args.signal, range)?;
        let (mut trainer, recipe) = self.begin(&samples, range, peak)?;
        let mut file = TrainingFile {
            path: self.args.output.clone(),
            domain: *samples.domain(),
            notes: self.signal.notes.clone(),
            range,
            recipe,
            every: self.args.checkpoint_every,
            replace: self.args.force || self.args.resume,
            last: Instant::now(),
            has_state: self.args.resume,
        };
        let report = self.train(&mut trainer, &samples, peak, &mut file)?;
        let last = self.args.stop_after.filter(|n| Some(*n) != file.recipe.steps);
        let finished = last.is_none_or(|n| trainer.steps() < n);
        let bytes = file.write(&trainer, self.args.keep_training || !finished, finished)?;
        self.tell(&trainer, &file.recipe, report, bytes, finished)
    }
}

impl<const D: usize> Job<'_, D> {
    /// A training from its beginning, or where it was left.
    fn begin<const C: usize>(
        &self,
        samples: &Samples<D, C>,
        [low, high]: [f32; 2],
        peak: f32,
    ) -> Result<(Trainer<D, C>, Recipe)> {
        let (print, signal) = (fingerprint(samples), self.args.signal.display().to_string());
        if self.args.resume {
            let Unfinished { trainer, recipe } =
                Unfinished::read(&self.args.output, &signal, &print)?;
            if let Some([there, here]) = recipe.difference(self.args) {
                let file = self.args.output.display();
                bail!("{file} was begun with {there}, not {here}; leave the option out");
            }
            return Ok((trainer, recipe));
        }
        let recipe = Recipe::new(self.args, print).map_err(|message| anyhow!(message))?;
        let architecture = recipe.field.architecture(&samples.domain().shape(), &recipe.options);
        let middle = 0.5 * low + 0.5 * high;
        let output = Output::of_range(middle - 0.5 * peak, middle + 0.5 * peak);
        let frame = Frame::of_cells(samples.domain());
        let network = Network::new(architecture, frame, output, recipe.seed)?;
        let options = recipe.field.train_options(&recipe.options, recipe.seed);
        Ok((Trainer::new(network, options), recipe))
    }

    fn train<const C: usize>(
        &self,
        trainer: &mut Trainer<D, C>,
        samples: &Samples<D, C>,
        peak: f32,
        file: &mut TrainingFile<D>,
    ) -> Result<FitReport> {
        let options = file.recipe.fit_options(peak);
        let mut progress = Progress::of("fitting", self.quiet);
        let mut failure = None;
        let after_step = |trainer: &Trainer<D, C>, now: FitProgress| {
            progress.update_with(now.progress as f32, || format!("{:.1} dB", now.psnr));
            if let Err(error) = file.write_if_due(trainer) {
                failure = Some(error);
            }
            failure.is_none() && self.args.stop_after.is_none_or(|n| now.step < n)
        };
        let result = fit(trainer, samples, &options, after_step);
        drop(progress);
        match (result, failure) {
            (_, Some(error)) => Err(error),
            (Err(error), None) => Err(self.in_our_words(&error, file)),
            (Ok(report), None) => Ok(report),
        }
    }

    fn in_our_words(&self, error: &Error, file: &TrainingFile<D>) -> anyhow::Error {
        let Error::Diverged { step, loss, .. } = error else { return anyhow!(error.clone()) };
        let o = &file.recipe.options;
        let smaller: Vec<String> =
            [("--rate", o.rate), ("--table-rate", o.table_rate), ("--omega", o.omega)]
                .iter()
                .filter_map(|(name, value)| Some(format!("{name} (now {:?})", (*value)?)))
                .collect();
        let path = self.args.output.display();
        let left = match (file.has_state, self.args.output.exists()) {
            (true, _) => format!("{path} holds the unfinished training as it was before"),
            (false, true) => format!("{path} is as it was"),
            (false, false) => format!("{path} was not written"),
        };
        anyhow!(
            "the fit of {} diverged at step {step} (loss {loss:.1e}); choose a smaller {}. {left}",
            self.args.signal.display(),
            smaller.join(" or ")
        )
    }

    fn tell<const C: usize>(
        &self,
        trainer: &Trainer<D, C>,
        recipe: &Recipe,
        report: FitReport,
        bytes: usize,
        finished: bool,
    ) -> Result<()> {
        let report = Report {
            field: recipe.field.name(),
            parameters: trainer.network.parameter_count(),
            steps: report.steps,
            seconds: trainer.seconds(),
            psnr: report.psnr,
            target_reached: recipe.target_psnr.map(|_| report.reached),
            bytes,
            finished,
            warnings: warnings(recipe, &report, finished),
        };
        if self.args.json {
            console::print(&files::to_json(&report)?)?;
        }
        if self.quiet {
            return Ok(());
        }
        console::warn(&report.warnings);
        if self.args.json {
            return Ok(());
        }
        let Signal { domain, values, numbers: (name, bytes), noun, .. } = self.signal;
        console::print(&report.to_text(&Surroundings {
            signal: self.args.signal.display().to_string(),
            size: size(&domain.shape()),
            noun,
            channels: C,
            samples: (name, bytes * values.len()),
            network: field_words::sentence(trainer.network.architecture()),
            file: self.args.output.display().to_string(),
        }))
    }
}

fn warnings(recipe: &Recipe, report: &FitReport, finished: bool) -> Vec<String> {
    match recipe.target_psnr {
        Some(target) if finished && !report.reached => vec![format!(
            "{target} dB were not reached, only {:.2}; raise the limit (--steps, --budget) or the \
             network's size",
            report.psnr
        )],
        _ => Vec::new(),
    }
}

fn range<const D: usize, const C: usize>(samples: &Samples<D, C>) -> [f32; 2] {
    let bounds = |[low, high]: [f32; 2], v: &f32| [low.min(*v), high.max(*v)];
    samples.as_planar().iter().fold([f32::INFINITY, f32::NEG_INFINITY], bounds)
}

/// The length of the range, which errors are measured by; for a signal of one value its own size, at least 1.
fn peak(signal: &Path, [low, high]: [f32; 2]) -> Result<f32> {
    let peak = if high > low { high - low } else { low.abs().max(1.0) };
    // Squares of the reciprocal are taken in f32.
    if !(1e-30..=1e30).contains(&peak) {
        bail!("{} has values from {low:e} to {high:e}; scale them to about 0..1", signal.display());
    }
    Ok(peak)
}
