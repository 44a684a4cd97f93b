//! Light fields come back as they were written, in every form; refocusing obeys closed forms.

mod support;

use std::fs;

use signal_io::{
    Error, Image, LightField, LightFieldFormat, LightFieldReadOptions, LightFieldWriteOptions,
    ReadOptions, SampleType, Transfer, WriteOptions, check_light_field_target, decode_light_field,
    read_light_field, write_image, write_light_field,
};
use support::{names_in, picture, random};

const RGB: [&str; 3] = ["R", "G", "B"];

fn random_field(shape: [usize; 4], channels: &[&str], sample: SampleType) -> LightField {
    let [w, h, u, v] = shape;
    LightField::from_strip(picture(w, h * u * v, channels, sample), [u, v]).unwrap()
}

fn read_plain() -> LightFieldReadOptions {
    LightFieldReadOptions::default()
}

fn write_plain() -> LightFieldWriteOptions {
    LightFieldWriteOptions::default()
}

#[test]
fn shapes_and_samples() {
    let shape = [2, 3, 4, 5];
    let data: Vec<f32> = (0..2 * 3 * 4 * 5 * 2).map(|k| k as f32).collect();
    let field = LightField::new(shape, &["a", "b"], data).unwrap();
    // (x, y, u, v) = (1, 2, 3, 4) of channel 1 is the last value.
    assert_eq!(field.as_planar()[(((5 + 4) * 4 + 3) * 3 + 2) * 2 + 1], 239.0);
    assert_eq!(field.view(3, 4).plane(1)[2 * 2 + 1], 239.0);
    assert_eq!(field.view(1, 0).plane(0)[0], 6.0, "u goes before v");
    let samples = field.to_samples::<2>(0.8).unwrap();
    assert_eq!(samples.domain().shape(), shape);
    assert_eq!(samples.domain().pitch(), [1.0, 1.0, 0.8, 0.8]);
    assert_eq!(samples.plane(1)[samples.domain().strides()[2]], 126.0);
    assert_eq!(LightField::from_samples(&samples, &field).unwrap(), field);
    let views: Vec<Image> = (0..20).map(|k| field.view(k % 4, k / 4)).collect();
    assert_eq!(LightField::from_views(&views, [4, 5]).unwrap(), field);
    assert!(matches!(LightField::from_views(&views, [4, 4]), Err(Error::Shape { .. })));
    let huge = LightField::from_strip(field.as_strip().clone(), [usize::MAX, usize::MAX]);
    assert!(matches!(huge, Err(Error::Shape { .. })));
    for pitch in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(field.to_samples::<2>(pitch), Err(Error::Shape { .. })), "{pitch}");
    }
}

#[test]
fn arrays_come_back_exactly() {
    use SampleType::{F16, F32, U8, U16};
    let folder = tempfile::tempdir().unwrap();
    for (k, (channels, sample)) in
        [(&RGB[..], U8), (&["Y"], U16), (&["C0", "C1"], F16), (&["R", "G", "B", "A"], F32)]
            .into_iter()
            .enumerate()
    {
        let field = random_field([5, 4, 3, 2], channels, sample);
        let path = folder.path().join(format!("{k}.npy"));
        check_light_field_target(&path, &write_plain()).unwrap();
        let report = write_light_field(&path, &field, &write_plain()).unwrap();
        assert_eq!((report.format, report.views), (LightFieldFormat::Array, 6));
        let text = String::from_utf8_lossy(&fs::read(&path).unwrap()[..128]).into_owned();
        let last =
            if channels.len() == 1 { String::new() } else { format!(", {}", channels.len()) };
        assert!(text.contains(&format!("(2, 3, 4, 5{last})")), "{text}");
        // An array does not say what its numbers mean.
        let read = ReadOptions { transfer: Some(field.transfer()), ..Default::default() };
        let options = LightFieldReadOptions { read, ..read_plain() };
        assert_eq!(read_light_field(&path, &options).unwrap(), field);
        let again = write_light_field(&path, &field, &write_plain());
        assert!(matches!(again, Err(Error::Exists { .. })));
    }
}

#[test]
fn folders_of_views() {
    let folder = tempfile::tempdir().unwrap();
    let field = random_field([5, 4, 11, 2], &RGB, SampleType::U16);
    let path = folder.path().join("chess");
    let report = write_light_field(&path, &field, &write_plain()).unwrap();
    assert_eq!((report.format, report.views), (LightFieldFormat::Views, 22));
    let names = names_in(&path);
    assert_eq!((names.len(), names[21].as_str()), (22, "view_01_10.png"));
    write_light_field(folder.path().join("r%dc%d.tif"), &field, &write_plain()).unwrap();
    let patterns = [
        "chess",
        "chess/view_%02d_%02d.png",
        "chess/*.png",
        "r%dc%d.tif",
        "r?c*.tif",
        "*%d*%d.tif",
    ];
    for pattern in patterns {
        let back = read_light_field(folder.path().join(pattern), &read_plain()).unwrap();
        assert_eq!(back, field, "{pattern}");
    }
    // A row is named first: view (u, v) = (10, 1).
    let view = signal_io::read_image(path.join("view_01_10.png"), &ReadOptions::default()).unwrap();
    assert_eq!(view, field.view(10, 1));

    // Replacing takes a grid of the same size.
    let force = LightFieldWriteOptions {
        write: WriteOptions { force: true, ..Default::default() },
        ..write_plain()
    };
    assert!(matches!(write_light_field(&path, &field, &write_plain()), Err(Error::Exists { .. })));
    write_light_field(&path, &field, &force).unwrap();
    let small = random_field([5, 4, 2, 2], &RGB, SampleType::U16);
    let result = write_light_field(&path, &small, &force);
    assert!(matches!(result, Err(Error::CannotHold { .. })), "{result:?}");

    fs::remove_file(path.join("view_01_03.png")).unwrap();
    let result = read_light_field(&path, &read_plain());
    assert!(matches!(result, Err(Error::MissingView { row: 1, column: 3, .. })), "{result:?}");
    write_image(path.join("view_01_03.png"), &picture(9, 9, &RGB, SampleType::U8), &force.write)
        .unwrap();
    let result = read_light_field(&path, &read_plain());
    let Err(Error::Mismatch { path: odd, .. }) = result else { panic!("{result:?}") };
    assert_eq!(odd, path.join("view_01_03.png"));
    fs::rename(path.join("view_01_03.png"), path.join("best.png")).unwrap();
    let result = read_light_field(&path, &read_plain());
    assert!(matches!(result, Err(Error::NoPlace { .. })), "{result:?}");
}

#[test]
fn lenslet_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let field = random_field([5, 4, 3, 2], &RGB, SampleType::U8);
    let path = folder.path().join("raw.png");
    let lenslet = LightFieldWriteOptions { lenslet: true, ..write_plain() };
    let result = write_light_field(&path, &field, &write_plain());
    assert!(matches!(result, Err(Error::UnsupportedFormat { .. })), "{result:?}");
    check_light_field_target(&path, &lenslet).unwrap();
    let report = write_light_field(&path, &field, &lenslet).unwrap();
    assert_eq!(report.format, LightFieldFormat::Lenslets);

    // Pixel (x * U + u, y * V + v) is pixel (x, y) of view (u, v).
    let image = signal_io::read_image(&path, &ReadOptions::default()).unwrap();
    assert_eq!((image.width(), image.height()), (15, 8));
    for (x, y, u, v) in [(0, 0, 0, 0), (4, 3, 2, 1), (2, 1, 1, 0), (1, 3, 0, 1)] {
        let expected = field.view(u, v).plane(1)[y * 5 + x];
        assert_eq!(image.plane(1)[(y * 2 + v) * 15 + x * 3 + u], expected);
    }
    let with_grid = |grid| LightFieldReadOptions { lenslet: grid, ..read_plain() };
    assert_eq!(read_light_field(&path, &with_grid(Some([3, 2]))).unwrap(), field);
    for grid in [None, Some([0, 2]), Some([4, 2]), Some([3, 3]), Some([usize::MAX, 1])] {
        let result = read_light_field(&path, &with_grid(grid));
        assert!(matches!(result, Err(Error::NotLenslets { .. })), "{grid:?}: {result:?}");
        assert!(result.unwrap_err().to_string().contains("raw.png"));
    }
    // An array of two or three axes is a picture.
    let array = folder.path().join("raw.npy");
    write_light_field(&array, &field, &lenslet).unwrap();
    let back = read_light_field(&array, &with_grid(Some([3, 2]))).unwrap();
    assert_eq!(back.as_planar(), field.as_planar());
}

/// A function that moves by `shift` pixels from view to view; in the middle view it is [`bump`].
fn wave(shape: [usize; 4], shift: f32) -> LightField {
    let [w, h, nu, nv] = shape;
    let mut data = Vec::new();
    for v in 0..nv {
        for u in 0..nu {
            let dx = shift * (u as f32 - (nu - 1) as f32 / 2.0);
            let dy = shift * (v as f32 - (nv - 1) as f32 / 2.0);
            for y in 0..h {
                data.extend((0..w).map(|x| bump(x as f32 - dx, y as f32 - dy)));
            }
        }
    }
    LightField::new(shape, &["Y"], data).unwrap()
}

fn bump(x: f32, y: f32) -> f32 {
    (0.3 * x).sin() + (0.2 * y + 0.1 * x).cos()
}

/// 1.4e-5 observed: a cubic spline through waves of 20 pixels, far from the border; three times that.
const SPLINE_TOLERANCE: f32 = 5e-5;

#[test]
fn refocusing_on_the_motion_undoes_it() {
    // Something that moves by -0.8 pixels from view to view.
    let field = wave([48, 40, 5, 3], -0.8);
    let sharp = field.refocused(-0.8);
    let mean = field.refocused(0.0);
    let mut blur: f32 = 0.0;
    for y in 8..32 {
        for x in 8..40 {
            let expected = bump(x as f32, y as f32);
            let error = (sharp.plane(0)[y * 48 + x] - expected).abs();
            assert!(error < SPLINE_TOLERANCE, "({x}, {y}): {error}");
            blur = blur.max((mean.plane(0)[y * 48 + x] - expected).abs());
        }
    }
    assert!(blur > 0.01, "without moving the views it is blurred: {blur}");
}

#[test]
fn refocusing_without_slope_is_the_mean() {
    let field = random_field([7, 6, 3, 2], &["R", "G", "B", "A"], SampleType::F32);
    let mean = field.refocused(0.0);
    assert_eq!((mean.channels(), mean.sample), (field.channels(), SampleType::F32));
    assert_eq!(mean.transfer, Transfer::Linear);
    for c in 0..4 {
        for k in 0..42 {
            let sum: f64 = (0..6).map(|n| f64::from(field.plane(c)[n * 42 + k])).sum();
            let (got, expected) = (mean.plane(c)[k], (sum / 6.0) as f32);
            // Values up to 444; a spline passes its samples to a few roundings.
            assert!((got - expected).abs() < 1e-3, "{got} for {expected}");
        }
    }
    // A single view is itself, whatever the slope.
    let single = random_field([7, 6, 1, 1], &["Y"], SampleType::U8);
    for slope in [0.0, 3.7, -1e9] {
        for (got, expected) in single.refocused(slope).plane(0).iter().zip(single.plane(0)) {
            assert!((got - expected).abs() < 1e-5, "{got} for {expected}");
        }
    }
    // Slopes that leave the picture give its mirror images, not a panic.
    assert_eq!(field.refocused(1e6).pixel_count(), 42);
}

#[test]
fn epipolar_pictures_are_slices() {
    let field = random_field([5, 4, 3, 2], &RGB, SampleType::U8);
    let slice = field.epipolar(2, 1);
    assert_eq!((slice.width(), slice.height()), (5, 3));
    for u in 0..3 {
        for c in 0..3 {
            let row = field.view(u, 1).plane(c)[2 * 5..3 * 5].to_vec();
            assert_eq!(&slice.plane(c)[u * 5..(u + 1) * 5], row);
        }
    }
}

#[test]
fn arrays_of_other_shapes_are_typed_errors() {
    let file = |shape: &str, bytes: usize| {
        let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}");
        header.push('\n');
        let mut out = b"\x93NUMPY\x01\0".to_vec();
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.resize(out.len() + bytes, 0);
        decode_light_field("a.npy", &out, &read_plain())
    };
    assert_eq!(file("(1, 2, 3, 4)", 24).unwrap().shape(), [4, 3, 2, 1]);
    assert!(matches!(file("(1, 2, 3, 4)", 23), Err(Error::Corrupt { .. })));
    assert!(matches!(file("(1, 2, 0, 4)", 0), Err(Error::Empty { .. })));
    assert!(matches!(file("(1, 2, 3, 4, 5, 6)", 720), Err(Error::UnsupportedFeature { .. })));
    assert!(matches!(file("(7,)", 7), Err(Error::UnsupportedFeature { .. })));
    for shape in [
        "(1048576, 1048576, 1, 1)",
        "(1, 1, 1048576, 1048576, 3)",
        "(4294967296, 4294967296, 4294967296, 4294967296)",
    ] {
        assert!(matches!(file(shape, 8), Err(Error::TooLarge { .. })), "{shape}");
    }
    assert!(matches!(file("(0, 4294967296, 4294967296, 9)", 0), Err(Error::Empty { .. })));
}

#[test]
fn damaged_arrays_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let field = random_field([5, 4, 3, 2], &RGB, SampleType::U8);
    write_light_field(&path, &field, &write_plain()).unwrap();
    let bytes = fs::read(&path).unwrap();
    for end in 0..bytes.len() {
        let cut = decode_light_field(&path, &bytes[..end], &read_plain());
        assert!(
            matches!(cut, Err(Error::Corrupt { .. } | Error::Empty { .. })),
            "cut at {end}: {cut:?}"
        );
    }
    let mut next = random(3);
    for _ in 0..5000 {
        let mut altered = bytes.clone();
        for _ in 0..2 {
            let at = (next() % 128) as usize;
            // Digits, brackets and commas do most harm.
            altered[at] = b"0123456789(),' TFf<>|"[(next() % 21) as usize];
        }
        let _ = decode_light_field("altered.npy", &altered, &read_plain());
    }
}
