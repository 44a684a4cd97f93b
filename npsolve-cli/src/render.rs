//! `npsolve render`: a field becomes a picture.

mod lattice;
mod sampler;
pub mod slices;
mod slopes;
pub mod spectrum;
mod view;
mod whole;

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use inr_core::{Domain, Spline, Unit};
use serde::Serialize;
use signal_io::{Image, ReadOptions, WriteOptions, WriteReport};

use crate::args::RenderArgs;
use crate::channels::{self, ChannelJob, with_channels};
use crate::field_file::{self, FieldFile};
use crate::kind::{self, SignalKind};
use crate::picture_kind::PictureKind;
use crate::progress::Progress;
use crate::report::count;
use crate::scene::samples_of;
use crate::{console, files};
use sampler::{Planes, Wanted, sample};
use slopes::{Slopes, normalise};

/// `--json`
#[derive(Debug, Serialize)]
struct Report {
    size: [usize; 2],
    channels: Vec<String>,
    /// Position of the first pixel and distance of neighbours, in the signal's units.
    origin: [f32; 2],
    pitch: [f32; 2],
    /// What coordinates and gradients are measured in.
    unit: &'static str,
    picture: Option<Written>,
    gradient: Option<Written>,
    seconds: f64,
}

/// A file.
#[derive(Debug, Serialize)]
struct Written {
    file: String,
    format: &'static str,
    sample_type: &'static str,
    channels: Vec<String>,
    clipped: usize,
    samples: usize,
    /// The number that white stands for, where it is not 1.
    white: Option<f32>,
}

/// Runs the command.
pub fn run(args: &RenderArgs, quiet: bool) -> Result<()> {
    let kind = match args.kind {
        _ if args.lenslet.is_some() => SignalKind::Lightfield,
        Some(kind) => kind,
        None => kind::of(&args.field),
    };
    if whole::is_wanted(kind, args) {
        return whole::run(kind, args, quiet);
    }
    check_targets(args)?;
    view::check(kind, args)?;
    let field = match kind {
        SignalKind::Image => FieldFile::read(&args.field)?,
        other => FieldFile::Picture(view::picture(other, args)?),
    };
    let (kind, signal) = (field.picture_kind(), field.domain()?);
    let lattice = target(args, &signal)?;
    check_size(args, &lattice, kind.channels.len())?;
    check_writes(args, &lattice, &kind)?;

    let start = Instant::now();
    let wanted = Wanted { values: args.output.is_some(), gradient: args.gradient.is_some() };
    let mut progress = Progress::of("rendering", quiet);
    let planes = planes(&args.field, &field, &lattice, wanted, &mut |s| progress.update(s))?;
    drop(progress);
    let seconds = start.elapsed().as_secs_f64();

    let size = lattice.shape();
    let picture = match &args.output {
        Some(path) => {
            let image = kind.picture(size, planes.values)?;
            Some(write(path, &image, &options(args)?, None)?)
        }
        None => None,
    };
    let gradient = match &args.gradient {
        Some(path) => Some(write_gradient(path, args.force, &kind, size, planes.gradient)?),
        None => None,
    };
    let (origin, pitch) = (lattice.origin(), lattice.pitch());
    let unit = match signal.unit_of_length() {
        Unit::Sample => "pixel",
        Unit::Second => "second",
        Unit::Millimetre => "millimetre",
    };
    let channels = kind.channels;
    let report = Report { size, channels, origin, pitch, unit, picture, gradient, seconds };
    if args.json {
        console::print(&files::to_json(&report)?)?;
    } else if !quiet {
        console::print(&report.to_text(&args.field))?;
    }
    Ok(())
}

/// Everything about the targets that can be known before the field is read.
fn check_targets(args: &RenderArgs) -> Result<()> {
    for path in [&args.output, &args.gradient].into_iter().flatten() {
        files::check_picture(path, args.force)?;
    }
    match &args.gradient {
        Some(path) if args.output.as_ref() == Some(path) => {
            bail!("-o and --gradient both name {}; choose two files", path.display())
        }
        _ => Ok(()),
    }
}

fn target(args: &RenderArgs, signal: &Domain<2>) -> Result<Domain<2>> {
    let [w, h] = signal.shape();
    if args.crop.is_some_and(|crop| !lattice::is_inside(signal, &crop)) {
        let file = args.field.display();
        bail!("--crop reaches beyond {file}, which is {w} x {h} pixels; choose a part of it");
    }
    lattice::target(signal, args.crop, args.size, args.scale)
        .with_context(|| format!("{}: choose a smaller --size or --scale", args.field.display()))
}

/// The limit that pictures are read with holds for those that are made.
fn check_size(args: &RenderArgs, lattice: &Domain<2>, channels: usize) -> Result<()> {
    let planes = channels as u64 * if args.gradient.is_some() { 3 } else { 1 };
    let limit = ReadOptions::default().limit_bytes;
    let needed = (lattice.len() as u64).saturating_mul(4 * planes);
    let [w, h] = lattice.shape();
    if needed > limit {
        bail!(
            "{} at {w} x {h} pixels would need {needed} bytes and the limit is {limit}; choose a \
             smaller --size or --scale, or render parts with --crop",
            args.field.display()
        );
    }
    Ok(())
}

/// Whether the formats can hold the pictures to come.
fn check_writes(args: &RenderArgs, lattice: &Domain<2>, kind: &PictureKind) -> Result<()> {
    let blank = |kind: &PictureKind| {
        kind.picture(lattice.shape(), vec![0.0; kind.channels.len() * lattice.len()])
    };
    if let Some(path) = &args.output {
        files::check_write(path, &blank(kind)?, &options(args)?)?;
    }
    if let Some(path) = &args.gradient {
        let kind = Slopes::for_file(path).picture_kind(kind);
        let options = WriteOptions { force: args.force, ..WriteOptions::default() };
        files::check_write(path, &blank(&kind)?, &options)?;
    }
    Ok(())
}

fn options(args: &RenderArgs) -> Result<WriteOptions> {
    let sample = args.depth.map(|d| d.sample_type()).transpose()?;
    Ok(WriteOptions { force: args.force, sample, ..WriteOptions::default() })
}

/// All planes of a field; pictures of many channels in groups.
fn planes(
    path: &Path,
    field: &FieldFile,
    lattice: &Domain<2>,
    wanted: Wanted,
    progress: &mut dyn FnMut(f32),
) -> Result<Planes> {
    let count = field.picture_kind().channels.len();
    let mut all = Planes::default();
    for first in (0..count).step_by(channels::MOST) {
        let size = channels::MOST.min(count - first);
        let mut share = |s: f32| progress((first as f32 + s * size as f32) / count as f32);
        let job = Group { path, field, first, lattice, wanted, progress: &mut share };
        let part = with_channels::<2, _>(size, job).with_context(|| {
            format!("{} has no channels; choose another file", path.display())
        })??;
        all.values.extend(part.values);
        all.gradient.extend(part.gradient);
    }
    Ok(all)
}

/// Some channels of a field.
struct Group<'a> {
    path: &'a Path,
    field: &'a FieldFile,
    first: usize,
    lattice: &'a Domain<2>,
    wanted: Wanted,
    progress: &'a mut dyn FnMut(f32),
}

impl ChannelJob for Group<'_> {
    type Output = Result<Planes>;

    fn run<const C: usize>(self) -> Result<Planes> {
        let planes = match self.field {
            FieldFile::Picture(image) => {
                let spline = Spline::interpolate_owned(samples_of::<C>(image, self.first)?);
                let pitch = spline.domain().pitch();
                sample(&spline, pitch, self.lattice, self.wanted, self.progress)
            }
            FieldFile::Network { bytes, .. } => {
                let checkpoint = field_file::checkpoint::<2, C>(self.path, bytes)?;
                let (network, pitch) = (&checkpoint.network, checkpoint.domain.pitch());
                sample(network, pitch, self.lattice, self.wanted, self.progress)
            }
        };
        planes.with_context(|| format!("{}: choose a smaller --size", self.path.display()))
    }
}

fn write_gradient(
    path: &Path,
    force: bool,
    kind: &PictureKind,
    size: [usize; 2],
    derivatives: Vec<f32>,
) -> Result<Written> {
    let slopes = Slopes::for_file(path);
    let mut planes = slopes.planes(kind, derivatives);
    let kind = slopes.picture_kind(kind);
    let blank = kind.picture([1, 1], vec![0.0; kind.channels.len()])?;
    let white =
        (!files::stored_type(path, &blank, None).is_float()).then(|| normalise(&mut planes));
    let options = WriteOptions { force, ..WriteOptions::default() };
    write(path, &kind.picture(size, planes)?, &options, white)
}

fn write(
    path: &Path,
    image: &Image,
    options: &WriteOptions,
    white: Option<f32>,
) -> Result<Written> {
    let WriteReport { format, sample, clipped, samples, .. } = files::write(path, image, options)?;
    Ok(Written {
        file: path.display().to_string(),
        format: format.name(),
        sample_type: sample.name(),
        channels: image.channels().to_vec(),
        clipped,
        samples,
        white,
    })
}

impl Report {
    fn to_text(&self, field: &Path) -> String {
        let [w, h] = self.size;
        let mut text = format!(
            "Rendered {} as {w} x {h} pixels, {}, in {:.2} s.\n",
            field.display(),
            count(self.channels.len(), "channel"),
            self.seconds
        );
        if let Some(p) = &self.picture {
            let (clipped, samples) = (p.clipped, p.samples);
            let _ = writeln!(
                text,
                "Wrote {} ({} {}); {clipped} of {samples} samples were clipped to fit.",
                p.file, p.sample_type, p.format
            );
        }
        if let Some(g) = &self.gradient {
            let _ = write!(text, "Wrote {} ({} {}): ", g.file, g.sample_type, g.format);
            let per = format!("per {} of the signal", self.unit);
            let _ = match g.white {
                Some(white) => {
                    writeln!(text, "the gradient's length per channel; white is {white:.4} {per}.")
                }
                None if g.channels.len() == 2 * self.channels.len() => {
                    writeln!(text, "derivatives {per}: {}.", g.channels.join(", "))
                }
                None => writeln!(text, "the gradient's length per channel, {per}."),
            };
        }
        text
    }
}
