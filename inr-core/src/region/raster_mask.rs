use std::sync::OnceLock;

use rayon::prelude::*;

use crate::{Domain, Error, Region, Result, distance_to, distance_to_cells};

/// A region painted on a lattice: one weight in `[0, 1]` per sample, of any topology.
///
/// The weight is constant on the sample cells and zero outside the domain's cells. A sample is
/// inside when its weight is at least 1/2; a soft mask's distances are those of its inside.
#[derive(Debug, Clone)]
pub struct RasterMask<const D: usize> {
    domain: Domain<D>,
    weights: Vec<f32>,
    /// Computed on first use: masks are often asked for weights only.
    signed_distances: OnceLock<Vec<f32>>,
}

impl<const D: usize> RasterMask<D> {
    /// A mask from one weight per sample, axis 0 contiguous.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Parameter`] for a weight outside `[0, 1]` or NaN.
    pub fn new(domain: Domain<D>, weights: Vec<f32>) -> Result<Self> {
        if weights.len() != domain.len() {
            return Err(Error::Length { expected: domain.len(), found: weights.len() });
        }
        if let Some(&value) = weights.iter().find(|w| !(0.0..=1.0).contains(*w)) {
            return Err(Error::Parameter { what: "the mask's weight", rule: "in [0, 1]", value });
        }
        Ok(Self { domain, weights, signed_distances: OnceLock::new() })
    }

    /// A region's weights at the sample positions of a domain.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the region gives a weight outside `[0, 1]`.
    pub fn from_region(region: &dyn Region<D>, domain: Domain<D>) -> Result<Self> {
        let at = |k| region.weight(&domain.position(domain.unflatten(k)));
        Self::new(domain, (0..domain.len()).into_par_iter().map(at).collect())
    }

    /// Where the samples sit.
    pub fn domain(&self) -> &Domain<D> {
        &self.domain
    }

    /// One weight per sample, axis 0 contiguous.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Whether a sample is inside: its weight is at least 1/2.
    ///
    /// # Panics
    /// If `sample >= domain().len()`.
    pub fn is_inside(&self, sample: usize) -> bool {
        self.weights[sample] >= 0.5
    }

    /// Signed distance of every sample centre to the boundary between inside and outside cells;
    /// everything beyond the domain's cells is outside.
    ///
    /// Exact up to f32 rounding, linear time, computed once. Infinite without an inside sample.
    pub fn signed_distances(&self) -> &[f32] {
        self.signed_distances.get_or_init(|| {
            let mut signed = distance_to_cells(&self.domain, |k| self.is_inside(k));
            let depth = distance_to_cells(&self.domain, |k| !self.is_inside(k));
            signed.par_iter_mut().zip(depth).enumerate().for_each(|(k, (signed, depth))| {
                if self.is_inside(k) {
                    *signed = -depth.min(self.distance_to_beyond(k, 0.5));
                }
            });
            signed
        })
    }

    /// The largest distance of an inside sample to the nearest outside sample, centre to centre,
    /// in physical units.
    ///
    /// With `beyond_is_outside` the lattice continues beyond the domain with outside samples;
    /// without it a mask may go on past the border, as under a mirror extension, and a mask without
    /// any outside sample has an infinite inradius. 0 without an inside sample.
    pub fn inradius(&self, beyond_is_outside: bool) -> f32 {
        let depth = distance_to(&self.domain, |k| !self.is_inside(k));
        let depth_of = |k: usize| match beyond_is_outside {
            true => depth[k].min(self.distance_to_beyond(k, 1.0)),
            false => depth[k],
        };
        (0..depth.len()).filter(|k| self.is_inside(*k)).map(depth_of).fold(0.0, f32::max)
    }

    /// Distance from a sample to `steps` pitches outward of the nearest border sample.
    fn distance_to_beyond(&self, sample: usize, steps: f32) -> f32 {
        let (shape, pitch) = (self.domain.shape(), self.domain.pitch());
        let index = self.domain.unflatten(sample);
        let to_border = |d: usize| index[d].min(shape[d] - 1 - index[d]) as f32;
        (0..D).map(|d| (to_border(d) + steps) * pitch[d]).fold(f32::INFINITY, f32::min)
    }

    /// Multilinear interpolation of the signed distances at a continuous index within the lattice.
    fn interpolate_signed(&self, index: &[f32; D]) -> f32 {
        let (shape, strides) = (self.domain.shape(), self.domain.strides());
        let signed = self.signed_distances();
        // The last interval also serves its right end; an axis of one sample has no interval.
        let left: [usize; D] =
            std::array::from_fn(|d| (index[d] as usize).min(shape[d].saturating_sub(2)));
        let mut sum = 0.0;
        for corner in 0..1_usize << D {
            let (mut flat, mut weight) = (0, 1.0);
            for d in 0..D {
                let (step, fraction) = (corner >> d & 1, index[d] - left[d] as f32);
                flat += (left[d] + step).min(shape[d] - 1) * strides[d];
                weight *= if step == 1 { fraction } else { 1.0 - fraction };
            }
            sum += weight * signed[flat];
        }
        sum
    }
}

impl<const D: usize> Region<D> for RasterMask<D> {
    /// Exact at sample positions ([`RasterMask::signed_distances`]), multilinear between them;
    /// beyond the outermost samples within about a pitch of the distance where the nearest point
    /// lies straight ahead, a lower bound elsewhere.
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        let (shape, pitch) = (self.domain.shape(), self.domain.pitch());
        let index = self.domain.to_index(x);
        let clamped: [f32; D] = std::array::from_fn(|d| index[d].clamp(0.0, (shape[d] - 1) as f32));
        let beyond = (0..D).fold(0.0, |r: f32, d| r.hypot((index[d] - clamped[d]) * pitch[d]));
        if self.signed_distances()[0] == f32::INFINITY {
            return f32::INFINITY; // 0 * infinity would be NaN below.
        }
        let at_border = self.interpolate_signed(&clamped);
        match at_border < 0.0 {
            true => at_border + beyond,
            // The mask lies on the far side of the border's tangent plane: the angle is obtuse.
            false => at_border.hypot(beyond),
        }
    }

    /// The nearest sample's weight; 0 outside the domain's cells.
    fn weight(&self, x: &[f32; D]) -> f32 {
        let (shape, strides) = (self.domain.shape(), self.domain.strides());
        let index = self.domain.to_index(x);
        let mut flat = 0;
        for d in 0..D {
            let nearest = (index[d] + 0.5).floor();
            // Also outside: NaN.
            if !(nearest >= 0.0 && nearest < shape[d] as f32) {
                return 0.0;
            }
            flat += (nearest as usize).min(shape[d] - 1) * strides[d];
        }
        self.weights[flat]
    }

    fn weights_along(&self, x: &[f32; D], step: f32, weights: &mut [f32]) {
        let index = self.domain.to_index(x).map(f64::from);
        self.weights_from(index, f64::from(step / self.domain.pitch()[0]), weights);
    }

    fn weights_on(&self, lattice: &Domain<D>, start: [usize; D], weights: &mut [f32]) {
        let index = std::array::from_fn(|d| {
            let i = self.domain.index_of(d, lattice, start[d]);
            // A shift by whole samples in numbers of a few digits is one; halves stay halves.
            if (i - i.round()).abs() < 1e-4 { i.round() } else { i }
        });
        let step = f64::from(lattice.pitch()[0] / self.domain.pitch()[0]);
        self.weights_from(index, step, weights);
    }

    fn bounds(&self) -> Option<[[f32; D]; 2]> {
        let edge = |d: usize, i: f64| {
            let origin = f64::from(self.domain.origin()[d]);
            (origin + i * f64::from(self.domain.pitch()[d])) as f32
        };
        let last: [f64; D] = self.domain.shape().map(|n| n as f64 - 0.5);
        Some([std::array::from_fn(|d| edge(d, -0.5)), std::array::from_fn(|d| edge(d, last[d]))])
    }
}

impl<const D: usize> RasterMask<D> {
    /// The weights at a sample index and every `step` from there along axis 0.
    fn weights_from(&self, index: [f64; D], step: f64, weights: &mut [f32]) {
        let (shape, strides) = (self.domain.shape(), self.domain.strides());
        let mut row = 0;
        for d in 1..D {
            let nearest = (index[d] + 0.5).floor();
            if !(nearest >= 0.0 && nearest < shape[d] as f64) {
                return weights.fill(0.0);
            }
            row += nearest as usize * strides[d];
        }
        let row = &self.weights[row..row + shape[0]];
        if (step - 1.0).abs() * (weights.len() as f64) < 1e-3 {
            // The mask's own pitch: a shifted copy.
            let first = (index[0] + 0.5).floor() as isize;
            let skip = first.saturating_neg().clamp(0, weights.len() as isize) as usize;
            let source = row.get(first.max(0) as usize..).unwrap_or(&[]);
            let n = source.len().min(weights.len() - skip);
            weights.fill(0.0);
            weights[skip..skip + n].copy_from_slice(&source[..n]);
            return;
        }
        for (i, weight) in weights.iter_mut().enumerate() {
            // A negative index saturates to 0 in the cast and is sorted out by the comparison.
            let nearest = (index[0] + i as f64 * step + 0.5).floor();
            *weight = if nearest >= 0.0 {
                row.get(nearest as usize).copied().unwrap_or(0.0)
            } else {
                0.0
            };
        }
    }
}

#[cfg(test)]
mod tests;
