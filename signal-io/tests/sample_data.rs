//! Real files, where they are at hand.

mod support;

use signal_io::{Image, ReadOptions, SampleType, Transfer, read_image};
use support::sample_data;

fn read(path: std::path::PathBuf) -> Image {
    read_image(path, &ReadOptions::default()).unwrap()
}

#[test]
fn high_dynamic_range_survives() {
    let Some(data) = sample_data() else { return };
    let exr = read(data.join("hdr_candle/background.exr"));
    assert_eq!(exr.channels()[..3], ["R", "G", "B"]);
    assert_eq!(exr.transfer, Transfer::Linear);
    let brightest = exr.as_planar().iter().copied().fold(0.0, f32::max);
    assert!((400.0..500.0).contains(&brightest), "the flame is at {brightest}");
    exr.select(&["R", "G", "B"]).unwrap().to_samples::<3>().unwrap().check_finite().unwrap();

    let png = read(data.join("hdr_candle/background16.png"));
    assert_eq!((png.sample, png.transfer), (SampleType::U16, Transfer::Srgb));
    assert_eq!((png.width(), png.height()), (exr.width(), exr.height()));
}

#[test]
fn every_picture_opens() {
    let Some(data) = sample_data() else { return };
    let mut count = 0;
    for folder in std::fs::read_dir(data).unwrap() {
        for file in std::fs::read_dir(folder.unwrap().path()).unwrap() {
            let image = read(file.unwrap().path());
            assert!(image.as_planar().iter().all(|v| v.is_finite()));
            assert!(matches!(image.color_count(), 1 | 3), "{:?}", image.channels());
            count += 1;
        }
    }
    assert!(count > 10, "{count} pictures");
}
