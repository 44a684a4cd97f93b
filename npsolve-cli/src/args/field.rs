//! The commands that make and use fields.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::Depth;
use crate::field_kind::{FieldKind, FieldOptions};
use crate::kind::SignalKind;
use crate::values::{self, Crop, Size, Slice};

/// Seed of a fit when none is given.
pub const DEFAULT_SEED: u64 = 1;

/// `npsolve fit`
#[derive(Debug, Args)]
pub struct FitArgs {
    /// The signal to fit, of 1 to 4 channels: a picture, sound, a volume, a video or a light field.
    pub signal: PathBuf,
    /// What the file is [default: what its name and content say].
    #[arg(long, value_enum)]
    pub kind: Option<SignalKind>,
    /// The light field is a picture of lenslets with this many pixels across and down below each lens.
    #[arg(long, value_name = "UxV", value_parser = values::size)]
    pub lenslet: Option<Size>,
    /// The field, a .safetensors file. Until the fit is finished it holds all that --resume needs.
    #[arg(short, long, value_name = "FIELD")]
    pub output: PathBuf,
    /// What kind of network [default: grid].
    #[arg(long, value_enum, value_name = "KIND")]
    pub field: Option<FieldKind>,
    /// Stop at this peak signal-to-noise ratio over all samples, in dB.
    #[arg(long, value_name = "DB", help_heading = "Limits", value_parser = values::decibel)]
    #[arg(allow_hyphen_values = true)]
    pub target_psnr: Option<f64>,
    /// Stop after this time: 2s, 500ms, 2m; a plain number is seconds.
    #[arg(long, value_name = "TIME", help_heading = "Limits", value_parser = values::duration)]
    #[arg(allow_hyphen_values = true)]
    pub budget: Option<Duration>,
    /// Stop after this many steps [default: 2000 or 3000, depending on the kind; none with --budget].
    #[arg(long, value_name = "N", help_heading = "Limits", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub options: FieldOptions,
    /// Seed of the first numbers and of the batches: with --steps, the same seed gives the same bits
    /// [default: 1].
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub seed: Option<u64>,
    /// How often the unfinished training is written.
    #[arg(long, value_name = "TIME", default_value = "10s", help_heading = "Checkpoints")]
    #[arg(value_parser = values::duration, allow_hyphen_values = true)]
    pub checkpoint_every: Duration,
    /// Go on with the unfinished FIELD, as if it had never stopped; wants the same picture. Options
    /// are taken from the file; those that are given must be the same.
    #[arg(long, help_heading = "Checkpoints")]
    pub resume: bool,
    /// Leave the state of the training in the finished file (three times its size).
    #[arg(long, help_heading = "Checkpoints")]
    pub keep_training: bool,
    /// Stop after this many steps in all, as if killed there.
    #[arg(long, value_name = "N", hide = true)]
    pub stop_after: Option<u64>,
    /// Overwrite an existing file.
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Print the numbers as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
}

impl FitArgs {
    /// An option that the kind of field does not have, as a message.
    pub fn check(&self) -> Result<(), String> {
        match (self.field, self.resume) {
            // The kind is in the file.
            (None, true) => Ok(()),
            (kind, _) => kind.unwrap_or_default().resolve(&self.options).map(|_| ()),
        }
    }
}

/// `npsolve render`
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A field (.safetensors), or any picture, which stands for the cubic spline
    /// through its pixels. Of a video one frame, of a light field one view, of a volume slices, of sound
    /// the spectrogram.
    pub field: PathBuf,
    /// The frame of a video to show, from 0; fractions lie between frames [default: the middle one].
    #[arg(long, value_name = "T", value_parser = values::not_negative)]
    pub frame: Option<f32>,
    /// The view of a light field to show: column and row from 0; fractions lie between views [default: the middle].
    #[arg(long, value_name = "U,V", value_parser = values::view)]
    pub view: Option<[f32; 2]>,
    /// Focus a light field on what moves by this many pixels from view to view; 0 is what does not move.
    #[arg(long, value_name = "PX", value_parser = values::any_number, allow_hyphen_values = true)]
    #[arg(conflicts_with = "view")]
    pub refocus: Option<f32>,
    /// The light field is a picture of lenslets with this many pixels across and down below each lens.
    #[arg(long, value_name = "UxV", value_parser = values::size)]
    pub lenslet: Option<Size>,
    /// The slice of a volume to show: axis and number, as z:40 [default: the three through the middle].
    #[arg(long, value_name = "AXIS:N", value_parser = values::slice)]
    pub slice: Option<Slice>,
    /// What the file is [default: what its name and content say].
    #[arg(long, value_enum)]
    pub kind: Option<SignalKind>,
    /// Write the signal itself and not a picture of it: sound, a volume, a video or a light field on its own lattice,
    /// or on one finer by --scale. Endings that no picture has, such as wav and nii, mean the same.
    #[arg(long, conflicts_with_all = ["frame", "view", "refocus", "slice"])]
    pub whole: bool,
    /// The picture; the extension says the format: png, jpg, tif, webp, pgm, ppm, pam, pfm, hdr, exr, npy.
    #[arg(short, long, value_name = "OUT", required_unless_present = "gradient")]
    pub output: Option<PathBuf>,
    /// Pixels of the result; the outer edges stay in place, and where it is coarser than the
    /// signal, pixels are averages [default: the signal's].
    #[arg(long, value_name = "WxH", value_parser = values::size, conflicts_with = "scale")]
    pub size: Option<Size>,
    /// The signal's number of pixels, or the crop's, times this.
    #[arg(long, value_name = "S", value_parser = values::positive, allow_hyphen_values = true)]
    pub scale: Option<f32>,
    /// A part of it: left edge, upper edge, width and height in pixels of the signal; fractions are fine.
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::crop, allow_hyphen_values = true)]
    pub crop: Option<Crop>,
    /// Write the gradient per pixel of the signal as well: exr and npy get all derivatives (dx, then dy
    /// of each channel), other formats its length per channel, which integers hold relative to the largest.
    #[arg(long, value_name = "OUT")]
    pub gradient: Option<PathBuf>,
    /// Number type of the picture [default: the signal's, if the format has it].
    #[arg(long, value_enum, requires = "output")]
    pub depth: Option<Depth>,
    /// Overwrite existing files.
    #[arg(long)]
    pub force: bool,
    /// Print the numbers as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
}
