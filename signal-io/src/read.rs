use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::budget::Budget;
use crate::codec;
use crate::format::extension;
use crate::{Error, Format, Image, Result, Transfer};

/// What [`read_image`] may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// The most bytes the decoded picture may take in memory (4 per sample). Decoding needs up to
    /// about three times as much for a moment. Default: 4 GiB.
    pub limit_bytes: u64,
    /// What the values of the file mean, where the caller knows better than the format: for example
    /// `Some(Transfer::Linear)` for an npy array of radiances. Only the label changes.
    pub transfer: Option<Transfer>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { limit_bytes: 4 << 30, transfer: None }
    }
}

/// Bytes that decide the format.
pub(crate) const HEAD: usize = 16;

/// Reads a picture. The format is found from the content; the extension counts only when the
/// content is unknown, and then only for a better message.
///
/// The crate's first page has the table of formats. Animations give their first frame, EXR files
/// the first layer; EXIF orientation is applied; the ICC profile is carried along. NaN and infinite
/// values of float files are kept: check with `Samples::check_finite` where they would do harm.
///
/// The file is read into memory once, so pipes work too. Sizes are checked before anything is
/// allocated for them: against `limit_bytes`, and against what the bytes there are could hold.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Io`], [`Error::UnsupportedFormat`], [`Error::UnsupportedFeature`],
/// [`Error::Corrupt`], [`Error::TooLarge`], [`Error::OutOfMemory`] and [`Error::Empty`].
pub fn read_image(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Image> {
    let path = path.as_ref();
    let (format, bytes) = read_bytes(path, options, |head| find_format(path, head))?;
    decode(path, format, &bytes, options)
}

/// The first bytes of a file, at most this many.
pub(crate) fn head_of(path: &Path, count: usize) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let io_error = |source| Error::io(path, "read", source);
    let file = File::open(path).map_err(io_error)?;
    file.take(count as u64).read_to_end(&mut bytes).map_err(io_error)?;
    Ok(bytes)
}

/// The bytes of a file of bounded length, after `accept` has agreed to its first [`HEAD`] bytes.
pub(crate) fn read_bytes<T>(
    path: &Path,
    options: &ReadOptions,
    accept: impl FnOnce(&[u8]) -> Result<T>,
) -> Result<(T, Vec<u8>)> {
    let io_error = |source| Error::io(path, "read", source);
    let mut file = File::open(path).map_err(io_error)?;
    let length = file.metadata().map_err(io_error)?.len();
    let mut bytes = Vec::new();
    (&mut file).take(HEAD as u64).read_to_end(&mut bytes).map_err(io_error)?;
    let accepted = accept(&bytes)?;

    // Twice the picture: float64 arrays are that large. 1 MiB: headers and profiles of small ones.
    let limit = options.limit_bytes.saturating_mul(2).saturating_add(1 << 20);
    if length > limit {
        return Err(Error::TooLarge { path: path.to_path_buf(), needed: length, limit });
    }
    // The length of a pipe is not known, hence the second check.
    let rest = limit.saturating_sub(bytes.len() as u64).saturating_add(1);
    file.take(rest).read_to_end(&mut bytes).map_err(io_error)?;
    if bytes.len() as u64 > limit {
        let needed = bytes.len() as u64;
        return Err(Error::TooLarge { path: path.to_path_buf(), needed, limit });
    }
    Ok((accepted, bytes))
}

/// The same for a file that is in memory already; `name` stands for the path in messages.
///
/// # Errors
/// Those of [`read_image`], without the ones of the file system.
pub fn decode_image(name: impl AsRef<Path>, bytes: &[u8], options: &ReadOptions) -> Result<Image> {
    let format = find_format(name.as_ref(), &bytes[..bytes.len().min(HEAD)])?;
    decode(name.as_ref(), format, bytes, options)
}

/// The format that the first bytes show or, failing that, the name.
pub(crate) fn find_format(path: &Path, head: &[u8]) -> Result<Format> {
    if head.is_empty() {
        return Err(Error::Empty { path: path.to_path_buf() });
    }
    Format::from_content(head).or_else(|| Format::from_extension(path)).ok_or_else(|| {
        Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: extension(path),
            known: Format::READABLE,
        }
    })
}

fn decode(path: &Path, format: Format, bytes: &[u8], options: &ReadOptions) -> Result<Image> {
    let budget = Budget::new(options.limit_bytes);
    let mut image = codec::decode(format, bytes, &budget)
        .map_err(|fault| fault.at(path, format.name(), "read"))?;
    image.transfer = options.transfer.unwrap_or(image.transfer);
    Ok(image)
}
