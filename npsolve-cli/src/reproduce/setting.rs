//! Scenes to reproduce figures on: RGB pictures in memory, cropped or shrunk.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use inr_core::{Domain, RasterMask, Samples, Spline, Translated};
use poisson_loss::{Guidance, Options, Patch, Problem};
use signal_io::Image;

use crate::args::{Figure, ReproduceArgs, SceneArgs};
use crate::compare::manifest::entry::{self, Entry};
use crate::demo;
use crate::scene::{Scene, samples_of};

use super::generated;

/// Sample data beside the project, where it is there.
const SAMPLE_DATA: &str = "../shared/data/manifest.json";
/// Scenes in the paper's table.
const TABLE_SCENES: usize = 5;

/// One scene.
#[derive(Clone)]
pub struct Setting {
    /// Name of scene and mask.
    pub name: String,
    /// What stays outside.
    pub background: Samples<2, 3>,
    /// What goes in.
    pub patch: Samples<2, 3>,
    /// Weights on the patch's lattice.
    pub mask: RasterMask<2>,
    /// Background pixel of the patch's first.
    pub offset: [f32; 2],
}

/// The scenes that the options ask for, at least one.
pub fn choose(args: &ReproduceArgs) -> Result<Vec<Setting>> {
    let manifest = args.manifest.clone().or_else(|| {
        let path = PathBuf::from(SAMPLE_DATA);
        path.is_file().then_some(path)
    });
    let count = if args.figure == Figure::Table1 { TABLE_SCENES } else { 1 };
    let mut settings = match manifest {
        Some(path) => from_manifest(&path, &args.scenes, count)?,
        None => built_in(&args.scenes, count)?,
    };
    if let Some(longest) = args.longest() {
        settings = settings.iter().map(|s| s.shrunk(longest)).collect::<Result<_>>()?;
    }
    Ok(settings)
}

fn from_manifest(path: &Path, names: &[String], count: usize) -> Result<Vec<Setting>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut entries = Vec::new();
    let pictures = entry::read(path)?.into_iter().filter(|(dimensions, _)| *dimensions == 2);
    for (k, (_, value)) in pictures.enumerate() {
        let entry: Entry = serde_json::from_value(value)
            .with_context(|| format!("scene {} of {}", k + 1, path.display()))?;
        entries.push(entry);
    }
    let known: Vec<&str> = entries.iter().map(|e| e.name.as_str()).collect();
    let wanted = selected(&known, names, count)?;
    wanted
        .into_iter()
        .map(|k| {
            let entry = &entries[k];
            // The tighter mask where there are two.
            let mask = entry.masks.get_key_value("free").or_else(|| entry.masks.iter().next());
            let name = mask.map_or(entry.name.clone(), |(m, _)| format!("{}/{m}", entry.name));
            let args = SceneArgs {
                mask: mask.map(|(_, path)| folder.join(path)),
                at: Some(entry.offset.into()),
                ..SceneArgs::default()
            };
            let [background, patch] = [&entry.background, &entry.patch].map(|p| folder.join(p));
            Setting::from_scene(name, &Scene::read(&background, &patch, &args)?)
        })
        .collect()
}

fn built_in(names: &[String], count: usize) -> Result<Vec<Setting>> {
    let mut all = generated::settings()?;
    all.insert(0, Setting::from_scene("coffee_cat".to_owned(), &demo::scene()?)?);
    let known: Vec<&str> = all.iter().map(|s| s.name.as_str()).collect();
    let wanted = selected(&known, names, count)?;
    Ok(wanted.into_iter().map(|k| all[k].clone()).collect())
}

/// Positions of the names, or the first few.
fn selected(known: &[&str], names: &[String], count: usize) -> Result<Vec<usize>> {
    if known.is_empty() {
        bail!("the list of scenes is empty");
    }
    if names.is_empty() {
        return Ok((0..count.min(known.len())).collect());
    }
    let find = |name: &String| {
        known
            .iter()
            .position(|k| k == name)
            .ok_or_else(|| anyhow!("there is no scene {name}; known are {}", known.join(", ")))
    };
    names.iter().map(find).collect()
}

impl Setting {
    /// A scene from files: three colours, or one that is repeated.
    fn from_scene(name: String, scene: &Scene) -> Result<Self> {
        Ok(Self {
            name,
            background: colors(&scene.background)?,
            patch: colors(&scene.patch)?,
            mask: scene.mask.clone(),
            offset: scene.offset,
        })
    }

    /// The region in the background's pixels.
    pub fn region(&self) -> Translated<&RasterMask<2>, 2> {
        Translated { region: &self.mask, offset: self.offset }
    }

    /// The problem; `region` is [`Setting::region`].
    pub fn problem<'a>(
        &'a self,
        region: &'a Translated<&'a RasterMask<2>, 2>,
        guidance: Guidance<2, 3>,
        options: Options,
    ) -> Problem<'a, 2, 3> {
        let patch = Patch::Samples { samples: &self.patch, offset: self.offset };
        Problem { background: &self.background, patch, region, guidance, options }
    }

    /// Sum of the region's weights, in pixels of the background that there are.
    pub fn measure(&self) -> f64 {
        let weight = |k: usize| f64::from(self.mask.weights()[k]);
        (0..self.mask.domain().len()).filter(|k| self.place(*k).is_some()).map(weight).sum()
    }

    /// First pixel and size of the part of the background around the region.
    pub fn surroundings(&self, margin: usize) -> ([usize; 2], [usize; 2]) {
        let shape = self.background.domain().shape();
        let (mut low, mut high) = (shape, [0; 2]);
        for k in (0..self.mask.domain().len()).filter(|k| self.mask.weights()[*k] > 0.0) {
            let Some(at) = self.place(k) else { continue };
            for d in 0..2 {
                (low[d], high[d]) = (low[d].min(at[d]), high[d].max(at[d] + 1));
            }
        }
        let start: [usize; 2] = std::array::from_fn(|d| low[d].saturating_sub(margin));
        let end: [usize; 2] = std::array::from_fn(|d| (high[d] + margin).min(shape[d]));
        (start, std::array::from_fn(|d| end[d].saturating_sub(start[d]).max(1)))
    }

    /// The background pixel nearest to a pixel of the patch.
    fn place(&self, k: usize) -> Option<[usize; 2]> {
        let (index, shape) = (self.mask.domain().unflatten(k), self.background.domain().shape());
        let at: [f32; 2] = std::array::from_fn(|d| (index[d] as f32 + self.offset[d]).round());
        let inside = (0..2).all(|d| at[d] >= 0.0 && at[d] < shape[d] as f32);
        inside.then(|| at.map(|v| v as usize))
    }

    /// The scene on a part of its background.
    pub fn cropped(&self, start: [usize; 2], size: [usize; 2]) -> Result<Self> {
        let offset = std::array::from_fn(|d| self.offset[d] - start[d] as f32);
        Ok(Self { background: crop(&self.background, start, size)?, offset, ..self.clone() })
    }

    /// The scene with at most so many pixels on its background's longest side; the mask stays hard, the place whole.
    fn shrunk(&self, longest: usize) -> Result<Self> {
        let [w, h] = self.background.domain().shape();
        let factor = longest as f32 / w.max(h) as f32;
        if factor >= 1.0 {
            return Ok(self.clone());
        }
        let size = |n: usize| ((n as f32 * factor).round() as usize).max(1);
        let smaller = |samples: &Samples<2, 3>| -> Result<Samples<2, 3>> {
            let shape = samples.domain().shape().map(size);
            let lattice = samples.domain().resized(shape)?;
            let values = Spline::interpolate(samples).resample(&lattice)?;
            Ok(Samples::from_planar(Domain::unit(shape)?, values.as_planar().to_vec())?)
        };
        let patch = smaller(&self.patch)?;
        let weights: Vec<f32> = {
            let domain = *self.mask.domain();
            let mask = Samples::<2, 1>::from_planar(domain, self.mask.weights().to_vec())?;
            let lattice = domain.resized(patch.domain().shape())?;
            let values = Spline::interpolate(&mask).resample(&lattice)?;
            values.as_planar().iter().map(|v| f32::from(u8::from(*v >= 0.5))).collect()
        };
        if weights.iter().all(|w| *w == 0.0) {
            bail!("the mask of {} vanishes at {longest} pixels; choose a larger --size", self.name);
        }
        Ok(Self {
            name: self.name.clone(),
            background: smaller(&self.background)?,
            mask: RasterMask::new(*patch.domain(), weights)?,
            patch,
            offset: self.offset.map(|o| (o * factor).round()),
        })
    }
}

/// A part of samples as samples of their own.
pub fn crop(samples: &Samples<2, 3>, start: [usize; 2], size: [usize; 2]) -> Result<Samples<2, 3>> {
    let w = samples.domain().shape()[0];
    Ok(Samples::from_fn(Domain::unit(size)?, |x| {
        let at = start[0] + x[0] as usize + (start[1] + x[1] as usize) * w;
        [0, 1, 2].map(|c| samples.plane(c)[at])
    }))
}

fn colors(image: &Image) -> Result<Samples<2, 3>> {
    match image.channels().len() {
        3 => samples_of::<3>(image, 0),
        1 => {
            let grey = samples_of::<1>(image, 0)?;
            Ok(Samples::from_planar(*grey.domain(), grey.as_planar().repeat(3))?)
        }
        n => bail!("a picture with {n} colour channels; figures are made of 1 or 3"),
    }
}
