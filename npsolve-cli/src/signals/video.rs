//! `npsolve blend` for videos: x, y and time are blended together, so nothing flickers.

use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Unit};
use serde_json::{Map, json};
use signal_io::{ReadOptions, Video, VideoWriteOptions};

use super::{Job, Plain, repeated_mask, settings, split_alpha, unsteadiness, with_colors};
use crate::args::{BlendArgs, ValueDomain};
use crate::files;
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::report::{Extras, Seconds};
use crate::shapes::{self, InSamples};
use crate::solve::Settings;

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    signal_io::check_video_target(&args.output, args.force).map_err(files::in_our_words)?;
    let scene = &args.scene;
    if scene.from.is_some() || scene.to.is_some() {
        bail!("--from and --to are for sound; choose frames with --region box:0,0,T0:W,H,T1");
    }
    let start = Instant::now();
    let names = [&args.background, &args.patch].map(|p| p.display().to_string());
    let read =
        |path| signal_io::read_video(path, &ReadOptions::default()).map_err(files::in_our_words);
    let (background, patch) = (read(&args.background)?, read(&args.patch)?);
    let (own_colors, _) = split_alpha(background.as_strip());
    let (patch_colors, patch_alpha) = split_alpha(patch.as_strip());
    let plain = |video: &Video, values| -> Result<Plain<3>> {
        let pitch = [1.0, 1.0, scene.time_pitch];
        let domain = Domain::new(video.shape(), pitch, [0.0; 3], Unit::Sample)?;
        Ok(Plain { domain, values })
    };
    let (before, patch_plain) = (plain(&background, own_colors)?, plain(&patch, patch_colors)?);
    let [width, height, frames] = patch.shape();
    let mask = match (&scene.region, &scene.mask, patch_alpha) {
        (Some(shape), _, _) => shapes::mask(shape, patch_plain.domain, &InSamples)?,
        (None, Some(path), _) => {
            RasterMask::new(patch_plain.domain, repeated_mask(path, width, height, frames)?)?
        }
        (None, None, Some(alpha)) => RasterMask::new(patch_plain.domain, alpha)?,
        (None, None, None) => {
            RasterMask::new(patch_plain.domain, vec![1.0; patch_plain.domain.len()])?
        }
    };
    let at = match &scene.at {
        Some(place) => shapes::position::<3>(place, &InSamples)?,
        None if background.shape()[..2] == patch.shape()[..2] => [0.0; 3],
        None => bail!("say where the patch goes with --at X,Y or --at X,Y,FRAME"),
    };
    let offset = [at[0] as f32, at[1] as f32, at[2] as f32 * scene.time_pitch];
    let domain = scene.domain.unwrap_or(ValueDomain::Stored);
    let stored = before.values.clone();
    let job = Job::new(&names, before, patch_plain, mask, offset, domain, scene)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = job.solve(&settings, with_metrics, quiet)?;
    let extras = match with_metrics {
        true => steadiness(&job, &settings, &stored, &solution.planes, background.shape())?,
        false => Map::new(),
    };

    let start = Instant::now();
    let mut result = Video::from_strip(
        with_colors(background.as_strip(), &solution.planes),
        background.shape()[2],
    )?;
    result.timing = background.timing.clone();
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
        names: &names,
        sizes: [background.shape().to_vec(), patch.shape().to_vec()],
        channels: background.as_strip().color_count(),
        place: at.to_vec(),
        domain: job.mapping,
        settings: &settings,
        warnings: solution.report.warnings.clone(),
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written: Some(Written {
            sample: background.sample().name(),
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
fn steadiness(
    job: &Job<3>,
    settings: &Settings,
    stored: &[f32],
    blended: &[f32],
    shape: [usize; 3],
) -> Result<Extras> {
    let (pasted, alone) = (job.paste(settings)?, job.one_by_one(settings)?);
    let flicker = |planes: &[f32]| json!(unsteadiness(planes, &pasted, stored, shape, 2..3));
    let mut all = Map::new();
    all.insert("flicker".to_owned(), flicker(blended));
    all.insert("flicker_frame_by_frame".to_owned(), flicker(&alone));
    Ok(all)
}
