//! Pictures and folders for the tests of this crate.
#![allow(dead_code)] // Each test binary uses its own part.

use std::path::{Path, PathBuf};

use signal_io::{
    Audio, AudioSample, Image, ReadOptions, Result, SampleType, Transfer, Video, WriteOptions,
};
use signal_io::{read_image, write_image};

/// Numbers that look random and are the same on every machine (SplitMix64).
pub(crate) fn random(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// A picture with random values that the sample type can hold exactly: flat parts and noise.
pub(crate) fn picture(w: usize, h: usize, channels: &[&str], sample: SampleType) -> Image {
    let mut next = random(w as u64 * 31 + h as u64);
    let data = (0..w * h * channels.len())
        .map(|k| {
            let bits = if k % w < w / 3 { 0x1234_5678_9abc_def0 } else { next() };
            match sample {
                SampleType::U8 => (bits >> 56) as f32 / 255.0,
                SampleType::U16 => (bits >> 48) as f32 / 65_535.0,
                // 11 significant bits, up to about 500 and down to about -500.
                SampleType::F16 => ((bits >> 53) as f32 - 1024.0) / 2.0,
                SampleType::F32 => ((bits >> 40) as f32 - 8_388_608.0) / 18_911.7,
            }
        })
        .collect();
    let mut image = Image::new(w, h, channels, data).unwrap();
    image.sample = sample;
    image.transfer = if sample.is_float() { Transfer::Linear } else { Transfer::Srgb };
    image
}

/// Noise that the sample type can hold exactly, both ends of its range included.
pub(crate) fn noise(rate_hz: u32, channels: usize, frames: usize, sample: AudioSample) -> Audio {
    let mut next = random(frames as u64 * 8 + channels as u64);
    // 32-bit integers have more bits than the floats that stand for them.
    let bits = if sample.is_float() { 24 } else { sample.bits().min(24) };
    let half = f64::from(1u32 << (bits - 1));
    let mut value = || ((next() >> (64 - bits)) as f64 / half - 1.0) as f32;
    let mut data: Vec<f32> = (0..channels * frames).map(|_| value()).collect();
    data[0] = -1.0;
    let mut audio = Audio::new(rate_hz, channels, data).unwrap();
    audio.sample = sample;
    audio
}

/// The bytes of a WAV file: the chunks `fmt ` and `data`, with these contents and true lengths.
pub(crate) fn wav(fmt: &[u8], data: &[u8]) -> Vec<u8> {
    let chunk = |name: &[u8], body: &[u8]| {
        let padding: &[u8] = if body.len() % 2 == 1 { &[0] } else { &[] };
        [name, &(body.len() as u32).to_le_bytes(), body, padding].concat()
    };
    let body = [b"WAVE".to_vec(), chunk(b"fmt ", fmt), chunk(b"data", data)].concat();
    chunk(b"RIFF", &body)
}

/// The `fmt ` chunk: 1 for integers and 3 for floats, channels, rate, bits.
pub(crate) fn wav_format(encoding: u16, channels: u16, rate_hz: u32, bits: u16) -> Vec<u8> {
    let frame = channels.wrapping_mul(bits / 8);
    let per_second = rate_hz.wrapping_mul(u32::from(frame));
    let parts = [
        &encoding.to_le_bytes()[..],
        &channels.to_le_bytes(),
        &rate_hz.to_le_bytes(),
        &per_second.to_le_bytes(),
        &frame.to_le_bytes(),
        &bits.to_le_bytes(),
    ];
    parts.concat()
}

/// The same as `WAVEFORMATEXTENSIBLE`, with that many significant bits.
pub(crate) fn wav_extensible(encoding: u16, channels: u16, bits: u16, valid: u16) -> Vec<u8> {
    let mut fmt = wav_format(0xfffe, channels, 48_000, bits);
    fmt.extend([22, 0]);
    fmt.extend(valid.to_le_bytes());
    fmt.extend([0; 4]); // No loudspeakers named.
    fmt.extend(encoding.to_le_bytes());
    fmt.extend([0, 0, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71]);
    fmt
}

/// A video with random values that the sample type can hold exactly.
pub(crate) fn video(shape: [usize; 3], channels: &[&str], sample: SampleType) -> Video {
    let [w, h, t] = shape;
    Video::from_strip(picture(w, h * t, channels, sample), t).unwrap()
}

/// The names in a folder, sorted; hidden ones included.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// An OpenEXR file with these layers: name, size, channels whose values are their running numbers.
pub(crate) fn layered_exr(layers: &[(&str, (usize, usize), &[&str])]) -> Vec<u8> {
    use exr::prelude::*;
    let mut number = 0.0;
    let mut all = Layers::new();
    for (name, size, channels) in layers {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
            .iter()
            .map(|channel| {
                number += 1.0;
                AnyChannel::new(*channel, FlatSamples::F32(vec![number; size.0 * size.1]))
            })
            .collect();
        let attributes = LayerAttributes::named(*name);
        let channels = AnyChannels::sort(list);
        all.push(Layer::new(*size, attributes, Encoding::FAST_LOSSLESS, channels));
    }
    let (w, h) = layers[0].1;
    let window = IntegerBounds::new((0, 0), (w, h));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let file = exr::prelude::Image::from_layers(ImageAttributes::new(window), all);
    file.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// The bytes of the file that this picture becomes.
pub(crate) fn file_bytes(extension: &str, image: &Image) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("picture.{extension}"));
    write_image(&path, image, &WriteOptions::default()).unwrap();
    std::fs::read(path).unwrap()
}

/// Writes and reads back.
pub(crate) fn round_trip(extension: &str, image: &Image, options: &WriteOptions) -> Result<Image> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("picture.{extension}"));
    write_image(&path, image, options)?;
    read_image(&path, &ReadOptions::default())
}

/// The folder of sample pictures, where there is one.
pub(crate) fn sample_data() -> Option<PathBuf> {
    sample_folder("2d")
}

/// The folder of sample recordings, where there is one.
pub(crate) fn sample_sounds() -> Option<PathBuf> {
    sample_folder("1d")
}

/// A folder of sample data, where there is one.
pub(crate) fn sample_folder(name: &str) -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    let folder = folder.join(name);
    let found = folder.is_dir().then_some(folder);
    if found.is_none() {
        println!("skipped: no sample data");
    }
    found
}

/// DWA stores what it cannot compress, such as noise, without its own structure; a ramp has it.
pub(crate) fn dwa() -> Vec<u8> {
    use exr::prelude::*;
    let ramp = (0..64 * 20).map(|k| f16::from_f32((k % 64) as f32)).collect();
    let encoding = Encoding {
        compression: Compression::DWAA(None),
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let list = [AnyChannel::new("R", FlatSamples::F16(ramp))];
    let channels = AnyChannels::sort(list.into_iter().collect());
    let mut bytes = std::io::Cursor::new(Vec::new());
    let file = Image::from_encoded_channels((64, 20), encoding, channels);
    file.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// A volume with random values that the number type can hold exactly: flat parts and noise.
pub(crate) fn volume(
    shape: [usize; 3],
    channels: usize,
    sample: signal_io::VoxelType,
) -> signal_io::Volume {
    let mut next = random(shape[0] as u64 * 31 + channels as u64);
    let [low, high] = sample.range().map(|v| v.clamp(-8_388_608.0, 8_388_607.0));
    let count = shape.iter().product::<usize>() * channels;
    let value = |k: usize| {
        let part =
            if k.is_multiple_of(3) { 0.25 } else { (next() >> 11) as f64 / (1u64 << 53) as f64 };
        (low + (high - low) * part).round() as f32
    };
    let data = (0..count).map(value).collect();
    let mut volume = signal_io::Volume::new(shape, channels, data).unwrap();
    volume.voxel_type = sample;
    volume
}

/// The bytes of the file that this volume becomes.
pub(crate) fn volume_bytes(
    extension: &str,
    volume: &signal_io::Volume,
    options: &signal_io::VolumeWriteOptions,
) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("volume.{extension}"));
    signal_io::write_volume(&path, volume, options).unwrap();
    std::fs::read(path).unwrap()
}
