//! Wrong input: a clear message, a documented exit code, and no output file.

use std::fs;

use signal_io::{Image, SampleType};

use crate::support::{Folder, flat, smooth};

const PLACE: &str = "--at 12,9 -o out.png";

/// Runs `blend` with these arguments; it must fail with these words and leave the folder as it was.
#[track_caller]
fn refused(folder: &Folder, arguments: &str, code: i32, words: &[&str]) {
    let before = folder.names();
    let run = folder.run(&format!("blend {arguments}")).fails(code, words);
    assert_eq!(run.stdout(), "");
    assert_eq!(folder.names(), before);
}

#[test]
fn missing_file() {
    let folder = Folder::with_scene();
    refused(
        &folder,
        &format!("background.png nothing.png {PLACE}"),
        1,
        &["nothing.png", "does not exist"],
    );
    refused(&folder, &format!("background.png patch.png --mask no.png {PLACE}"), 1, &["no.png"]);
    refused(&folder, &format!("background.png . {PLACE}"), 1, &["."]);
}

#[test]
fn truncated_corrupt_and_empty_files() {
    let folder = Folder::with_scene();
    let bytes = fs::read(folder.path("patch.png")).unwrap();
    fs::write(folder.path("half.png"), &bytes[..bytes.len() / 2]).unwrap();
    fs::write(folder.path("noise.png"), b"this is no picture at all").unwrap();
    fs::write(folder.path("empty.png"), b"").unwrap();
    fs::write(folder.path("zero.pgm"), b"P5\n0 0\n255\n").unwrap();
    for name in ["half.png", "noise.png", "empty.png", "zero.pgm"] {
        refused(&folder, &format!("background.png {name} {PLACE}"), 1, &[name]);
        refused(&folder, &format!("{name} patch.png {PLACE}"), 1, &[name]);
    }
}

#[test]
fn masks_of_another_size_empty_full_or_out_of_range() {
    let folder = Folder::with_scene();
    folder.picture("small.png", &flat(29, 24, 1.0), SampleType::U8);
    folder.picture("black.png", &flat(30, 24, 0.0), SampleType::U8);
    folder.picture("bright.npy", &flat(30, 24, 255.0), SampleType::F32);
    let with = |mask: &str| format!("background.png patch.png --mask {mask} {PLACE}");
    refused(&folder, &with("small.png"), 1, &["small.png", "29 x 24", "30 x 24"]);
    refused(&folder, &with("black.png"), 1, &["black.png", "empty"]);
    refused(&folder, &with("bright.npy"), 1, &["bright.npy", "255", "between 0"]);
    refused(&folder, "background.png background.png -o out.png", 1, &["background.png", "--keep"]);
    folder.run("blend background.png background.png --keep 5 -o out.png").ok();
}

#[test]
fn patch_outside_or_nowhere() {
    let folder = Folder::with_scene();
    for place in ["--at 60,0", "--at -30,0", "--at 0,1e30", "--center 500,-500"] {
        let arguments = format!("background.png patch.png {place} -o out.png");
        refused(&folder, &arguments, 1, &["outside", "60 x 44", "30 x 24"]);
    }
    refused(&folder, "background.png patch.png -o out.png", 1, &["--at", "--center"]);
    // The patch reaches in, but no white pixel of its mask does.
    let corner = "background.png patch.png --mask mask.png --at 59,43 -o out.png";
    refused(&folder, corner, 1, &["nothing to paste", "--at"]);
}

#[test]
fn patch_partly_outside_works_with_a_warning() {
    let folder = Folder::with_scene();
    let run = folder.run("blend background.png patch.png --at -10,30 -o out.png").ok();
    assert!(run.stderr().contains("warning: the region reaches beyond"), "{}", run.stderr());
}

#[test]
fn channels_that_do_not_match() {
    let folder = Folder::with_scene();
    folder.picture("gray.png", &smooth(60, 44, 1, 0.0), SampleType::U8);
    folder.picture("gray_patch.png", &smooth(30, 24, 1, 0.0), SampleType::U8);
    folder.picture("two.npy", &smooth(30, 24, 2, 0.0), SampleType::F32);
    refused(&folder, &format!("gray.png patch.png {PLACE}"), 1, &["--gray", "gray.png"]);
    refused(&folder, &format!("background.png two.npy {PLACE}"), 1, &["two.npy", "2", "3"]);
    refused(&folder, &format!("background.png two.npy --gray {PLACE}"), 1, &["two.npy", "--gray"]);
    folder.run(&format!("blend gray.png patch.png --gray {PLACE}")).ok();
    folder.run("blend background.png gray_patch.png --at 12,9 -o out2.png").ok();
}

#[test]
fn values_that_are_not_finite() {
    let folder = Folder::with_scene();
    for (name, value) in [("nan.npy", f32::NAN), ("inf.npy", f32::INFINITY)] {
        let image = smooth(30, 24, 3, 0.0);
        let mut data = image.as_planar().to_vec();
        data[30 * 24 + 30 * 5 + 7] = value;
        let bad = Image::new(30, 24, &["R", "G", "B"], data).unwrap();
        folder.picture(name, &bad, SampleType::F32);
        refused(&folder, &format!("background.png {name} {PLACE}"), 1, &[name, "7,5", "channel G"]);
    }
    let huge = Image::new(30, 24, &["R", "G", "B"], vec![3e38; 30 * 24 * 3]).unwrap();
    folder.picture("huge.npy", &huge, SampleType::F32);
    let run = folder.run(&format!("blend background.png huge.npy {PLACE}"));
    assert!(matches!(run.code(), 0 | 1), "{}", run.stderr());
}

#[test]
fn options_out_of_range_are_usage_errors() {
    let folder = Folder::with_scene();
    let pictures = "background.png patch.png --at 12,9 -o out.png";
    for (option, words) in [
        ("--length 0", ["--length", "above 0"]),
        ("--length -3", ["--length", "above 0"]),
        ("--keep nan", ["--keep", "above 0"]),
        ("--feather -1", ["--feather", "0 or"]),
        ("--guidance soft", ["strongest:channel", "monochrome"]),
        ("--tolerance 2", ["--tolerance", "between 0 and 1"]),
        ("--center 4,4", ["--at", "--center"]),
        ("--lambda 3", ["--lambda", "paper"]),
        ("--objective dirichlet --length 3", ["--length", "screened"]),
        ("--threads 0", ["--threads", "1"]),
        ("--depth 12", ["--depth", "f16"]),
    ] {
        refused(&folder, &format!("{pictures} {option}"), 2, &words);
    }
    refused(&folder, "background.png patch.png --at 12 -o out.png", 1, &["12 has 1", "has 2"]);
    refused(&folder, "background.png patch.png --at 1;2 -o out.png", 2, &["X,Y"]);
    refused(&folder, "background.png", 2, &["PATCH"]);
    folder.run("").fails(2, &["Usage"]);
}

#[test]
fn targets_are_checked_before_the_work() {
    let folder = Folder::with_scene();
    folder.picture("taken.png", &flat(2, 2, 0.5), SampleType::U8);
    let before = fs::read(folder.path("taken.png")).unwrap();
    let with = |rest: &str| format!("background.png patch.png --at 12,9 {rest}");
    refused(&folder, &with("-o taken.png"), 1, &["taken.png", "--force"]);
    refused(&folder, &with("-o out.png --metrics taken.png"), 1, &["taken.png", "--force"]);
    refused(&folder, &with("-o no/out.png"), 1, &["no", "folder"]);
    refused(&folder, &with("-o out.png --metrics no/m.json"), 1, &["no", "folder"]);
    refused(&folder, &with("-o out.gif"), 1, &["out.gif", "png"]);
    refused(&folder, &with("-o out"), 1, &["out", "png"]);
    refused(&folder, &with("-o out.pgm"), 1, &["out.pgm", "--gray"]);
    refused(&folder, &with("-o out.png --depth f32"), 1, &["out.png", "float"]);
    refused(&folder, &with("-o a.png --metrics a.png"), 1, &["a.png", "two files"]);
    assert_eq!(fs::read(folder.path("taken.png")).unwrap(), before);
    // Even before the pictures are looked at.
    refused(&folder, "nothing.png nothing.png -o taken.png", 1, &["taken.png"]);
    folder.run(&format!("blend {}", with("-o taken.png --force"))).ok();
    assert_ne!(fs::read(folder.path("taken.png")).unwrap(), before);
}

#[test]
fn formats_that_cannot_hold_alpha_or_channels() {
    let folder = Folder::with_scene();
    let rgba = smooth(60, 44, 3, 0.0).with_alpha(&[0.5; 60 * 44]).unwrap();
    folder.picture("rgba.png", &rgba, SampleType::U8);
    folder.picture("five.npy", &smooth(60, 44, 5, 0.0), SampleType::F32);
    folder.picture("five_patch.npy", &smooth(30, 24, 5, 1.0), SampleType::F32);
    refused(&folder, "rgba.png patch.png --at 1,1 -o out.jpg", 1, &["out.jpg", "alpha", ".png"]);
    refused(
        &folder,
        "five.npy five_patch.npy --at 1,1 -o out.png",
        1,
        &["out.png", "5 colour", ".npy"],
    );
}

#[test]
fn joint_rules_need_channels_in_one_group() {
    let folder = Folder::new();
    folder.picture("b.npy", &smooth(40, 30, 11, 0.0), SampleType::F32);
    folder.picture("p.npy", &smooth(20, 15, 11, 1.0), SampleType::F32);
    let arguments = "b.npy p.npy --at 9,8 -o out.npy";
    for guidance in ["strongest", "monochrome"] {
        let words = ["11 channels", "strongest:channel"];
        refused(&folder, &format!("{arguments} --guidance {guidance}"), 1, &words);
    }
    folder.run(&format!("blend {arguments} --guidance strongest:channel --json")).ok();
    folder.run("compare b.npy p.npy --at 9,8").fails(1, &["11", "blend"]);
}
