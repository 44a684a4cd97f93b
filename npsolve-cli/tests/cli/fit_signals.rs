//! Fields of sound, volumes, videos and light fields: fitted, described, rendered, blended.

use std::f32::consts::TAU;

use serde_json::{Value, json};
use signal_io::{
    Audio, AudioSample, AudioWriteOptions, LightField, LightFieldReadOptions, ReadOptions,
    SampleType, Volume, VolumeReadOptions, VolumeWriteOptions, read_audio, read_image,
    read_light_field, read_video, read_volume, write_audio, write_light_field, write_volume,
};

use crate::support::{Folder, smooth};

fn json_of(folder: &Folder, command: &str) -> Value {
    let run = folder.run(&format!("{command} --json")).ok();
    serde_json::from_str(&run.stdout()).expect("JSON")
}

/// PSNR in dB for values whose range is `peak`.
fn psnr(a: &[f32], b: &[f32], peak: f32) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from((a - b) / peak).powi(2)).sum();
    -10.0 * (sum / a.len() as f64).log10()
}

#[test]
fn sound_becomes_a_field_and_sound_again_at_another_rate() {
    let folder = Folder::new();
    let tone = |rate: u32| {
        let wave = |k: usize| 0.4 * (200.0 * k as f32 / rate as f32 * TAU).sin();
        Audio::new(rate, 1, (0..rate as usize / 2).map(wave).collect()).unwrap()
    };
    let mut audio = tone(4000);
    audio.sample = AudioSample::I16;
    write_audio(folder.path("a.wav"), &audio, &AudioWriteOptions::default()).unwrap();
    let report = json_of(&folder, "fit a.wav -o a.safetensors --steps 300");
    assert!(report["psnr"].as_f64().unwrap() > 40.0, "{report}");
    let about = &json_of(&folder, "inspect a.safetensors")[0];
    assert_eq!(about["shape"], json!([2000]));
    assert_eq!(about["notes"]["signal"], "audio");

    folder.run("render a.safetensors -o same.wav").ok();
    folder.run("render a.safetensors -o fine.wav --scale 2").ok();
    folder.run("render a.safetensors -o spectrum.png").ok();
    let read = |name: &str| read_audio(folder.path(name), &ReadOptions::default()).unwrap();
    let (same, fine) = (read("same.wav"), read("fine.wav"));
    assert_eq!((same.rate_hz(), same.sample), (4000, AudioSample::I16));
    assert!(psnr(same.as_planar(), audio.as_planar(), 0.8) > 38.0);
    // Samples of the finer lattice lie a quarter of a sample beside the coarser ones.
    assert_eq!((fine.rate_hz(), fine.frames()), (8000, 4000));
    let wave = |k: usize| 0.4 * (200.0 * (k as f32 - 0.5) / 8000.0 * TAU).sin();
    let truth: Vec<f32> = (0..4000).map(wave).collect();
    assert!(psnr(&fine.as_planar()[40..3960], &truth[40..3960], 0.8) > 30.0);

    // A field is taken like the sound itself.
    folder.run("blend a.safetensors a.wav --from 0.1 --to 0.3 --at 0.1 -o b.wav").ok();
    assert!(psnr(read("b.wav").as_planar(), audio.as_planar(), 0.8) > 38.0);
    folder.run("fit a.wav -o a.safetensors").fails(1, &["a.safetensors", "--force"]);
    folder.run("render a.wav -o x.wav --size 3x3").fails(1, &["--size", "--scale"]);
}

#[test]
fn volumes_keep_their_place_as_fields() {
    let folder = Folder::new();
    let value = |k: usize| {
        let [x, y, z] = [k % 16, k / 16 % 14, k / 224].map(|v| v as f32);
        100.0 + 40.0 * (0.4 * x).sin() + 20.0 * (0.3 * y - 0.5 * z).cos()
    };
    let affine = [[0.0, -2.0, 0.0, 7.0], [2.0, 0.0, 0.0, 1.0], [0.0, 0.0, 3.0, -5.0]];
    let volume = Volume::new([16, 14, 12], 1, (0..16 * 14 * 12).map(value).collect()).unwrap();
    let volume = volume.with_affine(affine).unwrap();
    write_volume(folder.path("v.nrrd"), &volume, &VolumeWriteOptions::default()).unwrap();
    folder.run("fit v.nrrd -o v.safetensors --steps 200").ok();
    folder.run("render v.safetensors -o same.nii.gz").ok();
    folder.run("render v.safetensors -o fine.nii --scale 2").ok();
    folder.run("render v.safetensors -o slices.png").ok();
    let read = |name: &str| read_volume(folder.path(name), &VolumeReadOptions::default()).unwrap();
    let (same, fine) = (read("same.nii.gz"), read("fine.nii"));
    assert!(psnr(same.as_planar(), volume.as_planar(), 120.0) > 35.0);
    let off = |a: [f64; 3], b: [f64; 3]| (0..3).map(|d| (a[d] - b[d]).abs()).fold(0.0, f64::max);
    assert!(off(same.to_world([3.0, 4.0, 5.0]), volume.to_world([3.0, 4.0, 5.0])) < 1e-4);
    // Twice as many voxels: the corner of the box stays, half a voxel before the first centre.
    assert_eq!((fine.shape(), fine.voxel_size()), ([32, 28, 24], [1.0, 1.0, 1.5]));
    assert!(off(fine.to_world([-0.5; 3]), volume.to_world([-0.5; 3])) < 1e-4);
}

#[test]
fn films_and_light_fields_become_fields() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("film")).unwrap();
    let frame = |t: usize| smooth(24, 20, 3, 0.15 * t as f32);
    for t in 0..6 {
        folder.picture(&format!("film/{t:02}.png"), &frame(t), SampleType::U8);
    }
    folder.run("fit film -o film.safetensors --steps 200").ok();
    folder.run("render film.safetensors -o out/%02d.png").ok();
    let film = read_video(folder.path("out/%02d.png"), &ReadOptions::default()).unwrap();
    assert_eq!((film.shape(), film.sample()), ([24, 20, 6], SampleType::U8));
    assert!(psnr(film.frame(3).as_planar(), frame(3).as_planar(), 1.0) > 30.0);
    folder.run("render film.safetensors -o between.png --frame 2.5").ok();

    let views: Vec<_> = (0..9).map(|k| smooth(20, 16, 3, 0.1 * k as f32)).collect();
    let field = LightField::from_views(&views, [3, 3]).unwrap();
    write_light_field(folder.path("l.npy"), &field, &Default::default()).unwrap();
    folder.run("fit l.npy -o l.safetensors --steps 200").ok();
    folder.run("render l.safetensors -o again.npy --whole").ok();
    folder.run("render l.safetensors -o view.png --view 1,2").ok();
    let again = read_light_field(folder.path("again.npy"), &LightFieldReadOptions::default());
    assert!(psnr(again.unwrap().as_planar(), field.as_planar(), 1.0) > 28.0);
    let view = read_image(folder.path("view.png"), &ReadOptions::default()).unwrap();
    assert!(psnr(view.as_planar(), field.view(1, 2).as_planar(), 1.0) > 28.0);
}
