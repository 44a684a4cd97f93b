//! A signal of any kind as such a signal again: a network's on its own lattice, or any at another scale.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail};
use inr_core::{Domain, Samples, Spline};
use serde_json::json;

use crate::args::RenderArgs;
use crate::channels::{Axes, Channels};
use crate::kind::SignalKind;
use crate::outcome::size;
use crate::signals::{Signal, audio, field, light_field, video, volume};
use crate::{console, field_file, files};

/// Whether the signal itself is asked for: by `--whole`, or by an ending that no picture has.
pub fn is_wanted(kind: SignalKind, args: &RenderArgs) -> bool {
    let Some(output) = &args.output else { return false };
    let name = output.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let ends = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e));
    let own = match kind {
        SignalKind::Image => return false,
        SignalKind::Audio => ends(&[".wav"]),
        SignalKind::Volume => ends(&[".nii", ".nii.gz", ".nrrd", ".json"]),
        SignalKind::Video => ends(&[".y4m", ".gif"]) || name.contains('%'),
        SignalKind::Lightfield => !name.contains('.') || name.contains('%'),
    };
    args.whole || own
}

/// Runs the command for a signal that is not a picture.
pub fn run(kind: SignalKind, args: &RenderArgs, quiet: bool) -> Result<()> {
    if args.size.is_some() || args.crop.is_some() || args.gradient.is_some() || args.depth.is_some()
    {
        bail!(
            "--size, --crop, --depth and --gradient are for pictures; {} takes --scale",
            kind.noun()
        );
    }
    let Some(output) = &args.output else { bail!("name the file to write with -o") };
    check(kind, output, args)?;
    let path = &args.field;
    match kind {
        SignalKind::Image => bail!("pictures have their own command"),
        SignalKind::Audio => write(audio::read(path)?, [true], args, output, quiet),
        SignalKind::Volume => write(volume::read(path)?, [true; 3], args, output, quiet),
        SignalKind::Video => {
            write(video::read(path, 1.0)?, [true, true, false], args, output, quiet)
        }
        SignalKind::Lightfield => {
            let views = light_field::read(path, args.lenslet, light_field::ANGULAR_PITCH)?;
            write(views, [true, true, false, false], args, output, quiet)
        }
    }
}

fn check(kind: SignalKind, output: &Path, args: &RenderArgs) -> Result<()> {
    let force = args.force;
    match kind {
        SignalKind::Audio => signal_io::check_audio_target(output, force),
        SignalKind::Volume => signal_io::check_volume_target(output, force),
        SignalKind::Video => signal_io::check_video_target(output, force),
        SignalKind::Lightfield => {
            signal_io::check_light_field_target(output, &light_field::write_options(force))
        }
        SignalKind::Image => signal_io::check_target(output, force),
    }
    .map_err(files::in_our_words)
}

/// Writes the signal, with `axes` at the scale of the command line.
fn write<S: Signal<D>, const D: usize>(
    signal: S,
    axes: [bool; D],
    args: &RenderArgs,
    output: &Path,
    quiet: bool,
) -> Result<()>
where
    Axes<D>: Channels,
{
    let start = Instant::now();
    let signal = match args.scale {
        Some(scale) => at_scale(signal, scale, axes, &args.field)?,
        None => signal,
    };
    let shape = signal.plain()?.domain.shape();
    signal.save(output, args.force)?;
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        let report = json!({ "size": shape.to_vec(), "file": output, "seconds": seconds });
        console::print(&files::to_json(&report)?)?;
    } else if !quiet {
        console::print(&format!(
            "Rendered {} as {} samples in {seconds:.2} s.\nWrote {}.\n",
            args.field.display(),
            size(&shape),
            output.display()
        ))?;
    }
    Ok(())
}

fn at_scale<S: Signal<D>, const D: usize>(
    signal: S,
    scale: f32,
    axes: [bool; D],
    path: &Path,
) -> Result<S>
where
    Axes<D>: Channels,
{
    let lattice = |own: &Domain<D>| -> Result<Domain<D>> {
        let samples = |d: usize| (own.shape()[d] as f32 * scale).round().max(1.0) as usize;
        let shape = std::array::from_fn(|d| if axes[d] { samples(d) } else { own.shape()[d] });
        Ok(own.resized(shape)?)
    };
    if field_file::is_network(path) {
        return field::read(path, lattice);
    }
    let plain = signal.plain()?;
    let target = lattice(&plain.domain)?;
    let mut values = Vec::with_capacity(plain.values.len() / plain.domain.len() * target.len());
    for plane in plain.values.chunks(plain.domain.len()) {
        let samples = Samples::<D, 1>::from_planar(plain.domain, plane.to_vec())?;
        let spline = Spline::interpolate_owned(samples);
        values.extend(spline.eval_lattice(&target, [0; D]).as_planar());
    }
    S::from_values(&signal.notes(), target, plain.values.len() / plain.domain.len(), values)
}
