//! Activations on slices, with what the reverse sweep needs of them.

use super::architecture::Activation;
use super::sincos::sincos;
use crate::Scalar;
use crate::cpu::{Simd, SimdKernel, dispatch_simd, sweep};

/// `f(u)`, the definition.
pub(crate) fn plain<T: Scalar>(activation: &Activation, layer: usize, u: T) -> T {
    match activation {
        Activation::Sine { .. } => (u * T::from_f64(f64::from(activation.omega(layer)))).sin(),
        Activation::Relu => {
            if u > T::zero() {
                u
            } else {
                T::zero()
            }
        }
        Activation::Silu => u / (T::one() + (-u).exp()),
    }
}

/// A unit's function as plain numbers: what a kernel needs to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Unit {
    Sine(f32),
    Relu,
    Silu,
}

impl Unit {
    pub fn of(activation: &Activation, layer: usize) -> Self {
        match activation {
            Activation::Sine { .. } => Self::Sine(activation.omega(layer)),
            Activation::Relu => Self::Relu,
            Activation::Silu => Self::Silu,
        }
    }

    /// Whether `f''` has to be kept for the reverse sweep: of the sine it follows from the value, of the
    /// rectifier it is zero.
    pub fn keeps_curvature(self) -> bool {
        matches!(self, Self::Silu)
    }
}

/// `h: u -> f(u)` in place, with `g = f'(u)` and `s = f''(u)`; `g` and `s` may be empty if they are not needed.
pub(crate) fn forward(unit: Unit, h: &mut [f32], g: &mut [f32], s: &mut [f32]) {
    assert!(g.is_empty() || g.len() == h.len(), "{} slopes for {} units", g.len(), h.len());
    assert!(s.is_empty() || s.len() == h.len(), "{} curvatures for {} units", s.len(), h.len());
    dispatch_simd(Forward { unit, h, g, s });
}

struct Forward<'a> {
    unit: Unit,
    h: &'a mut [f32],
    g: &'a mut [f32],
    s: &'a mut [f32],
}

impl SimdKernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let n = self.h.len();
        let h = &mut self.h[..n];
        match (self.unit, self.g.is_empty()) {
            (Unit::Sine(omega), true) => h.iter_mut().for_each(|h| *h = sincos::<S>(omega * *h).0),
            (Unit::Sine(omega), false) => {
                let g = &mut self.g[..n];
                for i in 0..n {
                    let (sin, cos) = sincos::<S>(omega * h[i]);
                    (h[i], g[i]) = (sin, omega * cos);
                }
            }
            (Unit::Relu, true) => h.iter_mut().for_each(|h| *h = if *h > 0.0 { *h } else { 0.0 }),
            (Unit::Relu, false) => {
                let g = &mut self.g[..n];
                for i in 0..n {
                    let on = h[i] > 0.0;
                    (h[i], g[i]) = if on { (h[i], 1.0) } else { (0.0, 0.0) };
                }
            }
            (Unit::Silu, true) => h.iter_mut().for_each(|h| *h *= sigmoid::<S>(*h)),
            (Unit::Silu, false) if self.s.is_empty() => {
                let g = &mut self.g[..n];
                for i in 0..n {
                    let (u, p) = (h[i], sigmoid::<S>(h[i]));
                    (h[i], g[i]) = (u * p, S::fma(u * p, 1.0 - p, p));
                }
            }
            (Unit::Silu, false) => {
                let (g, s) = (&mut self.g[..n], &mut self.s[..n]);
                for i in 0..n {
                    let (u, p) = (h[i], sigmoid::<S>(h[i]));
                    // p' = p (1 - p), so f' = p + u p' and f'' = p' (2 + u (1 - 2 p)).
                    let slope = p * (1.0 - p);
                    s[i] = slope * S::fma(u, 1.0 - 2.0 * p, 2.0);
                    (h[i], g[i]) = (u * p, S::fma(u, slope, p));
                }
            }
        }
    }
}

/// `1 / (1 + e^-u)`.
#[inline(always)]
fn sigmoid<S: Simd>(u: f32) -> f32 {
    1.0 / (1.0 + exp::<S>(-u))
}

/// `e^x` to about 2 ulp for x in -87..87, clamped beyond: enough for a sigmoid, whose ends are 0 and 1.
/// Degree 5 minimax polynomial on half an octave around 0 (Cephes `expf`).
#[inline(always)]
pub(crate) fn exp<S: Simd>(x: f32) -> f32 {
    /// 1.5 * 2^23: adding it rounds to an integer in the low bits.
    const MAGIC: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 87.0);
    let shifted = S::fma(x, std::f32::consts::LOG2_E, MAGIC);
    let k = shifted - MAGIC;
    // ln 2 in two parts.
    let r = S::fma(k, -0.693_359_4, x);
    let r = S::fma(k, 2.121_944_4e-4, r);
    let mut p = 1.987_569_1e-4;
    for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
        p = S::fma(p, r, c);
    }
    let e = S::fma(p, r * r, r + 1.0);
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
    e * scale
}

/// One layer's part of the reverse sweep, in place; see [`sweep`]. `h`, `g` and `s` are what [`forward`] left,
/// `z` the tangents of the weighted sums.
pub(crate) fn backward(unit: Unit, bar: &mut [f32], h: &[f32], g: &[f32], s: &[f32], z: &[f32]) {
    let curvature = match unit {
        Unit::Sine(omega) => Some((-omega * omega, h)),
        Unit::Relu => None,
        Unit::Silu => Some((1.0, s)),
    };
    // Without tangents nothing looks at it, and it was not kept.
    sweep(bar, g, z, curvature.filter(|_| !z.is_empty()));
}
