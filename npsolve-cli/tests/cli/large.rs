//! `blend --max-memory`: the same blends from file to file.

use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use signal_io::{Image, ReadOptions, SampleType, Transfer, read_image};

use crate::support::{Folder, disc, flat, smooth};

/// Forces blocks where the region is a few hundred pixels wide.
const LITTLE: &str = "--max-memory 52M";
const LITTLE_BYTES: u64 = 52 << 20;
/// What blocks may differ from the blend in memory, of values of order one; 16 bits add 8e-6.
const TOLERANCE: f32 = 1e-4;

fn read(folder: &Folder, name: &str) -> Image {
    read_image(folder.path(name), &ReadOptions::default()).expect(name)
}

/// Largest difference of two pictures that are alike in everything else.
#[track_caller]
fn difference(a: &Image, b: &Image) -> f32 {
    assert_eq!((a.width(), a.height(), a.channels()), (b.width(), b.height(), b.channels()));
    assert_eq!((a.sample, a.transfer, &a.icc), (b.sample, b.transfer, &b.icc));
    let pairs = a.as_planar().iter().zip(b.as_planar());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// A scene whose region needs many blocks.
fn wide_scene() -> Folder {
    let folder = Folder::new();
    folder.picture("background.png", &smooth(560, 520, 3, 0.3), SampleType::U16);
    folder.picture("patch.npy", &smooth(440, 430, 3, 2.0), SampleType::F32);
    folder.picture("mask.png", &disc(440, 430), SampleType::U8);
    folder
}

const WIDE: &str = "blend background.png patch.npy --mask mask.png --at 50,40 --length 8";

#[test]
fn blocks_give_the_blend_in_memory_within_the_limit() {
    let folder = wide_scene();
    let before = folder.names();
    folder.run(&format!("{WIDE} -o whole.png")).ok();
    let run = folder.run(&format!("{WIDE} -o blocks.png {LITTLE} --json")).ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    let (blocks, sweeps) = (report["blocks"].as_u64().unwrap(), report["sweeps"].as_u64().unwrap());
    assert!(blocks > 4 && sweeps > 1, "{report}");
    assert!(report["change"].as_f64() <= report["tolerance"].as_f64(), "{report}");
    assert!(report["scratch_bytes"].as_u64().unwrap() > 4 * 3 * 2 * 440 * 430, "{report}");
    if let Some(peak) = report["peak_memory_bytes"].as_u64() {
        assert!(peak <= LITTLE_BYTES, "{report}");
    }
    let (whole, in_blocks) = (read(&folder, "whole.png"), read(&folder, "blocks.png"));
    let largest = difference(&whole, &in_blocks);
    assert!(largest < TOLERANCE, "{largest}");
    assert!(difference(&whole, &read(&folder, "background.png")) > 0.05, "nothing was blended");
    let mut after = before;
    after.extend(["whole.png", "blocks.png"].map(str::to_owned));
    after.sort();
    assert_eq!(folder.names(), after);
}

#[test]
fn one_block_and_every_way_to_say_what_goes_where() {
    let folder = Folder::with_scene();
    let shade = |image: &Image, range: [f32; 2]| {
        let n = image.pixel_count();
        let alpha: Vec<f32> =
            (0..n).map(|k| range[0] + (range[1] - range[0]) * (k % 60) as f32 / 59.0).collect();
        image.clone().with_alpha(&alpha).unwrap()
    };
    let (background, patch) = (read(&folder, "background.png"), read(&folder, "patch.png"));
    folder.picture("shaded.png", &shade(&background, [0.2, 1.0]), SampleType::U16);
    let cut = patch.clone().with_alpha(disc(30, 24).plane(0)).unwrap();
    folder.picture("cut.png", &cut, SampleType::U8);
    folder.picture("background.tif", &background, SampleType::F32);
    folder.picture("gray.pfm", &background.to_gray().unwrap(), SampleType::F32);
    folder.picture("patch.jpg", &patch, SampleType::U8);
    let mask = flat(30, 24, 0.5).with_alpha(disc(30, 24).plane(0)).unwrap();
    folder.picture("alpha_mask.png", &mask, SampleType::U8);
    let mask = disc(30, 24).with_alpha(&[1.0; 720]).unwrap();
    folder.picture("opaque_mask.png", &mask, SampleType::U16);
    for (k, scene) in [
        "background.png patch.png --mask mask.png --at 12,9",
        "background.png patch.png --region ellipsoid:15,12:9,8 --at 12,9",
        "background.png patch.png --region box:3,4:25,20 --center 60,40",
        "background.png cut.png --at -8,30",
        "background.png patch.png --at 5,5 --guidance strongest",
        "background.png patch.png --mask alpha_mask.png --at 12,9 --guidance monochrome",
        "background.png patch.png --mask opaque_mask.png --at 12,9 --keep 6",
        "shaded.png cut.png --at 12,9 --domain linear",
        "background.tif patch.jpg --mask mask.png --at 12,9 --guidance mix:0.5,0.7",
        "gray.pfm patch.png --mask mask.png --at 12,9 --gray --domain srgb",
    ]
    .into_iter()
    .enumerate()
    {
        let extension = scene[..scene.find(' ').unwrap()].rsplit('.').next().unwrap();
        let [whole, blocks] = ["whole", "blocks"].map(|name| format!("{name}{k}.{extension}"));
        folder.run(&format!("blend {scene} -o {whole}")).ok();
        folder.run(&format!("blend {scene} -o {blocks} {LITTLE}")).ok();
        let (whole, blocks) = (read(&folder, &whole), read(&folder, &blocks));
        let largest = difference(&whole, &blocks);
        // Pictures of light are compared as light; the curve at black is 13 times as steep.
        assert!(largest < TOLERANCE, "{scene}: {largest}");
        assert_eq!(whole.alpha(), blocks.alpha(), "{scene}");
    }
    assert!(folder.names().iter().all(|name| !name.starts_with('.')), "{:?}", folder.names());
}

#[test]
fn pictures_of_eight_bits_differ_by_rounding_alone() {
    let folder = Folder::with_scene();
    let scene = "blend background.png patch.png --mask mask.png --at 12,9 --depth 8";
    folder.run(&format!("{scene} -o whole.png")).ok();
    folder.run(&format!("{scene} -o blocks.tif {LITTLE}")).ok();
    let (mut whole, blocks) = (read(&folder, "whole.png"), read(&folder, "blocks.tif"));
    assert_eq!(blocks.sample, SampleType::U8);
    whole.transfer = Transfer::Srgb;
    assert!(difference(&whole, &blocks) < 1.01 / 255.0);
}

#[cfg(unix)]
#[test]
fn a_stopped_blend_goes_on() {
    let folder = wide_scene();
    let command = format!("{WIDE} -o out.npy {LITTLE}");
    let start = || {
        let mut process = Command::new(assert_cmd::cargo::cargo_bin!("npsolve"));
        process.current_dir(folder.path("")).args(command.split_whitespace());
        process.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let (state, process) = (folder.path(".out.npy.npsolve-state"), start());
    for _ in 0..6000 {
        if state.exists() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    // While it works nobody else may use its files.
    folder.run(&command).fails(1, &["another npsolve", "out.npy"]);
    Command::new("kill").args(["-INT", &process.id().to_string()]).status().unwrap();
    let output = process.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("stopped") && message.contains("npsolve-state"), "{message}");
    let hidden: Vec<String> =
        folder.names().into_iter().filter(|name| name.starts_with('.')).collect();
    assert_eq!(hidden, [".out.npy.npsolve-state"]);

    folder.run(&command).ok();
    folder.run(&format!("{WIDE} -o whole.npy --depth 16")).ok();
    let largest = difference(&read(&folder, "whole.npy"), &read(&folder, "out.npy"));
    assert!(largest < TOLERANCE, "{largest}");
    assert!(folder.names().iter().all(|name| !name.starts_with('.')), "{:?}", folder.names());
}

#[test]
fn what_blocks_do_not_have_is_said() {
    let folder = Folder::with_scene();
    let before = folder.names();
    let scene = "blend background.png patch.png --mask mask.png --max-memory 1G";
    for (options, words) in [
        ("--at 12.5,9", &["12.5,9", "whole pixels"][..]),
        ("--at 12,9 --ramp", &["--ramp", "leave one of the two out"]),
        ("--at 12,9 --band", &["--band"]),
        ("--at 12,9 --feather 2", &["--feather"]),
        ("--at 12,9 --objective paper", &["--objective"]),
        ("--at 12,9 --metrics m.json", &["--metrics"]),
        ("--at 12,9 --field grid", &["--field"]),
        ("--at 12,9 --domain log", &["--domain"]),
        ("--at 12,9 --match-range", &["--match-range"]),
        ("--at 12,9 --kind volume", &["pictures"]),
        ("--at 900,9", &["outside"]),
    ] {
        folder.run(&format!("{scene} -o out.png {options}")).fails(1, words);
    }
    folder.run(&format!("{scene} --at 1,1 -o out.jpg")).fails(1, &["JPEG", ".tif", ".npy"]);
    folder.run(&format!("{scene} --at 1,1 -o patch.png")).fails(1, &["exists", "--force"]);
    folder.run(&format!("{scene} --at 1,1 -o no/out.png")).fails(1, &["no folder"]);
    folder.run(&format!("{scene} --max-memory 3T -o out.png")).fails(2, &["--max-memory"]);
    assert_eq!(folder.names(), before);
}

#[test]
fn the_least_memory_is_named_and_is_enough() {
    let folder = wide_scene();
    let refused = folder.run(&format!("{WIDE} -o out.png --max-memory 20M"));
    let message = refused.stderr();
    let least = message.split("pictures; ").nth(1).and_then(|rest| rest.split(' ').next());
    let least = least.expect("the least memory").to_owned();
    refused.fails(1, &["--max-memory", "too little", "is the least"]);
    let run = folder.run(&format!("{WIDE} -o out.png --max-memory {least} --json")).ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    assert!(report["blocks"].as_u64().unwrap() > 9, "{report}");
}

#[test]
fn bad_files_are_named_and_leave_nothing() {
    let folder = Folder::with_scene();
    let mut values = smooth(30, 24, 3, 1.0);
    values.as_planar_mut()[24 * 30 + 35] = f32::NAN;
    folder.picture("nan.npy", &values, SampleType::F32);
    folder.picture("black.png", &flat(30, 24, 0.0), SampleType::U8);
    folder.picture("bright.npy", &flat(30, 24, 2.0), SampleType::F32);
    folder.picture("small.png", &flat(29, 24, 1.0), SampleType::U8);
    let mut light = smooth(60, 44, 3, 0.3);
    light.as_planar_mut().iter_mut().for_each(|v| *v *= 5.0);
    light.transfer = Transfer::Linear;
    folder.picture("light.pfm", &light, SampleType::F32);
    let whole = std::fs::read(folder.path("background.png")).unwrap();
    std::fs::write(folder.path("half.png"), &whole[..whole.len() / 2]).unwrap();
    let before = folder.names();
    for (scene, words) in [
        ("background.png nan.npy --mask mask.png", &["nan.npy", "NaN", "5,1", "channel G"][..]),
        ("half.png patch.png --mask mask.png", &["half.png", "not a valid PNG"]),
        ("background.png patch.png --mask black.png", &["black.png", "empty"]),
        ("background.png patch.png --mask bright.npy", &["bright.npy", "2", "pixel 0,0"]),
        ("background.png patch.png --mask small.png", &["29 x 24", "30 x 24"]),
        ("background.png none.png", &["none.png", "does not exist"]),
        ("light.pfm patch.png --mask mask.png", &["light.pfm", "--domain linear"]),
        ("background.png patch.png --region box:40,40:50,50", &["nothing to paste"]),
    ] {
        folder.run(&format!("blend {scene} --at 12,9 -o out.png {LITTLE}")).fails(1, words);
    }
    // Decoded as a whole only where that fits a quarter of the memory.
    folder.picture("large.jpg", &smooth(1300, 900, 3, 0.3), SampleType::U8);
    folder
        .run(&format!("blend large.jpg patch.png --at 12,9 -o out.png {LITTLE}"))
        .fails(1, &["large.jpg", "decoded as a whole", "14040000 bytes", "convert it to PNG"]);
    std::fs::remove_file(folder.path("large.jpg")).unwrap();
    assert_eq!(folder.names(), before);
}
