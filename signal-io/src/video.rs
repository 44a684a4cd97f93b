mod gif;
mod read;
mod rgba;
mod timing;
mod webp;
mod write;
mod y4m;

use inr_core::Samples;

pub use self::read::{decode_video, read_video};
pub use self::timing::Timing;
pub use self::write::{
    VideoFormat, VideoReport, VideoWriteOptions, check_video_target, write_video,
};
use crate::{Image, Result, SampleType, Transfer, strip};

/// Frames of a GIF or WebP file; `None` for everything else, damaged files included.
pub(crate) fn frame_count(bytes: &[u8]) -> Option<usize> {
    match bytes {
        [b'G', b'I', b'F', ..] => gif::frame_count(bytes),
        [b'R', b'I', b'F', b'F', ..] => webp::frame_count(bytes),
        _ => None,
    }
}

/// A film in floating point: pictures of one size, one after the other.
///
/// The shape is `[X, Y, T]`: columns, rows, frames. Planes are stored one after the other; inside a
/// plane frames follow each other, in a frame rows go from top to bottom, and x is contiguous: value
/// `(x, y, t)` of channel `c` is `as_planar()[((c * T + t) * Y + y) * X + x]`. Numbers, channel names
/// and alpha are those of [`Image`]; so a video is also one tall picture with the frames one below
/// the other ([`Video::as_strip`]), on which all conversions of pictures work.
#[derive(Debug, Clone, PartialEq)]
pub struct Video {
    strip: Image,
    frames: usize,
    /// How long the frames are shown.
    pub timing: Timing,
}

impl Video {
    /// Takes planar values with their channel names; float, [`Transfer::Unspecified`], 25 frames a
    /// second.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) when an axis or the list of channels is empty, when the
    /// number of values is not `X * Y * T * channels`, or when names are empty or repeated.
    pub fn new<S: AsRef<str>>(shape: [usize; 3], channels: &[S], data: Vec<f32>) -> Result<Self> {
        let [width, height, frames] = shape;
        let strip = Image::new(width, height.saturating_mul(frames), channels, data)?;
        Self::from_strip(strip, frames)
    }

    /// The frames of a tall picture, from top to bottom; sample type, transfer and profile stay.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) when the rows cannot be divided into so many frames.
    pub fn from_strip(strip: Image, frames: usize) -> Result<Self> {
        strip::check_count(&strip, frames)?;
        Ok(Self { strip, frames, timing: Timing::default() })
    }

    /// Frames of one size with the same channels and transfer; sample type and profile are those of
    /// the first. 25 frames a second.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) for no frames, and with the number of the first one
    /// that differs.
    pub fn from_frames(frames: Vec<Image>) -> Result<Self> {
        Self::from_strip(strip::stack(&frames)?, frames.len())
    }

    /// Columns, rows, frames.
    pub fn shape(&self) -> [usize; 3] {
        [self.strip.width(), self.strip.height() / self.frames, self.frames]
    }

    /// Channel names in the order of the planes, alpha included.
    pub fn channels(&self) -> &[String] {
        self.strip.channels()
    }

    /// The number type of the file the video came from.
    pub fn sample(&self) -> SampleType {
        self.strip.sample
    }

    /// How the colour channels relate to light.
    pub fn transfer(&self) -> Transfer {
        self.strip.transfer
    }

    /// All frames, one below the other: `X` columns and `Y * T` rows.
    pub fn as_strip(&self) -> &Image {
        &self.strip
    }

    /// The same without the video around it.
    pub fn into_strip(self) -> Image {
        self.strip
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        self.strip.as_planar()
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        self.strip.as_planar_mut()
    }

    /// The values of one channel in all frames.
    ///
    /// # Panics
    /// If `channel >= channels().len()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        self.strip.plane(channel)
    }

    /// One frame, with sample type, transfer and profile.
    ///
    /// # Panics
    /// If `t >= shape()[2]`.
    pub fn frame(&self, t: usize) -> Image {
        strip::picture(&self.strip, self.frames, t)
    }

    /// The colour channels as typed samples on the lattice with pitch `[1, 1, time_pitch]`.
    ///
    /// The unit is the pixel: one frame counts as `time_pitch` (> 0) pixels, which says how much a
    /// change in time weighs against one in space. 1 is the usual choice; smaller values hold
    /// neighbouring frames together more strongly.
    ///
    /// # Errors
    /// [`Error::ChannelCount`](crate::Error::ChannelCount) when there are not exactly `C` colour
    /// channels, [`Error::Shape`](crate::Error::Shape) when the pitch is not positive and finite.
    pub fn to_samples<const C: usize>(&self, time_pitch: f32) -> Result<Samples<3, C>> {
        strip::to_samples(&self.strip, self.shape(), [1.0, 1.0, time_pitch])
    }

    /// A video of these samples, without alpha; sample type, transfer and profile are those of
    /// `like`, and its timing where it has as many frames, else its mean rate.
    ///
    /// Channels are named as in [`Image::from_samples`].
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) when `C` is 0.
    pub fn from_samples<const C: usize>(samples: &Samples<3, C>, like: &Self) -> Result<Self> {
        let frames = samples.domain().shape()[2];
        let strip = strip::from_samples(samples, &like.strip)?;
        let timing = match frames == like.frames {
            true => like.timing.clone(),
            false => like.timing.to_rate(),
        };
        Ok(Self { strip, frames, timing })
    }
}
