use std::path::Path;

use super::wav;
use crate::format::extension;
use crate::{Audio, AudioFormat, AudioSample, Error, Result, atomic};

/// What [`write_audio`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AudioWriteOptions {
    /// Replace an existing file.
    pub force: bool,
    /// The number type to store; `None` takes the sound's own.
    pub sample: Option<AudioSample>,
}

/// What [`write_audio`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AudioReport {
    /// The format written.
    pub format: AudioFormat,
    /// The number type written.
    pub sample: AudioSample,
    /// Samples written, all channels together.
    pub samples: usize,
    /// How many of them were outside [-1, 1] by more than rounding, or NaN, and were moved to the
    /// nearest value of an integer type (NaN to 0).
    pub clipped: usize,
}

/// Writes sound completely or not at all, as WAV.
///
/// Floats are written as they are. Integers are `round(value * 2^(bits - 1))`, to nearest without
/// dither, clamped to the range of the type.
///
/// # Errors
/// [`Error::UnsupportedFormat`] for other extensions, [`Error::Exists`], [`Error::NoFolder`],
/// [`Error::NotAFile`], [`Error::CannotHold`] beyond the 4 GiB of a WAV file, [`Error::Encode`] and
/// [`Error::Io`]; in each case there is no new file and an existing one is unchanged.
pub fn write_audio(
    path: impl AsRef<Path>,
    audio: &Audio,
    options: &AudioWriteOptions,
) -> Result<AudioReport> {
    let path = path.as_ref();
    check_audio_target(path, options.force)?;
    let (format, sample) = (AudioFormat::Wav, options.sample.unwrap_or(audio.sample));
    let clipped = atomic::replace(path, options.force, |writer| {
        wav::encode(audio, sample, writer).map_err(|f| f.at(path, format.name(), "write"))
    })?;
    Ok(AudioReport { format, sample, samples: audio.as_planar().len(), clipped })
}

/// Everything about a target that can be known before there is sound: extension, folder and
/// existing file. Call it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_audio_target(path: impl AsRef<Path>, force: bool) -> Result<()> {
    let path = path.as_ref();
    if AudioFormat::from_extension(path) != Some(AudioFormat::Wav) {
        return Err(Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: extension(path),
            known: AudioFormat::WRITABLE,
        });
    }
    atomic::check_place(path, force)
}
