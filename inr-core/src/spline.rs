use rayon::prelude::*;

use crate::basis::{cubic_weights, cubic_weights_d1, cubic_weights_of_order};
use crate::prefilter::{mirror, prefilter};
use crate::{Domain, Error, Field, Jet, Result, Samples, Scalar};

/// Points handed to one task of the batched evaluation.
const BATCH: usize = 1024;

/// A uniform cubic B-spline field with one coefficient per sample and knots at the samples: C2
/// everywhere, linear in its coefficients.
///
/// Outside its domain the field is the mirror image of its inside about the outermost knots,
/// again and again with period `2 (n - 1)` samples per axis; its normal derivative vanishes on
/// that border. An axis with a single sample is constant.
///
/// Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline<const D: usize, const C: usize> {
    coefficients: Samples<D, C>,
}

impl<const D: usize, const C: usize> Spline<D, C> {
    /// The spline through the samples. Linear time.
    ///
    /// It passes through every sample to a few f32 roundings; values that are not finite spread
    /// over their neighbourhood (use [`Samples::check_finite`] first).
    pub fn interpolate(samples: &Samples<D, C>) -> Self {
        Self::interpolate_owned(samples.clone())
    }

    /// [`Spline::interpolate`] that reuses the buffer of the samples.
    pub fn interpolate_owned(mut samples: Samples<D, C>) -> Self {
        let shape = samples.domain().shape();
        for c in 0..C {
            prefilter(&shape, samples.plane_mut(c));
        }
        Self { coefficients: samples }
    }

    /// A spline with these coefficients, one per knot of the lattice.
    pub fn from_coefficients(coefficients: Samples<D, C>) -> Self {
        Self { coefficients }
    }

    /// The coefficients, one per knot.
    pub fn coefficients(&self) -> &Samples<D, C> {
        &self.coefficients
    }

    /// The lattice of knots.
    pub fn domain(&self) -> &Domain<D> {
        self.coefficients.domain()
    }

    /// Value at `x` (physical coordinates) for any scalar type: with dual numbers it gives exact
    /// gradients, with nested ones Laplacians. This is the definition; `eval` and `eval_jet` are
    /// its fast forms.
    pub fn eval_scalar<T: Scalar>(&self, x: [T; D]) -> [T; C] {
        let domain = self.domain();
        let mut first = [0isize; D];
        let weights: [[T; 4]; D] = std::array::from_fn(|d| {
            let origin = T::from_f64(f64::from(domain.origin()[d]));
            let u = (x[d] - origin) * T::from_f64(1.0 / f64::from(domain.pitch()[d]));
            let knot = u.re().floor();
            first[d] = knot as isize - 1;
            cubic_weights(u - T::from_f64(knot))
        });
        let (shape, strides) = (domain.shape(), domain.strides());
        let mut value = [T::zero(); C];
        for combination in 0..4usize.pow(D as u32) {
            let (mut at, mut weight) = (0, T::one());
            for d in 0..D {
                let tap = combination >> (2 * d) & 3;
                at += mirror(first[d] + tap as isize, shape[d]) * strides[d];
                weight *= weights[d][tap];
            }
            for c in 0..C {
                value[c] += weight * T::from_f64(f64::from(self.coefficients.plane(c)[at]));
            }
        }
        value
    }

    /// A partial derivative on a whole lattice: order `derivative[d]` (0, 1 or 2) along axis `d`,
    /// per physical unit. `[0; D]` gives values.
    ///
    /// Sum-factorised: 4 products per axis and sample instead of `4^D`, and positions are
    /// computed in f64.
    ///
    /// # Panics
    /// If an order exceeds 2.
    pub fn eval_lattice(&self, lattice: &Domain<D>, derivative: [usize; D]) -> Samples<D, C> {
        let taps: [Vec<Taps>; D] =
            std::array::from_fn(|d| axis_taps(self.domain(), lattice, d, derivative[d]));
        let mut out = Vec::with_capacity(lattice.len() * C);
        for c in 0..C {
            let mut shape = self.domain().shape();
            let mut plane =
                contract_axis(self.coefficients.plane(c), &mut shape, D - 1, &taps[D - 1]);
            for d in (0..D - 1).rev() {
                plane = contract_axis(&plane, &mut shape, d, &taps[d]);
            }
            out.extend_from_slice(&plane);
        }
        Samples::from_planar(*lattice, out).expect("one value per lattice point and channel")
    }

    /// The field on another lattice: interpolated where the lattice is at least as fine as the
    /// knots, averaged over the lattice's cells along axes where it is coarser.
    ///
    /// The average takes one point per knot interval (midpoint rule), so a reduction by an
    /// integer factor is a plain mean of interpolated values. Combine with [`Domain::resized`]
    /// (keeps the outer edges of the pixels in place) and [`Domain::cropped`].
    ///
    /// # Errors
    /// [`Error::TooLarge`] when the finer lattice that the average needs does not fit.
    pub fn resample(&self, lattice: &Domain<D>) -> Result<Samples<D, C>> {
        let ratio: [usize; D] = std::array::from_fn(|d| {
            let r = f64::from(lattice.pitch()[d]) / f64::from(self.domain().pitch()[d]);
            (r - 1e-6).ceil().max(1.0) as usize // 1e-6: rounding of a pitch that is meant to be equal
        });
        let mut fine_shape = lattice.shape();
        for d in 0..D {
            fine_shape[d] = fine_shape[d]
                .checked_mul(ratio[d])
                .ok_or_else(|| Error::TooLarge { shape: lattice.shape().to_vec() })?;
        }
        let fine = self.eval_lattice(&lattice.resized(fine_shape)?, [0; D]);
        if ratio == [1; D] {
            return Ok(fine);
        }
        let mut out = Vec::with_capacity(lattice.len() * C);
        for c in 0..C {
            let (mut shape, mut plane) = (fine_shape, fine.plane(c).to_vec());
            for d in (0..D).rev() {
                plane = mean_axis(&plane, &mut shape, d, ratio[d]);
            }
            out.extend_from_slice(&plane);
        }
        Samples::from_planar(*lattice, out)
    }

    /// Value and gradient at one point, `f32`.
    #[inline]
    fn jet_at(&self, x: &[f32; D], with_gradient: bool) -> Jet<D, C> {
        let domain = self.domain();
        let (shape, strides, pitch) = (domain.shape(), domain.strides(), domain.pitch());
        let u = domain.to_index(x);
        let mut at = [[0usize; 4]; D];
        let mut w = [[0.0f32; 4]; D];
        let mut dw = [[0.0f32; 4]; D];
        for d in 0..D {
            let knot = u[d].floor();
            w[d] = cubic_weights(u[d] - knot);
            if with_gradient {
                dw[d] = cubic_weights_d1(u[d] - knot).map(|v| v / pitch[d]);
            }
            for tap in 0..4 {
                at[d][tap] = mirror(knot as isize - 1 + tap as isize, shape[d]) * strides[d];
            }
        }
        let mut jet = Jet::ZERO;
        for combination in 0..4usize.pow(D as u32 - 1) {
            let tap = |d: usize| combination >> (2 * (d - 1)) & 3;
            let row: usize = (1..D).map(|d| at[d][tap(d)]).sum();
            let outer: f32 = (1..D).map(|d| w[d][tap(d)]).product();
            let mut slopes = [0.0f32; D];
            if with_gradient {
                for d in 1..D {
                    slopes[d] =
                        (1..D).map(|e| if e == d { dw[e][tap(e)] } else { w[e][tap(e)] }).product();
                }
            }
            for c in 0..C {
                let plane = self.coefficients.plane(c);
                let taps = at[0].map(|i| plane[row + i]);
                let dot = |w: &[f32; 4]| (0..4).map(|k| w[k] * taps[k]).sum::<f32>();
                let value = dot(&w[0]);
                jet.value[c] += outer * value;
                if with_gradient {
                    jet.grad[c][0] += outer * dot(&dw[0]);
                    for d in 1..D {
                        jet.grad[c][d] += slopes[d] * value;
                    }
                }
            }
        }
        jet
    }
}

impl<const D: usize, const C: usize> Field<D, C> for Spline<D, C> {
    fn eval(&self, x: &[[f32; D]], y: &mut [[f32; C]]) {
        assert_eq!(x.len(), y.len(), "points and values");
        y.par_chunks_mut(BATCH).zip(x.par_chunks(BATCH)).for_each(|(y, x)| {
            y.iter_mut().zip(x).for_each(|(y, x)| *y = self.jet_at(x, false).value);
        });
    }

    fn eval_jet(&self, x: &[[f32; D]], y: &mut [Jet<D, C>]) {
        assert_eq!(x.len(), y.len(), "points and jets");
        y.par_chunks_mut(BATCH).zip(x.par_chunks(BATCH)).for_each(|(y, x)| {
            y.iter_mut().zip(x).for_each(|(y, x)| *y = self.jet_at(x, true));
        });
    }
}

/// What one lattice position reads along one axis: four knots and their weights.
struct Taps {
    at: [usize; 4],
    weight: [f32; 4],
}

fn axis_taps<const D: usize>(
    knots: &Domain<D>,
    lattice: &Domain<D>,
    d: usize,
    order: usize,
) -> Vec<Taps> {
    let pitch = f64::from(knots.pitch()[d]);
    let scale = pitch.powi(-(order as i32));
    let start = (f64::from(lattice.origin()[d]) - f64::from(knots.origin()[d])) / pitch;
    let step = f64::from(lattice.pitch()[d]) / pitch;
    (0..lattice.shape()[d])
        .map(|i| {
            let u = start + i as f64 * step;
            let knot = u.floor();
            Taps {
                at: std::array::from_fn(|k| {
                    mirror(knot as isize - 1 + k as isize, knots.shape()[d])
                }),
                weight: cubic_weights_of_order(u - knot, order).map(|w| (w * scale) as f32),
            }
        })
        .collect()
}

/// Replaces axis `d` of `src` by one entry per element of `taps`.
fn contract_axis<const D: usize>(
    src: &[f32],
    shape: &mut [usize; D],
    d: usize,
    taps: &[Taps],
) -> Vec<f32> {
    let inner: usize = shape[..d].iter().product();
    let (n, m) = (shape[d], taps.len());
    shape[d] = m;
    let mut dst = vec![0.0; shape.iter().product()];
    if inner == 1 {
        dst.par_chunks_mut(m).zip(src.par_chunks(n)).for_each(|(dst, src)| {
            for (v, t) in dst.iter_mut().zip(taps) {
                *v = (0..4).map(|k| t.weight[k] * src[t.at[k]]).sum();
            }
        });
    } else {
        dst.par_chunks_mut(inner).enumerate().for_each(|(row, dst)| {
            let (src, t) = (&src[row / m * n * inner..][..n * inner], &taps[row % m]);
            let r: [&[f32]; 4] = std::array::from_fn(|k| &src[t.at[k] * inner..][..inner]);
            for (i, v) in dst.iter_mut().enumerate() {
                *v = (0..4).map(|k| t.weight[k] * r[k][i]).sum();
            }
        });
    }
    dst
}

/// Replaces every `ratio` neighbours along axis `d` by their mean.
fn mean_axis<const D: usize>(
    src: &[f32],
    shape: &mut [usize; D],
    d: usize,
    ratio: usize,
) -> Vec<f32> {
    let inner: usize = shape[..d].iter().product();
    shape[d] /= ratio;
    let mut dst = vec![0.0; shape.iter().product()];
    dst.par_chunks_mut(inner).zip(src.par_chunks(inner * ratio)).for_each(|(dst, src)| {
        for (i, v) in dst.iter_mut().enumerate() {
            *v = src[i..].iter().step_by(inner).sum::<f32>() / ratio as f32;
        }
    });
    dst
}
