//! `blend` and `demo` from end to end.

use std::fs;

use inr_core::{RasterMask, Translated};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};
use serde_json::Value;
use signal_io::{Image, ReadOptions, SampleType, Transfer, read_image};

use crate::support::{Folder, disc, smooth};

const BLEND: &str = "blend background.png patch.png --mask mask.png --at 12,9";

fn read(folder: &Folder, name: &str) -> Image {
    read_image(folder.path(name), &ReadOptions::default()).expect(name)
}

/// What the library makes of pictures with the default options.
fn by_library<const C: usize>(background: &Image, patch: &Image, first: usize) -> Vec<f32> {
    let planes = |image: &Image| {
        let n = image.pixel_count();
        let data = image.as_planar()[first * n..(first + C) * n].to_vec();
        inr_core::Samples::<2, C>::from_planar(image.domain(), data).unwrap()
    };
    let mask = disc(patch.width(), patch.height());
    let mask = RasterMask::new(mask.domain(), mask.into_planar()).unwrap();
    let problem = Problem {
        background: &planes(background),
        patch: Patch::Samples { samples: &planes(patch), offset: [12.0, 9.0] },
        region: &Translated { region: mask, offset: [12.0, 9.0] },
        guidance: Guidance::Patch,
        options: Options::default(),
    };
    solve(&problem).unwrap().samples.as_planar().to_vec()
}

#[test]
fn result_is_the_librarys_bit_for_bit() {
    for channels in [1, 3, 8, 11] {
        let folder = Folder::new();
        let (background, patch) = (smooth(60, 44, channels, 0.3), smooth(30, 24, channels, 2.0));
        folder.picture("background.npy", &background, SampleType::F32);
        folder.picture("patch.npy", &patch, SampleType::F32);
        folder.picture("mask.png", &disc(30, 24), SampleType::U8);
        folder.run("blend background.npy patch.npy --mask mask.png --at 12,9 -o out.npy").ok();
        let expected = match channels {
            1 => by_library::<1>(&background, &patch, 0),
            3 => by_library::<3>(&background, &patch, 0),
            8 => by_library::<8>(&background, &patch, 0),
            _ => [by_library::<8>(&background, &patch, 0), by_library::<3>(&background, &patch, 8)]
                .concat(),
        };
        assert_eq!(read(&folder, "out.npy").as_planar(), expected, "{channels} channels");
    }
}

#[test]
fn outside_is_untouched_bit_for_bit_in_either_encoding() {
    let folder = Folder::with_scene();
    for (name, extra) in [("stored.png", ""), ("linear.png", "--domain linear")] {
        // A short length and a small mask far from the left edge keep the solved box away from it.
        let run = folder.run(&format!("{BLEND} --length 0.2 {extra} -o {name} --json")).ok();
        let report: Value = serde_json::from_str(&run.stdout()).unwrap();
        let (old, new) = (read(&folder, "background.png"), read(&folder, name));
        assert_eq!((new.sample, new.channels()), (SampleType::U16, old.channels()));
        let bound = |key: &str, d: usize| report[key][d].as_u64().unwrap() as usize;
        let inside = |i: usize, d: usize| {
            (bound("box_start", d)..bound("box_start", d) + bound("box_shape", d)).contains(&i)
        };
        let (mut same, mut changed) = (0, 0);
        for k in 0..old.as_planar().len() {
            let (x, y) = (k % 60, k / 60 % 44);
            let equal = old.as_planar()[k] == new.as_planar()[k];
            assert!(equal || (inside(x, 0) && inside(y, 1)), "{name}: {x},{y}");
            (same, changed) = (same + usize::from(equal), changed + usize::from(!equal));
        }
        assert!(same > 1000 && changed > 500, "{same} same, {changed} changed");
    }
}

#[test]
fn json_has_the_promised_fields() {
    let folder = Folder::with_scene();
    let run = folder.run(&format!("{BLEND} -o out.png --json --metrics m.json")).ok();
    assert_eq!(fs::read_to_string(folder.path("m.json")).unwrap(), run.stdout());
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    for key in [
        "m1",
        "m2",
        "objective",
        "excess_energy",
        "residual",
        "seam_rms",
        "seam_max",
        "psnr_outside",
        "clipped_fraction",
        "iterations",
        "solver",
        "guidance",
        "warnings",
    ] {
        assert!(report.get(key).is_some(), "{key} is missing: {report}");
    }
    for key in ["read", "solve", "write"] {
        assert!(report["seconds"][key].as_f64().unwrap() >= 0.0, "{key}");
    }
    assert_eq!(
        (&report["solver"], &report["guidance"]),
        (&"spline-screened".into(), &"patch".into())
    );
    assert!(report["residual"].as_f64().unwrap() <= 1e-6);
    assert!(report["iterations"].as_u64().unwrap() > 0);
}

#[test]
fn quiet_prints_nothing_and_the_summary_says_what_happened() {
    let folder = Folder::with_scene();
    let run = folder.run(&format!("{BLEND} -o out.png --quiet")).ok();
    assert_eq!((run.stdout(), run.stderr()), (String::new(), String::new()));
    let run = folder.run(&format!("{BLEND} -o out2.png")).ok();
    for word in ["patch.png", "60 x 44", "12,9", "iterations", "residual", "clipped", "out2.png"] {
        assert!(run.stdout().contains(word), "{word}: {}", run.stdout());
    }
    assert_eq!(run.stderr(), "");
}

#[test]
fn threads_do_not_change_the_bytes() {
    let folder = Folder::with_scene();
    for threads in [1, 2] {
        folder.run(&format!("{BLEND} -o out{threads}.exr --threads {threads}")).ok();
    }
    let bytes = |name| fs::read(folder.path(name)).unwrap();
    assert_eq!(bytes("out1.exr"), bytes("out2.exr"));
}

#[test]
fn every_objective_and_guidance_works() {
    let folder = Folder::with_scene();
    for options in [
        "--objective paper --lambda 5 --ramp",
        "--objective dirichlet",
        "--length 3 --keep 6 --band --feather 2.5",
        "--guidance strongest",
        "--guidance strongest:channel",
        "--guidance strongest:component",
        "--guidance sum",
        "--guidance mix:0.5,0.5",
        "--guidance monochrome",
        "--gray --depth 8",
    ] {
        folder.run(&format!("{BLEND} {options} -o out.png --force --json")).ok();
    }
}

#[test]
fn center_is_the_patchs_centre_and_equal_sizes_need_no_place() {
    let folder = Folder::with_scene();
    folder.run("blend background.png patch.png --mask mask.png --center 27,21 -o a.png").ok();
    folder.run(&format!("{BLEND} -o b.png")).ok();
    assert_eq!(read(&folder, "a.png"), read(&folder, "b.png"));
    folder.picture("big_mask.png", &disc(60, 44), SampleType::U8);
    folder.run("blend background.png background.png --mask big_mask.png -o c.png").ok();
    // Its own gradients on its own background: nothing to do, up to 16-bit rounding.
    let (old, new) = (read(&folder, "background.png"), read(&folder, "c.png"));
    let worst = old.as_planar().iter().zip(new.as_planar()).map(|(a, b)| (a - b).abs());
    assert!(worst.fold(0.0, f32::max) <= 1.1 / 65535.0);
}

#[test]
fn alpha_of_the_patch_is_the_mask_and_alpha_of_the_background_stays() {
    let folder = Folder::with_scene();
    let cutout = smooth(30, 24, 3, 2.0).with_alpha(disc(30, 24).plane(0)).unwrap();
    folder.picture("cutout.png", &cutout, SampleType::U16);
    folder.run("blend background.png cutout.png --at 12,9 -o by_alpha.png").ok();
    folder.run(&format!("{BLEND} -o by_mask.png")).ok();
    assert_eq!(read(&folder, "by_alpha.png"), read(&folder, "by_mask.png"));

    let alpha: Vec<f32> = (0..60 * 44).map(|k| (k % 60) as f32 / 59.0).collect();
    let glass = smooth(60, 44, 3, 0.3).with_alpha(&alpha).unwrap();
    folder.picture("glass.png", &glass, SampleType::U16);
    folder.run("blend glass.png patch.png --mask mask.png --at 12,9 -o glass_out.png").ok();
    let out = read(&folder, "glass_out.png");
    assert_eq!(out.alpha(), read(&folder, "glass.png").alpha());
    assert_eq!(out.split_alpha().0.as_planar(), read(&folder, "by_mask.png").as_planar());
}

#[test]
fn soft_masks_and_fractions_of_pixels() {
    let folder = Folder::with_scene();
    let mut soft = disc(30, 24);
    soft.as_planar_mut().iter_mut().for_each(|v| *v *= 0.6);
    folder.picture("soft.png", &soft, SampleType::U16);
    folder.run("blend background.png patch.png --mask soft.png --at 12.5,9.25 -o out.png").ok();
}

#[test]
fn linear_floats_into_an_encoded_background_are_converted() {
    let folder = Folder::with_scene();
    let patch = read(&folder, "patch.png").to_transfer(Transfer::Linear);
    folder.picture("patch.exr", &patch, SampleType::F32);
    folder.run(&format!("{BLEND} -o a.png")).ok();
    folder.run("blend background.png patch.exr --mask mask.png --at 12,9 -o b.png").ok();
    let (a, b) = (read(&folder, "a.png"), read(&folder, "b.png"));
    let worst = a.as_planar().iter().zip(b.as_planar()).map(|(a, b)| (a - b).abs());
    assert!(worst.fold(0.0, f32::max) < 3.0 / 65535.0);
}

#[test]
fn demo_writes_its_pictures_twice() {
    let folder = Folder::new();
    for _ in 0..2 {
        let run = folder.run("demo").ok();
        for name in ["paste.png", "blend.png", "paste-and-blend.png"] {
            assert!(run.stdout().contains(name), "{}", run.stdout());
            read(&folder, &format!("npsolve-demo/{name}"));
        }
    }
    // The command it ends with works as printed.
    let text = folder.run("demo --threads 1").ok().stdout();
    let command = text.lines().last().unwrap().trim().trim_start_matches("npsolve ").to_owned();
    folder.run(&command).ok();
    let same = |a: &str, b: &str| {
        assert_eq!(read(&folder, a).as_planar(), read(&folder, b).as_planar());
    };
    same("npsolve-demo/mine.png", "npsolve-demo/blend.png");
}

#[test]
fn help_has_examples_for_every_command() {
    let folder = Folder::new();
    for command in ["blend", "compare", "inspect", "demo"] {
        let text = folder.run(&format!("{command} --help")).ok().stdout();
        assert!(text.contains(&format!("Examples:\n  npsolve {command}")), "{text}");
    }
    assert!(folder.run("--help").ok().stdout().contains("Exit codes"));
    assert!(folder.run("--version").ok().stdout().starts_with("npsolve "));
}
