use std::path::Path;

use super::numbers::Coding;
use super::{Scaling, VolumeFormat, VoxelType, nifti, npy, nrrd, raw, tiff};
use crate::format::extension;
use crate::{Error, Result, Volume, atomic};

/// What [`write_volume`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VolumeWriteOptions {
    /// Replace an existing file.
    pub force: bool,
    /// The number type to store; `None` takes the volume's own, and `f32` where the volume has a scaling
    /// that the format cannot store.
    pub voxel_type: Option<VoxelType>,
    /// What the stored numbers shall mean; `None` takes the volume's own scaling. [`Scaling::spread`] over
    /// [`Volume::range`] uses all numbers of an integer type. Only NIfTI and raw volumes have it: it is
    /// ignored elsewhere.
    pub scaling: Option<Scaling>,
    /// NIfTI-2 also where NIfTI-1 would do: up to 32767 voxels along an axis.
    pub nifti2: bool,
}

/// What [`write_volume`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeReport {
    /// The format written.
    pub format: VolumeFormat,
    /// The number type written.
    pub voxel_type: VoxelType,
    /// What the numbers in the file mean.
    pub scaling: Scaling,
    /// Values written.
    pub samples: usize,
    /// How many of them were outside the range of the number type by more than rounding, or NaN where
    /// it has none, and were moved to the nearest value it has (NaN to the number 0).
    pub clipped: usize,
}

/// Writes a volume completely or not at all; the extension says the format, `.nii.gz` compresses.
///
/// By default the number type and the scaling are those the volume was read with. A value that nobody
/// changed then becomes the number it was: exactly for up to 24 bits, and for floats.
///
/// A raw volume is two files, the numbers beside the description; each is replaced completely or not at
/// all, the description last.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`], [`Error::NotAFile`],
/// [`Error::CannotHold`], [`Error::Encode`] and [`Error::Io`]; in each case there is no new file and
/// an existing one is unchanged.
pub fn write_volume(
    path: impl AsRef<Path>,
    volume: &Volume,
    options: &VolumeWriteOptions,
) -> Result<VolumeReport> {
    let path = path.as_ref();
    check_volume_target(path, options.force)?;
    let format = writable_format(path)?;
    let coding = choose_coding(format, volume, options);
    let compress = extension(path) == "gz";
    let add = |fault: crate::error::Fault| fault.at(path, format.name(), "write");
    if format == VolumeFormat::Raw {
        let clipped = raw::write(path, volume, coding, options.force)?;
        return Ok(report(format, volume, coding, clipped));
    }
    let clipped = atomic::replace(path, options.force, |writer| {
        match format {
            VolumeFormat::Nifti => nifti::encode(volume, coding, options.nifti2, compress, writer),
            VolumeFormat::Nrrd => nrrd::encode(volume, coding, writer),
            VolumeFormat::Npy => npy::encode(volume, coding, writer),
            VolumeFormat::Tiff | VolumeFormat::Raw => tiff::encode(volume, coding, writer),
        }
        .map_err(add)
    })?;
    Ok(report(format, volume, coding, clipped))
}

fn report(format: VolumeFormat, volume: &Volume, coding: Coding, clipped: usize) -> VolumeReport {
    let Coding { sample: voxel_type, scaling, .. } = coding;
    VolumeReport { format, voxel_type, scaling, samples: volume.as_planar().len(), clipped }
}

fn choose_coding(format: VolumeFormat, volume: &Volume, options: &VolumeWriteOptions) -> Coding {
    let mut wanted = options.scaling.unwrap_or(volume.scaling);
    if format == VolumeFormat::Nifti && !nifti::is_second(volume, options.nifti2) {
        // Its header has room for f32: the numbers must be made with what a reader will find.
        wanted.slope = f64::from(wanted.slope as f32);
        wanted.intercept = f64::from(wanted.intercept as f32);
    }
    let own = match volume.scaling == Scaling::IDENTITY || format.has_scaling() {
        true => volume.voxel_type,
        false => VoxelType::F32,
    };
    let sample = options.voxel_type.unwrap_or(own);
    // A scaling was made for the integers of one type: others do not profit from it, and floats only
    // lose digits.
    let fits = options.scaling.is_some() || (sample == volume.voxel_type && !sample.is_float());
    let keep = format.has_scaling() && wanted.is_valid() && fits;
    Coding { sample, little: true, scaling: if keep { wanted } else { Scaling::IDENTITY } }
}

/// Everything about a target that can be known before there is a volume: extension, folder and
/// existing files. Call it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_volume_target(path: impl AsRef<Path>, force: bool) -> Result<()> {
    let path = path.as_ref();
    if writable_format(path)? == VolumeFormat::Raw {
        atomic::check_place(&raw::numbers_path(path), force)?;
    }
    atomic::check_place(path, force)
}

fn writable_format(path: &Path) -> Result<VolumeFormat> {
    let extension = extension(path);
    // The header of an .nhdr file stands apart from its data.
    VolumeFormat::from_extension(path).filter(|_| extension != "nhdr").ok_or_else(|| {
        Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension,
            known: VolumeFormat::EXTENSIONS,
        }
    })
}
