//! `npsolve blend` for volumes: voxels with edges in millimetres and a place in the world.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use inr_core::{Domain, RasterMask, Region, Unit};
use rayon::prelude::*;
use serde_json::{Map, json};
use signal_io::{Image, Placement, Volume, VolumeReadOptions, VolumeWriteOptions, VoxelType};

use super::field::{self, Notes};
use super::{Job, Plain, Signal, check_weights, settings};
use crate::args::{BlendArgs, Depth, SceneArgs, ValueDomain};
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::render::slices;
use crate::report::{Extras, Seconds};
use crate::shapes::{self, Units};
use crate::values::{Coordinate, Counts, MeshCounts, MeshFile, Place};
use crate::{field_file, files};

/// Most memory for the triangles of a region.
const MESH_BYTES: u64 = 1 << 30;

/// Samples of a volume that place and lengths in millimetres count.
struct InVolume<'a>(&'a Volume);

impl Units<3> for InVolume<'_> {
    fn position(&self, place: &Place) -> Result<Vec<f64>> {
        let millimetres = place.0.iter().filter(|c| c.counts == Counts::Millimetres).count();
        match millimetres {
            0 => counted(place),
            3 => {
                let world = [0, 1, 2].map(|d| place.0[d].value);
                Ok(self.0.to_index(world).to_vec())
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

    fn inside_mesh(&self, file: &MeshFile) -> Result<Vec<f32>> {
        let mesh = signal_io::read_mesh(&file.path, MESH_BYTES).map_err(files::in_our_words)?;
        let scale = match file.counts {
            MeshCounts::Samples => diagonal(self.0.voxel_size()),
            MeshCounts::Millimetres => self.0.world_to_domain(),
            MeshCounts::Metres => {
                self.0.world_to_domain().map(|[x, y, z, t]| [1e3 * x, 1e3 * y, 1e3 * z, t])
            }
        };
        let name = file.path.display();
        let region =
            mesh.transformed(&scale).to_region().with_context(|| format!("{name} is no region"))?;
        let domain = self.0.domain();
        let weight = |k: usize| region.weight(&domain.position(domain.unflatten(k)));
        Ok((0..domain.len()).into_par_iter().map(weight).collect())
    }
}

/// The map of an axis each.
fn diagonal([x, y, z]: [f64; 3]) -> signal_io::Affine {
    [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]]
}

fn counted(place: &Place) -> Result<Vec<f64>> {
    let samples = |c: &Coordinate| match c.counts {
        Counts::Usual | Counts::Samples => Ok(c.value),
        _ => bail!("{c}: volumes have no seconds; write voxels, or mm"),
    };
    place.0.iter().map(samples).collect()
}

/// Both volumes, and where one goes in the other.
pub type Scene = super::Scene<Volume, 3>;

impl Signal<3> for Volume {
    fn plain(&self) -> Result<Plain<3>> {
        Ok(Plain { domain: self.domain(), values: self.as_planar().to_vec() })
    }

    fn with_values(&self, values: &[f32]) -> Result<Self> {
        let mut out = self.clone();
        out.as_planar_mut().copy_from_slice(values);
        Ok(out)
    }

    fn save(&self, path: &Path, force: bool) -> Result<()> {
        let options = VolumeWriteOptions { force, ..VolumeWriteOptions::default() };
        signal_io::write_volume(path, self, &options).map_err(files::in_our_words)?;
        Ok(())
    }

    fn ending(&self) -> &'static str {
        ".nii.gz"
    }

    fn picture(&self, at: [usize; 3], like: &Self) -> Result<Image> {
        slices::sheet(self, at, slices::window(like))
    }

    fn notes(&self) -> Notes {
        let affine = json!(self.affine()).to_string();
        let voxel = self.voxel_type.name().to_owned();
        Notes::from([(AFFINE.to_owned(), affine), (VOXEL.to_owned(), voxel)])
    }

    fn from_values(
        notes: &Notes,
        domain: Domain<3>,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self> {
        let volume = Self::new(domain.shape(), channels, values)?;
        let said = |key| notes.get(key).and_then(|text| serde_json::from_str(text).ok());
        let (pitch, origin) = (domain.pitch().map(f64::from), domain.origin().map(f64::from));
        let mut volume = match said(AFFINE) {
            Some(affine) => {
                // The lattice may be another one along the same axes, whose unit is the millimetre.
                let affine: signal_io::Affine = affine;
                let own = volume.clone().with_affine(affine)?.voxel_size();
                volume.with_affine(affine.map(|[x, y, z, t]| {
                    let step = [x / own[0], y / own[1], z / own[2]];
                    let shift: f64 = (0..3).map(|d| step[d] * origin[d]).sum();
                    [step[0] * pitch[0], step[1] * pitch[1], step[2] * pitch[2], t + shift]
                }))?
            }
            None => volume.with_voxel_size(pitch)?,
        };
        let voxel = notes.get(VOXEL).and_then(|name| VoxelType::from_name(name));
        volume.voxel_type = voxel.unwrap_or(VoxelType::F32);
        Ok(volume)
    }

    fn number_type(&self) -> (&'static str, usize) {
        (self.voxel_type.name(), self.voxel_type.bytes())
    }
}

/// Keys of notes.
const AFFINE: &str = "affine";
const VOXEL: &str = "voxel_type";

impl Scene {
    /// Reads the files.
    pub fn read(background: &Path, patch: &Path, args: &SceneArgs) -> Result<Self> {
        if args.from.is_some() || args.to.is_some() {
            bail!(
                "--from and --to are for sound; choose a part with --region box:X0,Y0,Z0:X1,Y1,Z1"
            );
        }
        let names = [background, patch].map(|p| p.display().to_string());
        let (background, own) = (self::read(background)?, self::read(patch)?);
        let mut warnings = Vec::new();
        let (patch, mask, at) = placed(&background, own, args, &names, &mut warnings)?;
        let pitch = background.domain().pitch();
        let offset = std::array::from_fn(|d| at[d] as f32 * pitch[d]);
        // Where voxel sizes agree to rounding, they are the same.
        let domain = Domain::new(patch.shape(), pitch, [0.0; 3], Unit::Millimetre)?;
        let patch = Plain { domain, values: patch.into_planar() };
        let mask = RasterMask::new(domain, mask)?;
        let values = args.domain.unwrap_or(ValueDomain::Normalize);
        let job = Job::new(&names, background.plain()?, patch, mask, offset, values, args)?;
        Ok(Self { names, background, job, place: at, warnings })
    }
}

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    signal_io::check_volume_target(&args.output, args.force).map_err(files::in_our_words)?;
    let write_options = VolumeWriteOptions {
        force: args.force,
        voxel_type: voxel_type(args.depth)?,
        ..VolumeWriteOptions::default()
    };
    let start = Instant::now();
    let scene = Scene::read(&args.background, &args.patch, &args.scene)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = scene.job.solve(&settings, with_metrics, quiet)?;

    let start = Instant::now();
    let result = scene.background.with_values(&solution.planes)?;
    let report = signal_io::write_volume(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    let mut warnings = scene.warnings.clone();
    warnings.extend(solution.report.warnings.iter().cloned());
    if report.clipped > 0 {
        warnings.push(format!(
            "{} voxels did not fit {} numbers and were clipped; write floats with --depth f32",
            report.clipped,
            report.voxel_type.name()
        ));
    }
    let outcome = Outcome {
        args,
        kind: SignalKind::Volume,
        names: &scene.names,
        sizes: scene.sizes(),
        channels: result.channels(),
        place: scene.place.to_vec(),
        domain: scene.job.mapping,
        settings: &settings,
        warnings,
        seconds: Seconds { read, solve: solution.seconds, write },
        solution: &solution,
        written: Some(Written {
            sample: report.voxel_type.name(),
            format: report.format.name(),
            samples: report.samples,
            clipped: report.clipped,
        }),
        network: None,
        bytes: None,
        remarks: String::new(),
        extras: extras(&scene.background),
    };
    outcome.tell(quiet)
}

fn extras(background: &Volume) -> Extras {
    let mut all = Map::new();
    all.insert("voxel_size_mm".to_owned(), json!(background.voxel_size()));
    all
}

/// Reads a volume.
pub fn read(path: &Path) -> Result<Volume> {
    if field_file::is_network(path) {
        return field::read(path, |own| Ok(*own));
    }
    signal_io::read_volume(path, &VolumeReadOptions::default()).map_err(files::in_our_words)
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
    if !(has_place(background) && has_place(&patch)) {
        if background.shape() == patch.shape() {
            return Ok((patch, weights, [0.0; 3]));
        }
        bail!("say where the patch's first voxel goes with --at X,Y,Z");
    }
    if let Some(shift) = Placement::new(&patch, background).translation() {
        // Rounding of places in files, such as 90.00001 mm.
        let whole = |v: f64| if (v - v.round()).abs() < 1e-3 { v.round() } else { v };
        return Ok((patch, weights, shift.map(whole)));
    }
    warnings
        .push(format!("{} has other axes or voxels than {}; it was resampled", names[1], names[0]));
    let on_background =
        |volume: &Volume| volume.resampled_like(background).with_context(|| names[1].clone());
    let mut resampled = on_background(&patch)?;
    let mask = Volume::new(patch.shape(), 1, weights)?.with_affine(*patch.affine())?;
    // Half a voxel's share decides, as for masks drawn on the background itself; NaN is beyond the patch.
    let inside = |w: &f32| if *w >= 0.5 { 1.0 } else { 0.0 };
    let weights: Vec<f32> = on_background(&mask)?.as_planar().iter().map(inside).collect();
    check_weights(&weights, "of the patch on the background")?;
    resampled.as_planar_mut().iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
    Ok((resampled, weights, [0.0; 3]))
}

/// Whether a volume says where it lies, and not only how large its voxels are.
pub fn has_place(volume: &Volume) -> bool {
    volume.affine() != &diagonal(volume.voxel_size())
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

fn voxel_type(depth: Option<Depth>) -> Result<Option<VoxelType>> {
    Ok(Some(match depth {
        None => return Ok(None),
        Some(Depth::Eight) => VoxelType::U8,
        Some(Depth::Sixteen) => VoxelType::U16,
        Some(Depth::F32) => VoxelType::F32,
        Some(Depth::TwentyFour | Depth::F16) => bail!("volumes take --depth 8, 16 or f32"),
    }))
}
