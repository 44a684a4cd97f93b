//! The sample scenes, where the folder with the data is there.

use std::path::PathBuf;

use inr_core::{RasterMask, Samples};
use serde_json::Value;
use signal_io::{Image, ReadOptions, read_image};

/// One background, patch and mask; grey scenes are repeated on three channels.
pub struct Scene {
    /// `scene/mask`.
    pub name: String,
    /// What stays outside.
    pub background: Samples<2, 3>,
    /// What goes in.
    pub patch: Samples<2, 3>,
    /// Weights on the patch's lattice.
    pub mask: RasterMask<2>,
    /// Background sample of the patch's first sample.
    pub offset: [f32; 2],
}

/// All 2-D scenes with all their masks; `None`, and a line that says so, without the data.
pub fn scenes() -> Option<Vec<Scene>> {
    let root = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    let Ok(text) = std::fs::read_to_string(root.join("manifest.json")) else {
        println!("skipped: no sample data");
        return None;
    };
    let manifest: Value = serde_json::from_str(&text).expect("a manifest in JSON");
    let read = |path: &Value| -> Image {
        let path = root.join(path.as_str().expect("a path"));
        read_image(&path, &ReadOptions::default())
            .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    let mut scenes = Vec::new();
    for entry in manifest["blend_2d"].as_array().expect("a list of scenes") {
        let (background, patch) = (read(&entry["background"]), read(&entry["patch"]));
        let offset = std::array::from_fn(|d| entry["offset"][d].as_f64().expect("a number") as f32);
        for (mask, path) in entry["masks"].as_object().expect("masks by name") {
            let image = read(path);
            scenes.push(Scene {
                name: format!("{}/{mask}", entry["name"].as_str().expect("a name")),
                background: color(&background),
                patch: color(&patch),
                mask: RasterMask::new(image.domain(), image.plane(0).to_vec())
                    .expect("weights in [0, 1]"),
                offset,
            });
        }
    }
    Some(scenes)
}

fn color(image: &Image) -> Samples<2, 3> {
    if image.color_count() == 3 {
        return image.to_samples().expect("three colours");
    }
    let grey: Samples<2, 1> = image.to_samples().expect("one channel");
    Samples::from_planar(*grey.domain(), grey.as_planar().repeat(3)).expect("three planes")
}
