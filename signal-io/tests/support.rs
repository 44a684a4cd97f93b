//! Pictures and folders for the tests of this crate.
#![allow(dead_code)] // Each test binary uses its own part.

use std::path::PathBuf;

use signal_io::{Image, ReadOptions, Result, SampleType, Transfer, WriteOptions};
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

fn sample_folder(name: &str) -> Option<PathBuf> {
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
