use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::{Volume, VolumeFormat, VoxelType, array, nifti};
use crate::error::Fault;
use crate::format::extension;
use crate::{Error, Result, atomic};

/// What [`write_volume`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VolumeWriteOptions {
    /// Replace an existing file.
    pub force: bool,
    /// The number type to store; `None` takes the volume's own.
    pub voxel: Option<VoxelType>,
}

/// What [`write_volume`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VolumeReport {
    /// The format written.
    pub format: VolumeFormat,
    /// The number type written.
    pub voxel: VoxelType,
    /// Values written, all channels together.
    pub samples: usize,
    /// How many of them were moved to the nearest value that the number type has by more than rounding.
    pub clipped: usize,
}

/// Writes a volume completely or not at all; the name of the target says the format.
///
/// A volume that was read from NIfTI is written to NIfTI with the same header, extensions included, and the same
/// scaling: values that did not change get the numbers they had. Arrays store the values themselves. Values that
/// are not finite become 0 in integers, and count as clipped.
///
/// # Errors
/// [`Error::UnsupportedFormat`] for other extensions, [`Error::Exists`], [`Error::NoFolder`],
/// [`Error::NotAFile`] and [`Error::Io`]; in each case there is no new file and an existing one is unchanged.
pub fn write_volume(
    path: impl AsRef<Path>,
    volume: &Volume,
    options: &VolumeWriteOptions,
) -> Result<VolumeReport> {
    let path = path.as_ref();
    let format = check(path, options.force)?;
    let voxel = options.voxel.unwrap_or(volume.voxel);
    let clipped = atomic::replace(path, options.force, |writer| {
        let written: std::result::Result<usize, Fault> = match format {
            VolumeFormat::Nifti => nifti::encode(volume, voxel, writer),
            VolumeFormat::NiftiGz => {
                let mut packed = GzEncoder::new(&mut *writer, Compression::default());
                nifti::encode(volume, voxel, &mut packed)
                    .and_then(|clipped| Ok(packed.finish().map(|_| clipped)?))
            }
            VolumeFormat::Array => array::encode(volume, voxel, writer),
        };
        written.map_err(|fault| fault.at(path, format.name(), "write"))
    })?;
    Ok(VolumeReport { format, voxel, samples: volume.as_planar().len(), clipped })
}

/// Everything about a target that can be known before there is a volume: extension, folder and existing file. Call
/// it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_volume_target(path: impl AsRef<Path>, force: bool) -> Result<()> {
    check(path.as_ref(), force).map(|_| ())
}

fn check(path: &Path, force: bool) -> Result<VolumeFormat> {
    let format = VolumeFormat::from_extension(path).ok_or_else(|| Error::UnsupportedFormat {
        path: path.to_path_buf(),
        extension: extension(path),
        known: VolumeFormat::KNOWN,
    })?;
    atomic::check_place(path, force)?;
    Ok(format)
}
