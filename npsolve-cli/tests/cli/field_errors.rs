//! Wrong input to `fit`, `render` and `inspect`: a clear message, a documented exit code, no output file.

use std::fs;

use inr_core::{Architecture, Checkpoint, Domain, Frame, Network, Output};
use signal_io::{Image, SampleType};

use crate::support::{Folder, flat, smooth};

/// A small field with random numbers.
fn field<const D: usize, const C: usize>() -> Vec<u8> {
    let domain = Domain::unit([6; D]).unwrap();
    let (frame, output) = (Frame::of_cells(&domain), Output::of_range(0.0, 1.0));
    let network = Network::<D, C>::new(Architecture::siren(8, 1, 3.0), frame, output, 1).unwrap();
    let notes = Default::default();
    Checkpoint { network, domain, notes, range: [0.0, 1.0], training: None }.to_bytes().unwrap()
}

/// A folder with a picture `p.png` and a field `f.safetensors`.
fn folder() -> Folder {
    let folder = Folder::new();
    folder.picture("p.png", &smooth(24, 18, 3, 0.4), SampleType::U8);
    fs::write(folder.path("f.safetensors"), field::<2, 3>()).unwrap();
    folder
}

#[track_caller]
fn refused(folder: &Folder, arguments: &str, code: i32, words: &[&str]) {
    let before = folder.names();
    let run = folder.run(arguments).fails(code, words);
    assert_eq!(run.stdout(), "");
    assert_eq!(folder.names(), before);
}

#[test]
fn files_that_are_no_fields() {
    let folder = folder();
    let good = field::<2, 3>();
    let replaced = |from: &str, to: &str| {
        let at = good.windows(from.len()).position(|w| w == from.as_bytes()).expect(from);
        [&good[..at], to.as_bytes(), &good[at + from.len()..]].concat()
    };
    for (name, bytes, words) in [
        ("empty.safetensors", vec![], "no field"),
        ("text.safetensors", b"this is no field at all".to_vec(), "no field"),
        ("cut.safetensors", good[..good.len() - 5].to_vec(), "cut off"),
        ("head.safetensors", good[..100].to_vec(), "cut off"),
        ("foreign.safetensors", replaced("npsolve-field", "another-field"), "another program"),
        ("newer.safetensors", replaced(r#""version":"1""#, r#""version":"9""#), "newer npsolve"),
        ("damaged.safetensors", replaced(r#"\"depth\":1"#, r#"\"depth\":2"#), "damaged"),
    ] {
        fs::write(folder.path(name), bytes).unwrap();
        refused(&folder, &format!("render {name} -o out.png"), 1, &[name, words]);
        let inspected = folder.run(&format!("inspect {name}"));
        // The header of a damaged network may still be read.
        assert!(inspected.code() == 1 || name.starts_with("damaged"), "{name}");
        let resumed = format!("fit p.png -o {name} --resume");
        folder.run(&resumed).fails(1, &[name]);
    }
    refused(&folder, "render nothing.safetensors -o out.png", 1, &["nothing", "does not exist"]);
}

#[test]
fn the_content_says_what_a_file_is() {
    let folder = folder();
    for name in ["bare", "named.png"] {
        fs::copy(folder.path("f.safetensors"), folder.path(name)).unwrap();
        let text = folder.run(&format!("inspect {name}")).ok().stdout();
        assert!(text.contains("siren field"), "{text}");
    }
    fs::copy(folder.path("p.png"), folder.path("p.safetensors")).unwrap();
    folder.run("render p.safetensors -o out.png").ok();
}

#[test]
fn fields_that_are_no_pictures() {
    let folder = folder();
    for (name, bytes, words) in [
        ("audio.safetensors", field::<1, 1>(), ["1 coordinates", "6 samples"]),
        ("scan.safetensors", field::<3, 1>(), ["3 coordinates", "6 x 6 x 6"]),
        ("plenoptic.safetensors", field::<5, 1>(), ["5 coordinates", "6 x 6 x 6 x 6 x 6"]),
        ("many.safetensors", field::<2, 7>(), ["7 channels", "1 to 4"]),
    ] {
        fs::write(folder.path(name), bytes).unwrap();
        let command = format!("render {name} -o out.png --kind image");
        refused(&folder, &command, 1, &[name, words[0], words[1]]);
        folder.run(&format!("inspect {name}")).ok();
        folder.run(&format!("inspect --json {name}")).ok();
    }
    // Where nobody says that they are pictures, they are what they are.
    folder.run("render scan.safetensors -o slices.png").ok();
    refused(&folder, "render plenoptic.safetensors -o out.png", 1, &["5 coordinates"]);
}

#[test]
fn pictures_that_cannot_be_fitted() {
    let folder = folder();
    folder.picture("five.npy", &smooth(8, 6, 5, 0.0), SampleType::F32);
    folder.picture("nan.npy", &flat(8, 6, f32::NAN), SampleType::F32);
    let wide = Image::new(2, 1, &["Y"], vec![-3e38, 3e38]).unwrap();
    folder.picture("wide.npy", &wide, SampleType::F32);
    fs::write(folder.path("zero.pgm"), b"P5\n0 0\n255\n").unwrap();
    let fit = |name: &str| format!("fit {name} -o out.safetensors --steps 2");
    refused(&folder, &fit("five.npy"), 1, &["five.npy", "5 channels", "1, 2, 3, 4"]);
    refused(&folder, &fit("nan.npy"), 1, &["nan.npy", "NaN", "replace"]);
    refused(&folder, &fit("wide.npy"), 1, &["wide.npy", "scale"]);
    refused(&folder, &fit("zero.pgm"), 1, &["zero.pgm"]);
    refused(&folder, &fit("nothing.png"), 1, &["nothing.png", "does not exist"]);
    refused(&folder, &fit("f.safetensors"), 1, &["f.safetensors"]);
}

#[test]
fn a_fit_that_diverges_says_what_to_change() {
    let folder = folder();
    let fit = "fit p.png -o out.safetensors --field siren --width 16 --rate 1e4 --steps 200";
    refused(&folder, fit, 1, &["p.png", "diverged at step", "--rate (now 10000", "not written"]);
    let before = fs::read(folder.path("f.safetensors")).unwrap();
    let over = fit.replace("out.", "f.") + " --force";
    refused(&folder, &over, 1, &["f.safetensors is as it was"]);
    assert_eq!(fs::read(folder.path("f.safetensors")).unwrap(), before);
}

#[test]
fn targets_are_checked_before_the_work() {
    let folder = folder();
    let fit = |rest: &str| format!("fit p.png {rest}");
    refused(&folder, &fit("-o out.png"), 1, &["out.png", ".safetensors"]);
    refused(&folder, &fit("-o f.safetensors"), 1, &["f.safetensors", "--force"]);
    refused(&folder, &fit("-o no/f.safetensors"), 1, &["no", "folder"]);
    refused(&folder, &fit("-o out.safetensors --resume"), 1, &["out.safetensors", "--resume"]);
    let render = |rest: &str| format!("render f.safetensors {rest}");
    refused(&folder, &render("-o p.png"), 1, &["p.png", "--force"]);
    refused(&folder, &render("-o out.foo"), 1, &["out.foo", "png"]);
    refused(&folder, &render("-o out.pgm"), 1, &["out.pgm"]);
    refused(&folder, &render("-o out.png --depth f32"), 1, &["out.png", "float"]);
    refused(&folder, &render("-o out.png --gradient out.png"), 1, &["out.png", "two files"]);
    refused(&folder, &render("-o out.png --gradient no/g.exr"), 1, &["no", "folder"]);
    refused(&folder, &render("-o out.png --crop 0,0,7,6"), 1, &["f.safetensors", "6 x 6"]);
    refused(&folder, &render("-o out.png --size 90000x90000"), 1, &["f.safetensors", "--size"]);
    refused(&folder, &render("-o out.png --scale 1e30"), 1, &["f.safetensors", "--scale"]);
}

#[test]
fn wrong_command_lines_are_usage_errors() {
    let folder = folder();
    for (option, words) in [
        ("--omega 3", ["grid", "--omega"]),
        ("--field siren --table-rows 64", ["siren", "--table-rows"]),
        ("--field siren --table-rate 1", ["siren", "--table-rate"]),
        ("--interpolation cubic", ["grid", "--interpolation"]),
        ("--field hash --interpolation soft", ["--interpolation", "smoothstep"]),
        ("--features 5", ["--features", "1, 2, 3, 4 or 8"]),
        ("--field spline", ["--field", "grid"]),
        ("--table-rows 1000", ["--table-rows", "power of two"]),
        ("--budget 3h", ["--budget", "500ms"]),
        ("--target-psnr -4", ["--target-psnr", "above 0"]),
        ("--steps 0", ["--steps", "0"]),
        ("--rate 0", ["--rate", "above 0"]),
        ("--width 0", ["--width", "from 1"]),
    ] {
        refused(&folder, &format!("fit p.png -o out.safetensors {option}"), 2, &words);
    }
    for (option, words) in [
        ("--size 4", ["--size", "1280x960"]),
        ("--size 0x4", ["--size", "1280x960"]),
        ("--size 4x4 --scale 2", ["--size", "--scale"]),
        ("--scale -1", ["--scale", "above 0"]),
        ("--crop 1,2,3", ["--crop", "X,Y,W,H"]),
    ] {
        refused(&folder, &format!("render f.safetensors -o out.png {option}"), 2, &words);
    }
    refused(&folder, "render f.safetensors", 2, &["--output"]);
}
