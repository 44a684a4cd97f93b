use std::path::Path;

use super::{AudioFormat, wav};
use crate::budget::Budget;
use crate::error::Fault;
use crate::format::extension;
use crate::read::{HEAD, read_bytes};
use crate::{Audio, Error, ReadOptions, Result};

/// Reads sound. The format is found from the content; the extension counts only when the content is
/// unknown, and then only for a better message.
///
/// The crate's first page has the table of formats. [`ReadOptions::limit_bytes`] bounds the decoded
/// sound (4 bytes per sample), whatever lengths the file claims; `transfer` means nothing here.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Io`], [`Error::UnsupportedFormat`], [`Error::UnsupportedFeature`],
/// [`Error::FeatureOff`], [`Error::Corrupt`], [`Error::TooLarge`], [`Error::OutOfMemory`] and
/// [`Error::Empty`].
pub fn read_audio(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Audio> {
    let path = path.as_ref();
    let (format, bytes) = read_bytes(path, options, |head| find_format(path, head))?;
    decode(path, format, &bytes, options)
}

/// The same for a file that is in memory already; `name` stands for the path in messages.
///
/// # Errors
/// Those of [`read_audio`], without the ones of the file system.
pub fn decode_audio(name: impl AsRef<Path>, bytes: &[u8], options: &ReadOptions) -> Result<Audio> {
    let format = find_format(name.as_ref(), &bytes[..bytes.len().min(HEAD)])?;
    decode(name.as_ref(), format, bytes, options)
}

fn find_format(path: &Path, head: &[u8]) -> Result<AudioFormat> {
    if head.is_empty() {
        return Err(Error::Empty { path: path.to_path_buf() });
    }
    AudioFormat::from_content(head).or_else(|| AudioFormat::from_extension(path)).ok_or_else(|| {
        Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: extension(path),
            known: AudioFormat::READABLE,
        }
    })
}

fn decode(path: &Path, format: AudioFormat, bytes: &[u8], options: &ReadOptions) -> Result<Audio> {
    let budget = Budget::new(options.limit_bytes);
    let bytes = without_id3(bytes);
    // Some programs put the tags of MP3 before FLAC.
    let format = AudioFormat::from_content(bytes).unwrap_or(format);
    let decoded = match format {
        AudioFormat::Wav => wav::decode(bytes, &budget),
        _ => decode_compressed(path, format, bytes, &budget)?,
    };
    decoded.map_err(|fault| fault.at(path, format.name(), "read"))
}

#[cfg(feature = "compressed-audio")]
fn decode_compressed(
    _: &Path,
    format: AudioFormat,
    bytes: &[u8],
    budget: &Budget,
) -> Result<std::result::Result<Audio, Fault>> {
    Ok(super::compressed::decode(format, bytes, budget))
}

#[cfg(not(feature = "compressed-audio"))]
fn decode_compressed(
    path: &Path,
    format: AudioFormat,
    _: &[u8],
    _: &Budget,
) -> Result<std::result::Result<Audio, Fault>> {
    let feature = "compressed-audio";
    Err(Error::FeatureOff { path: path.to_path_buf(), format: format.name(), feature })
}

/// The file without ID3v2 tags at its start, which may hold pictures of megabytes.
///
/// Source: ID3v2.4.0, section 3.1: ten bytes with the size in four times seven bits.
fn without_id3(bytes: &[u8]) -> &[u8] {
    let mut rest = bytes;
    while let [b'I', b'D', b'3', _, _, flags, a, b, c, d, ..] = *rest {
        let size = [a, b, c, d].iter().fold(0, |size, byte| size << 7 | usize::from(byte & 0x7f));
        let footer = if flags & 0x10 != 0 { 10 } else { 0 };
        rest = rest.get(10 + size + footer..).unwrap_or_default();
    }
    rest
}
