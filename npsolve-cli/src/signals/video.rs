//! `npsolve blend` for videos: x, y and time are blended together, so nothing flickers.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Unit};
use serde_json::{Map, json};
use signal_io::{Image, ReadOptions, Timing, Video, VideoWriteOptions};

use super::field::{self, Notes};
use super::{Job, Plain, Signal, number_type, repeated_mask, settings, split_alpha, with_colors};
use crate::args::{BlendArgs, SceneArgs, ValueDomain};
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::picture_kind::PictureKind;
use crate::report::{Extras, Seconds};
use crate::shapes::{self, InSamples};
use crate::solve::Settings;
use crate::{field_file, files};

/// Both videos, and where one goes in the other.
pub type Scene = super::Scene<Film, 3>;

/// A video with the distance of its frames.
pub struct Film {
    /// The samples.
    pub video: Video,
    time_pitch: f32,
}

impl Signal<3> for Film {
    fn plain(&self) -> Result<Plain<3>> {
        let pitch = [1.0, 1.0, self.time_pitch];
        let domain = Domain::new(self.video.shape(), pitch, [0.0; 3], Unit::Sample)?;
        Ok(Plain { domain, values: split_alpha(self.video.as_strip()).0 })
    }

    fn with_values(&self, values: &[f32]) -> Result<Self> {
        let strip = with_colors(self.video.as_strip(), values);
        let mut video = Video::from_strip(strip, self.video.shape()[2])?;
        video.timing = self.video.timing.clone();
        Ok(Self { video, time_pitch: self.time_pitch })
    }

    fn save(&self, path: &Path, force: bool) -> Result<()> {
        let options = VideoWriteOptions { force, ..VideoWriteOptions::default() };
        signal_io::write_video(path, &self.video, &options).map_err(files::in_our_words)?;
        Ok(())
    }

    /// A folder of pictures.
    fn ending(&self) -> &'static str {
        "/%04d.png"
    }

    fn picture(&self, at: [usize; 3], _: &Self) -> Result<Image> {
        Ok(self.video.frame(at[2]))
    }

    fn notes(&self) -> Notes {
        let mut notes = PictureKind::of(&self.video.as_strip().clone().split_alpha().0).to_notes();
        if let Timing::Rate { frames, seconds } = self.video.timing.to_rate() {
            notes.insert(RATE.to_owned(), format!("{frames}/{seconds}"));
        }
        notes
    }

    fn from_values(
        notes: &Notes,
        domain: Domain<3>,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self> {
        let [width, height, count] = domain.shape();
        let kind = PictureKind::from_notes(notes, channels);
        let strip = kind.picture([width, height * count], values)?;
        let mut video = Video::from_strip(strip, count)?;
        let rate = notes.get(RATE).and_then(|rate| rate.split_once('/'));
        if let Some((frames, seconds)) = rate
            && let (Ok(frames), Ok(seconds)) = (frames.parse(), seconds.parse())
        {
            video.timing = Timing::Rate { frames, seconds };
        }
        Ok(Self { video, time_pitch: domain.pitch()[2] })
    }

    fn number_type(&self) -> (&'static str, usize) {
        number_type(self.video.sample())
    }
}

/// Key of frames per second among notes.
const RATE: &str = "frames_per_second";

/// Reads a video.
pub fn read(path: &Path, time_pitch: f32) -> Result<Film> {
    if field_file::is_network(path) {
        return field::read(path, |own| Ok(*own));
    }
    let video =
        signal_io::read_video(path, &ReadOptions::default()).map_err(files::in_our_words)?;
    Ok(Film { video, time_pitch })
}

impl Scene {
    /// Reads the files.
    pub fn read(background: &Path, patch: &Path, args: &SceneArgs) -> Result<Self> {
        if args.from.is_some() || args.to.is_some() {
            bail!("--from and --to are for sound; choose frames with --region box:0,0,T0:W,H,T1");
        }
        let names = [background, patch].map(|p| p.display().to_string());
        let (background, patch) =
            (self::read(background, args.time_pitch)?, self::read(patch, args.time_pitch)?);
        let (before, inserted) = (background.plain()?, patch.plain()?);
        let (shape, [width, height, frames]) = (before.domain.shape(), inserted.domain.shape());
        let mask = match (&args.region, &args.mask, split_alpha(patch.video.as_strip()).1) {
            (Some(shape), _, _) => shapes::mask(shape, inserted.domain, &InSamples)?,
            (None, Some(path), _) => {
                RasterMask::new(inserted.domain, repeated_mask(path, width, height, frames)?)?
            }
            (None, None, Some(alpha)) => RasterMask::new(inserted.domain, alpha)?,
            (None, None, None) => {
                RasterMask::new(inserted.domain, vec![1.0; inserted.domain.len()])?
            }
        };
        let place = match &args.at {
            Some(place) => shapes::position::<3>(place, &InSamples)?,
            None if shape[..2] == [width, height] => [0.0; 3],
            None => bail!("say where the patch goes with --at X,Y or --at X,Y,FRAME"),
        };
        let offset = [place[0] as f32, place[1] as f32, place[2] as f32 * args.time_pitch];
        let domain = args.domain.unwrap_or(ValueDomain::Stored);
        let job = Job::new(&names, before, inserted, mask, offset, domain, args)?;
        Ok(Self { names, background, job, place, warnings: Vec::new() })
    }
}

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    signal_io::check_video_target(&args.output, args.force).map_err(files::in_our_words)?;
    let start = Instant::now();
    let scene = Scene::read(&args.background, &args.patch, &args.scene)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = scene.job.solve(&settings, with_metrics, quiet)?;
    let extras = match with_metrics {
        true => steadiness(&scene.job, &settings, &solution.planes)?,
        false => Map::new(),
    };

    let start = Instant::now();
    let result = scene.background.with_values(&solution.planes)?.video;
    let write_options = VideoWriteOptions {
        force: args.force,
        sample: args.depth.map(|d| d.sample_type()).transpose()?,
        ..VideoWriteOptions::default()
    };
    let report = signal_io::write_video(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    let outcome = Outcome {
        args,
        kind: SignalKind::Video,
        names: &scene.names,
        sizes: scene.sizes(),
        channels: result.as_strip().color_count(),
        place: scene.place.to_vec(),
        domain: scene.job.mapping,
        settings: &settings,
        warnings: solution.report.warnings.clone(),
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written: Some(Written {
            sample: result.sample().name(),
            format: report.format.name(),
            samples: report.samples,
            clipped: report.clipped,
        }),
        network: None,
        bytes: None,
        remarks: String::new(),
        extras,
    };
    outcome.tell(quiet)
}

/// Flicker of the blend, and of one that takes every frame for itself.
fn steadiness(job: &Job<3>, settings: &Settings, blended: &[f32]) -> Result<Extras> {
    let (pasted, alone) = (job.paste(settings)?, job.one_by_one(settings)?);
    let flicker = |planes: &[f32]| json!(job.unsteadiness(planes, &pasted, 2..3));
    let mut all = Map::new();
    all.insert("flicker".to_owned(), flicker(blended));
    all.insert("flicker_frame_by_frame".to_owned(), flicker(&alone));
    Ok(all)
}
