//! Orientation is applied, profiles are carried.

mod support;

use signal_io::{Image, ReadOptions, SampleType, Transfer, WriteOptions, decode_image};
use support::{file_bytes, picture, round_trip};

/// An EXIF block that holds nothing but an orientation.
fn exif(orientation: u8) -> Vec<u8> {
    let mut tiff = b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    tiff.extend([orientation, 0, 0, 0, 0, 0, 0]);
    tiff
}

/// The same JPEG with an EXIF segment right after its start.
fn with_exif(jpeg: &[u8], orientation: u8) -> Vec<u8> {
    let payload = [&b"Exif\0\0"[..], &exif(orientation)].concat();
    let length = (payload.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, &payload, &jpeg[2..]].concat()
}

fn decode(bytes: &[u8]) -> Image {
    decode_image("test", bytes, &ReadOptions::default()).unwrap()
}

/// Where the brightest quarter of the picture lies.
fn bright_corner(image: &Image) -> (bool, bool) {
    let (w, h) = (image.width(), image.height());
    let at = |x: usize, y: usize| image.plane(0)[y * w + x] > 0.5;
    let corners = [(w / 4, h / 4), (3 * w / 4, h / 4), (w / 4, 3 * h / 4), (3 * w / 4, 3 * h / 4)];
    let found: Vec<_> = corners.into_iter().filter(|(x, y)| at(*x, *y)).collect();
    assert_eq!(found.len(), 1);
    (found[0].0 > w / 2, found[0].1 > h / 2)
}

#[test]
fn every_exif_orientation_turns_the_picture_upright() {
    // 48 x 32, bright at the top left.
    let value = |k: usize| if k % 48 < 24 && k / 48 < 16 { 1.0 } else { 0.0 };
    let mut image = Image::new(48, 32, &["Y"], (0..48 * 32).map(value).collect()).unwrap();
    (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
    let jpeg = file_bytes("jpg", &image);
    // Orientation, then where the stored top left belongs: (right, bottom), and whether sides swap.
    // Source: the EXIF tag 274 ("the 0th row is at the visual ..., the 0th column at ...").
    let table = [
        (1, (false, false), false),
        (2, (true, false), false),
        (3, (true, true), false),
        (4, (false, true), false),
        (5, (false, false), true),
        (6, (true, false), true),
        (7, (true, true), true),
        (8, (false, true), true),
    ];
    for (orientation, corner, swapped) in table {
        let upright = decode(&with_exif(&jpeg, orientation));
        let expected = if swapped { (32, 48) } else { (48, 32) };
        assert_eq!((upright.width(), upright.height()), expected, "orientation {orientation}");
        assert_eq!(bright_corner(&upright), corner, "orientation {orientation}");
    }
    assert_eq!(decode(&with_exif(&jpeg, 9)), decode(&jpeg), "unknown values change nothing");
}

#[test]
fn tiff_and_webp_orientation() {
    let image = picture(5, 3, &["R", "G", "B"], SampleType::U8);
    let turned = |stored: &Image, upright: &Image| {
        assert_eq!((upright.width(), upright.height()), (3, 5));
        for (x, y) in [(0, 0), (2, 0), (1, 4)] {
            // Orientation 6: turned clockwise by a quarter.
            assert_eq!(upright.plane(1)[y * 3 + x], stored.plane(1)[(2 - x) * 5 + y]);
        }
    };
    // TIFF: the tag goes where the resolution unit (296, SHORT) was; order is not checked.
    let mut tiff = file_bytes("tif", &image);
    let unit = [296u16.to_le_bytes(), 3u16.to_le_bytes()].concat();
    let at = tiff.windows(4).position(|w| w == unit).unwrap();
    tiff[at..at + 2].copy_from_slice(&274u16.to_le_bytes());
    tiff[at + 8] = 6;
    turned(&image, &decode(&tiff));

    let mut webp = Vec::new();
    let pixels = image.to_samples::<3>().unwrap().to_interleaved();
    let pixels: Vec<u8> = pixels.iter().map(|v| (v * 255.0).round() as u8).collect();
    let mut encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut webp);
    image::ImageEncoder::set_exif_metadata(&mut encoder, exif(6)).unwrap();
    encoder.encode(&pixels, 5, 3, image::ExtendedColorType::Rgb8).unwrap();
    turned(&image, &decode(&webp));

    let mut png = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut png);
    image::ImageEncoder::set_exif_metadata(&mut encoder, exif(6)).unwrap();
    image::ImageEncoder::write_image(encoder, &pixels, 5, 3, image::ExtendedColorType::Rgb8)
        .unwrap();
    turned(&image, &decode(&png));
}

#[test]
fn profiles_are_carried() {
    // Longer than one JPEG segment (65519 bytes of payload each).
    for length in [300, 70_000] {
        let profile: Vec<u8> = (0..length).map(|k| (k % 251) as u8).collect();
        let mut image = picture(20, 10, &["R", "G", "B"], SampleType::U8);
        image.icc = Some(profile.clone());
        for extension in ["png", "jpg", "tif", "webp"] {
            let back = round_trip(extension, &image, &WriteOptions::default()).unwrap();
            assert!(back.icc.as_deref() == Some(&profile), "{extension}, {length} bytes");
        }
        for extension in ["ppm", "exr", "hdr", "npy"] {
            let back = round_trip(extension, &image, &WriteOptions::default()).unwrap();
            assert_eq!(back.icc, None, "{extension} has no place for it");
        }
    }
}

#[test]
fn palettes_and_transparent_colours_become_channels() {
    use image::codecs::gif::GifEncoder;
    // A GIF with a transparent pixel has alpha, an opaque one has not.
    for (alpha, channels) in [(255, 3), (0, 4)] {
        let mut bytes = Vec::new();
        let pixels = [[255, 0, 0, 255], [0, 0, 255, alpha]].concat();
        let mut encoder = GifEncoder::new(&mut bytes);
        encoder.encode(&pixels, 2, 1, image::ExtendedColorType::Rgba8).unwrap();
        drop(encoder);
        let gif = decode(&bytes);
        assert_eq!(gif.channels().len(), channels);
        assert_eq!(gif.plane(0)[0], 1.0);
    }
}
