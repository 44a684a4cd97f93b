//! Scans and stacks: values on a lattice of voxels that has a place in the world.

mod affine;
mod format;
mod kept;
mod nifti;
mod npy;
mod nrrd;
mod numbers;
mod placement;
mod raw;
mod read;
mod tiff;
mod view;
mod voxel_type;
mod write;

use inr_core::{Domain, Samples, Unit};

pub use self::affine::Affine;
pub(crate) use self::affine::{apply, compose, determinant, diagonal};
pub use self::format::VolumeFormat;
pub use self::kept::LengthUnit;
pub use self::placement::Placement;
pub(crate) use self::read::read_bounded;
pub use self::read::{VolumeReadOptions, decode_volume, read_volume};
pub use self::voxel_type::{Scaling, VoxelType};
pub use self::write::{VolumeReport, VolumeWriteOptions, check_volume_target, write_volume};

use self::kept::Kept;
use crate::{Error, Result};

/// A volume in floating point with one or more channels.
///
/// Planes are stored one after the other; x is contiguous inside a plane: value `(x, y, z)` of channel
/// `c` is `as_planar()[((c * Z + z) * Y + y) * X + x]`. Values are the physical ones: a file's scaling
/// is applied, nothing is normalised; 8-bit numbers from 0 to 255 stay 0 to 255.
///
/// The [affine](Self::affine) gives every voxel its place in the world, in millimetres. Where the file
/// says which way the patient lies, the world's axes point right, anterior and superior, the custom of
/// NIfTI; NRRD's other custom (left, posterior, superior) is converted.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    shape: [usize; 3],
    channels: usize,
    data: Vec<f32>,
    affine: Affine,
    /// The number type of the file the volume came from: what it is written back as.
    pub voxel_type: VoxelType,
    /// What the numbers of that file meant. Written back where the format has a place for it, so that
    /// values which nobody changed become the numbers they were.
    pub scaling: Scaling,
    /// The unit of lengths in the file; the affine is in millimetres whatever this says.
    pub length_unit: LengthUnit,
    /// The description in the file: `descrip` of NIfTI (up to 79 bytes), `content` of NRRD.
    pub description: String,
    kept: Kept,
}

impl Volume {
    /// Takes planar values; voxels of 1 mm along the world's axes, `f32`, no scaling.
    ///
    /// # Errors
    /// [`Error::Volume`] when there are no voxels or channels, or when the number of values is not
    /// `shape[0] * shape[1] * shape[2] * channels`.
    pub fn new(shape: [usize; 3], channels: usize, data: Vec<f32>) -> Result<Self> {
        let [x, y, z] = shape;
        if Domain::<3>::unit(shape).is_err() || channels == 0 {
            return Err(Error::Volume {
                what: format!("{x} x {y} x {z} voxels, {channels} channels"),
            });
        }
        if (x * y * z).checked_mul(channels) != Some(data.len()) {
            let n = data.len();
            let what = format!("{x} x {y} x {z} voxels in {channels} channels, but {n} values");
            return Err(Error::Volume { what });
        }
        Ok(Self {
            shape,
            channels,
            data,
            affine: affine::diagonal([1.0; 3]),
            voxel_type: VoxelType::F32,
            scaling: Scaling::IDENTITY,
            length_unit: LengthUnit::Millimetre,
            description: String::new(),
            kept: Kept::default(),
        })
    }

    /// The same values in another place: `affine` takes voxel indices to millimetres.
    ///
    /// # Errors
    /// [`Error::Affine`] for maps that are not finite, have an edge of length zero, or are singular.
    pub fn with_affine(mut self, affine: Affine) -> Result<Self> {
        affine::check(&affine)?;
        self.affine = affine;
        Ok(self)
    }

    /// The same values with voxels of this size in millimetres along the world's axes, the first one at
    /// the origin.
    ///
    /// # Errors
    /// [`Error::Affine`] for sizes that are not positive and finite.
    pub fn with_voxel_size(self, size: [f64; 3]) -> Result<Self> {
        if size.iter().any(|s| *s < 0.0) {
            return Err(Error::Affine { what: format!("voxels of {size:?} mm") });
        }
        self.with_affine(affine::diagonal(size))
    }

    /// Voxels along x, y and z.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Number of planes.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of voxels.
    pub fn voxel_count(&self) -> usize {
        self.shape.iter().product()
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The planes, without the volume around them.
    pub fn into_planar(self) -> Vec<f32> {
        self.data
    }

    /// The values of one channel.
    ///
    /// # Panics
    /// If `channel >= channels()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.voxel_count();
        &self.data[channel * n..(channel + 1) * n]
    }

    /// The map from voxel indices to the world, in millimetres.
    pub fn affine(&self) -> &Affine {
        &self.affine
    }

    /// World position of a voxel index, in millimetres. Indices of voxel centres are integers.
    pub fn to_world(&self, index: [f64; 3]) -> [f64; 3] {
        affine::apply(&self.affine, index)
    }

    /// Continuous voxel index of a world position in millimetres.
    pub fn to_index(&self, world: [f64; 3]) -> [f64; 3] {
        affine::apply(&affine::inverse(&self.affine), world)
    }

    /// Lengths of the voxel's edges, in millimetres.
    pub fn voxel_size(&self) -> [f64; 3] {
        affine::voxel_size(&self.affine)
    }

    /// The lattice of voxel centres along the volume's own axes: the pitch is the length of the voxel's
    /// edges in millimetres, the first voxel is at 0. Where the volume lies in the world is left out;
    /// sheared axes (rare: a tilted gantry) are treated as if they were orthogonal.
    pub fn domain(&self) -> Domain<3> {
        let pitch = self.voxel_size().map(|s| s as f32);
        Domain::new(self.shape, pitch, [0.0; 3], Unit::Millimetre)
            .expect("checked when it was made")
    }

    /// The map from the world, in millimetres, to the coordinates of [`domain`](Self::domain): it takes what
    /// is given in the world, such as a mesh, to where the samples are.
    pub fn world_to_domain(&self) -> Affine {
        affine::compose(&affine::diagonal(self.voxel_size()), &affine::inverse(&self.affine))
    }

    /// The smallest and the largest finite value; none where no value is finite.
    pub fn range(&self) -> Option<[f32; 2]> {
        let finite = self.data.iter().filter(|v| v.is_finite());
        finite.fold(None, |range, &v| match range {
            None => Some([v, v]),
            Some([low, high]) => Some([v.min(low), v.max(high)]),
        })
    }

    /// The type the blending crates work with, on the lattice of [`domain`](Self::domain).
    ///
    /// # Errors
    /// [`Error::ChannelCount`] when there are not `C` channels.
    pub fn to_samples<const C: usize>(&self) -> Result<Samples<3, C>> {
        if self.channels != C {
            return Err(Error::ChannelCount { expected: C, found: self.channels });
        }
        let samples = Samples::from_planar(self.domain(), self.data.clone());
        Ok(samples.expect("a volume has as many values as its shape says"))
    }

    /// A volume of these values in the place of `like`, with its number type, scaling and texts.
    ///
    /// # Errors
    /// [`Error::Volume`] when the shapes differ.
    pub fn from_samples<const C: usize>(samples: &Samples<3, C>, like: &Self) -> Result<Self> {
        let (shape, expected) = (samples.domain().shape(), like.shape);
        if shape != expected {
            return Err(Error::Volume {
                what: format!("{shape:?} voxels in the place of {expected:?}"),
            });
        }
        like.with_planes(C, samples.as_planar().to_vec())
    }

    /// Other values in the same place.
    fn with_planes(&self, channels: usize, data: Vec<f32>) -> Result<Self> {
        let new = Self::new(self.shape, channels, data)?;
        Ok(Self {
            affine: self.affine,
            voxel_type: self.voxel_type,
            scaling: self.scaling,
            length_unit: self.length_unit,
            description: self.description.clone(),
            kept: self.kept.clone(),
            ..new
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_and_values_belong_together() {
        for (shape, channels, values) in [([2, 2, 2], 1, 7), ([2, 0, 2], 1, 0), ([1, 1, 1], 0, 0)] {
            let result = Volume::new(shape, channels, vec![0.0; values]);
            assert!(matches!(result, Err(Error::Volume { .. })), "{shape:?}");
        }
        let huge = Volume::new([usize::MAX, 2, 2], 1, vec![]);
        assert!(matches!(huge, Err(Error::Volume { .. })));
    }

    #[test]
    fn the_domain_is_in_millimetres() {
        let volume = Volume::new([2, 3, 4], 1, vec![0.0; 24]).unwrap();
        // Turned by 90 degrees about z: x of the voxels is y of the world.
        let turned = [[0.0, -0.5, 0.0, 7.0], [2.0, 0.0, 0.0, 1.0], [0.0, 0.0, 3.0, -5.0]];
        let volume = volume.with_affine(turned).unwrap();
        assert_eq!(volume.domain().pitch(), [2.0, 0.5, 3.0]);
        assert_eq!(volume.domain().unit_of_length(), Unit::Millimetre);
        assert_eq!(volume.to_world([1.0, 2.0, 3.0]), [6.0, 3.0, 4.0]);
        assert_eq!(volume.to_index([6.0, 3.0, 4.0]), [1.0, 2.0, 3.0]);
        let position = volume.domain().position([1, 2, 3]).map(f64::from);
        assert_eq!(apply(&volume.world_to_domain(), [6.0, 3.0, 4.0]), position);
        assert!(matches!(volume.with_voxel_size([1.0, -1.0, 1.0]), Err(Error::Affine { .. })));
    }

    #[test]
    fn range_leaves_out_what_is_not_finite() {
        let data = vec![f32::NAN, 3.0, f32::INFINITY, -2.0];
        let volume = Volume::new([4, 1, 1], 1, data).unwrap();
        assert_eq!(volume.range(), Some([-2.0, 3.0]));
        let nothing = Volume::new([1, 1, 1], 1, vec![f32::NAN]).unwrap();
        assert_eq!(nothing.range(), None);
    }

    #[test]
    fn samples_come_back_with_everything_else() {
        let data: Vec<f32> = (0..16).map(|v| v as f32).collect();
        let mut volume = Volume::new([2, 2, 2], 2, data).unwrap();
        volume.voxel_type = VoxelType::I16;
        volume.description = "a scan".to_owned();
        let volume = volume.with_voxel_size([1.0, 2.0, 3.0]).unwrap();
        let samples = volume.to_samples::<2>().unwrap();
        assert_eq!(Volume::from_samples(&samples, &volume).unwrap(), volume);
        assert!(matches!(volume.to_samples::<1>(), Err(Error::ChannelCount { .. })));
        let other = Volume::new([2, 2, 1], 1, vec![0.0; 4]).unwrap();
        assert!(matches!(Volume::from_samples(&samples, &other), Err(Error::Volume { .. })));
    }
}
