use std::io::Write;
use std::path::Path;

use super::{Video, gif, webp, y4m};
use crate::format::extension;
use crate::plan::Plan;
use crate::strip::folder::Series;
use crate::strip::pattern::is_pattern;
use crate::{Error, Format, Result, SampleType, Transfer, WriteOptions, atomic};

/// The forms of videos this crate knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum VideoFormat {
    /// Animated GIF: at most 256 colours per frame, transparency on or off.
    Gif,
    /// Animated WebP; written without loss.
    WebP,
    /// YUV4MPEG2, uncompressed.
    Y4m,
    /// A folder of pictures.
    Pictures,
}

impl VideoFormat {
    /// What [`read_video`](crate::read_video) knows.
    pub const READABLE: &'static str =
        "gif, webp, y4m, a folder of pictures, a pattern such as frame_%04d.png";
    /// What [`write_video`] knows.
    pub const WRITABLE: &'static str = Self::READABLE;

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gif => "GIF",
            Self::WebP => "WebP",
            Self::Y4m => "Y4M",
            Self::Pictures => "picture sequence",
        }
    }

    /// The file format that a name promises; upper and lower case are the same.
    pub fn from_extension(path: &Path) -> Option<Self> {
        Some(match extension(path).as_str() {
            "gif" => Self::Gif,
            "webp" => Self::WebP,
            "y4m" => Self::Y4m,
            _ => return None,
        })
    }
}

/// What [`write_video`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VideoWriteOptions {
    /// Replace an existing file, or the files of an existing series.
    pub force: bool,
    /// The number type of pictures in a folder; `None` takes the video's own where the format has
    /// it. GIF and WebP have 8 bits only.
    pub sample: Option<SampleType>,
    /// JPEG quality of pictures in a folder, 1 to 100. Default: 95.
    pub jpeg_quality: u8,
    /// Bits per value in Y4M: 8 (default), 10, 12 or 16.
    pub y4m_bits: u8,
    /// Write Y4M in the full range, 0 to 255 in 8 bits; otherwise, and by default, in the limited
    /// range, 16 to 235, which every player expects.
    pub y4m_full_range: bool,
}

impl Default for VideoWriteOptions {
    fn default() -> Self {
        Self { force: false, sample: None, jpeg_quality: 95, y4m_bits: 8, y4m_full_range: false }
    }
}

impl VideoWriteOptions {
    fn picture(&self) -> WriteOptions {
        WriteOptions { force: self.force, sample: self.sample, jpeg_quality: self.jpeg_quality }
    }
}

/// What [`write_video`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VideoReport {
    /// The form written.
    pub format: VideoFormat,
    /// What the values mean there.
    pub transfer: Transfer,
    /// Frames written.
    pub frames: usize,
    /// Colour samples written (alpha not counted).
    pub samples: usize,
    /// How many of them (in Y4M: of their luma and chroma values) were moved to the nearest value
    /// that the number type has by more than rounding.
    pub clipped: usize,
}

/// The names of frames in a folder for which no pattern is given; they count from 0.
const FRAMES: &str = "frame_%04d.png";

/// Where a path leads.
enum Target {
    File(VideoFormat),
    Series(Series),
}

fn target(path: &Path) -> Result<Target> {
    let unknown = || Error::UnsupportedFormat {
        path: path.to_path_buf(),
        extension: extension(path),
        known: VideoFormat::WRITABLE,
    };
    // Patterns come first: `frame_%04d.webp` are pictures.
    if let Some(series) = Series::of_path(path, 1, FRAMES) {
        return Ok(Target::Series(series));
    }
    match VideoFormat::from_extension(path) {
        Some(format) if !is_pattern(path) => Ok(Target::File(format)),
        _ => Err(unknown()),
    }
}

/// Writes a video completely or not at all; the name of the target says the form.
///
/// * `.gif`: 256 colours per frame. Frames of at most 256 colours are kept exactly, others are
///   quantised (NeuQuant), which changes most values by a few of 255; alpha becomes on or off at
///   0.5. Times are rounded to 1/100 s.
/// * `.webp`: 8 bits without loss, alpha and profile included. Times are rounded to 1/1000 s.
/// * `.y4m`: 4:4:4 or mono. A value comes back within one step of its luma and chroma codes: in the
///   limited range of 8 bits within 2/255 of its red, green and blue. Constant rate: the mean where
///   delays differ. No alpha.
/// * `folder/frame_%04d.png`, or a folder (an existing one, a name without extension, or with a slash
///   at its end), which gets `frame_0000.png`, `frame_0001.png` and so on: pictures, see
///   [`write_image`](crate::write_image). A new folder appears when it is complete; in an existing one
///   the files are renamed into place when all are written. The rate is not stored.
///
/// Animations repeat for ever. As in pictures, light becomes sRGB in all forms that are made for
/// display.
///
/// # Errors
/// Those of [`write_image`](crate::write_image). [`Error::CannotHold`] also when an existing folder
/// has files of a longer series, which would be left over behind the new ones.
pub fn write_video(
    path: impl AsRef<Path>,
    video: &Video,
    options: &VideoWriteOptions,
) -> Result<VideoReport> {
    let path = path.as_ref();
    let frames = video.shape()[2];
    let format = match target(path)? {
        Target::File(format) => format,
        Target::Series(series) => {
            let numbers: Vec<Vec<usize>> = (0..frames).map(|t| vec![t]).collect();
            let report = series.write(&numbers, |t| video.frame(t), &options.picture())?;
            let (samples, clipped, transfer) = (report.samples, report.clipped, report.transfer);
            let format = VideoFormat::Pictures;
            return Ok(VideoReport { format, transfer, frames, samples, clipped });
        }
    };
    atomic::check_place(path, options.force)?;
    let named = |fault: crate::error::Fault| fault.at(path, format.name(), "write");
    let transfer = match video.transfer() {
        Transfer::Unspecified => Transfer::Unspecified,
        _ => Transfer::Srgb,
    };
    let (bytes, clipped) = match format {
        VideoFormat::Gif => animation(Format::Gif, video, options).and_then(gif::encode),
        VideoFormat::WebP => animation(Format::WebP, video, options).and_then(webp::encode),
        _ => y4m::encode(video, options.y4m_bits, options.y4m_full_range),
    }
    .map_err(named)?;
    atomic::replace(path, options.force, |writer| {
        writer.write_all(&bytes).map_err(|e| named(e.into()))
    })?;
    let strip = video.as_strip();
    let samples = strip.color_count() * strip.pixel_count();
    Ok(VideoReport { format, transfer, frames, samples, clipped })
}

/// A video and the plan by which its frames go into pictures of a format.
pub(super) type Animation<'a> = (&'a Video, Plan);

fn animation<'a>(
    format: Format,
    video: &'a Video,
    options: &VideoWriteOptions,
) -> std::result::Result<Animation<'a>, crate::error::Fault> {
    // Asking for more than 8 bits is an error; a video that merely has more is rounded.
    let extension = if format == Format::Gif { "gif" } else { "webp" };
    Ok((video, Plan::new(format, extension, &video.frame(0), &options.picture())?))
}

/// Everything about a target that can be known before there is a video: form, folder, existing
/// files. Call it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_video_target(path: impl AsRef<Path>, force: bool) -> Result<()> {
    let path = path.as_ref();
    match target(path)? {
        Target::File(_) => atomic::check_place(path, force),
        Target::Series(series) => series.check(force),
    }
}
