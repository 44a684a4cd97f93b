//! Where the patch goes: sets in `R^D` with a signed distance and a weight.

mod box_region;
mod ellipsoid;
mod mesh;
mod raster_mask;
mod set;
mod topology;

pub use box_region::BoxRegion;
pub use ellipsoid::Ellipsoid;
pub use mesh::MeshRegion;
pub use raster_mask::RasterMask;
pub use set::{Complement, Intersection, Translated, Union};

use crate::Domain;

/// A set of points in `R^D`, in physical coordinates.
pub trait Region<const D: usize>: Send + Sync {
    /// Distance from `x` to the region's boundary, in physical units: negative inside, infinite
    /// when there is no boundary in that direction (nothing is inside, or everything).
    ///
    /// Each region documents whether the value is exact or a bound. NaN coordinates give an
    /// unspecified value.
    fn signed_distance(&self, x: &[f32; D]) -> f32;

    /// How much `x` belongs to the region, in `[0, 1]`: for a hard region 1 where the signed
    /// distance is negative and 0 elsewhere.
    fn weight(&self, x: &[f32; D]) -> f32 {
        if self.signed_distance(x) < 0.0 { 1.0 } else { 0.0 }
    }

    /// The weights at `x`, `x + step`, `x + 2 step` ... along axis 0: one call per row of a lattice.
    fn weights_along(&self, x: &[f32; D], step: f32, weights: &mut [f32]) {
        for (i, weight) in weights.iter_mut().enumerate() {
            let mut x = *x;
            // In f64: a long row has more samples than f32 can count.
            x[0] = (f64::from(x[0]) + i as f64 * f64::from(step)) as f32;
            *weight = self.weight(&x);
        }
    }

    /// The weights at a lattice's samples from `start` on, along axis 0.
    ///
    /// The same as [`Region::weights_along`] up to rounding. Boxes and masks count samples in f64, so that
    /// they are right for any number of samples; other regions see positions rounded to f32, which
    /// tells neighbouring samples apart up to sample 2^24.
    fn weights_on(&self, lattice: &Domain<D>, start: [usize; D], weights: &mut [f32]) {
        self.weights_along(&lattice.position(start), lattice.pitch()[0], weights);
    }

    /// Two corners of a box outside of which all weights are zero, where it is known at no cost.
    fn bounds(&self) -> Option<[[f32; D]; 2]> {
        None
    }
}

impl<const D: usize, R: Region<D> + ?Sized> Region<D> for Box<R> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        (**self).signed_distance(x)
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        (**self).weight(x)
    }

    fn weights_along(&self, x: &[f32; D], step: f32, weights: &mut [f32]) {
        (**self).weights_along(x, step, weights);
    }

    fn weights_on(&self, lattice: &Domain<D>, start: [usize; D], weights: &mut [f32]) {
        (**self).weights_on(lattice, start, weights);
    }

    fn bounds(&self) -> Option<[[f32; D]; 2]> {
        (**self).bounds()
    }
}

impl<const D: usize, R: Region<D> + ?Sized> Region<D> for &R {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        (**self).signed_distance(x)
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        (**self).weight(x)
    }

    fn weights_along(&self, x: &[f32; D], step: f32, weights: &mut [f32]) {
        (**self).weights_along(x, step, weights);
    }

    fn weights_on(&self, lattice: &Domain<D>, start: [usize; D], weights: &mut [f32]) {
        (**self).weights_on(lattice, start, weights);
    }

    fn bounds(&self) -> Option<[[f32; D]; 2]> {
        (**self).bounds()
    }
}
