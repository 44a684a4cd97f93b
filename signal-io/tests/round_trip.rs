//! What is written is read back: integers exactly, floats bit for bit.

mod support;

use signal_io::{
    Error, Image, ReadOptions, SampleType, Transfer, WriteOptions, decode_image, write_image,
};
use support::{file_bytes, picture, round_trip};

const GRAY: [&str; 1] = ["Y"];
const GRAY_ALPHA: [&str; 2] = ["Y", "A"];
const RGB: [&str; 3] = ["R", "G", "B"];
const RGBA: [&str; 4] = ["R", "G", "B", "A"];

fn bits(image: &Image) -> Vec<u32> {
    image.as_planar().iter().map(|v| v.to_bits()).collect()
}

/// Everything comes back: names, sample type, and each value bit for bit.
fn comes_back(extension: &str, channels: &[&str], sample: SampleType) {
    // Sizes that are no multiple of strips, blocks, runs or bytes; and a single pixel.
    for (w, h) in [(37, 21), (1, 1), (3, 300), (300, 3), (129, 65)] {
        let image = picture(w, h, channels, sample);
        let back = round_trip(extension, &image, &WriteOptions::default()).unwrap();
        assert_eq!((back.width(), back.height()), (w, h), "{extension} {sample:?}");
        assert_eq!(back.channels(), channels, "{extension} {sample:?}");
        assert_eq!(back.sample, sample, "{extension} {channels:?}");
        assert_eq!(bits(&back), bits(&image), "{extension} {sample:?} {channels:?} {w} x {h}");
    }
}

#[test]
fn integers_in_lossless_formats() {
    use SampleType::{U8, U16};
    for channels in [&GRAY[..], &GRAY_ALPHA, &RGB, &RGBA] {
        for sample in [U8, U16] {
            for extension in ["png", "tif", "tiff", "pam"] {
                comes_back(extension, channels, sample);
            }
        }
    }
    for sample in [U8, U16] {
        comes_back("pgm", &GRAY, sample);
        comes_back("ppm", &RGB, sample);
        comes_back("pnm", &GRAY, sample);
        comes_back("pnm", &RGB, sample);
        comes_back("npy", &GRAY, sample);
        comes_back("npy", &["C0", "C1"], sample);
        comes_back("npy", &RGB, sample);
        comes_back("npy", &RGBA, sample);
        comes_back("npy", &["C0", "C1", "C2", "C3", "C4"], sample);
    }
    comes_back("webp", &RGB, U8);
    comes_back("webp", &RGBA, U8);
}

#[test]
fn webp_has_no_gray() {
    let gray = picture(37, 21, &GRAY, SampleType::U8);
    let back = round_trip("webp", &gray, &WriteOptions::default()).unwrap();
    assert_eq!(back, gray.to_rgb().unwrap());
}

#[test]
fn floats_bit_for_bit() {
    use SampleType::{F16, F32};
    for sample in [F16, F32] {
        for channels in [&GRAY[..], &GRAY_ALPHA, &RGB, &RGBA, &["Z", "a.R", "a.G", "a.B", "a.A"]] {
            comes_back("exr", channels, sample);
        }
        comes_back("npy", &RGB, sample);
        comes_back("npy", &["C0", "C1", "C2", "C3", "C4"], sample);
    }
    for channels in [&GRAY[..], &GRAY_ALPHA, &RGB, &RGBA] {
        comes_back("tif", channels, F32);
    }
    comes_back("pfm", &GRAY, F32);
    comes_back("pfm", &RGB, F32);
}

#[test]
fn float_files_keep_what_is_not_finite_and_signs() {
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, 443.25, -1e-40];
    for (extension, sample) in [
        ("exr", SampleType::F32),
        ("exr", SampleType::F16),
        ("npy", SampleType::F32),
        ("npy", SampleType::F16),
        ("tif", SampleType::F32),
        ("pfm", SampleType::F32),
    ] {
        let mut image = Image::new(3, 2, &GRAY, odd.to_vec()).unwrap();
        image.sample = sample;
        let back = round_trip(extension, &image, &WriteOptions::default()).unwrap();
        let got = back.as_planar();
        assert!(got[0].is_nan(), "{extension}");
        let finite = if sample == SampleType::F16 { 5 } else { 6 }; // -1e-40 is no half.
        for k in 1..finite {
            assert_eq!(got[k].to_bits(), odd[k].to_bits(), "{extension} {sample:?} {}", odd[k]);
        }
        assert!(back.to_samples::<1>().unwrap().check_finite().is_err());
    }
}

/// 8 bits for the largest of three components: half a step is 1/256 of it at worst.
const HDR_TOLERANCE: f32 = 1.001 / 256.0;

#[test]
fn radiance_keeps_eight_bits() {
    for (w, h) in [(37, 21), (1, 1), (7, 3), (8, 2), (300, 3)] {
        let mut image = picture(w, h, &RGB, SampleType::F32);
        image.as_planar_mut().iter_mut().for_each(|v| *v = v.abs());
        let back = round_trip("hdr", &image, &WriteOptions::default()).unwrap();
        let n = w * h;
        for k in 0..n {
            let largest = (0..3).map(|c| image.plane(c)[k]).fold(0.0, f32::max);
            for c in 0..3 {
                let (got, expected) = (back.plane(c)[k], image.plane(c)[k]);
                let error = (got - expected).abs();
                assert!(error <= HDR_TOLERANCE * largest, "{got} for {expected}: {error}");
            }
        }
        // What was read once is stable.
        let again = round_trip("hdr", &back, &WriteOptions::default()).unwrap();
        assert_eq!(bits(&again), bits(&back));
        // Grey becomes three equal channels.
        let gray = round_trip("hdr", &back.to_gray().unwrap(), &WriteOptions::default()).unwrap();
        assert_eq!(gray.plane(0), gray.plane(2));
    }
}

/// Quality 95 on a smooth ramp: 3/255 observed at most.
const JPEG_TOLERANCE: f32 = 5.0 / 255.0;

#[test]
fn jpeg_is_close() {
    for channels in [&GRAY[..], &RGB] {
        let value = |k: usize| (k % 64) as f32 / 80.0 + (k / 4096) as f32 * 0.05;
        let data = (0..64 * 64 * channels.len()).map(value).collect();
        let mut image = Image::new(64, 64, channels, data).unwrap();
        (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
        let back = round_trip("jpg", &image, &WriteOptions::default()).unwrap();
        assert_eq!(back.channels(), channels);
        for (got, expected) in back.as_planar().iter().zip(image.as_planar()) {
            let error = (got - expected).abs();
            assert!(error <= JPEG_TOLERANCE, "{got} for {expected}: {error}");
        }
        let small = WriteOptions { jpeg_quality: 30, ..Default::default() };
        assert!(round_trip("jpg", &image, &small).is_ok());
    }
}

#[test]
fn display_and_light_are_converted_where_formats_differ() {
    let srgb = picture(37, 21, &RGBA, SampleType::U16);
    // PNG to EXR and back: through linear light, to the same 16-bit numbers.
    let exr = round_trip("exr", &srgb, &WriteOptions::default()).unwrap();
    assert_eq!(exr, {
        let mut e = srgb.to_transfer(Transfer::Linear);
        e.sample = SampleType::F32;
        e
    });
    let options = WriteOptions { sample: Some(SampleType::U16), ..Default::default() };
    assert_eq!(round_trip("png", &exr, &options).unwrap(), srgb);
    // npy and float TIFF take the numbers as they are, and give them back so.
    for extension in ["npy", "tif"] {
        let options = WriteOptions { sample: Some(SampleType::F32), ..Default::default() };
        let array = round_trip(extension, &srgb, &options).unwrap();
        assert_eq!(array.transfer, Transfer::Unspecified);
        assert_eq!(bits(&array), bits(&srgb));
        let options = WriteOptions { sample: Some(SampleType::U16), ..Default::default() };
        assert_eq!(round_trip("png", &array, &options).unwrap(), srgb);
    }
    // The caller may know what the numbers of an array mean.
    let bytes = file_bytes("npy", &exr);
    let read = ReadOptions { transfer: Some(Transfer::Linear), ..Default::default() };
    assert_eq!(decode_image("a.npy", &bytes, &read).unwrap(), exr);
}

#[test]
fn default_depths() {
    use SampleType::{F16, F32, U8, U16};
    for (extension, from, to) in [
        ("png", F32, U16),
        ("png", F16, U16),
        ("jpg", F32, U8),
        ("jpg", U16, U8),
        ("webp", U16, U8),
        ("tif", F16, F32),
        ("exr", U8, F32),
        ("exr", F16, F16),
        ("hdr", U8, F32),
        ("npy", U8, U8),
        ("ppm", F32, U16),
    ] {
        let image = picture(9, 9, &RGB, from);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("a.{extension}"));
        let report = write_image(path, &image, &WriteOptions::default()).unwrap();
        assert_eq!(report.sample, to, "{extension} from {from:?}");
        assert_eq!(report.samples, 9 * 9 * 3);
    }
}

#[test]
fn clipped_colours_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let plane = [-0.5, 0.0, 1.0, 1.0005, 1.5, f32::NAN];
    let data = [plane, plane].concat();
    let image = Image::new(3, 2, &GRAY_ALPHA, data).unwrap();
    let clipped = |name: &str, sample| {
        let options = WriteOptions { force: true, sample, ..Default::default() };
        write_image(folder.path().join(name), &image, &options).unwrap().clipped
    };
    assert_eq!(clipped("a.png", Some(SampleType::U8)), 3);
    assert_eq!(clipped("a.png", None), 4, "1.0005 is out of range in 16 bits");
    assert_eq!(clipped("a.tif", None), 0);
    assert_eq!(clipped("a.exr", None), 0);
    let bright = Image::new(2, 1, &GRAY, vec![1e5, -3.0]).unwrap();
    let options = WriteOptions { sample: Some(SampleType::F16), ..Default::default() };
    let report = write_image(folder.path().join("bright.exr"), &bright, &options).unwrap();
    assert_eq!(report.clipped, 1);
    let report =
        write_image(folder.path().join("bright.hdr"), &bright, &options_default()).unwrap();
    assert_eq!((report.clipped, report.samples), (3, 6), "-3 in each of three equal channels");
}

fn options_default() -> WriteOptions {
    WriteOptions::default()
}

#[test]
fn what_a_format_cannot_hold() {
    use SampleType::{F16, F32, U8, U16};
    let five = ["C0", "C1", "C2", "C3", "C4"];
    let cases: [(&str, &[&str], Option<SampleType>); 15] = [
        ("png", &five, None),
        ("png", &RGB, Some(F32)),
        ("jpg", &RGBA, None),
        ("jpg", &RGB, Some(U16)),
        ("webp", &RGB, Some(F32)),
        ("hdr", &RGBA, None),
        ("hdr", &RGB, Some(U8)),
        ("pfm", &GRAY_ALPHA, None),
        ("pgm", &RGB, None),
        ("ppm", &RGBA, None),
        ("pam", &RGB, Some(F16)),
        ("exr", &RGB, Some(U16)),
        ("tif", &RGB, Some(F16)),
        ("tif", &five, None),
        ("png", &["A"], None),
    ];
    for (extension, channels, sample) in cases {
        let image = picture(4, 4, channels, U8);
        let options = WriteOptions { sample, ..Default::default() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("a.{extension}"));
        let error = write_image(&path, &image, &options).unwrap_err();
        assert!(matches!(error, Error::CannotHold { .. }), "{extension}: {error}");
        assert!(error.to_string().contains(path.to_str().unwrap()), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(signal_io::check_write(&path, &image, &options).is_err());
    }
    let wide = picture(70_000, 1, &GRAY, U8);
    for extension in ["jpg", "webp"] {
        let result = round_trip(extension, &wide, &WriteOptions::default());
        assert!(matches!(result, Err(Error::CannotHold { .. })));
    }
}
