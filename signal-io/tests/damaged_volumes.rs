//! Volumes that are cut short, altered or lying: a typed error that names the file or a volume, never a
//! panic and never memory for what a header merely claims.

mod support;

use signal_io::{
    Error, Result, Volume, VolumeReadOptions, VolumeWriteOptions, VoxelType, decode_volume,
    read_volume,
};
use support::{random, volume, volume_bytes};

fn decode(extension: &str, bytes: &[u8]) -> Result<Volume> {
    let result =
        decode_volume(format!("damaged.{extension}"), bytes, &VolumeReadOptions::default());
    if let Err(error) = &result {
        assert!(error.to_string().contains("damaged."), "{error}");
    }
    result
}

/// One small file of every format.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let plain = VolumeWriteOptions::default();
    let second = VolumeWriteOptions { nifti2: true, ..plain };
    let scan = volume([7, 5, 3], 1, VoxelType::I16);
    let colour = volume([5, 4, 3], 3, VoxelType::U8);
    let float = volume([5, 4, 3], 1, VoxelType::F32);
    let text = b"NRRD0004\ntype: short\ndimension: 3\nsizes: 2 1 2\nspacings: 1 2 3\nencoding: ascii\n\n1 2 3 44";
    let mut raw = b"NRRD0001\ntype: uchar\ndimension: 4\nsizes: 2 2 2 1\nspace directions: none (1,0,0) (0,2,0) (0,0,3)\nspace: LPS\nencoding: raw\n\n".to_vec();
    raw.extend(0..8);
    vec![
        ("nii", volume_bytes("nii", &scan, &plain)),
        ("nii", volume_bytes("nii", &colour, &second)),
        ("nii.gz", volume_bytes("nii.gz", &scan, &plain)),
        ("nrrd", volume_bytes("nrrd", &scan, &plain)),
        ("nrrd", volume_bytes("nrrd", &colour, &plain)),
        ("nrrd", text.to_vec()),
        ("nrrd", raw),
        ("npy", volume_bytes("npy", &scan, &plain)),
        ("npy", volume_bytes("npy", &colour, &plain)),
        ("tif", volume_bytes("tif", &scan, &plain)),
        ("tif", volume_bytes("tif", &float, &plain)),
    ]
}

#[test]
fn cut_files_are_errors() {
    for (extension, bytes) in files() {
        let whole = decode(extension, &bytes).unwrap();
        for end in 0..bytes.len() {
            match decode(extension, &bytes[..end]) {
                Err(Error::Corrupt { .. } | Error::Empty { .. }) => {}
                Err(Error::UnsupportedFeature { .. }) => {}
                Err(other) => panic!("{extension} cut at {end}: {other}"),
                // A digit of the last number of a text, or the values of a page table's last tags.
                Ok(_) if bytes.ends_with(b"44") && end + 1 == bytes.len() => {}
                Ok(other) => assert_eq!(other, whole, "{extension} cut at {end}"),
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
                // Most changes go to the header, where they do most harm.
                let length = altered.len();
                let reach = if next().is_multiple_of(4) { length } else { length.min(356) };
                let at = (next() % reach as u64) as usize;
                altered[at] = match next() % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => altered[at] ^ 1 << (next() % 8),
                    _ => next() as u8,
                };
            }
            if let Ok(volume) = decode(extension, &altered) {
                assert!(volume.voxel_size().iter().all(|s| *s > 0.0 && s.is_finite()));
                let _ = volume.domain();
            }
        }
    }
}

/// Enough to find the usual off-by-one in seconds; 1500 have been run.
const ROUNDS: usize = 300;

#[test]
fn garbage_is_refused() {
    let mut next = random(1);
    let noise: Vec<u8> = (0..4096).map(|_| next() as u8).collect();
    for extension in ["nii", "nii.gz", "nrrd", "npy", "tif"] {
        let result = decode(extension, &noise);
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{extension}: {result:?}");
        assert!(matches!(decode(extension, b""), Err(Error::Empty { .. })));
    }
    let json = decode("json", b"{}");
    assert!(matches!(json, Err(Error::UnsupportedFeature { .. })), "{json:?}");
    assert!(matches!(decode("doc", &noise), Err(Error::UnsupportedFormat { .. })));
    for (extension, bytes) in files() {
        for keep in [4, 8, 16, 32, 348, 352] {
            let _ = decode(extension, &[&bytes[..keep.min(bytes.len())], &noise].concat());
        }
    }
}

fn patch(bytes: &[u8], at: usize, number: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out[at..at + number.len()].copy_from_slice(number);
    out
}

fn corrupt(result: Result<Volume>) -> bool {
    matches!(result, Err(Error::Corrupt { .. }))
}

#[test]
fn absurd_nifti_headers() {
    let scan = volume([7, 5, 3], 1, VoxelType::I16);
    let turned = [[2.0, 0.0, 0.0, 1.0], [0.0, 3.0, 0.0, 1.0], [0.0, 0.0, 4.0, 1.0]];
    let scan = scan.with_affine(turned).unwrap();
    let first = volume_bytes("nii", &scan, &VolumeWriteOptions::default());
    let side = |n: i16| {
        let sized = patch(&first, 42, &n.to_le_bytes());
        patch(&patch(&sized, 44, &n.to_le_bytes()), 46, &n.to_le_bytes())
    };
    assert!(matches!(decode("nii", &side(30_000)), Err(Error::TooLarge { .. })));
    assert!(corrupt(decode("nii", &side(900)))); // Within the limit, but not within the file.
    assert!(corrupt(decode("nii", &side(-7))));
    assert!(matches!(decode("nii", &side(0)), Err(Error::Empty { .. })));
    for (at, number) in [
        (40, &9i16.to_le_bytes()[..]), // Axes.
        (40, &(-3i16).to_le_bytes()),
        (108, &1e30f32.to_le_bytes()), // Begin of the data.
        (108, &f32::NAN.to_le_bytes()),
        (108, &(-352f32).to_le_bytes()),
        (108, &347f32.to_le_bytes()),
        (112, &f32::INFINITY.to_le_bytes()), // Scaling.
        (116, &f32::NAN.to_le_bytes()),
        (280, &f32::NAN.to_le_bytes()), // Affine: not finite, singular, too large.
        (280, &0f32.to_le_bytes()),
        (292, &f32::INFINITY.to_le_bytes()),
        (344, b"nope"),
    ] {
        let result = decode("nii", &patch(&first, at, number));
        let known = matches!(result, Err(Error::Corrupt { .. } | Error::UnsupportedFeature { .. }));
        assert!(known, "{at}: {result:?}");
    }
    // A type that is not read: complex numbers.
    let complex = decode("nii", &patch(&first, 70, &32i16.to_le_bytes()));
    assert!(matches!(complex, Err(Error::UnsupportedFeature { .. })));

    let options = VolumeWriteOptions { nifti2: true, ..Default::default() };
    let second = volume_bytes("nii", &scan, &options);
    for n in [1i64 << 40, i64::MAX] {
        let result = decode("nii", &patch(&second, 24, &n.to_le_bytes()));
        assert!(matches!(result, Err(Error::TooLarge { .. })), "{result:?}");
    }
    assert!(corrupt(decode("nii", &patch(&second, 24, &(-1i64).to_le_bytes()))));
    let result = decode("nii", &patch(&second, 168, &i64::MAX.to_le_bytes()));
    assert!(matches!(result, Err(Error::UnsupportedFeature { .. })), "{result:?}");
}

#[test]
fn absurd_text_headers() {
    let nrrd = |fields: &str| {
        let file = format!("NRRD0004\n{fields}\nendian: little\n\n12345678");
        decode("nrrd", file.as_bytes())
    };
    let base = "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw";
    assert!(nrrd(base).is_ok());
    for encoding in ["raw", "gzip", "ascii"] {
        let huge = base.replace("2 2 2", "99999 99999 99999").replace("raw", encoding);
        assert!(matches!(nrrd(&huge), Err(Error::TooLarge { .. })));
        assert!(corrupt(nrrd(&base.replace("2 2 2", "900 900 900").replace("raw", encoding))));
    }
    assert!(matches!(nrrd(&base.replace("2 2 2", "2 0 2")), Err(Error::Empty { .. })));
    for bad in [
        base.replace("2 2 2", "2 -2 2"),
        base.replace("2 2 2", "2 2"),
        base.replace("2 2 2", "2 99999999999999999999999 2"),
        base.replace("type: uchar\n", ""),
        base.replace("encoding: raw", "no colon"),
        format!("{base}\nspace directions: (1,0,0) (0,1,0) (1,1,0)"),
        format!("{base}\nspace directions: (1,0,0) (0,1,0) (0,0,nan)"),
        format!("{base}\nspace directions: (1,0,0) (0,1,0) (0,0)"),
        format!("{base}\nspace directions: (1,0,0) (0,1,0) (0,0,1"),
        format!("{base}\nspace directions: (1,0,0) (0,1,0)"),
        format!("{base}\nspacings: 1 1 0"),
        format!("{base}\nspacings: 1 1"),
        format!("{base}\nspacings: 1 1 inf"),
    ] {
        assert!(corrupt(nrrd(&bad)), "{bad}: {:?}", nrrd(&bad));
    }
    for other in [
        format!("{base}\ndata file: other.raw"),
        format!("{base}\nbyte skip: -1"),
        base.replace("uchar", "block"),
        base.replace("raw", "bzip2"),
        base.replace("dimension: 3\nsizes: 2 2 2", "dimension: 2\nsizes: 4 2"),
    ] {
        assert!(matches!(nrrd(&other), Err(Error::UnsupportedFeature { .. })), "{other}");
    }
    let npy = |shape: &str| {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}");
        let mut file = b"\x93NUMPY\x01\0".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        decode("npy", &[&file, header.as_bytes(), &[0; 16]].concat())
    };
    assert!(npy("(1, 2, 2)").is_ok());
    let huge = npy("(1000000000, 1000000000, 1000000000)");
    assert!(matches!(huge, Err(Error::TooLarge { .. })));
    assert!(corrupt(npy("(900, 900, 900)")));
    assert!(matches!(npy("(0, 2, 2)"), Err(Error::Empty { .. })));
    assert!(matches!(npy("(2, 2)"), Err(Error::UnsupportedFeature { .. })));
}

/// A gigabyte of zeros in a megabyte: the limit holds, and so does what the header says.
#[test]
fn compressed_zeros_do_not_take_memory() {
    use std::io::Write;
    let small = volume_bytes("nii", &volume([4, 4, 4], 1, VoxelType::U8), &Default::default());
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    gzip.write_all(&small).unwrap();
    for _ in 0..256 {
        gzip.write_all(&[0; 1 << 16]).unwrap();
    }
    assert!(corrupt(decode("nii.gz", &gzip.finish().unwrap())));
}

#[test]
fn the_limit_is_the_decoded_size() {
    let scan = volume([7, 5, 3], 1, VoxelType::I16);
    let needed = 7 * 5 * 3 * 4;
    for extension in ["nii", "nii.gz", "nrrd", "npy", "tif"] {
        let bytes = volume_bytes(extension, &scan, &VolumeWriteOptions::default());
        let with = |limit_bytes| decode_volume("", &bytes, &VolumeReadOptions { limit_bytes });
        assert!(with(needed).is_ok(), "{extension}");
        let result = with(needed - 1);
        assert!(
            matches!(result, Err(Error::TooLarge { needed: n, .. }) if n == needed),
            "{extension}: {result:?}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.nii");
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap(); // Sparse: takes no space.
    let result = read_volume(&path, &VolumeReadOptions { limit_bytes: 1 << 20 });
    assert!(matches!(result, Err(Error::TooLarge { needed, .. }) if needed == 1 << 40));
    let missing = read_volume(folder.path().join("no.nii"), &VolumeReadOptions::default());
    assert!(matches!(missing, Err(Error::NotFound { .. })));
}
