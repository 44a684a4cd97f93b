//! Every kind of signal at the command line. The truth of most tests: a patch that is the background plus a constant
//! blends into the background itself.

use std::f64::consts::{FRAC_PI_2, TAU};

use serde_json::Value;
use signal_io::{
    Audio, AudioSample, AudioWriteOptions, Image, LightField, LightFieldReadOptions, ReadOptions,
    SampleType, Transfer, Volume, VolumeReadOptions, VolumeWriteOptions, VoxelType, read_audio,
    read_image, read_light_field, read_video, read_volume, write_audio, write_light_field,
    write_volume,
};

use crate::support::{Folder, smooth};

fn json(folder: &Folder, command: &str) -> Value {
    let run = folder.run(&format!("{command} --json")).ok();
    serde_json::from_str(&run.stdout()).expect("JSON")
}

fn number(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or_else(|| panic!("{key} in {report}"))
}

fn sound(folder: &Folder, name: &str, rate: u32, seconds: f64, tone: f64, mean: f32) -> Audio {
    let n = (seconds * f64::from(rate)) as usize;
    let wave = |k: usize| (0.3 * (tone * k as f64 / f64::from(rate) * TAU).sin()) as f32 + mean;
    let mut audio = Audio::new(rate, 1, (0..n).map(wave).collect()).unwrap();
    audio.sample = AudioSample::I16;
    write_audio(folder.path(name), &audio, &AudioWriteOptions::default()).unwrap();
    read_audio(folder.path(name), &ReadOptions::default()).unwrap()
}

#[test]
fn sound_joins_without_clicks_and_is_untouched_elsewhere() {
    let folder = Folder::new();
    let background = sound(&folder, "b.wav", 8000, 2.0, 220.0, 0.0);
    let patch = sound(&folder, "p.wav", 8000, 1.0, 330.0, 0.2);
    let report = json(&folder, "blend b.wav p.wav --from 0.25 --to 0.75 --at 1s -o o.wav");
    let blend = read_audio(folder.path("o.wav"), &ReadOptions::default()).unwrap();
    assert_eq!((blend.frames(), blend.rate_hz(), blend.sample), (16_000, 8000, AudioSample::I16));
    // The background gives way over 2 ms, 16 frames: 24 lengths away it is what it was.
    assert_eq!(blend.plane(0)[..7600], background.plane(0)[..7600]);
    assert_eq!(blend.plane(0)[12_400..], background.plane(0)[12_400..]);
    // Eight times 20 ms inside, the patch has its own level again.
    for k in 9400..10_600 {
        let difference = blend.plane(0)[k] - patch.plane(0)[k - 8000 + 2000];
        assert!(difference.abs() < 1e-3, "{k}: {difference}");
    }
    let clicks = |key: &str| -> f64 {
        report[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).sum()
    };
    let (ours, pasted) = (clicks("click_energy_blend"), clicks("click_energy_pasted"));
    assert!(ours < 0.1 * pasted, "{ours} and {pasted}");
    assert_eq!((&report["kind"], &report["size"][0]), (&"audio".into(), &16_000.into()));
    assert!(number(&report["blend"], "peak") < 0.75, "{report}");

    // The patch's own gradients alone, with nothing that returns to its level: background plus a constant.
    sound(&folder, "same.wav", 8000, 2.0, 220.0, 0.25);
    folder.run("blend b.wav same.wav --from 0.5 --to 1.5 --at 0.5 --keep 1e9 -o same-out.wav").ok();
    let same = read_audio(folder.path("same-out.wav"), &ReadOptions::default()).unwrap();
    let off = same.plane(0).iter().zip(background.plane(0)).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f32::max) < 1e-4);
}

#[test]
fn sound_is_resampled_and_blends_through_its_spectrogram() {
    let folder = Folder::new();
    let background = sound(&folder, "b.wav", 8000, 2.0, 220.0, 0.0);
    sound(&folder, "p.wav", 11_025, 0.5, 1500.0, 0.0);
    let command = "blend b.wav p.wav --at 4000smp --mode spectrogram --guidance strongest -o o.wav";
    let run = folder.run(command).ok();
    assert!(run.stderr().contains("resampled"), "{}", run.stderr());
    let blend = read_audio(folder.path("o.wav"), &ReadOptions::default()).unwrap();
    assert_eq!(blend.plane(0)[..2000], background.plane(0)[..2000]);
    assert_eq!(blend.plane(0)[11_000..], background.plane(0)[11_000..]);
    // Both tones are heard where the patch is.
    let level = |audio: &Audio, hertz: f64| -> f64 {
        let part = &audio.plane(0)[5000..7000];
        let sum = |phase: f64| -> f64 {
            let angle = |k: usize| TAU * hertz * k as f64 / 8000.0 + phase;
            part.iter().enumerate().map(|(k, v)| f64::from(*v) * angle(k).sin()).sum()
        };
        sum(0.0).hypot(sum(FRAC_PI_2)) / 1000.0
    };
    assert!(level(&background, 1500.0) < 0.01, "{}", level(&background, 1500.0));
    assert!(level(&blend, 1500.0) > 0.03, "{}", level(&blend, 1500.0));
    assert!(level(&blend, 220.0) > 0.03, "{}", level(&blend, 220.0));
}

fn volume(folder: &Folder, name: &str, shape: [usize; 3], shift: f64, constant: f32) -> Volume {
    let n: usize = shape.iter().product();
    let value = |k: usize| {
        let (x, y, z) = (k % shape[0], k / shape[0] % shape[1], k / shape[0] / shape[1]);
        let (x, y, z) = (x as f32 + shift as f32 / 2.0, y as f32, z as f32);
        (100.0 + 30.0 * (0.4 * x).sin() + 20.0 * (0.3 * y - 0.2 * z).cos() + constant).round()
    };
    let mut volume = Volume::new(shape, 1, (0..n).map(value).collect()).unwrap();
    let map = [[2.0, 0.0, 0.0, -20.0 + shift], [0.0, 2.0, 0.0, 5.0], [0.0, 0.0, 3.0, 0.0]];
    volume = volume.with_affine(map).unwrap();
    volume.voxel_type = VoxelType::U8;
    write_volume(folder.path(name), &volume, &VolumeWriteOptions::default()).unwrap();
    volume
}

#[test]
fn volumes_meet_in_millimetres() {
    let folder = Folder::new();
    let background = volume(&folder, "b.nii.gz", [24, 20, 12], 0.0, 0.0);
    // Six voxels further along x, brighter: the same structure at the same place in the world.
    volume(&folder, "p.nii", [14, 20, 12], 12.0, 40.0);
    let read = |name: &str| read_volume(folder.path(name), &VolumeReadOptions::default()).unwrap();
    for region in ["box:3,4,2:10,14,9", "ellipsoid:4mm,23mm,18mm:10mm,12mm,12mm"] {
        let report =
            json(&folder, &format!("blend b.nii.gz p.nii --region {region} -o o.nii.gz --force"));
        let blend = read("o.nii.gz");
        assert_eq!((blend.affine(), blend.voxel_type), (background.affine(), VoxelType::U8));
        assert_eq!(blend.as_planar(), background.as_planar(), "{region}");
        assert_eq!((&report["kind"], &report["domain"]), (&"volume".into(), &"normalize".into()));
        assert_eq!(report["offset"], serde_json::json!([6.0, 0.0, 0.0]));
        assert!(number(&report, "region_samples") > 50.0, "{report}");
    }
    let described = json(&folder, "inspect b.nii.gz");
    assert_eq!(described[0]["voxel_size_mm"], serde_json::json!([2.0, 2.0, 3.0]));
    folder.run("render b.nii.gz -o views.png").ok();
    folder.run("render b.nii.gz -o slice.png --slice z:3").ok();
    let slice = read_image(folder.path("slice.png"), &ReadOptions::default()).unwrap();
    assert_eq!((slice.width(), slice.height()), (24, 20));
    folder.run("render b.nii.gz -o x.png --slice z:12").fails(1, &["z", "12"]);
    folder.run("blend b.nii.gz p.nii --region box:99,0,0:120,9,9 -o x.nii").fails(1, &["--region"]);
    folder.run("blend b.nii.gz p.nii --from 1 -o x.nii").fails(1, &["--from", "sound"]);
}

#[test]
fn other_axes_are_resampled() {
    let folder = Folder::new();
    let background = volume(&folder, "b.nii", [24, 20, 12], 0.0, 0.0);
    // The same volume, its first two axes exchanged, and a constant.
    let [x, y, z] = background.shape();
    let mut turned = vec![0.0; x * y * z];
    for k in 0..turned.len() {
        let (i, j, l) = (k % x, k / x % y, k / x / y);
        turned[(l * x + i) * y + j] = background.as_planar()[k] + 50.0;
    }
    let mut patch = Volume::new([y, x, z], 1, turned).unwrap();
    let map = [[0.0, 2.0, 0.0, -20.0], [2.0, 0.0, 0.0, 5.0], [0.0, 0.0, 3.0, 0.0]];
    patch = patch.with_affine(map).unwrap();
    patch.voxel_type = VoxelType::F32;
    write_volume(folder.path("p.nii"), &patch, &VolumeWriteOptions::default()).unwrap();
    let run = folder.run("blend b.nii p.nii --region box:5,6,3:15,18,9 -o o.nii").ok();
    assert!(run.stderr().contains("resampled"), "{}", run.stderr());
    let blend = read_volume(folder.path("o.nii"), &VolumeReadOptions::default()).unwrap();
    assert_eq!(blend.as_planar(), background.as_planar());
}

#[test]
fn videos_do_not_flicker() {
    let folder = Folder::new();
    for (name, light) in [("b", 0.0f32), ("p", 0.12)] {
        std::fs::create_dir(folder.path(name)).unwrap();
        for t in 0..6 {
            let mut frame = if name == "b" {
                smooth(40, 32, 3, 0.3 + 0.05 * t as f32)
            } else {
                smooth(20, 16, 3, 2.0)
            };
            // Light that changes from frame to frame.
            let lift = light * ((t * 7 % 5) as f32 - 2.0) / 2.0;
            frame.as_planar_mut().iter_mut().for_each(|v| *v += lift);
            folder.picture(&format!("{name}/f{t:02}.png"), &frame, SampleType::U16);
        }
    }
    let report = json(&folder, "blend b p --at 9,8 -o o/%03d.png");
    assert_eq!(report["size"], serde_json::json!([40, 32, 6]));
    let (together, alone) = (number(&report, "flicker"), number(&report, "flicker_frame_by_frame"));
    assert!(together < 0.5 * alone, "{together} and {alone}");
    let blend = read_video(folder.path("o/%03d.png"), &ReadOptions::default()).unwrap();
    assert_eq!(blend.shape(), [40, 32, 6]);
    folder.run("blend b p --at 9,8 -o o.y4m").ok();
    folder.run("blend o.y4m p --at 3,3 -o o.webp --quiet").ok();
    assert_eq!(json(&folder, "inspect o.webp")[0]["kind"], "video");
    folder.run("render o.webp -o frame.png --frame 2.5").ok();
    folder.run("render o.webp -o x.png --frame 6").fails(1, &["frames 0 to 5"]);
    folder.run("blend b p -o x.gif").fails(1, &["--at"]);
}

#[test]
fn light_fields_keep_their_slices_together() {
    let folder = Folder::new();
    let make = |name: &str, constant: f32| {
        let views: Vec<Image> = (0..9)
            .map(|k| {
                let mut view = smooth(24, 20, 3, 0.2 * (k % 3) as f32 + 0.1 * (k / 3) as f32);
                view.as_planar_mut().iter_mut().for_each(|v| *v += constant);
                view
            })
            .collect();
        let field = LightField::from_views(&views, [3, 3]).unwrap();
        write_light_field(folder.path(name), &field, &Default::default()).unwrap();
        field
    };
    let background = make("b.npy", 0.0);
    make("p.npy", 0.15);
    let report = json(&folder, "blend b.npy p.npy --region box:6,5:18,15 -o o.npy");
    let options = LightFieldReadOptions::default();
    let blend = read_light_field(folder.path("o.npy"), &options).unwrap();
    let off = blend.as_planar().iter().zip(background.as_planar()).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f32::max) < 1e-4);
    assert_eq!(
        (&report["kind"], &report["region_samples"]),
        (&"lightfield".into(), &1080.0.into())
    );
    assert!(number(&report, "epipolar_difference") < 1e-5, "{report}");
    folder.run("blend b.npy p.npy --region box:6,5:18,15 -o views").ok();
    assert_eq!(json(&folder, "inspect views")[0]["size"], serde_json::json!([24, 20, 3, 3]));
    folder.run("render views -o between.png --view 0.5,1").ok();
    folder.run("render b.npy -o focus.png --refocus 0.8").ok();
    folder.run("render b.npy -o x.png --view 3,0").fails(1, &["views 0,0 to 2,2"]);
    folder.run("render b.npy -o x.png --frame 1").fails(1, &["--frame is for a video"]);
}

#[test]
fn light_beyond_screens_blends_in_ratios() {
    let folder = Folder::new();
    let light = |factor: f32| {
        let mut image = smooth(40, 32, 3, 0.3);
        image.as_planar_mut().iter_mut().for_each(|v| *v = factor * (9.0 * *v).exp());
        image.transfer = Transfer::Linear;
        image
    };
    folder.picture("b.exr", &light(1.0), SampleType::F32);
    folder.picture("p.exr", &light(7.0), SampleType::F32);
    let report = json(&folder, "blend b.exr p.exr --region box:12,10:28,22 --length 0.3 -o o.exr");
    assert_eq!(report["domain"], "log");
    let read = |name: &str| read_image(folder.path(name), &ReadOptions::default()).unwrap();
    let (background, blend) = (read("b.exr"), read("o.exr"));
    assert!(background.as_planar().iter().any(|v| *v > 400.0));
    // Seven times the light is the same picture; only the floor of the logarithm tells them apart.
    for (a, b) in blend.as_planar().iter().zip(background.as_planar()) {
        assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    }
    let report =
        json(&folder, "blend b.exr p.exr --region box:12,10:28,22 --domain stored -o s.exr");
    assert_eq!(report["domain"], "stored");
    let far = blend.as_planar().iter().zip(background.as_planar()).filter(|(a, b)| a == b).count();
    assert!(far > 100, "{far} untouched");
}

#[test]
fn options_of_other_kinds_are_refused() {
    let folder = Folder::with_scene();
    sound(&folder, "s.wav", 8000, 0.5, 300.0, 0.0);
    for (command, words) in [
        ("blend background.png patch.png --at 1,1 --from 2 -o x.png", ["--from", "sound"]),
        ("blend s.wav s.wav --mask mask.png -o x.wav", ["--mask", "--from"]),
        ("blend s.wav s.wav --at 9 -o x.wav", ["outside", "--at"]),
        ("blend s.wav s.wav --from 0.4 --to 0.3 -o x.wav", ["--from", "nothing"]),
        ("blend s.wav s.wav --at 1,2 -o x.wav", ["2 coordinates", "one"]),
        ("blend s.wav s.wav --field grid -o x.wav", ["--field", "pictures"]),
        ("blend s.wav s.wav -o x.png", ["x.png", "wav"]),
        ("blend s.wav patch.png -o x.wav", ["patch.png", "format"]),
        ("blend background.png s.wav --at 1,1 -o x.png", ["s.wav", "format"]),
        ("render background.png --slice z:1 -o x.png", ["--slice", "volume"]),
    ] {
        folder.run(command).fails(1, &words);
    }
    assert!(!folder.names().iter().any(|n| n.starts_with("x.")), "{:?}", folder.names());
    folder.run("render s.wav -o spectrum.png").ok();
    assert_eq!(json(&folder, "inspect s.wav")[0]["sampling_rate_hz"], 8000);
}
