use std::path::Path;

use flate2::read::GzDecoder;

use super::{Volume, array, nifti};
use crate::budget::Budget;
use crate::error::Fault;
use crate::format::extension;
use crate::read::{HEAD, read_bytes};
use crate::{Error, ReadOptions, Result};

/// The best that deflate does: bytes of zeros shrink to a 1032nd.
const BEST_RATIO: u64 = 1032;

/// The forms of volumes this crate knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum VolumeFormat {
    /// NIfTI-1 or NIfTI-2 in one file.
    Nifti,
    /// The same, compressed.
    NiftiGz,
    /// A NumPy array with axes (Z, Y, X) or (Z, Y, X, C).
    Array,
}

impl VolumeFormat {
    /// What [`read_volume`] and [`write_volume`](crate::write_volume) know.
    pub const KNOWN: &'static str = "nii, nii.gz, npy";

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nifti => "NIfTI",
            Self::NiftiGz => "compressed NIfTI",
            Self::Array => "npy",
        }
    }

    /// The format that a name promises; upper and lower case are the same.
    pub fn from_extension(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        [(".nii", Self::Nifti), (".nii.gz", Self::NiftiGz), (".npy", Self::Array)]
            .into_iter()
            .find(|(ending, _)| name.ends_with(ending))
            .map(|(_, format)| format)
    }

    fn from_content(head: &[u8]) -> Option<Self> {
        match head {
            [0x1f, 0x8b, ..] => Some(Self::NiftiGz),
            head if head.starts_with(b"\x93NUMPY") => Some(Self::Array),
            head => nifti::is_head(head).then_some(Self::Nifti),
        }
    }
}

/// Reads a volume. The format is found from the content.
///
/// * NIfTI-1 and -2, plain or compressed, both byte orders: integers and floats of 8 to 64 bits; slope and
///   intercept are applied; the place is that of the sform, else of the qform, else the voxel sizes alone;
///   metres and micrometres become millimetres. Axes beyond the third become channels.
/// * `.npy` with axes (Z, Y, X) or (Z, Y, X, C), both orders: integers and floats; voxels of 1 mm, no place.
///
/// [`ReadOptions::limit_bytes`] bounds the decoded volume (4 bytes per value); `transfer` means nothing here.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Io`], [`Error::UnsupportedFormat`], [`Error::UnsupportedFeature`],
/// [`Error::Corrupt`], [`Error::TooLarge`], [`Error::OutOfMemory`] and [`Error::Empty`].
pub fn read_volume(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Volume> {
    let path = path.as_ref();
    let (format, bytes) = read_bytes(path, options, |head| find_format(path, head))?;
    decode(path, format, &bytes, options)
}

/// The same for a file that is in memory already; `name` stands for the path in messages.
///
/// # Errors
/// Those of [`read_volume`], without the ones of the file system.
pub fn decode_volume(
    name: impl AsRef<Path>,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<Volume> {
    let format = find_format(name.as_ref(), &bytes[..bytes.len().min(HEAD)])?;
    decode(name.as_ref(), format, bytes, options)
}

fn find_format(path: &Path, head: &[u8]) -> Result<VolumeFormat> {
    if head.is_empty() {
        return Err(Error::Empty { path: path.to_path_buf() });
    }
    VolumeFormat::from_content(head).or_else(|| VolumeFormat::from_extension(path)).ok_or_else(
        || Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: extension(path),
            known: VolumeFormat::KNOWN,
        },
    )
}

fn decode(
    path: &Path,
    format: VolumeFormat,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<Volume> {
    let (budget, length) = (Budget::new(options.limit_bytes), bytes.len() as u64);
    let decoded: std::result::Result<Volume, Fault> = match format {
        VolumeFormat::Nifti => nifti::decode(bytes, length, &budget),
        VolumeFormat::NiftiGz => {
            nifti::decode(GzDecoder::new(bytes), length.saturating_mul(BEST_RATIO), &budget)
        }
        VolumeFormat::Array => array::decode(bytes, &budget),
    };
    decoded.map_err(|fault| fault.at(path, format.name(), "read"))
}
