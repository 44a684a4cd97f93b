//! `fit` from end to end.

use std::fs;

use inr_core::{Checkpoint, psnr};
use serde_json::Value;
use signal_io::{Image, SampleType};

use crate::support::{Folder, flat, smooth};

/// A folder with a small smooth picture `p.png`.
fn folder() -> Folder {
    let folder = Folder::new();
    folder.picture("p.png", &smooth(24, 18, 3, 0.4), SampleType::U8);
    folder
}

fn json(folder: &Folder, arguments: &str) -> Value {
    let run = folder.run(&format!("{arguments} --json")).ok();
    serde_json::from_str(&run.stdout()).expect("JSON")
}

#[test]
fn every_kind_fits_and_reports_what_is_in_its_file() {
    for (kind, options, enough) in [
        ("grid", "--table-rows 256", 30.0),
        ("hash", "--table-rows 1024", 28.0),
        ("siren", "--width 24 --omega 10 --rate 5e-3", 25.0),
        ("fourier", "--width 24 --features 16 --sigma 2 --rate 1e-2", 25.0),
        ("diner", "--width 16 --depth 2 --rate 1e-2 --table-rate 3e-2", 25.0),
    ] {
        let folder = folder();
        let command = format!("fit p.png -o f.safetensors --field {kind} {options} --steps 120");
        let report = json(&folder, &command);
        let bytes = fs::read(folder.path("f.safetensors")).unwrap();
        let field = Checkpoint::<2, 3>::from_bytes(&bytes).unwrap();
        // 8-bit samples, not those that were written: psnr is over what fit has read.
        let read = signal_io::read_image(folder.path("p.png"), &Default::default()).unwrap();
        let values = read.as_planar().iter().copied();
        let peak = values.clone().fold(0.0, f32::max) - values.fold(1.0, f32::min);
        let measured = psnr(&field.network, &read.to_samples::<3>().unwrap(), peak);
        let told = report["psnr"].as_f64().unwrap();
        assert!(told > enough, "{kind}: {told} dB");
        assert!((told - measured).abs() < 1e-9, "{kind}: {told} and {measured}");
        assert_eq!(report["field"], kind);
        assert_eq!(report["parameters"], field.network.parameter_count());
        assert_eq!((&report["steps"], &report["bytes"]), (&120.into(), &bytes.len().into()));
        assert_eq!((&report["target_reached"], &report["finished"]), (&Value::Null, &true.into()));
        assert!(field.training.is_none());
    }
}

#[test]
fn a_fit_that_was_stopped_goes_on_with_the_same_bits() {
    for (kind, options) in [
        ("grid", "--table-rows 64 --width 16"),
        ("siren", "--width 16 --omega 5"),
        ("diner", "--width 8 --interpolation linear"),
    ] {
        let folder = folder();
        let fit = format!("fit p.png --field {kind} {options} --batch 100 --steps 40 --seed 3");
        folder.run(&format!("{fit} -o whole.safetensors")).ok();
        let half = json(&folder, &format!("{fit} -o parts.safetensors --stop-after 15"));
        assert_eq!((&half["finished"], &half["steps"]), (&false.into(), &15.into()));
        let about = json(&folder, "inspect parts.safetensors");
        let state = (&about[0]["finished"], &about[0]["step"], &about[0]["steps"]);
        assert_eq!(state, (&false.into(), &15.into(), &40.into()));
        // Some of the options again, more checkpoints on the way, another number of threads.
        let on = "fit p.png -o parts.safetensors --resume --steps 40 --checkpoint-every 1ms";
        assert_eq!(json(&folder, &format!("{on} --threads 3"))["finished"], true);
        let [whole, parts] = ["whole.safetensors", "parts.safetensors"]
            .map(|name| fs::read(folder.path(name)).unwrap());
        assert_eq!(whole, parts, "{kind}");
        folder.run(on).fails(1, &["parts.safetensors", "finished", "--force"]);
    }
}

#[test]
fn resuming_wants_the_same_picture_and_options() {
    let folder = folder();
    folder.picture("q.png", &smooth(24, 18, 3, 0.5), SampleType::U8);
    folder.picture("gray.png", &smooth(24, 18, 1, 0.4), SampleType::U8);
    let fit = "fit p.png -o f.safetensors --table-rows 64 --width 16 --steps 40";
    folder.run(&format!("{fit} --stop-after 5")).ok();
    let before = fs::read(folder.path("f.safetensors")).unwrap();
    let refused = |arguments: &str, code: i32, words: &[&str]| {
        let run = format!("fit {arguments} -o f.safetensors --resume");
        folder.run(&run).fails(code, words);
        assert_eq!(fs::read(folder.path("f.safetensors")).unwrap(), before);
    };
    refused("q.png", 1, &["f.safetensors", "other values", "q.png"]);
    refused("gray.png", 1, &["f.safetensors", "other values", "gray.png"]);
    refused("p.png --width 32", 1, &["--width 16", "--width 32"]);
    refused("p.png --budget 3s", 1, &["no --budget"]);
    refused("p.png --field siren", 1, &["--field grid", "--field siren"]);
    refused("p.png --force", 2, &["--force", "--resume"]);
    // A file without --resume is never continued.
    folder.run(fit).fails(1, &["f.safetensors", "--force"]);
}

#[test]
fn a_kept_training_is_finished_all_the_same() {
    let folder = folder();
    let fit = "fit p.png --table-rows 64 --width 16 --steps 10";
    folder.run(&format!("{fit} -o f.safetensors --keep-training")).ok();
    folder.run(&format!("{fit} -o g.safetensors")).ok();
    let read =
        |name: &str| Checkpoint::<2, 3>::from_bytes(&fs::read(folder.path(name)).unwrap()).unwrap();
    let (kept, plain) = (read("f.safetensors"), read("g.safetensors"));
    assert_eq!(kept.network.params(), plain.network.params());
    assert_eq!(kept.training.unwrap().state["steps"], 10);
    let about = folder.run("inspect f.safetensors").ok().stdout();
    assert!(about.contains("finished after step 10"), "{about}");
    folder.run("fit p.png -o f.safetensors --resume").fails(1, &["finished after step 10"]);
}

#[test]
fn limits_end_a_fit() {
    let folder = folder();
    let fit = "fit p.png -o f.safetensors --table-rows 256 --force";
    let reached = json(&folder, &format!("{fit} --target-psnr 20"));
    assert_eq!(reached["target_reached"], true);
    assert!(reached["psnr"].as_f64() >= Some(20.0) && reached["steps"].as_u64() < Some(300));
    let run = folder.run(&format!("{fit} --target-psnr 90 --steps 3 --json")).ok();
    let missed: Value = serde_json::from_str(&run.stdout()).unwrap();
    assert_eq!((&missed["target_reached"], &missed["steps"]), (&false.into(), &3.into()));
    assert!(run.stderr().contains("warning: 90 dB were not reached"), "{}", run.stderr());
    let timed = json(&folder, &format!("{fit} --budget 100ms"));
    assert!(timed["steps"].as_u64() >= Some(1), "{timed}");
    assert!(timed["seconds"].as_f64().is_some_and(|s| (0.1..5.0).contains(&s)), "{timed}");
}

#[test]
fn any_range_of_values_fits_as_well() {
    let unit = smooth(20, 16, 1, 0.4);
    let mut told = Vec::new();
    for (name, scale, offset) in
        [("a.npy", 1.0, 0.0), ("b.npy", 4e6, -1e6), ("c.npy", 3e-20, 0.0), ("d.npy", -1.0, 0.0)]
    {
        let folder = Folder::new();
        let data = unit.as_planar().iter().map(|v| v * scale + offset).collect();
        let image = Image::new(20, 16, &["Y"], data).unwrap();
        folder.picture(name, &image, SampleType::F32);
        let fit = format!("fit {name} -o f.safetensors --table-rows 256 --width 16 --steps 60");
        told.push(json(&folder, &fit)["psnr"].as_f64().unwrap());
    }
    // The same picture in other units; only roundings differ, which the training amplifies.
    assert!(told.iter().all(|t| *t > 25.0 && (t - told[0]).abs() < 3.0), "{told:?}");
}

#[test]
fn pictures_of_one_value_or_one_pixel() {
    let folder = Folder::new();
    for (name, image) in [
        ("one.npy", flat(1, 1, 0.5)),
        ("row.npy", flat(9, 1, -3.0)),
        ("huge.npy", flat(4, 5, 1e20)),
        ("zero.npy", flat(4, 5, 0.0)),
    ] {
        folder.picture(name, &image, SampleType::F32);
        let report = json(&folder, &format!("fit {name} -o {name}.safetensors --steps 5"));
        assert!(report["psnr"].as_f64().is_none_or(|p| p > 30.0), "{name}: {report}");
        folder.run(&format!("render {name}.safetensors -o out.npy --force")).ok();
    }
}
