//! `render`, and `inspect` of fields.

use inr_core::Spline;
use serde_json::Value;
use signal_io::{Image, ReadOptions, SampleType, Transfer, read_image};

use crate::support::{Folder, smooth};

/// 8-bit files of smooth pictures against splines in floats: half a grey level and f32 roundings.
const EIGHT_BITS: f32 = 0.5 / 255.0 + 1e-4;

fn read(folder: &Folder, name: &str) -> Image {
    read_image(folder.path(name), &ReadOptions::default()).expect(name)
}

fn psnr(a: &Image, b: &Image) -> f64 {
    assert_eq!((a.width(), a.height(), a.channels()), (b.width(), b.height(), b.channels()));
    let squares = a.as_planar().iter().zip(b.as_planar()).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / a.as_planar().len() as f64).log10()
}

/// A folder with a field `f.safetensors` of the picture `p.{extension}`.
fn fitted(image: &Image, extension: &str, sample: SampleType) -> Folder {
    let folder = Folder::new();
    folder.picture(&format!("p.{extension}"), image, sample);
    let fit = "-o f.safetensors --table-rows 256 --width 24 --steps 150";
    folder.run(&format!("fit p.{extension} {fit}")).ok();
    folder
}

#[test]
fn a_rendered_field_is_the_picture_it_was_fitted_to() {
    let with_alpha = |image: Image| {
        let alpha: Vec<f32> = image.plane(0).iter().map(|v| 1.2 * v).collect();
        image.with_alpha(&alpha).unwrap()
    };
    let linear = |mut image: Image| {
        image.transfer = Transfer::Linear;
        image
    };
    for (image, extension, sample) in [
        (smooth(26, 18, 3, 0.4), "png", SampleType::U8),
        (smooth(26, 18, 1, 0.4), "png", SampleType::U16),
        (with_alpha(smooth(26, 18, 3, 0.4)), "png", SampleType::U16),
        (with_alpha(smooth(26, 18, 1, 0.4)), "png", SampleType::U8),
        (linear(smooth(26, 18, 3, 0.4)), "exr", SampleType::F16),
        (smooth(26, 18, 2, 0.4), "npy", SampleType::F32),
    ] {
        let folder = fitted(&image, extension, sample);
        folder.run(&format!("render f.safetensors -o r.{extension}")).ok();
        let (was, is) =
            (read(&folder, &format!("p.{extension}")), read(&folder, &format!("r.{extension}")));
        assert_eq!((is.sample, is.transfer), (was.sample, was.transfer));
        let got = psnr(&was, &is);
        assert!(got > 32.0, "{:?}: {got} dB", image.channels());
    }
}

#[test]
fn opaque_alpha_is_left_out() {
    let image = smooth(20, 14, 3, 0.4).with_alpha(&[1.0; 280]).unwrap();
    let folder = fitted(&image, "png", SampleType::U8);
    folder.run("render f.safetensors -o r.png").ok();
    assert_eq!(read(&folder, "r.png").channels(), ["R", "G", "B"]);
}

#[test]
fn pictures_stand_for_their_splines() {
    let folder = Folder::new();
    let image = smooth(30, 20, 3, 0.7);
    folder.picture("p.npy", &image, SampleType::F32);
    folder.picture("p.png", &image, SampleType::U8);
    folder.run("render p.png -o same.png").ok();
    assert_eq!(read(&folder, "same.png").as_planar(), read(&folder, "p.png").as_planar());

    let spline = Spline::interpolate(&image.to_samples::<3>().unwrap());
    for (options, shape) in [("--scale 3", [90, 60]), ("--size 10x7", [10, 7])] {
        folder.run(&format!("render p.npy -o r.npy --force {options}")).ok();
        let expected = spline.resample(&image.domain().resized(shape).unwrap()).unwrap();
        let got = read(&folder, "r.npy");
        assert_eq!([got.width(), got.height()], shape);
        for (g, e) in got.as_planar().iter().zip(expected.as_planar()) {
            assert!((g - e).abs() < 1e-5, "{options}: got {g}, expected {e}");
        }
    }
    folder.run("render p.npy -o r.png --crop 4,6,10,8").ok();
    let (whole, part) = (read(&folder, "p.npy"), read(&folder, "r.png"));
    assert_eq!((part.width(), part.height()), (10, 8));
    let (a, b) = (part.plane(1)[3 + 10 * 2], whole.plane(1)[(4 + 3) + 30 * (6 + 2)]);
    assert!((a - b).abs() < EIGHT_BITS, "{a} {b}");
}

#[test]
fn many_channels_are_rendered_in_groups() {
    let folder = Folder::new();
    folder.picture("p.npy", &smooth(20, 12, 7, 0.2), SampleType::F32);
    folder.run("render p.npy -o r.npy --gradient g.npy").ok();
    assert!(psnr(&read(&folder, "p.npy"), &read(&folder, "r.npy")) > 100.0);
    assert_eq!(read(&folder, "g.npy").channels().len(), 14);
}

#[test]
fn gradients_are_those_of_the_picture() {
    let folder = Folder::new();
    let (w, h) = (30, 20);
    let value = |k: usize| 0.02 * (k % w) as f32 - 0.01 * (k / w) as f32 + 0.3;
    let image = Image::new(w, h, &["Y"], (0..w * h).map(value).collect()).unwrap();
    folder.picture("p.npy", &image, SampleType::F32);
    folder.run("render p.npy --gradient g.exr").ok();
    let g = read(&folder, "g.exr");
    // Away from the border, where the spline's mirror image bends it, the picture is a plane.
    let inner = 15 + w * 10;
    for (name, slope) in [("Y.dx", 0.02), ("Y.dy", -0.01)] {
        let got = g.plane_named(name).expect(name)[inner];
        assert!((got - slope).abs() < 1e-4, "{name}: {got}");
    }
    // Integers hold the lengths relative to the largest; twice the size, the slopes stay.
    let run = folder.run("render p.npy -o r.npy --scale 2 --gradient g.png --json").ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    let white = report["gradient"]["white"].as_f64().unwrap();
    let length = f64::from(read(&folder, "g.png").plane(0)[31 + 60 * 20]) * white;
    assert!((length - 0.02f64.hypot(0.01)).abs() < 1e-4, "{length}");
    assert_eq!(report["size"], serde_json::json!([60, 40]));
}

#[test]
fn a_field_can_be_enlarged_and_reduced() {
    let image = smooth(26, 18, 3, 0.4);
    let folder = fitted(&image, "png", SampleType::U8);
    folder.run("render f.safetensors -o half.npy --scale 0.5 --depth f32").ok();
    folder.run("render f.safetensors -o whole.npy --depth f32").ok();
    let (half, whole) = (read(&folder, "half.npy"), read(&folder, "whole.npy"));
    // Twice as coarse: the mean of the four samples on the fine lattice, which are those of the signal.
    for (x, y, c) in [(0, 0, 0), (12, 8, 2), (5, 3, 1)] {
        let at = |i: usize, j: usize| whole.plane(c)[2 * x + i + 26 * (2 * y + j)];
        let mean = 0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1));
        let got = half.plane(c)[x + 13 * y];
        assert!((got - mean).abs() < 1e-5, "{got} {mean}");
    }
    folder.run("render f.safetensors -o eye.png --crop 3.5,2,8,6 --size 80x60").ok();
    let eye = read(&folder, "eye.png");
    assert_eq!((eye.width(), eye.height(), eye.sample), (80, 60, SampleType::U8));
}

#[test]
fn inspect_describes_fields() {
    let folder = fitted(&smooth(26, 18, 3, 0.4), "png", SampleType::U16);
    let text = folder.run("inspect f.safetensors p.png").ok().stdout();
    for words in
        ["grid field over 26 x 18 samples", "(R, G, B)", "finished", "sample_type: u16", "SiLU"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    let run = folder.run("inspect --json f.safetensors p.png").ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    assert_eq!((&report[0]["field"], &report[0]["finished"]), (&"grid".into(), &true.into()));
    assert_eq!(report[0]["shape"], serde_json::json!([26, 18]));
    assert_eq!(report[0]["notes"]["encoding"], "srgb");
    assert_eq!(report[1]["width"], 26);
}
