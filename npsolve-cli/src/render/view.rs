//! The picture that stands for a signal of more or fewer dimensions than two: a frame, a view, slices, a spectrogram.

use std::path::Path;

use anyhow::{Result, bail};
use inr_core::{Domain, Samples, Spline};
use signal_io::{Image, ReadOptions};

use crate::args::RenderArgs;
use crate::files::in_our_words;
use crate::kind::SignalKind;
use crate::signals::{light_field, video};

/// Options of one kind that another does not have.
pub fn check(kind: SignalKind, args: &RenderArgs) -> Result<()> {
    let used = [
        (args.view.is_some(), "--view", SignalKind::Lightfield),
        (args.refocus.is_some(), "--refocus", SignalKind::Lightfield),
        (args.frame.is_some(), "--frame", SignalKind::Video),
        (args.slice.is_some(), "--slice", SignalKind::Volume),
    ];
    match used.into_iter().find(|(used, _, of)| *used && *of != kind) {
        Some((_, option, of)) => {
            bail!("{option} is for {}; {} is {}", of.noun(), args.field.display(), kind.noun())
        }
        None => Ok(()),
    }
}

/// Reads a signal and makes the picture that the options ask for.
pub fn picture(kind: SignalKind, args: &RenderArgs) -> Result<Image> {
    let path = &args.field;
    match kind {
        SignalKind::Video => frame(path, args.frame),
        SignalKind::Lightfield => view(path, args),
        SignalKind::Image => {
            signal_io::read_image(path, &ReadOptions::default()).map_err(in_our_words)
        }
        SignalKind::Audio => super::spectrum::picture(path),
        SignalKind::Volume => super::slices::picture(path, args.slice),
    }
}

fn frame(path: &Path, at: Option<f32>) -> Result<Image> {
    let film = video::read(path, 1.0)?;
    let video = &film.video;
    let [width, height, frames] = video.shape();
    let at = at.unwrap_or(((frames - 1) / 2) as f32);
    if !(0.0..=(frames - 1) as f32).contains(&at) {
        bail!("{} has frames 0 to {}; --frame {at} is not there", path.display(), frames - 1);
    }
    between(video.as_strip(), [width * height, frames, 1], [at, 0.0], height)
}

fn view(path: &Path, args: &RenderArgs) -> Result<Image> {
    let views = light_field::read(path, args.lenslet, 1.0)?;
    let field = &views.field;
    let [width, height, columns, rows] = field.shape();
    if let Some(slope) = args.refocus {
        return Ok(field.refocused(slope));
    }
    let middle = [columns, rows].map(|n| (n - 1) as f32 / 2.0);
    let at = args.view.unwrap_or(middle);
    let last = [columns - 1, rows - 1];
    if !(0..2).all(|d| (0.0..=last[d] as f32).contains(&at[d])) {
        let [u, v] = last;
        bail!(
            "{} has views 0,0 to {u},{v}; --view {},{} is not there",
            path.display(),
            at[0],
            at[1]
        );
    }
    between(field.as_strip(), [width * height, columns, rows], at, height)
}

/// The picture at a fractional place among `columns` times `rows` pictures of `n` pixels each, one after the other, by
/// the cubic spline through the values of each pixel.
fn between(
    strip: &Image,
    [n, columns, rows]: [usize; 3],
    at: [f32; 2],
    height: usize,
) -> Result<Image> {
    let lattice = Domain::unit([columns, rows])?;
    // The spline's weights are those of unit impulses: one for every picture.
    let weights = (0..lattice.len())
        .map(|k| {
            let mut impulse = vec![0.0; lattice.len()];
            impulse[k] = 1.0;
            let spline = Spline::interpolate_owned(Samples::<2, 1>::from_planar(lattice, impulse)?);
            Ok(f64::from(spline.eval_scalar(at)[0]))
        })
        .collect::<Result<Vec<f64>>>()?;
    let mut data = Vec::with_capacity(n * strip.channels().len());
    for c in 0..strip.channels().len() {
        let plane = strip.plane(c);
        data.extend((0..n).map(|p| {
            let sum: f64 =
                weights.iter().enumerate().map(|(k, w)| w * f64::from(plane[k * n + p])).sum();
            sum as f32
        }));
    }
    let mut image = Image::new(n / height, height, strip.channels(), data)?;
    (image.sample, image.transfer) = (strip.sample, strip.transfer);
    image.icc = strip.icc.clone();
    Ok(image)
}
