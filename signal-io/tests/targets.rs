//! Targets are checked early and replaced completely or not at all.

mod support;

use std::fs;

use signal_io::{
    Error, Image, ReadOptions, SampleType, WriteOptions, check_target, read_image, write_image,
};
use support::picture;

#[test]
fn targets_are_checked_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there.png");
    fs::write(&there, "precious").unwrap();

    assert!(check_target(folder.path().join("new.exr"), false).is_ok());
    assert!(matches!(check_target(&there, false), Err(Error::Exists { .. })));
    assert!(check_target(&there, true).is_ok());
    let missing = folder.path().join("no/such/a.png");
    assert!(matches!(check_target(missing, false), Err(Error::NoFolder { .. })));
    for name in ["a.gif", "a.pbm", "a.doc", "a", "png"] {
        let result = check_target(folder.path().join(name), false);
        assert!(matches!(result, Err(Error::UnsupportedFormat { .. })), "{name}");
    }
    fs::create_dir(folder.path().join("folder.png")).unwrap();
    let result = check_target(folder.path().join("folder.png"), true);
    assert!(matches!(result, Err(Error::NotAFile { .. })));
}

#[test]
fn an_existing_file_survives_refusals() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("there.png");
    fs::write(&path, "precious").unwrap();
    let image = picture(4, 4, &["R", "G", "B"], SampleType::U8);
    let keep = WriteOptions::default();
    assert!(matches!(write_image(&path, &image, &keep), Err(Error::Exists { .. })));
    // A failure with force leaves the old file, too.
    let impossible =
        WriteOptions { force: true, sample: Some(SampleType::F32), ..WriteOptions::default() };
    assert!(matches!(write_image(&path, &image, &impossible), Err(Error::CannotHold { .. })));
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    let force = WriteOptions { force: true, ..WriteOptions::default() };
    write_image(&path, &image, &force).unwrap();
    assert_eq!(read_image(&path, &ReadOptions::default()).unwrap(), image);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_failing_encoder_leaves_nothing() {
    // OpenEXR names must be Latin; this is found while encoding.
    let folder = tempfile::tempdir().unwrap();
    let image = Image::new(2, 2, &["深度"], vec![0.0; 4]).unwrap();
    let result = write_image(folder.path().join("a.exr"), &image, &WriteOptions::default());
    assert!(matches!(result, Err(Error::CannotHold { .. })), "{result:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn missing_files_and_folders_for_files() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str| read_image(folder.path().join(name), &ReadOptions::default());
    let error = read("nothing.png").unwrap_err();
    assert!(matches!(error, Error::NotFound { .. }));
    assert!(error.to_string().contains("nothing.png"), "{error}");
    assert!(matches!(read(""), Err(Error::Io { .. })));
    fs::write(folder.path().join("empty.png"), "").unwrap();
    assert!(matches!(read("empty.png"), Err(Error::Empty { .. })));
}

#[test]
fn a_file_longer_than_the_limit_is_not_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.ppm");
    let file = fs::File::create(&path).unwrap();
    std::io::Write::write_all(&mut &file, b"P6\n1 1\n255\nabc").unwrap();
    file.set_len(1 << 40).unwrap(); // Sparse: takes no space.
    let result = read_image(&path, &ReadOptions { limit_bytes: 1 << 20, ..Default::default() });
    assert!(matches!(result, Err(Error::TooLarge { needed, .. }) if needed == 1 << 40));
}

#[cfg(unix)]
#[test]
fn pipes_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&path).status();
    if !made.is_ok_and(|s| s.success()) {
        println!("skipped: no mkfifo");
        return;
    }
    let image = picture(4, 4, &["R", "G", "B"], SampleType::U8);
    let bytes = support::file_bytes("png", &image);
    let writer = {
        let path = path.clone();
        std::thread::spawn(move || fs::write(path, bytes))
    };
    assert_eq!(read_image(&path, &ReadOptions::default()).unwrap(), image);
    writer.join().unwrap().unwrap();
    // But a pipe is no target.
    let force = WriteOptions { force: true, ..WriteOptions::default() };
    let target = folder.path().join("pipe.png");
    fs::rename(&path, &target).unwrap();
    assert!(matches!(write_image(&target, &image, &force), Err(Error::NotAFile { .. })));
}
