//! Demos of sound, volumes, videos and light fields: signals made here, blended by the command that is then shown.

use std::f32::consts::TAU;
use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context, Result, bail};
use clap::Parser;
use signal_io::{
    Audio, AudioSample, AudioWriteOptions, Image, LightField, LightFieldWriteOptions, SampleType,
    Transfer, Video, VideoWriteOptions, Volume, VolumeWriteOptions, VoxelType, WriteOptions,
};

use crate::args::{Cli, Command};
use crate::files::in_our_words;
use crate::kind::SignalKind;
use crate::{blend, console, render};

/// A finished demo: what the user reads, and the options of the blend.
struct Story {
    extension: &'static str,
    text: &'static str,
    options: &'static [&'static str],
    /// Options of `render` for the pictures.
    view: &'static [&'static str],
}

/// Makes a signal of this kind and blends it.
pub fn run(kind: SignalKind, folder: &Path, quiet: bool) -> Result<()> {
    let story = match kind {
        SignalKind::Image => bail!("pictures have a demo of their own"),
        SignalKind::Audio => sound(folder)?,
        SignalKind::Volume => volume(folder)?,
        SignalKind::Video => video(folder)?,
        SignalKind::Lightfield => light_field(folder)?,
    };
    let file = |name: &str| folder.join(format!("{name}.{}", story.extension)).into_os_string();
    let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
    let command: Vec<OsString> = [
        words(&["npsolve", "blend"]),
        vec![file("background"), file("patch")],
        words(story.options),
        vec!["-o".into(), file("blend")],
    ]
    .concat();
    execute(&command, quiet)?;
    for name in ["paste", "blend"] {
        let picture = folder.join(format!("{name}.png")).into_os_string();
        let all = [
            words(&["npsolve", "render"]),
            vec![file(name), "-o".into(), picture],
            words(story.view),
        ];
        execute(&all.concat(), true)?;
    }
    if quiet {
        return Ok(());
    }
    let shown: Vec<_> = command.iter().map(|w| w.to_string_lossy()).collect();
    console::print(&format!(
        "\n{}\n\n  copied       {}, {}\n  blended      {}, {}\n\nThe same by hand:\n  {}\n",
        story.text,
        file("paste").to_string_lossy(),
        folder.join("paste.png").display(),
        file("blend").to_string_lossy(),
        folder.join("blend.png").display(),
        shown.join(" ")
    ))
}

/// Runs a command line of this program; its files are the demo's own and may be replaced.
fn execute(words: &[OsString], quiet: bool) -> Result<()> {
    let cli = Cli::try_parse_from(words.iter().cloned().chain(["--force".into()]))
        .context("the demo's own command")?;
    match &cli.command {
        Command::Blend(args) => blend::run(args, quiet),
        Command::Render(args) => render::run(args, quiet),
        _ => bail!("the demo blends and renders only"),
    }
}

/// A plucked melody, and a bell whose recording has another level and an offset.
fn sound(folder: &Path) -> Result<Story> {
    const RATE: u32 = 44_100;
    let rate = RATE as f32;
    let note = |k: usize, notes: &[f32], length: f32| {
        let t = k as f32 / rate;
        let (step, age) = ((t / length) as usize, t % length);
        let hertz = notes[step % notes.len()];
        // A few harmonics that fade, after an attack of 5 ms.
        let tone: f32 = (1..5).map(|h| (TAU * hertz * h as f32 * age).sin() / (h * h) as f32).sum();
        tone * (-4.0 * age).exp() * (age / 5e-3).min(1.0)
    };
    let make = |seconds: f32, of: &dyn Fn(usize) -> f32| -> Result<Audio> {
        let mut audio = Audio::new(RATE, 1, (0..(seconds * rate) as usize).map(of).collect())?;
        audio.sample = AudioSample::I16;
        Ok(audio)
    };
    let melody = make(6.0, &|k| 0.35 * note(k, &[220.0, 262.0, 330.0, 294.0, 247.0, 196.0], 0.5))?;
    let bell = make(2.0, &|k| 0.25 * note(k, &[880.0, 1175.0], 1.0) + 0.15)?;
    let at = (2.25 * rate) as usize;
    let mut paste = melody.clone();
    paste.as_planar_mut()[at..at + bell.frames()].copy_from_slice(bell.as_planar());
    let options = AudioWriteOptions { force: true, ..AudioWriteOptions::default() };
    for (name, audio) in [("background", &melody), ("patch", &bell), ("paste", &paste)] {
        let path = folder.join(format!("{name}.wav"));
        signal_io::write_audio(path, audio, &options).map_err(in_our_words)?;
    }
    Ok(Story {
        extension: "wav",
        text: "A bell went into a melody at 2.25 s. Copied, it clicks where it begins and ends: white lines in the\n\
               spectrogram. Blended, the melody gives way within two milliseconds, and the bell is at its own level\n\
               after twenty.",
        options: &["--at", "2.25"],
        view: &[],
    })
}

/// A ball with layers and grains, and another one from a brighter scanner.
fn volume(folder: &Path) -> Result<Story> {
    const N: usize = 72;
    let make = |gain: f32, lift: f32, turn: f32| -> Result<Volume> {
        let value = |k: usize| {
            let [x, y, z] =
                [k % N, k / N % N, k / N / N].map(|i| (i as f32 - (N - 1) as f32 / 2.0) / 30.0);
            let r = (x * x + 1.2 * y * y + 0.9 * z * z).sqrt();
            let body = 1.0 / (1.0 + (30.0 * (r - 1.0)).exp());
            let grain = (9.0 * x + turn).sin() * (8.0 * y - turn).cos() * (7.0 * z).sin();
            let shell = (-80.0 * (r - 0.9) * (r - 0.9)).exp();
            body * (gain * (70.0 + 25.0 * grain + 60.0 * shell) + lift)
        };
        let affine = [[2.0, 0.0, 0.0, -71.0], [0.0, 2.0, 0.0, -71.0], [0.0, 0.0, 2.0, -71.0]];
        let values = (0..N * N * N).map(value).collect();
        let mut volume = Volume::new([N; 3], 1, values)?.with_affine(affine)?;
        volume.voxel_type = VoxelType::I16;
        Ok(volume)
    };
    let (background, patch) = (make(1.0, 0.0, 0.0)?, make(1.3, 35.0, 2.0)?);
    let mut paste = background.clone();
    for k in 0..N * N * N {
        let offset = [k % N, k / N % N, k / N / N].map(|i| (i as f32 - 36.0) / 14.0);
        if offset.iter().map(|v| v * v).sum::<f32>() < 1.0 {
            paste.as_planar_mut()[k] = patch.as_planar()[k];
        }
    }
    let options = VolumeWriteOptions { force: true, ..VolumeWriteOptions::default() };
    for (name, volume) in [("background", &background), ("patch", &patch), ("paste", &paste)] {
        let path = folder.join(format!("{name}.nii.gz"));
        signal_io::write_volume(path, volume, &options).map_err(in_our_words)?;
    }
    Ok(Story {
        extension: "nii.gz",
        text: "The inside of one scan went into another one, whose scanner is darker. Copied, it is a bright ball with\n\
               an edge. Blended, it keeps its structure at the level of its surroundings; voxels and place are kept.",
        options: &["--region", "ellipsoid:36,36,36:14,14,14"],
        view: &[],
    })
}

/// A smooth texture that moves, as RGB.
fn texture(x: f32, y: f32, c: usize) -> f32 {
    let c = c as f32;
    0.45 + 0.12 * (0.31 * x + 0.8 * c).sin() * (0.23 * y).cos()
        + 0.08 * (0.11 * x - 0.27 * y + c).sin()
}

/// A disc with rings at the middle of a 48 x 48 picture.
fn rings(x: f32, y: f32, c: usize) -> f32 {
    let r = (x - 23.5).hypot(y - 23.5);
    0.5 + 0.2 * (0.8 * r + c as f32).sin() * (-r / 18.0).exp()
}

fn picture([w, h]: [usize; 2], of: impl Fn(f32, f32, usize) -> f32) -> Result<Image> {
    let value = |k: usize| of((k % w) as f32, (k / w % h) as f32, k / w / h);
    let mut image = Image::new(w, h, &["R", "G", "B"], (0..3 * w * h).map(value).collect())?;
    (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
    Ok(image)
}

/// The patch over the background at a place, both as pictures.
fn pasted(background: &Image, patch: &Image, [left, top]: [usize; 2]) -> Result<Image> {
    let inside = |x: usize, y: usize| {
        (left..left + patch.width()).contains(&x) && (top..top + patch.height()).contains(&y)
    };
    picture([background.width(), background.height()], |x, y, c| {
        let (x, y) = (x as usize, y as usize);
        match inside(x, y) {
            true => patch.plane(c)[(y - top) * patch.width() + x - left],
            false => background.plane(c)[y * background.width() + x],
        }
    })
}

/// A drifting texture, and rings under a light that flickers.
fn video(folder: &Path) -> Result<Story> {
    let (mut background, mut patch, mut paste) = (Vec::new(), Vec::new(), Vec::new());
    for t in 0..24 {
        let drift = 0.7 * t as f32;
        // A sequence that jumps about without a period one would notice.
        let light = 0.06 * ((t * t * 7 % 13) as f32 / 6.0 - 1.0);
        let b = picture([112, 84], |x, y, c| texture(x + drift, y, c))?;
        let p = picture([48, 48], |x, y, c| rings(x, y + 0.2 * drift, c) + light)?;
        paste.push(pasted(&b, &p, [32, 18])?);
        background.push(b);
        patch.push(p);
    }
    let options = VideoWriteOptions { force: true, ..VideoWriteOptions::default() };
    for (name, frames) in [("background", background), ("patch", patch), ("paste", paste)] {
        let path = folder.join(format!("{name}.webp"));
        let video = Video::from_frames(frames)?;
        signal_io::write_video(path, &video, &options).map_err(in_our_words)?;
    }
    Ok(Story {
        extension: "webp",
        text: "Rings under a flickering lamp went into a calm video. Copied, they have an edge and they flicker. Blended\n\
               in space and time together, they do neither.",
        options: &["--at", "32,18"],
        view: &["--frame", "12"],
    })
}

/// A far texture, and near rings that move more from view to view.
fn light_field(folder: &Path) -> Result<Story> {
    let (mut background, mut patch, mut paste) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..25 {
        let (u, v) = ((k % 5) as f32 - 2.0, (k / 5) as f32 - 2.0);
        let b = picture([112, 84], |x, y, c| texture(x + 0.8 * u, y + 0.8 * v, c))?;
        let p = picture([48, 48], |x, y, c| 0.1 + rings(x + 1.2 * u, y + 1.2 * v, c))?;
        paste.push(pasted(&b, &p, [32, 18])?);
        background.push(b);
        patch.push(p);
    }
    let options = LightFieldWriteOptions {
        write: WriteOptions { force: true, ..WriteOptions::default() },
        ..LightFieldWriteOptions::default()
    };
    for (name, views) in [("background", background), ("patch", patch), ("paste", paste)] {
        let path = folder.join(format!("{name}.npy"));
        let field = LightField::from_views(&views, [5, 5])?;
        signal_io::write_light_field(path, &field, &options).map_err(in_our_words)?;
    }
    Ok(Story {
        extension: "npy",
        text: "Rings near the camera went into a light field of something far. The pictures show the view between the\n\
               cameras at 1.5,2: blended, all 25 views have changed alike, so what lies between them fits, too.",
        options: &["--at", "32,18"],
        view: &["--view", "1.5,2"],
    })
}
