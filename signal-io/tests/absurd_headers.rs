//! Headers that promise what no file can hold: refused before memory is taken for them.

mod support;

use signal_io::{Error, Image, ReadOptions, Result, SampleType, decode_image};
use support::{file_bytes, picture};

fn decode(extension: &str, bytes: &[u8]) -> Result<Image> {
    decode_image(format!("absurd.{extension}"), bytes, &ReadOptions::default())
}

/// Replaces a big- or little-endian number in a file.
fn patch(bytes: &[u8], at: usize, number: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out[at..at + number.len()].copy_from_slice(number);
    out
}

fn too_large(result: Result<Image>) -> bool {
    matches!(result, Err(Error::TooLarge { .. }))
}

/// The checksum of PNG chunks (CRC-32, reflected).
fn crc(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| c >> 1 ^ (0xedb8_8320 * (c & 1)))
    };
    !bytes.iter().fold(!0, step)
}

#[test]
fn absurd_png_headers() {
    let whole = file_bytes("png", &picture(37, 21, &["R", "G", "B"], SampleType::U8));
    let with_size = |side: u32| {
        let sized = patch(&patch(&whole, 16, &side.to_be_bytes()), 20, &side.to_be_bytes());
        let sum = crc(&sized[12..29]).to_be_bytes();
        patch(&sized, 29, &sum)
    };
    assert!(too_large(decode("png", &with_size(1_000_000_000))));
    let within_the_limit = decode("png", &with_size(18_000));
    assert!(matches!(within_the_limit, Err(Error::Corrupt { .. })), "{within_the_limit:?}");
    assert!(matches!(decode("png", &with_size(0)), Err(Error::Empty { .. })));
}

#[test]
fn absurd_tiff_headers() {
    for sample in [SampleType::U8, SampleType::F32] {
        let whole = file_bytes("tif", &picture(37, 21, &["Y"], sample));
        let find = |tag: u16| {
            let entry = [tag.to_le_bytes(), 4u16.to_le_bytes()].concat();
            whole.windows(4).position(|w| w == entry).unwrap() + 8
        };
        let with_size = |side: u32| {
            let sized = patch(&whole, find(256), &side.to_le_bytes());
            patch(&sized, find(257), &side.to_le_bytes())
        };
        // The strip table does not match such a height, which is found before the size is.
        let absurd = decode("tif", &with_size(1_000_000_000));
        assert!(
            matches!(absurd, Err(Error::Corrupt { .. } | Error::TooLarge { .. })),
            "{absurd:?}"
        );
        let within_the_limit = decode("tif", &with_size(18_000));
        assert!(matches!(within_the_limit, Err(Error::Corrupt { .. })), "{within_the_limit:?}");
    }
}

#[test]
fn absurd_exr_headers() {
    let whole = file_bytes("exr", &picture(37, 21, &["R", "G", "B"], SampleType::F32));
    let name = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = whole.windows(name.len()).position(|w| w == name).unwrap() + name.len();
    let with_size = |side: i32| {
        let sized = patch(&whole, at + 8, &(side - 1).to_le_bytes());
        patch(&sized, at + 12, &(side - 1).to_le_bytes())
    };
    assert!(too_large(decode("exr", &with_size(1_000_000_000))));
    let within_the_limit = decode("exr", &with_size(18_000));
    assert!(matches!(within_the_limit, Err(Error::Corrupt { .. })), "{within_the_limit:?}");
}

/// Once ended the program: the decoder allocated what a chunk claimed.
#[test]
fn absurd_dwa_chunks() {
    let whole = support::dwa();
    // The offset table has one entry, which points right behind itself; there, after line and
    // length, eleven counters begin.
    let entry = |at: &usize| whole[*at..*at + 8] == (*at as u64 + 8).to_le_bytes();
    let counters = (0..whole.len() - 8).find(entry).unwrap() + 16;
    assert!(decode("exr", &whole).is_ok());
    for k in [1, 6, 7, 8, 9] {
        let lying = patch(&whole, counters + 8 * k, &(1u64 << 45).to_le_bytes());
        assert!(matches!(decode("exr", &lying), Err(Error::Corrupt { .. })), "counter {k}");
    }
}

#[test]
fn absurd_text_headers() {
    for head in [
        "P5 {} {} 255\n",
        "P7\nWIDTH {}\nHEIGHT {}\nDEPTH 3\nMAXVAL 255\nENDHDR\n",
        "PF {} {} -1.0\n",
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n",
    ] {
        let with_size = |side: &str| [head.replace("{}", side).as_bytes(), &[2; 64]].concat();
        assert!(too_large(decode("", &with_size("1000000000"))), "{head}");
        assert!(matches!(decode("", &with_size("15000")), Err(Error::Corrupt { .. })), "{head}");
        assert!(decode("", &with_size("99999999999999999999999")).is_err(), "{head}");
        assert!(matches!(decode("", &with_size("0")), Err(Error::Empty { .. })), "{head}");
    }
}

#[test]
fn the_limit_is_the_decoded_size() {
    let image = picture(37, 21, &["R", "G", "B"], SampleType::U8);
    let needed = 37 * 21 * 3 * 4;
    for extension in ["png", "jpg", "tif", "webp", "ppm", "hdr", "exr", "npy", "pfm"] {
        let bytes = file_bytes(extension, &image);
        let with_limit =
            |limit_bytes| decode_image("", &bytes, &ReadOptions { limit_bytes, transfer: None });
        assert!(with_limit(needed).is_ok(), "{extension}");
        let result = with_limit(needed - 1);
        assert!(
            matches!(result, Err(Error::TooLarge { needed: n, .. }) if n == needed),
            "{extension}: {result:?}"
        );
    }
}
