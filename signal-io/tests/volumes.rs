//! Volumes through files: what comes back, and what damaged files do.

use std::fs;

use signal_io::{
    Error, ReadOptions, Scaling, Volume, VolumeWriteOptions, VoxelType, decode_volume, read_volume,
    write_volume,
};

const MAP: [[f64; 4]; 3] = [[-2.0, 0.0, 0.5, 90.0], [0.0, 1.5, 0.0, -126.0], [0.25, 0.0, 3.0, 7.0]];

fn volume(channels: usize) -> Volume {
    let data = (0..60 * channels).map(|v| (v * 7 % 120) as f32).collect();
    let mut volume = Volume::new([5, 4, 3], channels, data).unwrap();
    volume.set_affine(MAP).unwrap();
    volume
}

fn file(name: &str, volume: &Volume, voxel: VoxelType) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let options = VolumeWriteOptions { voxel: Some(voxel), ..VolumeWriteOptions::default() };
    assert_eq!(write_volume(&path, volume, &options).unwrap().clipped, 0);
    assert!(matches!(write_volume(&path, volume, &options), Err(Error::Exists { .. })));
    fs::read(&path).unwrap()
}

fn decode(name: &str, bytes: &[u8]) -> Result<Volume, Error> {
    decode_volume(name, bytes, &ReadOptions::default())
}

#[test]
fn every_format_and_type_round_trips() {
    for channels in [1, 2] {
        let volume = volume(channels);
        for voxel in VoxelType::ALL {
            for name in ["v.nii", "v.nii.gz", "v.npy"] {
                let read = decode(name, &file(name, &volume, voxel)).unwrap();
                assert_eq!(read.as_planar(), volume.as_planar(), "{name} {voxel}");
                assert_eq!((read.shape(), read.channels()), (volume.shape(), channels));
                assert_eq!(read.voxel, voxel);
                assert_eq!(read.has_affine(), name != "v.npy");
                if read.has_affine() {
                    assert_eq!(read.affine(), MAP);
                }
            }
        }
    }
}

#[test]
fn headers_and_scaling_are_kept() {
    let mut bytes = file("v.nii", &volume(1), VoxelType::I16);
    bytes[148..154].copy_from_slice(b"a scan"); // descrip
    bytes[112..116].copy_from_slice(&0.1f32.to_le_bytes()); // scl_slope
    bytes[116..120].copy_from_slice(&(-5.0f32).to_le_bytes()); // scl_inter
    let mut read = decode("v.nii", &bytes).unwrap();
    let slope = f64::from(0.1f32);
    assert_eq!(read.scaling, Scaling { slope, intercept: -5.0 });
    assert_eq!(read.as_planar()[1], (7.0 * slope - 5.0) as f32);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.nii");
    write_volume(&path, &read, &VolumeWriteOptions::default()).unwrap();
    assert!(fs::read(&path).unwrap() == bytes, "unchanged voxels, unchanged file");
    // Beyond the range of the numbers: clipped and counted.
    read.as_planar_mut()[0] = 1e9;
    read.as_planar_mut()[1] = f32::NAN;
    let options = VolumeWriteOptions { force: true, ..VolumeWriteOptions::default() };
    assert_eq!(write_volume(&path, &read, &options).unwrap().clipped, 2);
}

#[test]
fn both_byte_orders_versions_and_quaternions() {
    // A header of the second version, big-endian, with a turn of 90 degrees about z.
    let mut bytes = vec![0; 544 + 8];
    bytes[..4].copy_from_slice(&540i32.to_be_bytes());
    bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    bytes[12..14].copy_from_slice(&512i16.to_be_bytes());
    for (k, n) in [3i64, 2, 2, 1].into_iter().enumerate() {
        bytes[16 + 8 * k..24 + 8 * k].copy_from_slice(&n.to_be_bytes());
    }
    for (k, edge) in [1.0f64, 2.0, 3.0, 4.0].into_iter().enumerate() {
        bytes[104 + 8 * k..112 + 8 * k].copy_from_slice(&edge.to_be_bytes());
    }
    bytes[168..176].copy_from_slice(&544i64.to_be_bytes());
    bytes[344..348].copy_from_slice(&1i32.to_be_bytes());
    bytes[368..376].copy_from_slice(&0.5f64.sqrt().to_be_bytes());
    bytes[376..384].copy_from_slice(&10.0f64.to_be_bytes());
    bytes[503] = 3; // micrometres
    for (k, v) in [1u16, 2, 3, 40_000].into_iter().enumerate() {
        bytes[544 + 2 * k..546 + 2 * k].copy_from_slice(&v.to_be_bytes());
    }
    let read = decode("v.nii", &bytes).unwrap();
    assert_eq!(read.as_planar(), [1.0, 2.0, 3.0, 40_000.0]);
    let expected = [[0.0, -3e-3, 0.0, 1e-2], [2e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 4e-3, 0.0]];
    for (row, expected) in read.affine().iter().flatten().zip(expected.iter().flatten()) {
        assert!((row - expected).abs() < 1e-9, "{:?}", read.affine());
    }
}

#[test]
fn damaged_files_are_typed_errors() {
    for name in ["v.nii", "v.nii.gz", "v.npy"] {
        let bytes = file(name, &volume(1), VoxelType::U8);
        for length in 0..bytes.len() {
            let error = decode(name, &bytes[..length]).expect_err("cut short");
            assert!(error.to_string().contains(name), "{length}: {error}");
        }
        assert!(decode(name, &[bytes.clone(), vec![0]].concat()).is_err() || name == "v.nii.gz");
        for at in 0..bytes.len().min(400) {
            for value in [0, 1, 0x7f, 0x80, 0xff] {
                let mut altered = bytes.clone();
                altered[at] = value;
                let _ = decode(name, &altered); // Whatever it is now: no panic, no memory.
            }
        }
    }
}

#[test]
fn absurd_headers_take_no_memory() {
    let good = file("v.nii", &volume(1), VoxelType::U8);
    let with = |at: usize, new: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        decode("v.nii", &bytes).expect_err("absurd")
    };
    // 32767^3 voxels, and 2^40 in the second version.
    let many = 32_767i16.to_le_bytes();
    let error = with(42, &[many, many, many].concat());
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    let mut second = vec![0; 544];
    second[..4].copy_from_slice(&540i32.to_le_bytes());
    second[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    second[12..14].copy_from_slice(&2i16.to_le_bytes());
    second[168..176].copy_from_slice(&544i64.to_le_bytes());
    for (k, n) in [1i64, 1 << 40].into_iter().enumerate() {
        second[16 + 8 * k..24 + 8 * k].copy_from_slice(&n.to_le_bytes());
    }
    let error = decode("v.nii", &second).expect_err("absurd");
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    // Within the limit, but not in the file.
    let thousand = 1000i16.to_le_bytes();
    let error = with(42, &[thousand, thousand, thousand].concat());
    assert!(matches!(error, Error::Corrupt { .. }), "{error}");
    for (at, new) in [
        (40, &(-3i16).to_le_bytes()[..]),
        (42, &(-5i16).to_le_bytes()),
        (42, &[0, 0]),
        (70, &1792i16.to_le_bytes()),
        (108, &f32::NAN.to_le_bytes()),
        (108, &1e30f32.to_le_bytes()),
        (280, &f32::NAN.to_le_bytes()),
        (280, &[0; 48]),
        (344, b"nope"),
        (344, b"ni1\0"),
    ] {
        let error = with(at, new);
        let typed = matches!(error, Error::Corrupt { .. } | Error::UnsupportedFeature { .. });
        assert!(typed, "{at}: {error}");
    }
    assert!(matches!(decode("v.nii", &[]), Err(Error::Empty { .. })));
    assert!(matches!(decode("v.xyz", b"nothing"), Err(Error::UnsupportedFormat { .. })));
}

#[test]
fn sample_scans_are_read() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/3d");
    if !std::path::Path::new(folder).is_dir() {
        println!("skipped: no sample data");
        return;
    }
    for name in ["mni152_t1_2mm.nii.gz", "colin27_t1_2mm.nii.gz"] {
        let scan = read_volume(format!("{folder}/{name}"), &ReadOptions::default()).unwrap();
        assert_eq!((scan.shape(), scan.voxel), ([91, 109, 91], VoxelType::U8));
        assert_eq!(scan.voxel_size(), [2.0; 3]);
    }
    let path = format!("{folder}/nuclei_31x61x57_u16.npy");
    let nuclei = read_volume(path, &ReadOptions::default()).unwrap();
    assert_eq!((nuclei.shape(), nuclei.range()), ([57, 61, 31], Some([104.0, 375.0])));
}
