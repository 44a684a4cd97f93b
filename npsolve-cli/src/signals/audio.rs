//! `npsolve blend` for sound.

use std::ops::Range;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use inr_core::{Domain, RasterMask};
use poisson_loss::Objective;
use serde_json::{Map, json};
use signal_io::{Audio, AudioReport, AudioSample, AudioWriteOptions, Image, ReadOptions};

use super::field::{self, Notes};
use super::{Job, Plain, Signal, scaled, settings, spectrogram};
use crate::args::{AudioMode, BlendArgs, Depth, SceneArgs, ValueDomain};
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::render::spectrum;
use crate::report::{Extras, Seconds};
use crate::solve::{Settings, Solution};
use crate::value_domain::Mapping;
use crate::values::{Coordinate, Counts};
use crate::{field_file, files};

/// Default lengths in seconds: the background gives way over 2 ms, and the patch's own level is back after
/// 20 ms, so that an offset at the join neither clicks nor stays.
const LENGTH: f64 = 2e-3;
const KEEP: f64 = 20e-3;
/// Lengths around the region that can feel it: `exp(-24)` is below the rounding of 24-bit sound.
const REACH: f64 = 24.0;
/// Frames around the part of the patch that are read with it.
const AROUND: usize = 64;

/// Two recordings with one rate and the same channels, and where one goes in the other.
pub struct Scene {
    /// The whole background.
    pub background: Audio,
    /// The part of the patch that goes in, with some frames around it: a spline has to know how it goes on.
    pub patch: Audio,
    /// Frames of the patch that go in.
    pub part: Range<usize>,
    /// Where the first of them goes, in frames of the background.
    pub at: f64,
    pub names: [String; 2],
    pub warnings: Vec<String>,
}

/// A piece of the background around the region, blended.
pub(super) struct Piece {
    /// Its first frame.
    pub start: usize,
    /// What the solver did; the planes are those of the piece.
    pub solution: Solution,
    /// The piece with the patch copied in.
    pub pasted: Vec<f32>,
}

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    signal_io::check_audio_target(&args.output, args.force).map_err(files::in_our_words)?;
    let start = Instant::now();
    let scene = Scene::read(&args.background, &args.patch, &args.scene)?;
    let write_options = AudioWriteOptions { force: args.force, sample: sample(args.depth)? };
    let read = start.elapsed().as_secs_f64();

    let settings = in_frames(settings(args), args.scene.mode, scene.background.rate_hz());
    let with_metrics = args.json || args.metrics.is_some();
    let piece = match args.scene.mode {
        AudioMode::Waveform => scene.waveform(&settings, &args.scene, with_metrics, quiet)?,
        AudioMode::Spectrogram => spectrogram::blend(&scene, &settings, with_metrics, quiet)?,
    };

    let mut result = scene.background.clone();
    piece.insert(&piece.solution.planes, &mut result);
    let mut pasted = scene.background.clone();
    piece.insert(&piece.pasted, &mut pasted);

    let start = Instant::now();
    let written = signal_io::write_audio(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    let heard = scene.measure(&pasted, &result)?;
    let mut warnings = scene.warnings.clone();
    warnings.extend(piece.solution.report.warnings.iter().cloned());
    if written.clipped > 0 {
        warnings.push(format!(
            "{} samples exceeded full scale and were clipped; write floats with --depth f32, or shorten --keep",
            written.clipped
        ));
    }
    let outcome = Outcome {
        args,
        kind: SignalKind::Audio,
        names: &scene.names,
        sizes: [vec![scene.background.frames()], vec![scene.part.len()]],
        channels: scene.background.channels(),
        place: vec![scene.at],
        domain: Mapping::Identity,
        settings: &settings,
        solution: &piece.solution,
        written: Some(told(&written)),
        network: None,
        bytes: None,
        warnings,
        seconds: Seconds { read, solve: piece.solution.seconds, write },
        remarks: remarks(&heard),
        extras: heard,
    };
    outcome.tell(quiet)
}

impl Signal<1> for Audio {
    fn plain(&self) -> Result<Plain<1>> {
        Ok(Plain { domain: Domain::unit([self.frames()])?, values: self.as_planar().to_vec() })
    }

    fn with_values(&self, values: &[f32]) -> Result<Self> {
        let mut out = self.clone();
        out.as_planar_mut().copy_from_slice(values);
        Ok(out)
    }

    fn save(&self, path: &Path, force: bool) -> Result<()> {
        let options = AudioWriteOptions { force, sample: None };
        signal_io::write_audio(path, self, &options).map_err(files::in_our_words)?;
        Ok(())
    }

    fn ending(&self) -> &'static str {
        ".wav"
    }

    fn picture(&self, _: [usize; 1], _: &Self) -> Result<Image> {
        spectrum::of(self)
    }

    fn notes(&self) -> Notes {
        let rate = self.rate_hz().to_string();
        let sample = self.sample.name().to_owned();
        Notes::from([(RATE.to_owned(), rate), (SAMPLE.to_owned(), sample)])
    }

    fn from_values(
        notes: &Notes,
        domain: Domain<1>,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self> {
        let rate: u32 = notes.get(RATE).and_then(|r| r.parse().ok()).unwrap_or(USUAL_RATE);
        // A finer lattice has more samples a second.
        let rate = (f64::from(rate) / f64::from(domain.pitch()[0])).round() as u32;
        let mut audio = Self::new(rate, channels, values)?;
        let types = [AudioSample::U8, AudioSample::I16, AudioSample::I24, AudioSample::I32];
        let said = |t: &AudioSample| notes.get(SAMPLE).is_some_and(|n| n == t.name());
        audio.sample = types.into_iter().find(said).unwrap_or(AudioSample::F32);
        Ok(audio)
    }

    fn number_type(&self) -> (&'static str, usize) {
        let bytes = match self.sample {
            AudioSample::U8 => 1,
            AudioSample::I16 => 2,
            AudioSample::I24 => 3,
            _ => 4,
        };
        (self.sample.name(), bytes)
    }
}

/// Keys of notes, and the rate where they say none.
const RATE: &str = "sampling_rate_hz";
const SAMPLE: &str = "sample_type";
const USUAL_RATE: u32 = 44_100;

/// Reads sound.
pub fn read(path: &Path) -> Result<Audio> {
    if field_file::is_network(path) {
        return field::read(path, |own| Ok(*own));
    }
    signal_io::read_audio(path, &ReadOptions::default()).map_err(files::in_our_words)
}

impl Scene {
    /// Reads the files.
    pub fn read(background: &Path, patch: &Path, args: &SceneArgs) -> Result<Self> {
        if args.mask.is_some() || args.region.is_some() {
            bail!(
                "sound has no --mask or --region; choose a part of the patch with --from and --to"
            );
        }
        let names = [background, patch].map(|p| p.display().to_string());
        let (background, mut patch) = (self::read(background)?, self::read(patch)?);
        let mut warnings = Vec::new();
        let (rate, own) = (background.rate_hz(), patch.rate_hz());
        // The part first: resampling minutes for a second of them would be wasted.
        let frame = |c: &Coordinate| frames(c, own);
        let begin = args.from.as_ref().map_or(Ok(0.0), frame)?;
        let end = args.to.as_ref().map_or(Ok(patch.frames() as f64), frame)?;
        let (first, last) = (begin.round().max(0.0), end.round().min(patch.frames() as f64));
        if first >= last {
            bail!(
                "{} lasts {:.3} s; --from {:.3} s to --to {:.3} s selects nothing of it",
                names[1],
                patch.seconds(),
                begin / f64::from(own),
                end / f64::from(own)
            );
        }
        let (first, last) = (first as usize, last as usize);
        let (begin, end) =
            (first.saturating_sub(AROUND), last.saturating_add(AROUND).min(patch.frames()));
        patch = patch.cropped(begin, end - begin)?;
        let mut part = first - begin..last - begin;
        if own != rate {
            warnings.push(format!(
                "{} has {own} Hz; it was resampled to the background's {rate} Hz",
                names[1]
            ));
            patch = patch.resampled(rate).with_context(|| names[1].clone())?;
            let ratio = f64::from(rate) / f64::from(own);
            let [start, end] = [part.start, part.end].map(|f| (f as f64 * ratio).round() as usize);
            part = start..end.min(patch.frames()).max(start + 1);
        }
        if patch.channels() != background.channels() {
            let (from, to) = (patch.channels(), background.channels());
            patch = patch.to_channels(to).with_context(|| names[1].clone())?;
            warnings.push(format!(
                "{} has {from} channels; it was brought to the background's {to}",
                names[1]
            ));
        }
        let at = match &args.at {
            Some(place) if place.0.len() == 1 => frames(&place.0[0], rate)?,
            Some(place) => {
                bail!("--at {place} has {} coordinates; sound has one, its time", place.0.len())
            }
            None if background.frames() == part.len() => 0.0,
            None => bail!(
                "{} lasts {:.3} s and {} {:.3} s: say where the patch begins with --at SECONDS",
                names[0],
                background.seconds(),
                names[1],
                part.len() as f64 / f64::from(rate)
            ),
        };
        if at >= background.frames() as f64 - 0.5 || at + part.len() as f64 <= 0.5 {
            bail!(
                "the patch lies wholly outside the background: {} lasts {:.3} s; change --at",
                names[0],
                background.seconds()
            );
        }
        Ok(Self { background, patch, part, at, names, warnings })
    }

    /// The exact blend of the waveform.
    fn waveform(
        &self,
        settings: &Settings,
        args: &SceneArgs,
        with_metrics: bool,
        quiet: bool,
    ) -> Result<Piece> {
        let (start, part) = self.excerpt(settings, args)?;
        let mut solution = part.job.solve(settings, with_metrics, quiet)?;
        solution.report.box_start.iter_mut().for_each(|b| *b += start);
        Ok(Piece { start, solution, pasted: part.job.paste(settings)? })
    }

    /// The part of the background that can feel the region, and its first frame in the whole.
    pub fn excerpt(
        &self,
        settings: &Settings,
        args: &SceneArgs,
    ) -> Result<(usize, super::Scene<Audio, 1>)> {
        let reach = match settings.options.objective {
            Objective::Screened { length: Some(length), .. } => REACH * f64::from(length),
            _ => 0.0,
        };
        // The splines and the window of the click measure want some neighbours too.
        let (start, background) = self.window(reach + 4096.0)?;
        let mask = RasterMask::new(Domain::unit([self.patch.frames()])?, self.weights())?;
        let place = self.at - start as f64;
        let job = Job::new(
            &self.names,
            background.plain()?,
            self.patch.plain()?,
            mask,
            [place as f32 - self.part.start as f32],
            args.domain.unwrap_or(ValueDomain::Stored),
            args,
        )?;
        let (names, warnings) = (self.names.clone(), self.warnings.clone());
        Ok((start, super::Scene { names, background, job, place: [place], warnings }))
    }

    /// 1 for the frames that go in.
    fn weights(&self) -> Vec<f32> {
        let inside = |k| f32::from(u8::from(self.part.contains(&k)));
        (0..self.patch.frames()).map(inside).collect()
    }

    /// The frames that go in, alone.
    pub(super) fn inserted(&self) -> Result<Audio> {
        Ok(self.patch.cropped(self.part.start, self.part.len())?)
    }

    /// The background within `margin` frames of the patch, and its first frame.
    pub(super) fn window(&self, margin: f64) -> Result<(usize, Audio)> {
        let n = self.background.frames();
        let start = (self.at - margin).floor().max(0.0) as usize;
        let end = (self.at + self.part.len() as f64 + margin).ceil().min(n as f64) as usize;
        Ok((start, self.background.cropped(start, end - start)?))
    }

    /// Frames of the background at which patch and background meet.
    fn joins(&self) -> Vec<usize> {
        let n = self.background.frames() as f64;
        [self.at, self.at + self.part.len() as f64]
            .into_iter()
            .filter(|f| *f > 0.5 && *f < n - 0.5)
            .map(|f| f.round() as usize)
            .collect()
    }

    /// Peak, level, loudness and clicks of background, patch, copy and blend.
    fn measure(&self, pasted: &Audio, result: &Audio) -> Result<Extras> {
        let level = |audio: &Audio| {
            json!({
                "peak": audio.peak(),
                "mean": audio.mean(),
                "loudness_lufs": audio.loudness(),
            })
        };
        let clicks = |audio: &Audio| -> Vec<f64> {
            self.joins().iter().map(|join| audio.click_energy(*join)).collect()
        };
        // The whole of an hour is not needed for what happens in a few seconds of it.
        let (start, window) = self.window(0.0)?;
        let part = |audio: &Audio| audio.cropped(start, window.frames());
        let mut all = Map::new();
        all.insert("sampling_rate_hz".to_owned(), json!(result.rate_hz()));
        all.insert("background".to_owned(), level(&window));
        all.insert("patch".to_owned(), level(&self.inserted()?));
        all.insert("pasted".to_owned(), level(&part(pasted)?));
        all.insert("blend".to_owned(), level(&part(result)?));
        all.insert(
            "joins_seconds".to_owned(),
            json!(
                self.joins()
                    .iter()
                    .map(|j| *j as f64 / f64::from(result.rate_hz()))
                    .collect::<Vec<_>>()
            ),
        );
        all.insert("click_energy_pasted".to_owned(), json!(clicks(pasted)));
        all.insert("click_energy_blend".to_owned(), json!(clicks(result)));
        Ok(all)
    }
}

impl Piece {
    /// Puts planes of the piece into the whole.
    fn insert(&self, planes: &[f32], whole: &mut Audio) {
        let (n, channels) = (whole.frames(), whole.channels());
        let length = planes.len() / channels;
        for c in 0..channels {
            let at = c * n + self.start;
            whole.as_planar_mut()[at..at + length]
                .copy_from_slice(&planes[c * length..(c + 1) * length]);
        }
    }
}

/// A time in frames.
fn frames(time: &Coordinate, rate_hz: u32) -> Result<f64> {
    match time.counts {
        Counts::Samples => Ok(time.value),
        Counts::Usual | Counts::Seconds => Ok(time.value * f64::from(rate_hz)),
        Counts::Millimetres => {
            bail!("{time}: sound has no millimetres; write seconds, or samples with smp")
        }
    }
}

/// Lengths of the command line are in milliseconds.
pub fn in_frames(settings: Settings, mode: AudioMode, rate_hz: u32) -> Settings {
    let Settings { guidance, options } = settings;
    let rate = f64::from(rate_hz);
    let mut options = scaled(options, (rate * 1e-3) as f32);
    if let Objective::Screened { length, keep } = &mut options.objective {
        length.get_or_insert((LENGTH * rate).max(2.0) as f32);
        if mode == AudioMode::Waveform {
            keep.get_or_insert((KEEP * rate) as f32);
        }
    }
    Settings { guidance, options }
}

fn sample(depth: Option<Depth>) -> Result<Option<AudioSample>> {
    Ok(Some(match depth {
        None => return Ok(None),
        Some(Depth::Eight) => AudioSample::U8,
        Some(Depth::Sixteen) => AudioSample::I16,
        Some(Depth::TwentyFour) => AudioSample::I24,
        Some(Depth::F32) => AudioSample::F32,
        Some(Depth::F16) => bail!("WAV has no half floats; take --depth 16, 24 or f32"),
    }))
}

fn told(report: &AudioReport) -> Written {
    let AudioReport { samples, clipped, .. } = *report;
    Written { sample: report.sample.name(), format: report.format.name(), samples, clipped }
}

fn remarks(heard: &Extras) -> String {
    let number = |group: &str, key: &str| heard[group][key].as_f64().unwrap_or(f64::NAN);
    let decibel = |ratio: f64| 10.0 * ratio.log10();
    let clicks = |key: &str| -> f64 {
        heard[key].as_array().into_iter().flatten().filter_map(|v| v.as_f64()).sum()
    };
    format!(
        "Peak {:.3} (background {:.3}, patch {:.3}); mean {:+.4}; loudness {:.1} LUFS (background {:.1}); \
         clicks at the joins {:.1} dB against a plain copy.\n",
        number("blend", "peak"),
        number("background", "peak"),
        number("patch", "peak"),
        number("blend", "mean"),
        number("blend", "loudness_lufs"),
        number("background", "loudness_lufs"),
        decibel(clicks("click_energy_blend") / clicks("click_energy_pasted")),
    )
}
