use crate::{Domain, Scalar};

/// The box that a network scales to -1..1 along every axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame<const D: usize> {
    /// Its middle, in physical units.
    pub center: [f32; D],
    /// Half its length along each axis, positive.
    pub half: [f32; D],
}

impl<const D: usize> Frame<D> {
    /// The cells of a signal: from the outer edge of its first sample to that of its last.
    pub fn of_cells(domain: &Domain<D>) -> Self {
        let (h, n, origin) = (domain.pitch(), domain.shape(), domain.origin());
        Self {
            center: std::array::from_fn(|d| origin[d] + 0.5 * h[d] * (n[d] - 1) as f32),
            half: std::array::from_fn(|d| 0.5 * h[d] * n[d] as f32),
        }
    }

    /// From the first sample of a signal to its last: what most published networks are trained in.
    pub fn of_samples(domain: &Domain<D>) -> Self {
        let (h, n) = (domain.pitch(), domain.shape());
        Self {
            half: std::array::from_fn(|d| 0.5 * h[d] * n[d].max(2).saturating_sub(1) as f32),
            ..Self::of_cells(domain)
        }
    }

    /// Scaled coordinates per physical unit.
    #[inline(always)]
    pub(crate) fn inverse(&self, d: usize) -> f32 {
        1.0 / self.half[d]
    }

    /// Scaled coordinates.
    pub(crate) fn scale<T: Scalar>(&self, x: [T; D]) -> [T; D] {
        let c = |v: f32| T::from_f64(f64::from(v));
        std::array::from_fn(|d| (x[d] - c(self.center[d])) / c(self.half[d]))
    }
}
