//! `npsolve blend` for volumes: voxels with edges in millimetres and a place in the world.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Unit};
use serde_json::{Map, json};
use signal_io::{ReadOptions, Volume, VolumeWriteOptions, VoxelType};

use super::{Job, Plain, check_weights, settings};
use crate::args::{BlendArgs, Depth, SceneArgs, ValueDomain};
use crate::files;
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::report::{Extras, Seconds};
use crate::shapes::{self, Units};
use crate::values::{Coordinate, Counts, Place};

/// Samples of a volume that place and lengths in millimetres count.
struct InVolume<'a>(&'a Volume);

impl Units<3> for InVolume<'_> {
    fn position(&self, place: &Place) -> Result<Vec<f64>> {
        let millimetres = place.0.iter().filter(|c| c.counts == Counts::Millimetres).count();
        match millimetres {
            0 => counted(place),
            3 => {
                let world = [0, 1, 2].map(|d| place.0[d].value);
                Ok(self.0.world_to_index(world).to_vec())
            }
            _ => bail!("{place}: a place in millimetres has three coordinates, all with mm"),
        }
    }

    fn lengths(&self, lengths: &Place) -> Result<Vec<f64>> {
        let size = self.0.voxel_size();
        let samples = |(d, c): (usize, &Coordinate)| match c.counts {
            Counts::Usual | Counts::Samples => Ok(c.value),
            Counts::Millimetres => Ok(c.value / size[d.min(2)]),
            Counts::Seconds => bail!("{c}: volumes have no seconds; write voxels, or mm"),
        };
        lengths.0.iter().enumerate().map(samples).collect()
    }
}

fn counted(place: &Place) -> Result<Vec<f64>> {
    let samples = |c: &Coordinate| match c.counts {
        Counts::Usual | Counts::Samples => Ok(c.value),
        _ => bail!("{c}: volumes have no seconds; write voxels, or mm"),
    };
    place.0.iter().map(samples).collect()
}

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    signal_io::check_volume_target(&args.output, args.force).map_err(files::in_our_words)?;
    let scene = &args.scene;
    if scene.from.is_some() || scene.to.is_some() {
        bail!("--from and --to are for sound; choose a part with --region box:X0,Y0,Z0:X1,Y1,Z1");
    }
    let start = Instant::now();
    let names = [&args.background, &args.patch].map(|p| p.display().to_string());
    let (background, own) = (read(&args.background)?, read(&args.patch)?);
    let mut warnings = Vec::new();
    let (patch, mask, at) = placed(&background, own, scene, &names, &mut warnings)?;
    let plain =
        |volume: &Volume| Plain { domain: volume.domain(), values: volume.as_planar().to_vec() };
    let pitch = background.domain().pitch();
    let offset = std::array::from_fn(|d| at[d] as f32 * pitch[d]);
    // Where voxel sizes agree to rounding, they are the same.
    let patch_plain = Plain {
        domain: Domain::new(patch.shape(), pitch, [0.0; 3], Unit::Millimetre)?,
        values: patch.as_planar().to_vec(),
    };
    let mask = RasterMask::new(patch_plain.domain, mask)?;
    let domain = scene.domain.unwrap_or(ValueDomain::Normalize);
    let job = Job::new(&names, plain(&background), patch_plain, mask, offset, domain, scene)?;
    let write_options = VolumeWriteOptions { force: args.force, voxel: voxel(args.depth)? };
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = job.solve(&settings, with_metrics, quiet)?;

    let start = Instant::now();
    let mut result = background.clone();
    result.as_planar_mut().copy_from_slice(&solution.planes);
    let report = signal_io::write_volume(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    warnings.extend(solution.report.warnings.iter().cloned());
    if report.clipped > 0 {
        warnings.push(format!(
            "{} voxels did not fit {} numbers and were clipped; write floats with --depth f32",
            report.clipped,
            report.voxel.name()
        ));
    }
    let outcome = Outcome {
        args,
        kind: SignalKind::Volume,
        names: &names,
        sizes: [background.shape().to_vec(), patch.shape().to_vec()],
        channels: background.channels(),
        place: at.to_vec(),
        domain: job.mapping,
        settings: &settings,
        warnings,
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written: Some(Written {
            sample: report.voxel.name(),
            format: report.format.name(),
            samples: report.samples,
            clipped: report.clipped,
        }),
        network: None,
        bytes: None,
        remarks: String::new(),
        extras: extras(&background),
    };
    outcome.tell(quiet)
}

fn extras(background: &Volume) -> Extras {
    let mut all = Map::new();
    all.insert("voxel_size_mm".to_owned(), json!(background.voxel_size()));
    all
}

fn read(path: &Path) -> Result<Volume> {
    signal_io::read_volume(path, &ReadOptions::default()).map_err(files::in_our_words)
}

/// The patch in voxels of the background's size and direction, which of them take part, and where its first one
/// goes, in voxels of the background.
fn placed(
    background: &Volume,
    patch: Volume,
    args: &SceneArgs,
    names: &[String; 2],
    warnings: &mut Vec<String>,
) -> Result<(Volume, Vec<f32>, [f64; 3])> {
    let weights = weights(&patch, args)?;
    if let Some(place) = &args.at {
        // A place was said: voxels have to agree, directions are the user's business.
        let sizes = [background.voxel_size(), patch.voxel_size()];
        let agree = (0..3).all(|d| (sizes[0][d] / sizes[1][d] - 1.0).abs() < 1e-3);
        if !agree {
            bail!(
                "{} has voxels of {:?} mm and {} of {:?} mm; leave --at out to place it by its own coordinates, which \
                 resamples it",
                names[0],
                sizes[0],
                names[1],
                sizes[1]
            );
        }
        let at = shapes::position::<3>(place, &InVolume(background))?;
        return Ok((patch, weights, at));
    }
    if !(background.has_affine() && patch.has_affine()) {
        if background.shape() == patch.shape() {
            return Ok((patch, weights, [0.0; 3]));
        }
        bail!("say where the patch's first voxel goes with --at X,Y,Z");
    }
    if let Some(shift) = patch.shift_to(background) {
        return Ok((patch, weights, shift));
    }
    warnings
        .push(format!("{} has other axes or voxels than {}; it was resampled", names[1], names[0]));
    let (resampled, inside) = patch.resampled_like(background)?;
    let mut mask = patch.clone();
    if mask.channels() > 1 {
        mask = Volume::new(patch.shape(), 1, weights)?;
        mask.set_affine(patch.affine())?;
    } else {
        mask.as_planar_mut().copy_from_slice(&weights);
    }
    let (mask, _) = mask.resampled_like(background)?;
    // Half a voxel's share decides, as for masks drawn on the background itself.
    let of = |(w, inside): (&f32, &f32)| if *w * *inside >= 0.5 { 1.0 } else { 0.0 };
    let weights: Vec<f32> = mask.as_planar().iter().zip(&inside).map(of).collect();
    check_weights(&weights, "of the patch on the background")?;
    Ok((resampled, weights, [0.0; 3]))
}

/// Which voxels of the patch take part.
fn weights(patch: &Volume, args: &SceneArgs) -> Result<Vec<f32>> {
    let domain = patch.domain();
    match (&args.region, &args.mask) {
        (Some(shape), _) => Ok(shapes::mask(shape, domain, &InVolume(patch))?.weights().to_vec()),
        (None, Some(path)) => {
            let (name, mask) = (path.display().to_string(), read(path)?);
            if mask.shape() != patch.shape() || mask.channels() != 1 {
                bail!(
                    "the mask {name} is {:?} voxels; the patch has {:?}",
                    mask.shape(),
                    patch.shape()
                );
            }
            // Labels and bytes count as well: the largest value is 1.
            let most = mask.range().map_or(1.0, |[_, high]| high.max(1.0));
            let weights: Vec<f32> = mask.as_planar().iter().map(|v| v / most).collect();
            check_weights(&weights, &name)?;
            Ok(weights)
        }
        (None, None) => Ok(vec![1.0; domain.len()]),
    }
}

fn voxel(depth: Option<Depth>) -> Result<Option<VoxelType>> {
    Ok(Some(match depth {
        None => return Ok(None),
        Some(Depth::Eight) => VoxelType::U8,
        Some(Depth::Sixteen) => VoxelType::U16,
        Some(Depth::F32) => VoxelType::F32,
        Some(Depth::TwentyFour | Depth::F16) => bail!("volumes take --depth 8, 16 or f32"),
    }))
}
