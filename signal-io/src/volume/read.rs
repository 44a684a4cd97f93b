use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::{VolumeFormat, nifti, npy, nrrd, raw, tiff};
use crate::budget::Budget;
use crate::format::extension;
use crate::{Error, Result, Volume};

/// What [`read_volume`] may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VolumeReadOptions {
    /// The most bytes the volume may take in memory (4 per value). The file is in memory too while it is
    /// read. Default: 4 GiB.
    pub limit_bytes: u64,
}

impl Default for VolumeReadOptions {
    fn default() -> Self {
        Self { limit_bytes: 4 << 30 }
    }
}

/// Bytes that decide the format.
const HEAD: usize = 8;

/// Reads a volume. The format is found from the content, and from the extension where the content does
/// not tell; the crate's first page has the table of formats.
///
/// Sizes are checked before anything is allocated for them: against `limit_bytes`, and against what the
/// bytes there are could hold. NaN and infinite values are kept.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Io`], [`Error::UnsupportedFormat`], [`Error::UnsupportedFeature`],
/// [`Error::Corrupt`], [`Error::TooLarge`], [`Error::OutOfMemory`] and [`Error::Empty`].
pub fn read_volume(path: impl AsRef<Path>, options: &VolumeReadOptions) -> Result<Volume> {
    let path = path.as_ref();
    let bytes = read_bounded(path, options.limit_bytes)?;
    match find_format(path, &bytes)? {
        VolumeFormat::Raw => raw::read(path, &bytes, options),
        format => decode(path, format, &bytes, options),
    }
}

/// The same for a file that is in memory already; `name` stands for the path in messages. A JSON
/// description names another file and cannot be read so.
///
/// # Errors
/// Those of [`read_volume`], without the ones of the file system.
pub fn decode_volume(
    name: impl AsRef<Path>,
    bytes: &[u8],
    options: &VolumeReadOptions,
) -> Result<Volume> {
    decode(name.as_ref(), find_format(name.as_ref(), bytes)?, bytes, options)
}

/// The bytes of a file, if they are not more than a volume within the limit can need.
pub(crate) fn read_bounded(path: &Path, limit_bytes: u64) -> Result<Vec<u8>> {
    let io_error = |source| Error::io(path, "read", source);
    let file = File::open(path).map_err(io_error)?;
    // Twice the volume: doubles are that large. 1 MiB: headers of small ones.
    let limit = limit_bytes.saturating_mul(2).saturating_add(1 << 20);
    let length = file.metadata().map_err(io_error)?.len();
    let too_large = |needed| Error::TooLarge { path: path.to_path_buf(), needed, limit };
    if length > limit {
        return Err(too_large(length));
    }
    // The length of a pipe is not known, hence the second check.
    let mut bytes = Vec::new();
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(io_error)?;
    match bytes.len() as u64 > limit {
        true => Err(too_large(bytes.len() as u64)),
        false => Ok(bytes),
    }
}

fn find_format(path: &Path, bytes: &[u8]) -> Result<VolumeFormat> {
    if bytes.is_empty() {
        return Err(Error::Empty { path: path.to_path_buf() });
    }
    let content = VolumeFormat::from_content(&bytes[..bytes.len().min(HEAD)]);
    content.or_else(|| VolumeFormat::from_extension(path)).ok_or_else(|| Error::UnsupportedFormat {
        path: path.to_path_buf(),
        extension: extension(path),
        known: VolumeFormat::EXTENSIONS,
    })
}

fn decode(
    path: &Path,
    format: VolumeFormat,
    bytes: &[u8],
    options: &VolumeReadOptions,
) -> Result<Volume> {
    let budget = Budget::new(options.limit_bytes);
    match format {
        VolumeFormat::Nifti => nifti::decode(bytes, &budget),
        VolumeFormat::Nrrd => nrrd::decode(bytes, &budget),
        VolumeFormat::Npy => npy::decode(bytes, &budget),
        VolumeFormat::Tiff => tiff::decode(bytes, &budget),
        VolumeFormat::Raw => raw::refuse(),
    }
    .map_err(|fault| fault.at(path, format.name(), "read"))
}
