//! Writes the seeds of the corpus: small files of generated signals in every format that can be written, in several
//! number types.

use std::fs;
use std::path::{Path, PathBuf};

use inr_core::{Architecture, Checkpoint, Domain, Frame, Network, Output};
use signal_io::{
    Audio, AudioSample, AudioWriteOptions, Image, LightField, SampleType, Transfer, Video,
    VideoWriteOptions, Volume, VolumeWriteOptions, VoxelType, WriteOptions, write_audio,
    write_image, write_light_field, write_video, write_volume,
};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let file = |reader: &str, name: &str| -> Result<PathBuf> {
        let folder = corpus.join(reader);
        fs::create_dir_all(&folder)?;
        Ok(folder.join(name))
    };
    for (reader, extension, channels, sample) in [
        ("image_png", "png", 1, SampleType::U8),
        ("image_png", "png", 4, SampleType::U16),
        ("image_jpg", "jpg", 1, SampleType::U8),
        ("image_jpg", "jpg", 3, SampleType::U8),
        ("image_tif", "tif", 1, SampleType::U8),
        ("image_tif", "tif", 3, SampleType::U16),
        ("image_tif", "tif", 2, SampleType::F32),
        ("image_webp", "webp", 3, SampleType::U8),
        ("image_webp", "webp", 4, SampleType::U8),
        ("image_ppm", "pgm", 1, SampleType::U8),
        ("image_ppm", "ppm", 3, SampleType::U16),
        ("image_ppm", "pam", 4, SampleType::U8),
        ("image_pfm", "pfm", 1, SampleType::F32),
        ("image_pfm", "pfm", 3, SampleType::F32),
        ("image_hdr", "hdr", 3, SampleType::F32),
        ("image_exr", "exr", 1, SampleType::F32),
        ("image_exr", "exr", 4, SampleType::F16),
        ("image_npy", "npy", 1, SampleType::U8),
        ("image_npy", "npy", 3, SampleType::F32),
    ] {
        let image = picture(9, 7, channels, 0.0)?;
        let options = WriteOptions { force: true, sample: Some(sample), jpeg_quality: 60 };
        write_image(file(reader, &format!("{channels}-{}.{extension}", sample.name()))?, &image, &options)?;
    }
    for (channels, sample) in [(1, AudioSample::U8), (2, AudioSample::I16), (1, AudioSample::I24), (1, AudioSample::F32)] {
        let wave = |k: usize| (k as f32 * 0.3).sin();
        let audio = Audio::new(8000, channels, (0..40 * channels).map(wave).collect())?;
        let options = AudioWriteOptions { force: true, sample: Some(sample) };
        write_audio(file("audio_wav", &format!("{channels}-{}.wav", sample.name()))?, &audio, &options)?;
    }
    for (reader, name, channels, voxel) in [
        ("volume_nii", "u8.nii", 1, VoxelType::U8),
        ("volume_nii", "i16.nii.gz", 1, VoxelType::I16),
        ("volume_nii", "f32.nii", 2, VoxelType::F32),
        ("volume_nrrd", "u16.nrrd", 1, VoxelType::U16),
        ("volume_nrrd", "f32.nrrd", 3, VoxelType::F32),
        ("volume_npy", "i32.npy", 1, VoxelType::I32),
        ("volume_npy", "u8.npy", 2, VoxelType::U8),
        ("volume_tif", "u16.tif", 1, VoxelType::U16),
        ("volume_tif", "f32.tif", 1, VoxelType::F32),
    ] {
        let values = (0..4 * 3 * 2 * channels).map(|k| (k * 7 % 50) as f32).collect();
        let mut volume = Volume::new([4, 3, 2], channels, values)?.with_voxel_size([1.0, 2.0, 2.5])?;
        volume.voxel_type = voxel;
        let options = VolumeWriteOptions { force: true, ..VolumeWriteOptions::default() };
        write_volume(file(reader, name)?, &volume, &options)?;
    }
    for (name, text) in [
        ("u8.json", r#"{"file": "a.raw", "shape": [8, 4, 3], "dtype": "u8", "spacing": [2, 2, 3]}"#),
        ("f32.json", r#"{"file": "a.raw", "shape": [2, 2, 2], "channels": 3, "dtype": "f32", "order": "interleaved"}"#),
        ("affine.json", r#"{"file": "a.raw", "shape": [2, 6, 4], "dtype": "i16", "endian": "big", "slope": 0.5, "intercept": 3, "affine": [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 3, -5]]}"#),
    ] {
        fs::write(file("volume_json", name)?, text)?;
    }
    for (reader, name, channels) in [
        ("video_gif", "3.gif", 3),
        ("video_webp", "4.webp", 4),
        ("video_y4m", "3.y4m", 3),
        ("video_y4m", "1.y4m", 1),
        ("image_gif", "3.gif", 3),
    ] {
        let frames = (0..3).map(|t| picture(8, 6, channels, t as f32)).collect::<Result<Vec<_>>>()?;
        let options = VideoWriteOptions { force: true, ..VideoWriteOptions::default() };
        write_video(file(reader, name)?, &Video::from_frames(frames)?, &options)?;
    }
    let views = (0..4).map(|k| picture(6, 5, 3, k as f32)).collect::<Result<Vec<_>>>()?;
    let field = LightField::from_views(&views, [2, 2])?;
    let path = file("light_npy", "u8.npy")?;
    let _ = fs::remove_file(&path);
    write_light_field(path, &field, &Default::default())?;
    fs::write(file("mesh_glb", "box.glb")?, glb())?;
    network::<2, 3>(Architecture::siren(4, 1, 30.0), file("network_safetensors", "siren.safetensors")?)?;
    network::<3, 1>(Architecture::hash(&[6, 5, 4], 64), file("network_safetensors", "hash.safetensors")?)?;
    network::<1, 1>(Architecture::fourier(3, 2.0, 4, 1), file("network_safetensors", "fourier.safetensors")?)
}

fn picture(width: usize, height: usize, channels: usize, phase: f32) -> Result<Image> {
    let names: &[&str] = match channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    };
    let value = |k: usize| 0.5 + 0.5 * (k as f32 * 0.37 + phase).sin();
    let data = (0..width * height * channels).map(value).collect();
    let mut image = Image::new(width, height, names, data)?;
    (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
    Ok(image)
}

fn network<const D: usize, const C: usize>(architecture: Architecture, path: PathBuf) -> Result<()> {
    let domain = Domain::<D>::unit([6; D])?;
    let network = Network::<D, C>::new(architecture, Frame::of_cells(&domain), Output::of_range(0.0, 1.0), 1)?;
    let checkpoint =
        Checkpoint { network, domain, notes: Default::default(), range: [0.0, 1.0], training: None };
    Ok(fs::write(path, checkpoint.to_bytes()?)?)
}

/// The box from -1 to 1, turned by its node.
fn glb() -> Vec<u8> {
    const SIDES: [[u8; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let corner = |k: u8| [0, 1, 2].map(|d| if k >> d & 1 == 1 { 1.0f32 } else { -1.0 });
    let mut binary: Vec<u8> = (0..8).flat_map(|k| corner(k).map(f32::to_le_bytes).concat()).collect();
    binary.extend(SIDES.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]));
    let mut json = r#"{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [2, 1, 1], "rotation": [0, 0, 0.6, 0.8], "children": [1]}, {"translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5121, "count": 36, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 36}],
        "buffers": [{"byteLength": 132}]}"#
        .to_owned();
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let word = |n: usize| (n as u32).to_le_bytes();
    let chunk = |kind: &[u8; 4], data: &[u8]| [&word(data.len()), &kind[..], data].concat();
    let length = word(28 + json.len() + binary.len());
    [&b"glTF\x02\0\0\0"[..], &length, &chunk(b"JSON", json.as_bytes()), &chunk(b"BIN\0", &binary)].concat()
}
