//! `npsolve blend` for light fields: all views are blended together, so that they stay views of one scene.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Unit};
use serde_json::{Map, json};
use signal_io::{Image, LightField, LightFieldReadOptions, LightFieldWriteOptions, WriteOptions};

use super::field::{self, Notes};
use super::{Job, Plain, Signal, number_type, repeated_mask, settings, split_alpha, with_colors};
use crate::args::{BlendArgs, SceneArgs, ValueDomain};
use crate::kind::SignalKind;
use crate::outcome::{Outcome, Written};
use crate::picture_kind::PictureKind;
use crate::report::{Extras, Seconds};
use crate::shapes::{self, InSamples};
use crate::solve::Settings;
use crate::values::Size;
use crate::{field_file, files};

/// Pixels by which a camera's step moves the picture, where nothing is said.
pub const ANGULAR_PITCH: f32 = 0.8;

/// Options of a file of its own kind.
pub fn write_options(force: bool) -> LightFieldWriteOptions {
    let write = WriteOptions { force, ..WriteOptions::default() };
    LightFieldWriteOptions { write, lenslet: false }
}

/// Both light fields, and where one goes in the other.
pub type Scene = super::Scene<Views, 4>;

/// A light field with the distance of its views, and how its file holds them.
pub struct Views {
    /// The samples.
    pub field: LightField,
    angular_pitch: f32,
}

impl Signal<4> for Views {
    fn plain(&self) -> Result<Plain<4>> {
        let pitch = [1.0, 1.0, self.angular_pitch, self.angular_pitch];
        let domain = Domain::new(self.field.shape(), pitch, [0.0; 4], Unit::Sample)?;
        Ok(Plain { domain, values: split_alpha(self.field.as_strip()).0 })
    }

    fn with_values(&self, values: &[f32]) -> Result<Self> {
        let [_, _, u, v] = self.field.shape();
        let field = LightField::from_strip(with_colors(self.field.as_strip(), values), [u, v])?;
        Ok(Self { field, ..*self })
    }

    fn save(&self, path: &Path, force: bool) -> Result<()> {
        signal_io::write_light_field(path, &self.field, &write_options(force))
            .map_err(files::in_our_words)?;
        Ok(())
    }

    fn ending(&self) -> &'static str {
        ".npy"
    }

    fn picture(&self, at: [usize; 4], _: &Self) -> Result<Image> {
        Ok(self.field.view(at[2], at[3]))
    }

    fn notes(&self) -> Notes {
        PictureKind::of(&self.field.as_strip().clone().split_alpha().0).to_notes()
    }

    fn from_values(
        notes: &Notes,
        domain: Domain<4>,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self> {
        let [width, height, u, v] = domain.shape();
        let kind = PictureKind::from_notes(notes, channels);
        let strip = kind.picture([width, height * u * v], values)?;
        let field = LightField::from_strip(strip, [u, v])?;
        Ok(Self { field, angular_pitch: domain.pitch()[2] })
    }

    fn number_type(&self) -> (&'static str, usize) {
        number_type(self.field.sample())
    }
}

/// Reads a light field.
pub fn read(path: &Path, lenslet: Option<Size>, angular_pitch: f32) -> Result<Views> {
    if field_file::is_network(path) {
        return field::read(path, |own| Ok(*own));
    }
    let options =
        LightFieldReadOptions { lenslet: lenslet.map(|s| s.0), ..LightFieldReadOptions::default() };
    let field = signal_io::read_light_field(path, &options).map_err(files::in_our_words)?;
    Ok(Views { field, angular_pitch })
}

impl Scene {
    /// Reads the files.
    pub fn read(background: &Path, patch: &Path, args: &SceneArgs) -> Result<Self> {
        if args.from.is_some() || args.to.is_some() {
            bail!(
                "--from and --to are for sound; choose views with --region box:X0,Y0,U0,V0:X1,Y1,U1,V1"
            );
        }
        let names = [background, patch].map(|p| p.display().to_string());
        let read = |path| self::read(path, args.lenslet, args.angular_pitch);
        let (background, patch) = (read(background)?, read(patch)?);
        let (before, inserted) = (background.plain()?, patch.plain()?);
        let [width, height, u, v] = inserted.domain.shape();
        let mask = match (&args.region, &args.mask, split_alpha(patch.field.as_strip()).1) {
            (Some(shape), _, _) => shapes::mask(shape, inserted.domain, &InSamples)?,
            (None, Some(path), _) => {
                RasterMask::new(inserted.domain, repeated_mask(path, width, height, u * v)?)?
            }
            (None, None, Some(alpha)) => RasterMask::new(inserted.domain, alpha)?,
            (None, None, None) => {
                RasterMask::new(inserted.domain, vec![1.0; inserted.domain.len()])?
            }
        };
        let place = match &args.at {
            Some(place) => shapes::position::<4>(place, &InSamples)?,
            None if before.domain.shape() == inserted.domain.shape() => [0.0; 4],
            None => bail!("say where the patch goes with --at X,Y or --at X,Y,U,V"),
        };
        let pitch = before.domain.pitch();
        let offset = std::array::from_fn(|d| place[d] as f32 * pitch[d]);
        let domain = args.domain.unwrap_or(ValueDomain::Stored);
        let job = Job::new(&names, before, inserted, mask, offset, domain, args)?;
        Ok(Self { names, background, job, place, warnings: Vec::new() })
    }
}

/// Runs the command.
pub fn blend(args: &BlendArgs, quiet: bool) -> Result<()> {
    let write_options = LightFieldWriteOptions {
        write: WriteOptions {
            force: args.force,
            sample: args.depth.map(|d| d.sample_type()).transpose()?,
            ..WriteOptions::default()
        },
        lenslet: args.scene.lenslet.is_some(),
    };
    signal_io::check_light_field_target(&args.output, &write_options)
        .map_err(files::in_our_words)?;
    let start = Instant::now();
    let scene = Scene::read(&args.background, &args.patch, &args.scene)?;
    let read = start.elapsed().as_secs_f64();

    let settings = settings(args);
    let with_metrics = args.json || args.metrics.is_some();
    let solution = scene.job.solve(&settings, with_metrics, quiet)?;
    let extras = match with_metrics {
        true => consistency(&scene.job, &settings, &solution.planes)?,
        false => Map::new(),
    };

    let start = Instant::now();
    let result = scene.background.with_values(&solution.planes)?.field;
    let report = signal_io::write_light_field(&args.output, &result, &write_options)
        .map_err(files::in_our_words)?;
    let write = start.elapsed().as_secs_f64();

    let outcome = Outcome {
        args,
        kind: SignalKind::Lightfield,
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
fn consistency(job: &Job<4>, settings: &Settings, blended: &[f32]) -> Result<Extras> {
    let (pasted, alone) = (job.paste(settings)?, job.one_by_one(settings)?);
    let difference = |planes: &[f32]| json!(job.unsteadiness(planes, &pasted, 2..4));
    let mut all = Map::new();
    all.insert("epipolar_difference".to_owned(), difference(blended));
    all.insert("epipolar_difference_view_by_view".to_owned(), difference(&alone));
    Ok(all)
}
