mod affine;
mod array;
mod nifti;
mod numbers;
mod place;
mod read;
mod slices;
mod voxel_type;
mod write;

use inr_core::{Domain, Unit};

pub use self::affine::Affine;
pub use self::read::{VolumeFormat, decode_volume, read_volume};
pub use self::voxel_type::{Scaling, VoxelType};
pub use self::write::{VolumeReport, VolumeWriteOptions, check_volume_target, write_volume};
use crate::{Error, Result};

/// A volume in floating point: scans, fields on lattices.
///
/// The shape is `[X, Y, Z]`; planes are stored one after the other with x contiguous: voxel
/// `(x, y, z)` of channel `c` is `as_planar()[((c * Z + z) * Y + y) * X + x]`. Values are physical ones:
/// not scaled to [0, 1], with the slope and intercept of the file applied. Further axes of a file (time,
/// vector components) are channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    shape: [usize; 3],
    channels: usize,
    data: Vec<f32>,
    affine: Affine,
    placed: bool,
    /// The number type of the file: what the volume is written back as.
    pub voxel: VoxelType,
    /// What the file's numbers mean.
    pub scaling: Scaling,
    /// The header of a NIfTI file, so that all it says is written back.
    header: Option<Vec<u8>>,
}

impl Volume {
    /// Takes planar values: `channels` planes of `X * Y * Z` values; float, voxels of 1 mm, no place.
    ///
    /// # Errors
    /// [`Error::Shape`] when an axis or the number of channels is 0, or the number of values is another.
    pub fn new(shape: [usize; 3], channels: usize, data: Vec<f32>) -> Result<Self> {
        let count = Domain::unit(shape).ok().and_then(|d| d.len().checked_mul(channels));
        if channels == 0 || count != Some(data.len()) {
            let n = data.len();
            let what = format!("{shape:?} voxels in {channels} channels, but {n} values");
            return Err(Error::Shape { what });
        }
        Ok(Self {
            shape,
            channels,
            data,
            affine: affine::diagonal([1.0; 3]),
            placed: false,
            voxel: VoxelType::F32,
            scaling: Scaling::IDENTITY,
            header: None,
        })
    }

    /// Voxels per axis.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Number of channels, at least 1.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The values of one channel.
    ///
    /// # Panics
    /// If `channel >= channels()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.data.len() / self.channels;
        &self.data[channel * n..(channel + 1) * n]
    }

    /// Smallest and largest finite value; `None` without any.
    pub fn range(&self) -> Option<[f32; 2]> {
        let finite = || self.data.iter().copied().filter(|v| v.is_finite());
        Some([finite().reduce(f32::min)?, finite().reduce(f32::max)?])
    }

    /// Voxel index to world coordinates in millimetres.
    pub fn affine(&self) -> Affine {
        self.affine
    }

    /// Places the volume.
    ///
    /// # Errors
    /// [`Error::Shape`] for maps that are not finite or cannot be turned round.
    pub fn set_affine(&mut self, map: Affine) -> Result<()> {
        affine::check(&map).map_err(|what| Error::Shape { what })?;
        (self.affine, self.placed) = (map, true);
        Ok(())
    }

    /// Whether anything was said about the place: by the file, or by [`set_affine`](Self::set_affine).
    pub fn has_affine(&self) -> bool {
        self.placed
    }

    /// Lengths of the voxel's edges in millimetres.
    pub fn voxel_size(&self) -> [f64; 3] {
        affine::voxel_size(&self.affine)
    }

    /// The lattice in millimetres along the volume's own axes: pitch = edges of a voxel, first voxel at 0.
    pub fn domain(&self) -> Domain<3> {
        let pitch = self.voxel_size().map(|v| v as f32);
        Domain::new(self.shape, pitch, [0.0; 3], Unit::Millimetre).expect("checked when placed")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_and_places_are_checked() {
        assert!(Volume::new([2, 2, 2], 1, vec![0.0; 7]).is_err());
        assert!(Volume::new([2, 0, 2], 1, vec![]).is_err());
        assert!(Volume::new([2, 2, 2], 0, vec![]).is_err());
        assert!(Volume::new([usize::MAX, 2, 2], 1, vec![]).is_err());
        let mut volume = Volume::new([2, 1, 1], 2, vec![1.0, f32::NAN, -3.0, 4.0]).unwrap();
        assert_eq!((volume.range(), volume.plane(1)), (Some([-3.0, 4.0]), &[-3.0, 4.0][..]));
        assert!(!volume.has_affine());
        assert!(volume.set_affine([[0.0; 4]; 3]).is_err());
        volume
            .set_affine([[0.0, -2.0, 0.0, 5.0], [1.5, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 1.0]])
            .unwrap();
        assert_eq!(volume.domain().pitch(), [1.5, 2.0, 3.0]);
    }
}
