//! What is written is read back: values, number types, places, units and texts.

mod support;

use signal_io::{
    Affine, Error, LengthUnit, Scaling, Volume, VolumeFormat, VolumeReadOptions,
    VolumeWriteOptions, VoxelType, check_volume_target, decode_volume, read_volume, write_volume,
};
use support::{volume, volume_bytes};

/// Axes swapped, one reversed, sizes that no two share; every entry is an f32.
const TURNED: Affine = [[0.0, -0.75, 0.0, 90.5], [2.0, 0.0, 0.0, -12.25], [0.0, 0.0, 3.5, 7.0]];

fn read(name: &str, bytes: &[u8]) -> Volume {
    decode_volume(name, bytes, &VolumeReadOptions::default()).unwrap()
}

/// Writes and reads through files, which the two-file format needs.
fn through(extension: &str, volume: &Volume, options: &VolumeWriteOptions) -> Volume {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("volume.{extension}"));
    let report = write_volume(&path, volume, options).unwrap();
    assert_eq!(report.clipped, 0, "{extension}");
    read_volume(&path, &VolumeReadOptions::default()).unwrap()
}

#[test]
fn values_and_types_round_trip_in_every_format() {
    for extension in ["nii", "nii.gz", "nrrd", "npy", "tif", "json"] {
        for sample in VoxelType::ALL {
            for channels in [1, 3] {
                let volume = volume([5, 4, 3], channels, sample);
                let back = through(extension, &volume, &VolumeWriteOptions::default());
                assert_eq!(back.voxel_type, sample, "{extension}");
                assert_eq!(back.as_planar(), volume.as_planar(), "{extension} {sample}");
                assert_eq!((back.shape(), back.channels()), ([5, 4, 3], channels), "{extension}");
            }
        }
    }
}

#[test]
fn places_units_and_texts_round_trip() {
    for extension in ["nii", "nii.gz", "nrrd", "json"] {
        let mut volume = volume([5, 4, 3], 1, VoxelType::I16).with_affine(TURNED).unwrap();
        volume.description = "a phantom, second run".to_owned();
        let back = through(extension, &volume, &VolumeWriteOptions::default());
        assert_eq!(back.affine(), &TURNED, "{extension}");
        assert_eq!(back.description, volume.description);
        assert_eq!(back.length_unit, LengthUnit::Millimetre);
    }
    for unit in [LengthUnit::Metre, LengthUnit::Micrometre] {
        for extension in ["nii", "nrrd"] {
            let mut volume = volume([5, 4, 3], 1, VoxelType::I16);
            volume.length_unit = unit;
            let back = through(extension, &volume, &VolumeWriteOptions::default());
            assert_eq!(back.length_unit, unit, "{extension}");
            // One rounding to f32, of lengths in the file's unit.
            assert!(back.voxel_size().iter().all(|s| (s - 1.0).abs() < 1e-7), "{extension}");
        }
    }
}

#[test]
fn both_versions_of_nifti_agree() {
    let volume = volume([5, 4, 3], 2, VoxelType::F32).with_affine(TURNED).unwrap();
    let first = volume_bytes("nii", &volume, &VolumeWriteOptions::default());
    let options = VolumeWriteOptions { nifti2: true, ..Default::default() };
    let second = volume_bytes("nii", &volume, &options);
    assert_eq!((first[0], second[0]), (348u32.to_le_bytes()[0], 540u32.to_le_bytes()[0]));
    let (a, b) = (read("a.nii", &first), read("b.nii", &second));
    assert_eq!(a.as_planar(), b.as_planar());
    assert_eq!((a.affine(), a.shape()), (b.affine(), b.shape()));
    // A volume from NIfTI-2 stays one, and its file the same.
    assert_eq!(volume_bytes("nii", &b, &VolumeWriteOptions::default()), second);
    assert_eq!(volume_bytes("nii", &a, &VolumeWriteOptions::default()), first);
}

/// A NIfTI-1 file from its definition, in either byte order: 2 x 1 x 1 numbers of i16, scaled.
fn nifti(little: bool, sform: i16, qform: i16) -> Vec<u8> {
    let mut out = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        if !little {
            bytes.reverse();
        }
        out[at..at + bytes.len()].copy_from_slice(&bytes);
    };
    put(0, &348i32.to_le_bytes());
    for (k, n) in [3i16, 2, 1, 1, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * k, &n.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for (k, size) in [-1.0f32, 2.0, 3.0, 4.0].into_iter().enumerate() {
        put(76 + 4 * k, &size.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(112, &0.5f32.to_le_bytes());
    put(116, &(-1024f32).to_le_bytes());
    put(123, &[2]);
    put(252, &qform.to_le_bytes());
    put(254, &sform.to_le_bytes());
    // Half a turn about z: the quaternion (0, 0, 0, 1).
    for (k, value) in [0.0f32, 0.0, 1.0, 10.0, 20.0, 30.0].into_iter().enumerate() {
        put(256 + 4 * k, &value.to_le_bytes());
    }
    let rows = [5.0f32, 0.0, 0.0, -1.0, 0.0, 6.0, 0.0, -2.0, 0.0, 0.0, 7.0, -3.0];
    for (k, value) in rows.into_iter().enumerate() {
        put(280 + 4 * k, &value.to_le_bytes());
    }
    out[344..348].copy_from_slice(b"n+1\0");
    for number in [100i16, -3] {
        out.extend(if little { number.to_le_bytes() } else { number.to_be_bytes() });
    }
    out
}

#[test]
fn nifti_by_its_definition() {
    for little in [true, false] {
        let both = read("both.nii", &nifti(little, 2, 1));
        assert_eq!(both.as_planar(), [0.5 * 100.0 - 1024.0, 0.5 * -3.0 - 1024.0]);
        assert_eq!(both.affine()[0], [5.0, 0.0, 0.0, -1.0]);
        let turned = read("turned.nii", &nifti(little, 0, 1));
        assert_eq!(turned.affine()[0], [-2.0, 0.0, 0.0, 10.0]);
        assert_eq!(turned.affine()[1], [0.0, -3.0, 0.0, 20.0]);
        assert_eq!(turned.affine()[2], [0.0, 0.0, -4.0, 30.0]); // Reflected: pixdim[0] < 0.
        let bare = read("bare.nii", &nifti(little, 0, 0));
        assert_eq!(bare.voxel_size(), [2.0, 3.0, 4.0]);
        assert_eq!(bare.to_world([0.0; 3]), [0.0; 3]);
        // What was read goes back as it was, the quaternion included.
        for (sform, qform) in [(2, 1), (0, 1), (0, 0)] {
            let volume = read("a.nii", &nifti(little, sform, qform));
            let bytes = volume_bytes("nii", &volume, &VolumeWriteOptions::default());
            let mut expected = nifti(true, sform, qform);
            expected[38] = b'r';
            assert_eq!(bytes, expected, "{sform} {qform}");
        }
    }
}

#[test]
fn what_is_not_understood_returns_to_nifti() {
    let plain = nifti(true, 2, 1);
    let mut file = plain[..348].to_vec();
    file[38] = b'r';
    file[39] = 0b11_01_10; // Directions of frequency, phase and slice.
    file[108..112].copy_from_slice(&384f32.to_le_bytes());
    file[124..128].copy_from_slice(&99.5f32.to_le_bytes()); // The brightest value to show.
    file[148..155].copy_from_slice(b"FSL 5.0");
    file[328..333].copy_from_slice(b"tract");
    file.extend([1, 0, 0, 0]);
    file.extend(32u32.to_le_bytes());
    file.extend(6u32.to_le_bytes()); // A comment.
    file.extend(b"<xml>header text</xml>\0\0");
    file.extend(&plain[352..]);
    assert_eq!(file.len(), 388);
    let volume = read("a.nii", &file);
    assert_eq!(volume.description, "FSL 5.0");
    assert_eq!(volume_bytes("nii", &volume, &VolumeWriteOptions::default()), file);

    let mut empty_field = plain;
    empty_field[108..112].fill(0);
    assert_eq!(read("b.nii", &empty_field).as_planar(), volume.as_planar());
}

#[test]
fn voxel_sizes_survive_in_stacks() {
    let scan = volume([5, 4, 3], 2, VoxelType::U16).with_voxel_size([0.25, 0.3, 1.75]).unwrap();
    let back = through("tif", &scan, &VolumeWriteOptions::default());
    assert_eq!(back.as_planar(), scan.as_planar());
    // Resolutions are fractions of a millionth.
    for (got, want) in back.voxel_size().iter().zip(scan.voxel_size()) {
        assert!((got - want).abs() < 1e-6, "{got} {want}");
    }
}

#[test]
fn values_nobody_changed_are_the_same_numbers() {
    for sample in [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16] {
        for scaling in [
            Scaling { slope: 0.003_921_568_859_368_563, intercept: -0.1 },
            Scaling { slope: -17.25, intercept: 1e4 },
            Scaling { slope: 1e-9, intercept: 0.0 },
        ] {
            let [min, max] = sample.range();
            let numbers: Vec<f64> =
                (0..=1000).map(|k| (min + (max - min) / 1000.0 * f64::from(k)).round()).collect();
            let values = numbers.iter().map(|n| {
                (scaling.slope as f32 as f64 * n + scaling.intercept as f32 as f64) as f32
            });
            let mut volume = Volume::new([1001, 1, 1], 1, values.collect()).unwrap();
            (volume.voxel_type, volume.scaling) = (sample, scaling);
            let bytes = volume_bytes("nii", &volume, &VolumeWriteOptions::default());
            let mut read_back = read("a.nii", &bytes);
            assert_eq!(read_back.as_planar(), volume.as_planar(), "{sample} {scaling:?}");
            // A blend changes a part; the other numbers in the file stay.
            read_back.as_planar_mut()[500] = read_back.as_planar()[300];
            let changed = volume_bytes("nii", &read_back, &VolumeWriteOptions::default());
            let differ: Vec<usize> =
                (0..bytes.len()).filter(|k| bytes[*k] != changed[*k]).collect();
            let at = 352 + 500 * sample.bytes();
            assert!(differ.iter().all(|k| (at..at + sample.bytes()).contains(k)), "{differ:?}");
        }
    }
}

#[test]
fn scaling_goes_where_there_is_room_for_it() {
    let mut volume = volume([5, 4, 3], 1, VoxelType::U8);
    volume.scaling = Scaling { slope: 0.5, intercept: -3.0 };
    volume.as_planar_mut().iter_mut().for_each(|v| *v = 0.5 * *v - 3.0);
    for extension in ["nii", "json"] {
        let back = through(extension, &volume, &VolumeWriteOptions::default());
        assert_eq!((back.scaling, back.voxel_type), (volume.scaling, VoxelType::U8));
        assert_eq!(back.as_planar(), volume.as_planar());
    }
    for extension in ["nrrd", "npy", "tif"] {
        let back = through(extension, &volume, &VolumeWriteOptions::default());
        assert_eq!((back.scaling, back.voxel_type), (Scaling::IDENTITY, VoxelType::F32));
        assert_eq!(back.as_planar(), volume.as_planar());
    }
    let spread = Scaling::spread(volume.range().unwrap(), VoxelType::I16);
    let options = VolumeWriteOptions {
        voxel_type: Some(VoxelType::I16),
        scaling: Some(spread),
        ..Default::default()
    };
    let back = through("nii", &volume, &options);
    let worst = back.as_planar().iter().zip(volume.as_planar()).map(|(a, b)| (a - b).abs());
    // Half a step of 16 bits over the range.
    assert!(worst.fold(0.0, f32::max) < 130.0 / 65_535.0);
}

#[test]
fn clipped_values_are_counted() {
    let data = vec![-5.0, 0.0, 255.4, 256.0, f32::NAN, 7.5];
    let mut volume = Volume::new([3, 2, 1], 1, data).unwrap();
    volume.voxel_type = VoxelType::U8;
    let folder = tempfile::tempdir().unwrap();
    for extension in ["nii", "nrrd", "npy", "tif", "json"] {
        let path = folder.path().join(format!("a.{extension}"));
        let report = write_volume(&path, &volume, &VolumeWriteOptions::default()).unwrap();
        assert_eq!((report.clipped, report.samples), (3, 6), "{extension}");
        let back = read_volume(&path, &VolumeReadOptions::default()).unwrap();
        assert_eq!(back.as_planar(), [0.0, 0.0, 255.0, 255.0, 0.0, 8.0], "{extension}");
    }
}

#[test]
fn nrrd_by_its_definition() {
    let text = |fields: &str, body: &str| {
        format!("NRRD0004\n# a comment\n{fields}\n\n{body}").into_bytes()
    };
    let lps = text(
        "type: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 1 3\n\
         space directions: (2,0,0) (0,0,1) (0,-3,0)\nkinds: domain domain domain\nencoding: ascii\n\
         space origin: (10,20,30)\nmodality:=MR",
        "1 2 3\n-4 5 6\n",
    );
    let volume = read("lps.nrrd", &lps);
    assert_eq!(volume.as_planar(), [1.0, 2.0, 3.0, -4.0, 5.0, 6.0]);
    assert_eq!(volume.to_world([0.0; 3]), [-10.0, -20.0, 30.0]);
    assert_eq!(volume.to_world([1.0, 1.0, 1.0]), [-12.0, -17.0, 31.0]);
    let again = volume_bytes("nrrd", &volume, &VolumeWriteOptions::default());
    assert_eq!(read("again.nrrd", &again), volume);

    let mut colours =
        text("type: uchar\ndimension: 4\nsizes: 2 1 2 1\nspacings: nan 0.5 2 4\nencoding: raw", "");
    colours.extend([1, 2, 3, 4]);
    let volume = read("colours.nrrd", &colours);
    assert_eq!((volume.shape(), volume.channels()), ([1, 2, 1], 2));
    assert_eq!(volume.as_planar(), [1.0, 3.0, 2.0, 4.0]);
    assert_eq!(volume.voxel_size(), [0.5, 2.0, 4.0]);

    let mut big = text("type: uint16\ndimension: 3\nsizes: 1 1 1\nendian: big\nencoding: raw", "");
    big.extend([1, 2]);
    assert_eq!(read("big.nrrd", &big).as_planar(), [258.0]);
}

#[test]
fn arrays_are_z_y_x() {
    let header = "{'descr': '<u2', 'fortran_order': ORDER, 'shape': (2, 1, 3)}\n";
    let file = |order: &str| {
        let header = header.replace("ORDER", order);
        let mut out = b"\x93NUMPY\x01\0".to_vec();
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.extend((0..6u16).flat_map(|n| n.to_le_bytes()));
        out
    };
    let rows = read("c.npy", &file("False"));
    assert_eq!((rows.shape(), rows.voxel_type), ([3, 1, 2], VoxelType::U16));
    assert_eq!(rows.as_planar(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    // Number z + 2 x in Fortran order.
    assert_eq!(read("f.npy", &file("True")).as_planar(), [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
}

#[test]
fn raw_volumes_are_described_by_json() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scan.json");
    std::fs::write(folder.path().join("scan.bin"), [9, 9, 0, 1, 0, 2, 1, 0, 255, 255]).unwrap();
    let json = r#"{ "file": "scan.bin", "shape": [2, 1, 1], "channels": 2, "dtype": "i16",
        "endian": "big", "order": "interleaved", "offset_bytes": 2, "spacing": [0.5, 1, 2],
        "slope": 2, "intercept": 1 }"#;
    std::fs::write(&path, json).unwrap();
    let volume = read_volume(&path, &VolumeReadOptions::default()).unwrap();
    assert_eq!(volume.as_planar(), [3.0, 513.0, 5.0, -1.0]);
    assert_eq!(volume.voxel_size(), [0.5, 1.0, 2.0]);
    for bad in [
        json.replace("scan.bin", "../scan.bin"),
        json.replace("scan.bin", "/etc/hostname"),
        json.replace("\"slope\": 2", "\"slope\": 0"),
        json.replace("spacing", "spacings"),
        json.replace("[0.5, 1, 2]", "[0.5, 1, 0]"),
        json.replace("[2, 1, 1]", "[3, 1, 1]"),
        json.replace("\"offset_bytes\": 2", "\"offset_bytes\": 2000"),
        json[..40].to_owned(),
    ] {
        std::fs::write(&path, &bad).unwrap();
        let result = read_volume(&path, &VolumeReadOptions::default());
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{bad}: {result:?}");
    }
    std::fs::write(&path, json.replace("scan.bin", "gone.bin")).unwrap();
    let gone = read_volume(&path, &VolumeReadOptions::default());
    assert!(matches!(gone, Err(Error::NotFound { path }) if path.ends_with("gone.bin")));
}

#[test]
fn targets_are_checked_and_replaced_completely() {
    let folder = tempfile::tempdir().unwrap();
    let volume = volume([3, 3, 3], 1, VoxelType::U8);
    for name in ["a.nii", "a.nii.gz", "a.nrrd", "a.npy", "a.tif", "a.json"] {
        let path = folder.path().join(name);
        check_volume_target(&path, false).unwrap();
        write_volume(&path, &volume, &VolumeWriteOptions::default()).unwrap();
        let refused = write_volume(&path, &volume, &VolumeWriteOptions::default());
        assert!(matches!(refused, Err(Error::Exists { .. })), "{name}");
        let force = VolumeWriteOptions { force: true, ..Default::default() };
        let report = write_volume(&path, &volume, &force).unwrap();
        assert_eq!(Some(report.format), VolumeFormat::from_extension(&path));
    }
    for name in ["a.nhdr", "a.gz", "a.tar.gz", "a.png", "a"] {
        let result = check_volume_target(folder.path().join(name), false);
        assert!(matches!(result, Err(Error::UnsupportedFormat { .. })), "{name}");
    }
    std::fs::write(folder.path().join("b.raw"), "precious").unwrap();
    let result = check_volume_target(folder.path().join("b.json"), false);
    assert!(matches!(result, Err(Error::Exists { .. })));
}
