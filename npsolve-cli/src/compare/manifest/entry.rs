//! The scenes of a manifest, of every kind of signal.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde_json::Value;

use crate::args::SceneArgs;
use crate::kind::SignalKind;
use crate::values::{Coordinate, Place, Shape};

/// The part of the file that is used. Scenes are read one by one, so that a bad one spoils only itself.
#[derive(Deserialize)]
struct Manifest {
    #[serde(default)]
    blend_1d: Vec<Value>,
    #[serde(default)]
    blend_2d: Vec<Value>,
    #[serde(default)]
    blend_3d: Vec<Value>,
    #[serde(default)]
    blend_4d: Vec<Value>,
}

/// One scene of a manifest; paths are relative to the file.
#[derive(Deserialize)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// The signal to paste into.
    pub background: PathBuf,
    /// The signal to paste.
    pub patch: PathBuf,
    /// Without names the guidance of the command line.
    #[serde(default)]
    pub guidance: Vec<String>,
    /// Of pictures: without masks the patch's alpha, or the whole patch, is the region.
    #[serde(default)]
    pub masks: BTreeMap<String, PathBuf>,
    /// Of pictures: where the patch's first pixel goes.
    #[serde(default)]
    pub offset: [f32; 2],
    /// Of sound: first frame of the part, and the one behind its last.
    patch_range_samples: Option<[f64; 2]>,
    /// Of sound: where the part's first frame goes.
    offset_samples: Option<f64>,
    /// Of volumes and light fields.
    region: Option<Region>,
    /// Of volumes: where the patch's first voxel goes.
    offset_voxel: Option<[f64; 3]>,
    /// Of light fields: where the patch goes, slowest axis first.
    offset_vuyx: Option<[f64; 4]>,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Region {
    Box {
        #[serde(alias = "min_voxel", alias = "min_vuyx")]
        min: Vec<f64>,
        #[serde(alias = "max_voxel_exclusive", alias = "max_vuyx_exclusive")]
        max: Vec<f64>,
    },
    Ellipsoid {
        #[serde(alias = "centre_voxel")]
        centre: Vec<f64>,
        #[serde(alias = "radii_voxel")]
        radii: Vec<f64>,
    },
}

/// The scenes of all lists, not yet looked at, with the dimension of their list.
pub fn read(path: &Path) -> Result<Vec<(usize, Value)>> {
    let text = fs::read_to_string(path)
        .with_context(|| format!("cannot read {}; check the path", path.display()))?;
    let file = path.display();
    let manifest: Manifest = serde_json::from_str(&text).with_context(|| {
        format!("{file} is not a list of scenes; it needs a JSON list \"blend_2d\"")
    })?;
    let lists = [manifest.blend_1d, manifest.blend_2d, manifest.blend_3d, manifest.blend_4d];
    let of = |(k, list): (usize, Vec<Value>)| list.into_iter().map(move |scene| (k + 1, scene));
    let all: Vec<_> = lists.into_iter().enumerate().flat_map(of).collect();
    if all.is_empty() {
        bail!(
            "{file} has no scenes; it needs a JSON list \"blend_2d\", or blend_1d, blend_3d, blend_4d"
        );
    }
    Ok(all)
}

/// Coordinates that count samples, x first; those of light fields come slowest axis first.
fn place(values: &[f64]) -> Place {
    let samples = |v: &f64| Coordinate::samples(*v);
    match values.len() {
        4 => Place(values.iter().rev().map(samples).collect()),
        _ => Place(values.iter().map(samples).collect()),
    }
}

impl Entry {
    /// The kind of signal for a list of this dimension.
    pub fn kind(dimensions: usize) -> SignalKind {
        match dimensions {
            1 => SignalKind::Audio,
            2 => SignalKind::Image,
            3 => SignalKind::Volume,
            _ => SignalKind::Lightfield,
        }
    }

    /// The places and regions to blend at, by name; `like` says everything else.
    pub fn scenes(&self, folder: &Path, like: &SceneArgs) -> Vec<(String, SceneArgs)> {
        let mut all = like.clone();
        all.at = Some(match (self.offset_samples, self.offset_voxel, self.offset_vuyx) {
            (Some(frame), _, _) => place(&[frame]),
            (_, Some(voxel), _) => place(&voxel),
            (_, _, Some(vuyx)) => place(&vuyx),
            _ => self.offset.into(),
        });
        if let Some(range) = self.patch_range_samples {
            [all.from, all.to] = range.map(|v| Some(Coordinate::samples(v)));
        }
        all.region = self.region.as_ref().map(|region| match region {
            Region::Box { min, max } => Shape::Box(place(min), place(max)),
            Region::Ellipsoid { centre, radii } => Shape::Ellipsoid(place(centre), place(radii)),
        });
        if self.masks.is_empty() {
            return vec![("all".to_owned(), all)];
        }
        let masked = |(name, path): (&String, &PathBuf)| {
            (name.clone(), SceneArgs { mask: Some(folder.join(path)), ..all.clone() })
        };
        self.masks.iter().map(masked).collect()
    }
}
