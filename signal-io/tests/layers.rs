//! OpenEXR files of several layers.

mod support;

use signal_io::{Error, ReadOptions, WriteOptions, decode_image};
use support::{layered_exr, random, round_trip};

const RGBA: &[&str] = &["A", "B", "G", "R"];

#[test]
fn all_layers_come_with_their_names_and_go_back() {
    let layers = [
        ("beauty", (5, 3), RGBA),
        ("diffuse", (5, 3), &["diffuse.B", "diffuse.R"]),
        ("z", (5, 3), &["Z"]),
    ];
    let image = decode_image("a.exr", &layered_exr(&layers), &ReadOptions::default()).unwrap();
    let expected = [
        ("beauty.R", 4.0),
        ("beauty.G", 3.0),
        ("beauty.B", 2.0),
        ("beauty.A", 1.0),
        ("diffuse.R", 6.0),
        ("diffuse.B", 5.0),
        ("z.Z", 7.0),
    ];
    assert_eq!(image.channels(), expected.map(|(name, _)| name));
    for (c, (name, value)) in expected.into_iter().enumerate() {
        assert_eq!(image.plane(c), [value; 15], "{name}");
    }
    let back = round_trip("exr", &image, &WriteOptions::default()).unwrap();
    assert_eq!(back, image);
    assert_eq!(image.select(&["diffuse.R"]).unwrap().plane(0), [6.0; 15]);
}

#[test]
fn a_single_layer_needs_no_prefix() {
    let bytes = layered_exr(&[("beauty", (2, 2), &["B", "G", "R"])]);
    let image = decode_image("a.exr", &bytes, &ReadOptions::default()).unwrap();
    assert_eq!(image.channels(), ["R", "G", "B"]);
}

#[test]
fn layers_of_another_size_are_left_out() {
    let layers: [(&str, _, &[&str]); 3] =
        [("main", (4, 4), &["Y"]), ("thumbnail", (2, 2), &["Y"]), ("mask", (4, 4), &["Y"])];
    let image = decode_image("a.exr", &layered_exr(&layers), &ReadOptions::default()).unwrap();
    assert_eq!(image.channels(), ["main.Y", "mask.Y"]);
}

#[test]
fn the_limit_counts_all_layers() {
    let bytes = layered_exr(&[("a", (8, 8), &["Y"]), ("b", (8, 8), &["Y"])]);
    let read =
        |limit_bytes| decode_image("a.exr", &bytes, &ReadOptions { limit_bytes, transfer: None });
    assert!(read(8 * 8 * 4 * 2).is_ok());
    assert!(matches!(read(8 * 8 * 4 * 2 - 1), Err(Error::TooLarge { needed: 512, .. })));
}

#[test]
fn equal_names_are_refused() {
    // Different layers, but the names of their channels come out equal.
    let bytes = layered_exr(&[("a", (2, 2), &["b.Y"]), ("a.b", (2, 2), &["Y"])]);
    let result = decode_image("a.exr", &bytes, &ReadOptions::default());
    assert!(matches!(result, Err(Error::Corrupt { .. })), "{result:?}");
}

#[test]
fn damaged_layers_never_panic() {
    let bytes = layered_exr(&[("a", (9, 7), RGBA), ("b", (9, 7), &["Y"])]);
    for end in 0..bytes.len() {
        let cut = decode_image("a.exr", &bytes[..end], &ReadOptions::default());
        assert!(
            matches!(cut, Err(Error::Corrupt { .. } | Error::Empty { .. })),
            "cut at {end}: {cut:?}"
        );
    }
    let mut next = random(7);
    for _ in 0..1000 {
        let mut altered = bytes.clone();
        let at = (next() % altered.len() as u64) as usize;
        altered[at] = next() as u8;
        let _ = decode_image("a.exr", &altered, &ReadOptions::default());
    }
}
