//! One reader per name, for bytes of any content: the fuzz targets, and the test that reads their corpus.

use std::path::Path;

use inr_core::{Checkpoint, Description};
use signal_io::{
    LightFieldReadOptions, ReadOptions, VolumeReadOptions, decode_audio, decode_image,
    decode_light_field, decode_mesh, decode_video, decode_volume, read_volume,
};

/// Memory that a file may ask for: far more than the seeds need, little enough for many fuzzers.
const LIMIT: u64 = 8 << 20;

/// All readers. What stands behind the underscore is the extension of their files.
pub const READERS: [&str; 25] = [
    "image_png",
    "image_jpg",
    "image_tif",
    "image_webp",
    "image_gif",
    "image_ppm",
    "image_pfm",
    "image_hdr",
    "image_exr",
    "image_npy",
    "audio_wav",
    "audio_flac",
    "audio_ogg",
    "audio_mp3",
    "volume_nii",
    "volume_nrrd",
    "volume_npy",
    "volume_tif",
    "volume_json",
    "video_gif",
    "video_webp",
    "video_y4m",
    "light_npy",
    "mesh_glb",
    "network_safetensors",
];

/// Reads bytes with one of the [`READERS`]; whether they were a file of its format. Must never panic.
pub fn read(reader: &str, bytes: &[u8]) -> bool {
    let (kind, extension) = reader.split_once('_').expect("the name of a reader");
    let name = format!("a.{extension}");
    let options = ReadOptions { limit_bytes: LIMIT, ..ReadOptions::default() };
    let of_volumes = VolumeReadOptions { limit_bytes: LIMIT };
    match kind {
        "image" => decode_image(&name, bytes, &options).is_ok(),
        "audio" => decode_audio(&name, bytes, &options).is_ok(),
        "volume" if extension == "json" => described(bytes, &of_volumes),
        "volume" => decode_volume(&name, bytes, &of_volumes).is_ok(),
        "video" => decode_video(&name, bytes, &options).is_ok(),
        "light" => {
            let options = LightFieldReadOptions { read: options, ..Default::default() };
            decode_light_field(&name, bytes, &options).is_ok()
        }
        "mesh" => decode_mesh(&name, bytes, LIMIT).is_ok_and(|mesh| {
            let _ = mesh.to_region();
            true
        }),
        _ => Description::from_bytes(bytes).is_ok_and(|about| {
            match [about.dimensions, about.channels] {
                [1, 1] => Checkpoint::<1, 1>::from_bytes(bytes).is_ok(),
                [2, 3] => Checkpoint::<2, 3>::from_bytes(bytes).is_ok(),
                [3, 1] => Checkpoint::<3, 1>::from_bytes(bytes).is_ok(),
                _ => true,
            }
        }),
    }
}

/// A description of raw numbers stands beside a file with these numbers.
fn described(bytes: &[u8], options: &VolumeReadOptions) -> bool {
    let folder = std::env::temp_dir().join(format!("npsolve-fuzz-{}", std::process::id()));
    let written = std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(folder.join("a.raw"), [7u8; 96]))
        .and_then(|()| std::fs::write(folder.join("a.json"), bytes));
    written.is_ok() && read_volume(Path::new(&folder).join("a.json"), options).is_ok()
}
