//! Files that are cut short, altered or lying: always a typed error or a picture, never a panic and
//! never memory for what a header merely claims.

mod support;

use signal_io::{Error, Image, ReadOptions, Result, SampleType, decode_image};
use support::{file_bytes, picture, random};

fn decode(extension: &str, bytes: &[u8]) -> Result<Image> {
    decode_image(format!("damaged.{extension}"), bytes, &ReadOptions::default())
}

/// One small file of every format and depth that can be written.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    use SampleType::{F16, F32, U8, U16};
    let rgb = ["R", "G", "B"];
    let rgba = ["R", "G", "B", "A"];
    let list: [(&str, &[&str], SampleType); 19] = [
        ("png", &rgb, U8),
        ("png", &rgba, U16),
        ("png", &["Y"], U8),
        ("jpg", &rgb, U8),
        ("jpg", &["Y"], U8),
        ("tif", &rgb, U8),
        ("tif", &["Y", "A"], U16),
        ("tif", &rgba, F32),
        ("webp", &rgb, U8),
        ("webp", &rgba, U8),
        ("pgm", &["Y"], U16),
        ("ppm", &rgb, U8),
        ("pam", &["Y", "A"], U8),
        ("pfm", &rgb, F32),
        ("hdr", &rgb, F32),
        ("exr", &rgba, F16),
        ("exr", &["Y", "Z"], F32),
        ("npy", &rgb, F32),
        ("npy", &["Y"], U16),
    ];
    let file = |(ext, channels, sample)| (ext, file_bytes(ext, &picture(37, 21, channels, sample)));
    let mut files: Vec<_> = list.into_iter().map(file).collect();
    files.push(("gif", gif()));
    files.extend(other_exrs().into_iter().map(|bytes| ("exr", bytes)));
    files.extend(other_tiffs().into_iter().map(|bytes| ("tif", bytes)));
    files.push(("pgm", b"P2\n3 2\n9\n1 2 3\n4 5 6 ".to_vec()));
    files.push(("pbm", b"P1\n3 2\n1 0 1\n0 1 1 ".to_vec()));
    files.push(("pbm", b"P4\n9 2\n\x55\x80\xaa\0".to_vec()));
    files
}

/// A GIF by the `image` crate, as this one writes none.
fn gif() -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels: Vec<u8> = (0..20 * 10 * 3).map(|k| (k * 7 % 256) as u8).collect();
    let mut encoder = image::codecs::gif::GifEncoder::new(&mut bytes);
    encoder.encode(&pixels, 20, 10, image::ExtendedColorType::Rgb8).unwrap();
    drop(encoder);
    bytes
}

/// Compressions and tiles that this crate does not write.
fn other_exrs() -> Vec<Vec<u8>> {
    use exr::prelude::*;
    let image = picture(37, 21, &["R", "G", "B"], signal_io::SampleType::F16);
    let encode = |compression, blocks| {
        let plane = |c: usize| image.plane(c).iter().map(|v| f16::from_f32(*v)).collect();
        let channel = |(c, name)| AnyChannel::new(name, FlatSamples::F16(plane(c)));
        let list = [(0, "R"), (1, "G"), (2, "B")].map(channel);
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let mut bytes = std::io::Cursor::new(Vec::new());
        let channels = AnyChannels::sort(list.into_iter().collect());
        let file = Image::from_encoded_channels((37, 21), encoding, channels);
        file.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    };
    use Compression as C;
    let tiles = Blocks::Tiles(Vec2(16, 16));
    let methods = [C::Uncompressed, C::RLE, C::ZIP1, C::PIZ, C::PXR24, C::B44, C::B44A];
    let mut files: Vec<_> = methods.map(|c| encode(c, Blocks::ScanLines)).into();
    files.extend([encode(C::RLE, tiles), encode(C::PIZ, tiles)]);
    files.push(encode(C::DWAA(None), Blocks::ScanLines));
    files.push(support::dwa());
    files
}

/// Compressions that this crate does not write.
fn other_tiffs() -> Vec<Vec<u8>> {
    use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype::RGB16};
    let image = picture(37, 21, &["R", "G", "B"], SampleType::U16);
    let values = image.to_samples::<3>().unwrap().to_interleaved();
    let values: Vec<u16> = values.iter().map(|v| (v * 65_535.0).round() as u16).collect();
    let encode = |compression, predictor| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let encoder = TiffEncoder::new(&mut bytes).unwrap();
        let mut encoder = encoder.with_compression(compression).with_predictor(predictor);
        encoder.write_image::<RGB16>(37, 21, &values).unwrap();
        bytes.into_inner()
    };
    vec![
        encode(Compression::Lzw, Predictor::Horizontal),
        encode(Compression::Deflate(DeflateLevel::Fast), Predictor::None),
        encode(Compression::Packbits, Predictor::None),
    ]
}

/// Bytes at the end whose loss no reader notices, because the picture is complete without them.
fn idle_tail(extension: &str, bytes: &[u8]) -> usize {
    match extension {
        // The IEND chunk: 12 bytes; the checksum of the last IDAT chunk before it: 4 more.
        "png" => 16,
        // Strips come first; of the directory at the end, the values of the last tags are padding.
        "tif" => 0,
        // The last blank of a plain file.
        "pgm" | "pbm" if bytes.ends_with(b" ") => 1,
        // The end-of-data code, the block end and the trailer byte.
        "gif" => 4,
        _ => 0,
    }
}

#[test]
fn cut_files_are_errors() {
    for (extension, bytes) in files() {
        let whole = decode(extension, &bytes).unwrap();
        let step = (bytes.len() / 700).max(1);
        let ends = (0..bytes.len()).filter(|e| e % step == 0 || *e < 300 || e + 40 > bytes.len());
        for end in ends {
            match decode(extension, &bytes[..end]) {
                Err(Error::Corrupt { .. } | Error::Empty { .. }) => {}
                Err(Error::UnsupportedFeature { .. }) => {}
                Err(other) => panic!("{extension} cut at {end}: {other}"),
                Ok(picture) => {
                    let lost = bytes.len() - end;
                    assert!(
                        lost <= idle_tail(extension, &bytes),
                        "{extension}: {lost} bytes missed"
                    );
                    assert_eq!(picture, whole, "{extension} cut at {end}");
                }
            }
        }
    }
}

#[test]
fn altered_files_never_panic() {
    for (extension, bytes) in files() {
        let mut next = random(bytes.len() as u64);
        for round in 0..ROUNDS {
            let mut altered = bytes.clone();
            for _ in 0..1 + round % 4 {
                // Half of the changes go to the header, where they do most harm.
                let reach =
                    if next().is_multiple_of(2) { altered.len().min(200) } else { altered.len() };
                let at = (next() % reach as u64) as usize;
                altered[at] = match next() % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => altered[at] ^ 1 << (next() % 8),
                    _ => next() as u8,
                };
            }
            let _ = decode(extension, &altered);
        }
    }
}

/// Enough to find the usual off-by-one in seconds; 6000 have been run without another panic than the
/// one that `codec/exr.rs` tells of.
const ROUNDS: usize = 400;

#[test]
fn garbage_is_refused() {
    let mut next = random(1);
    let noise: Vec<u8> = (0..4096).map(|_| next() as u8).collect();
    for extension in signal_io::Format::READABLE.split(", ") {
        let result = decode(extension, &noise);
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{extension}: {result:?}");
        assert!(matches!(decode(extension, b""), Err(Error::Empty { .. })));
    }
    let result = decode("doc", &noise);
    assert!(
        matches!(result, Err(Error::UnsupportedFormat { ref extension, .. }) if extension == "doc")
    );
    // Every known beginning followed by noise.
    for (extension, bytes) in files() {
        for keep in [4, 8, 12, 16, 24, 32] {
            let mixed = [&bytes[..keep.min(bytes.len())], &noise].concat();
            let _ = decode(extension, &mixed);
        }
    }
}

#[test]
fn the_content_decides_not_the_name() {
    for (extension, bytes) in files() {
        let right = decode(extension, &bytes).unwrap();
        assert_eq!(decode("jpg", &bytes).unwrap(), right, "{extension} named jpg");
        assert_eq!(decode("", &bytes).unwrap(), right, "{extension} without extension");
    }
}
