//! `npsolve inspect`: what is in pictures and fields.

mod field;
mod signal;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, bail};
use inr_core::RasterMask;
use serde::Serialize;
use signal_io::{Image, Transfer};

use crate::args::InspectArgs;
use crate::kind::{self, SignalKind};
use crate::report::count;
use crate::{console, field_file, files, mask};
use field::FieldDescription;
use signal::SignalDescription;

/// A plane counts as a mask when at least this share of its values is 0 or 1, and both occur.
const MASK_SHARE: f64 = 0.9;

/// A file, described.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Found {
    Picture(Description),
    Signal(SignalDescription),
    Field(Box<FieldDescription>),
}

/// A picture, described.
#[derive(Debug, Serialize)]
struct Description {
    file: String,
    width: usize,
    height: usize,
    channels: Vec<Channel>,
    sample_type: &'static str,
    transfer: &'static str,
    icc_bytes: Option<usize>,
    mask: Option<MaskDescription>,
}

/// One channel. Values that are not finite count only in `not_finite`.
#[derive(Debug, Serialize)]
struct Channel {
    name: String,
    min: Option<f32>,
    max: Option<f32>,
    mean: Option<f64>,
    not_finite: usize,
}

/// A picture as a mask.
#[derive(Debug, Serialize)]
struct MaskDescription {
    /// "alpha" or "luminance".
    of: &'static str,
    /// Samples of weight 1/2 or more.
    inside: usize,
    /// Samples with a weight between 0 and 1.
    soft: usize,
    components: usize,
    holes: usize,
    /// Largest distance of an inside sample to the outside, in pixels.
    inradius: Option<f32>,
    touches_border: bool,
}

/// Runs the command: all files are tried, the first failure decides the exit code.
pub fn run(args: &InspectArgs) -> Result<()> {
    let (mut found, mut failures) = (Vec::new(), Vec::new());
    for path in &args.files {
        match look(path, args.kind) {
            Ok(one) => found.push(one),
            Err(error) => failures.push(format!("{error:#}")),
        }
    }
    if args.json {
        console::print(&files::to_json(&found)?)?;
    } else {
        console::print(&found.iter().map(Found::to_text).collect::<String>())?;
    }
    match failures.is_empty() {
        true => Ok(()),
        false => bail!("{}", failures.join("\nerror: ")),
    }
}

fn look(path: &Path, kind: Option<SignalKind>) -> Result<Found> {
    if field_file::is_network(path) {
        return Ok(Found::Field(Box::new(field::describe(path)?)));
    }
    match kind.unwrap_or_else(|| kind::of(path)) {
        SignalKind::Image => Ok(Found::Picture(describe(path, &files::read_any(path)?)?)),
        other => Ok(Found::Signal(signal::describe(path, other)?)),
    }
}

fn describe(path: &Path, image: &Image) -> Result<Description> {
    Ok(Description {
        file: path.display().to_string(),
        width: image.width(),
        height: image.height(),
        channels: (0..image.channels().len())
            .map(|c| channel_of(image.channels()[c].clone(), image.plane(c)))
            .collect(),
        sample_type: image.sample.name(),
        transfer: match image.transfer {
            Transfer::Srgb => "sRGB",
            Transfer::Linear => "linear",
            Transfer::Unspecified => "unspecified",
        },
        icc_bytes: image.icc.as_ref().map(Vec::len),
        mask: describe_mask(path, image)?,
    })
}

fn channel_of(name: String, plane: &[f32]) -> Channel {
    let finite = || plane.iter().copied().filter(|v| v.is_finite());
    let n = finite().count();
    Channel {
        name,
        min: finite().reduce(f32::min),
        max: finite().reduce(f32::max),
        mean: (n > 0).then(|| finite().map(f64::from).sum::<f64>() / n as f64),
        not_finite: plane.len() - n,
    }
}

/// The picture as a mask, if it looks like one.
fn describe_mask(path: &Path, image: &Image) -> Result<Option<MaskDescription>> {
    let transparent = image.alpha().is_some_and(|a| a.iter().any(|v| *v != 1.0));
    if !transparent && !matches!(image.color_count(), 1 | 3) {
        return Ok(None);
    }
    let weights = mask::weights_of(image, &path.display().to_string())?;
    let hard = weights.iter().filter(|w| **w == 0.0 || **w == 1.0).count();
    let both = weights.contains(&0.0) && weights.contains(&1.0);
    let looks_like_one = transparent || (both && hard as f64 >= MASK_SHARE * weights.len() as f64);
    if !looks_like_one || weights.iter().any(|w| !(0.0..=1.0).contains(w)) {
        return Ok(None);
    }
    let mask = RasterMask::new(image.domain(), weights)?;
    let radius = mask.inradius(true);
    Ok(Some(MaskDescription {
        of: if transparent { "alpha" } else { "luminance" },
        inside: (0..image.pixel_count()).filter(|k| mask.is_inside(*k)).count(),
        soft: mask.weights().iter().filter(|w| **w > 0.0 && **w < 1.0).count(),
        components: mask.components(),
        holes: mask.holes(),
        inradius: radius.is_finite().then_some(radius),
        touches_border: mask.touches_border(),
    }))
}

impl Found {
    fn to_text(&self) -> String {
        match self {
            Self::Picture(picture) => picture.to_text(),
            Self::Signal(signal) => signal.to_text(),
            Self::Field(field) => field.to_text(),
        }
    }
}

impl Description {
    fn to_text(&self) -> String {
        let mut text = format!(
            "{}: {} x {} pixels, {}, {}, {}",
            self.file,
            self.width,
            self.height,
            count(self.channels.len(), "channel"),
            self.sample_type,
            self.transfer
        );
        match self.icc_bytes {
            Some(bytes) => text += &format!(", colour profile of {bytes} bytes\n"),
            None => text.push('\n'),
        }
        self.channels.iter().for_each(|c| text += &c.to_text());
        if let Some(mask) = &self.mask {
            text += &mask.to_text();
        }
        text
    }
}

impl Channel {
    fn to_text(&self) -> String {
        let mut text = match (self.min, self.max, self.mean) {
            (Some(min), Some(max), Some(mean)) => {
                format!("  {}: {min} to {max}, mean {mean:.4}", self.name)
            }
            _ => format!("  {}: no finite value", self.name),
        };
        if self.not_finite > 0 {
            let _ = write!(text, "; {} not finite", count(self.not_finite, "value"));
        }
        text + "\n"
    }
}

impl MaskDescription {
    fn to_text(&self) -> String {
        let radius = self.inradius.map_or("no".to_owned(), |r| format!("{r:.1} px"));
        let border = if self.touches_border { "touches the border" } else { "clear of the border" };
        format!(
            "  as a mask ({}): {} inside, {} soft, {}, {}, inradius {radius}, {border}\n",
            self.of,
            count(self.inside, "pixel"),
            self.soft,
            count(self.components, "component"),
            count(self.holes, "hole"),
        )
    }
}
