//! `npsolve blend` for light fields: all views are blended together, so that they stay views of one scene.

use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Unit};
use serde_json::{Map, json};
use signal_io::{LightField, LightFieldReadOptions, LightFieldWriteOptions, WriteOptions};

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
    let scene = &args.scene;
    let write_options = LightFieldWriteOptions {
        write: WriteOptions {
            force: args.force,
            sample: args.depth.map(|d| d.sample_type()).transpose()?,
            ..WriteOptions::default()
        },
        lenslet: scene.lenslet.is_some(),
    };
    signal_io::check_light_field_target(&args.output, &write_options)
        .map_err(files::in_our_words)?;
    if scene.from.is_some() || scene.to.is_some() {
        bail!(
            "--from and --to are for sound; choose views with --region box:X0,Y0,U0,V0:X1,Y1,U1,V1"
        );
    }
    let start = Instant::now();
    let names = [&args.background, &args.patch].map(|p| p.display().to_string());
    let lenslet = scene.lenslet.map(|size| size.0);
    let options = LightFieldReadOptions { lenslet, ..LightFieldReadOptions::default() };
    let read = |path| signal_io::read_light_field(path, &options).map_err(files::in_our_words);
    let (background, patch) = (read(&args.background)?, read(&args.patch)?);
    let (own_colors, _) = split_alpha(background.as_strip());
    let (patch_colors, patch_alpha) = split_alpha(patch.as_strip());
    let plain = |field: &LightField, values| -> Result<Plain<4>> {
        let pitch = [1.0, 1.0, scene.angular_pitch, scene.angular_pitch];
        let domain = Domain::new(field.shape(), pitch, [0.0; 4], Unit::Sample)?;
        Ok(Plain { domain, values })
    };
    let (before, patch_plain) = (plain(&background, own_colors)?, plain(&patch, patch_colors)?);
    let [width, height, u, v] = patch.shape();
    let mask = match (&scene.region, &scene.mask, patch_alpha) {
        (Some(shape), _, _) => shapes::mask(shape, patch_plain.domain, &InSamples)?,
        (None, Some(path), _) => {
            RasterMask::new(patch_plain.domain, repeated_mask(path, width, height, u * v)?)?
        }
        (None, None, Some(alpha)) => RasterMask::new(patch_plain.domain, alpha)?,
        (None, None, None) => {
            RasterMask::new(patch_plain.domain, vec![1.0; patch_plain.domain.len()])?
        }
    };
    let at = match &scene.at {
        Some(place) => shapes::position::<4>(place, &InSamples)?,
        None if background.shape() == patch.shape() => [0.0; 4],
        None => bail!("say where the patch goes with --at X,Y or --at X,Y,U,V"),
    };
    let angular = scene.angular_pitch;
    let offset = [at[0] as f32, at[1] as f32, at[2] as f32 * angular, at[3] as f32 * angular];
    let domain = scene.domain.unwrap_or(ValueDomain::Stored);
    let stored = before.values.clone();
    let job = Job::new(&names, before, patch_plain, mask, offset, domain, scene)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = job.solve(&settings, with_metrics, quiet)?;
    let shape = background.shape();
    let extras = match with_metrics {
        true => consistency(&job, &settings, &stored, &solution.planes, shape)?,
        false => Map::new(),
    };

    let start = Instant::now();
    let result = LightField::from_strip(
        with_colors(background.as_strip(), &solution.planes),
        [shape[2], shape[3]],
    )?;
    let report = signal_io::write_light_field(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    let outcome = Outcome {
        args,
        kind: SignalKind::Lightfield,
        names: &names,
        sizes: [shape.to_vec(), patch.shape().to_vec()],
        channels: background.as_strip().color_count(),
        place: at.to_vec(),
        domain: job.mapping,
        settings: &settings,
        warnings: solution.report.warnings.clone(),
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written: Some(Written {
            sample: report.sample.name(),
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

/// Consistency of epipolar slices: how much the correction differs between neighbouring views, for the blend and for
/// one that takes every view for itself.
fn consistency(
    job: &Job<4>,
    settings: &Settings,
    stored: &[f32],
    blended: &[f32],
    shape: [usize; 4],
) -> Result<Extras> {
    let (pasted, alone) = (job.paste(settings)?, job.one_by_one(settings)?);
    let difference = |planes: &[f32]| json!(unsteadiness(planes, &pasted, stored, shape, 2..4));
    let mut all = Map::new();
    all.insert("epipolar_difference".to_owned(), difference(blended));
    all.insert("epipolar_difference_view_by_view".to_owned(), difference(&alone));
    Ok(all)
}
