//! Sines and cosines of fixed frequencies, with tangents.

use super::architecture::{Fourier, Frequencies};
use super::frame::Frame;
use super::sincos::sincos;
use crate::Scalar;
use crate::cpu::{Simd, SimdKernel, dispatch_simd};
use crate::random::Random;

/// Frequency vectors in the order of the features: groups of sines, each followed by the cosines of the
/// same vectors.
#[derive(Debug, Clone)]
pub(crate) struct Waves<const D: usize> {
    frequencies: Vec<[f32; D]>,
    group: usize,
    include_input: bool,
}

impl<const D: usize> Waves<D> {
    pub fn new(fourier: &Fourier) -> Self {
        let (frequencies, group) = match fourier.frequencies {
            Frequencies::Axis { octaves, base } => {
                let axis = |k: usize, axis: usize| {
                    let mut w = [0.0; D];
                    w[axis] = base * (k as f32).exp2();
                    w
                };
                ((0..octaves * D).map(|i| axis(i / D, i % D)).collect(), D)
            }
            Frequencies::Gaussian { count, sigma, seed } => {
                let random = Random::new(seed, Random::FREQUENCIES);
                let component = |k: usize| std::f32::consts::TAU * sigma * random.normal(k as u64);
                let vector = |i: usize| std::array::from_fn(|d| component(i * D + d));
                ((0..count).map(vector).collect(), count)
            }
        };
        Self { frequencies, group, include_input: fourier.include_input }
    }

    pub fn outputs(&self) -> usize {
        2 * self.frequencies.len() + if self.include_input { D } else { 0 }
    }

    /// The frequency vectors, in radians per unit of the scaled coordinates.
    pub fn frequencies(&self) -> &[[f32; D]] {
        &self.frequencies
    }

    /// The definition: features of one point for any scalar.
    pub fn plain<T: Scalar>(&self, u: [T; D], out: &mut Vec<T>) {
        if self.include_input {
            out.extend(u);
        }
        let phase =
            |w: &[f32; D]| -> T { (0..D).map(|d| u[d] * T::from_f64(f64::from(w[d]))).sum() };
        for group in self.frequencies.chunks(self.group) {
            out.extend(group.iter().map(|w| phase(w).sin()));
            out.extend(group.iter().map(|w| phase(w).cos()));
        }
    }

    /// Features of a tile, `[block][point][stride]`; tangents if there are blocks for them.
    pub fn forward(&self, frame: &Frame<D>, x: &[[f32; D]], out: &mut [f32], stride: usize) {
        dispatch_simd(Forward { waves: self, frame, x, out, stride });
    }
}

struct Forward<'a, const D: usize> {
    waves: &'a Waves<D>,
    frame: &'a Frame<D>,
    x: &'a [[f32; D]],
    out: &'a mut [f32],
    stride: usize,
}

impl<const D: usize> SimdKernel for Forward<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { waves, frame, x, out, stride } = self;
        let block = x.len() * stride;
        let tangents = out.len() > block;
        let n = waves.frequencies.len();
        // Without heap memory per call for the usual sizes; sized for all vectors of one point.
        let (mut sin, mut cos) = (vec![0.0f32; n], vec![0.0f32; n]);
        for (p, x) in x.iter().enumerate() {
            let u: [f32; D] = std::array::from_fn(|d| (x[d] - frame.center[d]) * frame.inverse(d));
            for (w, phase) in waves.frequencies.iter().zip(&mut sin) {
                *phase = (0..D).map(|d| u[d] * w[d]).sum();
            }
            let (sin, cos) = (&mut sin[..n], &mut cos[..n]);
            for k in 0..n {
                (sin[k], cos[k]) = sincos::<S>(sin[k]);
            }
            let mut at = p * stride;
            if waves.include_input {
                for d in 0..D {
                    out[at + d] = u[d];
                    if tangents {
                        (0..D).for_each(|e| out[at + d + (1 + e) * block] = 0.0);
                        out[at + d + (1 + d) * block] = frame.inverse(d);
                    }
                }
                at += D;
            }
            for (k, group) in waves.frequencies.chunks(waves.group).enumerate() {
                let (m, first) = (group.len(), k * waves.group);
                out[at..at + m].copy_from_slice(&sin[first..first + m]);
                out[at + m..at + 2 * m].copy_from_slice(&cos[first..first + m]);
                if tangents {
                    for d in 0..D {
                        let out = &mut out[at + (1 + d) * block..][..2 * m];
                        for (i, w) in group.iter().enumerate() {
                            let slope = w[d] * frame.inverse(d);
                            out[i] = slope * cos[first + i];
                            out[m + i] = -slope * sin[first + i];
                        }
                    }
                }
                at += 2 * m;
            }
        }
    }
}
