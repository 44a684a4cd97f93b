use std::fs;

use super::*;
use crate::{WriteOptions, write_image};

/// Waves, with values beyond 0..1 in some formats' reach.
fn picture(width: usize, height: usize, names: &[&str], transfer: Transfer) -> Image {
    let value = |k: usize| 0.5 + 0.6 * (0.37 * k as f32).sin();
    let data = (0..width * height * names.len()).map(value).collect();
    let mut image = Image::new(width, height, names, data).unwrap();
    image.transfer = transfer;
    image
}

fn by_rows(path: &Path, options: &ReadOptions, rows: usize) -> Result<Image> {
    let mut reader = RowReader::open(path, options)?;
    let info = reader.info().clone();
    let mut planes = vec![Vec::new(); info.channels.len()];
    while let Some(band) = reader.read(rows)? {
        for (c, plane) in planes.iter_mut().enumerate() {
            plane.extend_from_slice(band.plane(c));
        }
    }
    assert!(reader.read(1)?.is_none());
    info.rows(planes.concat())
}

/// Number types and channels of every format that is written by rows.
fn cases() -> Vec<(&'static str, SampleType, &'static [&'static str])> {
    use SampleType::{F16, F32, U8, U16};
    let mut all = Vec::new();
    let usual: [&[&str]; 4] = [&["Y"], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]];
    for names in usual {
        all.extend([U8, U16].map(|s| ("a.png", s, names)));
        all.extend([U8, U16, F32].map(|s| ("a.tif", s, names)));
    }
    for names in [&["Y"][..], &["R", "G", "B", "A"], &["C0", "C1", "C2", "C3", "C4"]] {
        all.extend([U8, U16, F16, F32].map(|s| ("a.npy", s, names)));
    }
    all.extend([("a.pfm", F32, usual[0]), ("a.pfm", F32, usual[2])]);
    all
}

#[test]
fn bands_are_the_picture_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    for (name, sample, names) in cases() {
        let path = folder.path().join(name);
        let mut image = picture(37, 23, names, Transfer::Srgb);
        image.icc = Some(vec![7; 130]);
        let options = WriteOptions { force: true, sample: Some(sample), ..WriteOptions::default() };
        write_image(&path, &image, &options).unwrap();
        let read = ReadOptions::default();
        let whole = read_image(&path, &read).unwrap();
        for rows in [1, 5, 23, 100] {
            assert_eq!(by_rows(&path, &read, rows).unwrap(), whole, "{name} {sample:?} {names:?}");
        }
        // A tiny limit is no hindrance: nothing is decoded as a whole.
        let tiny = ReadOptions { limit_bytes: 37 * 23 * 40, ..read };
        assert!(!RowReader::open(&path, &tiny).unwrap().is_in_memory(), "{name}");
        let light = ReadOptions { transfer: Some(Transfer::Linear), ..read };
        assert_eq!(by_rows(&path, &light, 7).unwrap().transfer, Transfer::Linear);
    }
}

#[test]
fn files_written_by_rows_hold_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    for (name, sample, names) in cases() {
        for transfer in [Transfer::Srgb, Transfer::Linear] {
            let (at_once, path) =
                (folder.path().join(format!("whole-{name}")), folder.path().join(name));
            let mut image = picture(61, 33, names, transfer);
            image.icc = Some((0..131).collect());
            let options =
                WriteOptions { force: true, sample: Some(sample), ..WriteOptions::default() };
            let expected = write_image(&at_once, &image, &options).unwrap();
            let mut writer = RowWriter::create(&path, &PictureInfo::of(&image), &options).unwrap();
            let info = PictureInfo::of(&image);
            for (first, last) in [(0, 1), (1, 20), (20, 33)] {
                let part = |c| &image.plane(c)[first * 61..last * 61];
                let data: Vec<&[f32]> = (0..names.len()).map(part).collect();
                writer.push(&info.rows(data.concat()).unwrap()).unwrap();
            }
            assert_eq!(writer.finish().unwrap(), expected, "{name} {sample:?} {names:?}");
            let read = |path| read_image(path, &ReadOptions::default()).unwrap();
            assert_eq!(read(&path), read(&at_once), "{name} {sample:?} {names:?}");
        }
    }
}

#[test]
fn tiles_and_palettes_are_read_by_rows() {
    let folder = tempfile::tempdir().unwrap();
    let read = ReadOptions::default();
    for names in [&["Y"][..], &["R", "G", "B"]] {
        let path = folder.path().join("tiles.tif");
        let info = PictureInfo::of(&picture(37, 41, names, Transfer::Srgb));
        fs::write(&path, tiff::tiled(&info, |x, y, c| (x * 3 + y * 5 + c * 7) as u8)).unwrap();
        let whole = read_image(&path, &read).unwrap();
        assert_eq!(whole.plane(0)[40 * 37 + 36] * 255.0, (36 * 3 + 40 * 5 - 256) as f32);
        assert_eq!(by_rows(&path, &read, 10).unwrap(), whole);
    }
    let path = folder.path().join("palette.png");
    let mut encoder = ::png::Encoder::new(fs::File::create(&path).unwrap(), 5, 3);
    encoder.set_color(::png::ColorType::Indexed);
    encoder.set_depth(::png::BitDepth::Two);
    encoder.set_palette(vec![0, 10, 20, 30, 40, 50, 60, 70, 80]);
    encoder.write_header().unwrap().write_image_data(&[0b0001_1000, 0, 1, 0, 2, 64]).unwrap();
    let whole = read_image(&path, &read).unwrap();
    assert_eq!(by_rows(&path, &read, 2).unwrap(), whole);
}

#[test]
fn other_formats_are_decoded_whole_within_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let image = picture(40, 30, &["R", "G", "B"], Transfer::Srgb);
    for name in ["a.jpg", "a.ppm", "a.exr", "a.hdr", "a.webp"] {
        let path = folder.path().join(name);
        write_image(&path, &image, &WriteOptions::default()).unwrap();
        let read = ReadOptions { limit_bytes: 40 * 30 * 12, ..ReadOptions::default() };
        assert!(RowReader::open(&path, &read).unwrap().is_in_memory());
        assert_eq!(by_rows(&path, &read, 7).unwrap(), read_image(&path, &read).unwrap());
        let less = ReadOptions { limit_bytes: 40 * 30 * 12 - 1, ..read };
        let refused = RowReader::open(&path, &less).unwrap_err();
        assert!(matches!(refused, Error::NotByRows { action: "read", .. }), "{refused}");
        assert!(refused.to_string().contains("14400 bytes"), "{refused}");
        let target = folder.path().join(format!("b{name}"));
        let refused =
            RowWriter::create(&target, &PictureInfo::of(&image), &WriteOptions::default());
        assert!(matches!(refused, Err(Error::NotByRows { action: "written", .. })));
        assert!(!target.exists());
    }
}

#[test]
fn damaged_files_are_typed_errors() {
    let folder = tempfile::tempdir().unwrap();
    let image = picture(64, 64, &["R", "G", "B"], Transfer::Srgb);
    for name in ["a.png", "a.tif", "a.npy", "a.pfm"] {
        let path = folder.path().join(name);
        let options = WriteOptions { force: true, ..WriteOptions::default() };
        write_image(&path, &image, &options).unwrap();
        let bytes = fs::read(&path).unwrap();
        for keep in [0, 1, 2, 3, 9, 17, 40, 100, bytes.len() / 2, bytes.len() - 100] {
            fs::write(&path, &bytes[..keep]).unwrap();
            let result = by_rows(&path, &ReadOptions::default(), 9);
            assert!(
                matches!(
                    result,
                    Err(Error::Corrupt { .. }
                        | Error::Empty { .. }
                        | Error::UnsupportedFeature { .. })
                ),
                "{name} cut to {keep}: {result:?}"
            );
        }
    }
}

#[test]
fn unfinished_files_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let image = picture(8, 4, &["Y"], Transfer::Srgb);
    let mut info = PictureInfo::of(&image);
    info.height = 6;
    for name in ["a.png", "a.tif", "a.npy"] {
        let path = folder.path().join(name);
        let mut writer = RowWriter::create(&path, &info, &WriteOptions::default()).unwrap();
        writer.push(&image).unwrap();
        assert!(matches!(writer.push(&image), Err(Error::Shape { .. })), "two rows too many");
        assert!(matches!(writer.finish(), Err(Error::Shape { .. })), "two rows too few");
        drop(RowWriter::create(&path, &info, &WriteOptions::default()).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{name}");
    }
}
