//! `blend` into networks from end to end.

use std::fs;

use inr_core::{Checkpoint, Encoding, Field};
use serde_json::Value;
use signal_io::{Image, ReadOptions, SampleType, read_image};

use crate::support::{Folder, disc, smooth};

const BLEND: &str = "blend background.png patch.png --mask mask.png --at 12,9";

fn read(folder: &Folder, name: &str) -> Image {
    read_image(folder.path(name), &ReadOptions::default()).expect(name)
}

fn metrics(folder: &Folder, arguments: &str) -> Value {
    let run = folder.run(&format!("{arguments} --json")).ok();
    serde_json::from_str(&run.stdout()).expect("JSON")
}

fn largest_difference(a: &Image, b: &Image) -> f32 {
    a.as_planar().iter().zip(b.as_planar()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_grid_is_the_exact_blend_as_a_picture_and_as_a_file() {
    let folder = Folder::with_scene();
    folder.run(&format!("{BLEND} -o exact.exr")).ok();
    let report = metrics(&folder, &format!("{BLEND} --field grid -o grid.exr"));
    assert_eq!(
        (&report["solver"], &report["network"]["steps"]),
        (&"grid-screened".into(), &0.into())
    );
    assert!(report["excess_energy"].as_f64().unwrap() < 1e-3, "{report}");
    // Half floats of values below 1, and an exact solution to 1e-4.
    assert!(largest_difference(&read(&folder, "exact.exr"), &read(&folder, "grid.exr")) < 2e-3);

    // The file's name alone asks for a network of the whole picture.
    folder.run(&format!("{BLEND} -o grid.safetensors")).ok();
    folder.run("render grid.safetensors -o rendered.exr --depth f32").ok();
    assert!(largest_difference(&read(&folder, "exact.exr"), &read(&folder, "rendered.exr")) < 2e-3);
}

#[test]
fn networks_blend_into_a_network_of_the_backgrounds_kind() {
    let folder = Folder::new();
    folder.picture("s.png", &smooth(48, 40, 3, 0.3), SampleType::U16);
    folder.picture("t.png", &smooth(24, 20, 3, 2.0), SampleType::U16);
    folder.picture("mask.png", &disc(24, 20), SampleType::U8);
    folder.run("fit s.png -o s.safetensors --table-rows 1024 --steps 300").ok();
    folder.run("fit t.png -o t.safetensors --field siren --width 32 --omega 10 --rate 5e-3 --steps 200").ok();
    let command =
        "blend s.safetensors t.safetensors --mask mask.png --at 11,9 --steps 300 -o g.safetensors";
    let report = metrics(&folder, command);
    assert!(report["network"]["distance"].as_f64().unwrap() < 0.02, "{report}");
    let load = |name: &str| {
        Checkpoint::<2, 3>::from_bytes(&fs::read(folder.path(name)).unwrap()).expect(name)
    };
    let (s, g) = (load("s.safetensors"), load("g.safetensors"));
    assert_eq!(s.network.architecture(), g.network.architecture());
    assert!(matches!(g.network.architecture().encoding, Encoding::Grid(_)));
    assert_eq!((s.domain, &s.notes["channels"]), (g.domain, &g.notes["channels"]));
    let at = |field: &Checkpoint<2, 3>, x: [f32; 2]| {
        let mut y = [[0.0; 3]];
        field.network.eval(&[x], &mut y);
        y[0]
    };
    let apart = |x| {
        let (a, b) = (at(&s, x), at(&g, x));
        (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
    };
    // The patch is in, and the background far from it is what it was.
    assert!(apart([23.0, 19.0]) > 0.03 && apart([2.0, 2.0]) < 0.02);
}

#[test]
fn the_papers_solver_runs_its_steps() {
    let folder = Folder::with_scene();
    let command = format!("{BLEND} --objective paper --field diner --steps 30 -o out.png");
    let report = metrics(&folder, &command);
    assert_eq!(report["network"]["steps"], 30);
    assert!(report["network"]["loss"].as_f64().unwrap().is_finite());
}

#[test]
fn what_cannot_be_done_is_said() {
    let folder = Folder::with_scene();
    let fails = |options: &str, words: &[&str]| {
        folder.run(&format!("{BLEND} {options}")).fails(1, words);
    };
    fails("--field hash -o out.png", &["gradient", "cubic grid"]);
    fails("--field spline -o out.safetensors", &["out.safetensors", "--field grid"]);
    fails("--budget 5s -o out.png", &["--budget", "--field"]);
    fs::write(folder.path("bad.safetensors"), "nothing").unwrap();
    folder
        .run("blend bad.safetensors patch.png --at 1,1 -o out.png")
        .fails(1, &["bad.safetensors", "npsolve fit"]);
    assert!(!folder.names().iter().any(|n| n.starts_with("out")));
}
