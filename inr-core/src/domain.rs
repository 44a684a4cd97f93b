use crate::{Error, Result};

/// The physical unit of a domain's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// Sample steps: pixels, voxels, light-field steps.
    #[default]
    Sample,
    /// Seconds.
    Second,
    /// Millimetres.
    Millimetre,
}

/// A regular lattice of sample positions in R^D: sample `i` sits at `origin + i * pitch`.
///
/// Axis 0 is stored contiguously: x of an image (W, H), x of a volume (X, Y, Z). Samples are
/// points, and each owns the cell half a pitch around it: an image with unit pitch and origin 0
/// has its pixel centres at integers and covers `[-0.5, W - 0.5]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Domain<const D: usize> {
    shape: [usize; D],
    pitch: [f32; D],
    origin: [f32; D],
    unit: Unit,
}

impl<const D: usize> Domain<D> {
    /// A lattice with unit pitch and its first sample at the coordinate origin.
    ///
    /// # Errors
    /// [`Error::EmptyAxis`] and [`Error::TooLarge`].
    pub fn unit(shape: [usize; D]) -> Result<Self> {
        Self::new(shape, [1.0; D], [0.0; D], Unit::Sample)
    }

    /// A lattice with the given samples per axis, pitch (> 0) and position of the first sample.
    ///
    /// # Errors
    /// [`Error::EmptyAxis`], [`Error::Pitch`] and [`Error::TooLarge`].
    pub fn new(shape: [usize; D], pitch: [f32; D], origin: [f32; D], unit: Unit) -> Result<Self> {
        let mut len = 1usize;
        for d in 0..D {
            if shape[d] == 0 {
                return Err(Error::EmptyAxis { axis: d });
            }
            if !(pitch[d] > 0.0 && pitch[d].is_finite()) {
                return Err(Error::Pitch { axis: d, value: pitch[d] });
            }
            len = len
                .checked_mul(shape[d])
                .filter(|n| *n <= isize::MAX as usize / 8)
                .ok_or_else(|| Error::TooLarge { shape: shape.to_vec() })?;
        }
        Ok(Self { shape, pitch, origin, unit })
    }

    /// Samples per axis, axis 0 contiguous.
    pub fn shape(&self) -> [usize; D] {
        self.shape
    }

    /// Distance between neighbouring samples per axis, in physical units.
    pub fn pitch(&self) -> [f32; D] {
        self.pitch
    }

    /// Position of sample 0 in physical units.
    pub fn origin(&self) -> [f32; D] {
        self.origin
    }

    /// The unit of the coordinates.
    pub fn unit_of_length(&self) -> Unit {
        self.unit
    }

    /// Number of samples.
    #[allow(clippy::len_without_is_empty)] // A domain is never empty.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Distance in the flat buffer between neighbours along each axis.
    pub fn strides(&self) -> [usize; D] {
        let mut strides = [1; D];
        for d in 1..D {
            strides[d] = strides[d - 1] * self.shape[d - 1];
        }
        strides
    }

    /// The geometric mean of the pitches: the length unit of gradients (`h_ref`).
    pub fn reference_pitch(&self) -> f32 {
        let log_sum: f64 = self.pitch.iter().map(|h| f64::from(*h).ln()).sum();
        (log_sum / D as f64).exp() as f32
    }

    /// Physical position of a sample.
    pub fn position(&self, index: [usize; D]) -> [f32; D] {
        std::array::from_fn(|d| self.origin[d] + index[d] as f32 * self.pitch[d])
    }

    /// Sample index, in f64, along axis `d` of this lattice of sample `i` of another one.
    pub(crate) fn index_of(&self, d: usize, other: &Self, i: usize) -> f64 {
        let distance = f64::from(other.origin[d]) - f64::from(self.origin[d]);
        (distance + i as f64 * f64::from(other.pitch[d])) / f64::from(self.pitch[d])
    }

    /// Continuous sample index of a physical position.
    pub fn to_index(&self, x: &[f32; D]) -> [f32; D] {
        std::array::from_fn(|d| (x[d] - self.origin[d]) / self.pitch[d])
    }

    /// Splits a flat buffer index into one index per axis.
    pub fn unflatten(&self, mut flat: usize) -> [usize; D] {
        std::array::from_fn(|d| {
            let i = flat % self.shape[d];
            flat /= self.shape[d];
            i
        })
    }

    /// The same extent, covered by another number of samples: the outer cell edges stay in place.
    ///
    /// # Errors
    /// [`Error::EmptyAxis`] and [`Error::TooLarge`].
    pub fn resized(&self, shape: [usize; D]) -> Result<Self> {
        let pitch: [f32; D] =
            std::array::from_fn(|d| self.pitch[d] * self.shape[d] as f32 / shape[d].max(1) as f32);
        let origin = std::array::from_fn(|d| self.origin[d] + 0.5 * (pitch[d] - self.pitch[d]));
        Self::new(shape, pitch, origin, self.unit)
    }

    /// The part with `shape` samples whose first sample is sample `start` of this domain.
    ///
    /// # Errors
    /// [`Error::EmptyAxis`] and [`Error::TooLarge`].
    pub fn cropped(&self, start: [usize; D], shape: [usize; D]) -> Result<Self> {
        Self::new(shape, self.pitch, self.position(start), self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resized_keeps_the_outer_edges() {
        let a = Domain::new([4, 6], [1.0, 2.0], [0.0, 5.0], Unit::Sample).unwrap();
        let b = a.resized([8, 3]).unwrap();
        for d in 0..2 {
            let left = |g: &Domain<2>| g.origin()[d] - 0.5 * g.pitch()[d];
            let right = |g: &Domain<2>| left(g) + g.pitch()[d] * g.shape()[d] as f32;
            assert!((left(&a) - left(&b)).abs() < 1e-6);
            assert!((right(&a) - right(&b)).abs() < 1e-5);
        }
    }

    #[test]
    fn bad_shapes_and_pitches_are_typed_errors() {
        assert_eq!(Domain::unit([3, 0]), Err(Error::EmptyAxis { axis: 1 }));
        let pitch = Domain::new([3], [-1.0], [0.0], Unit::Second);
        assert_eq!(pitch, Err(Error::Pitch { axis: 0, value: -1.0 }));
        assert!(matches!(Domain::unit([usize::MAX / 2, 4]), Err(Error::TooLarge { .. })));
    }

    #[test]
    fn flat_and_axis_indices_agree() {
        let d = Domain::unit([3, 4, 5]).unwrap();
        let s = d.strides();
        for flat in 0..d.len() {
            let i = d.unflatten(flat);
            assert_eq!(i[0] * s[0] + i[1] * s[1] + i[2] * s[2], flat);
        }
    }
}
