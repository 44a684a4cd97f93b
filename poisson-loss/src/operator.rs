//! The quadratic form of the objective in spline coefficients, as matrix-free passes over tiles.
//!
//! `A c = sum_d alpha_d B_d^T gamma B_d c + B^T s B c`, the mean over two points per knot interval
//! and axis (at 1/4 and 3/4): `B` evaluates the spline there, `B_d` its derivative along axis
//! `d`; `gamma` and `s` are constant on sample cells. Where they are constant on a neighbourhood
//! the products collapse to 7-tap factors per axis.

use inr_core::cpu::{Kernel, dispatch};
use inr_core::{cubic_weights, cubic_weights_d1};
use rayon::prelude::*;

use crate::tile::{Beyond, Frame, Tile, uniform_value};

/// How far the operator reaches along every axis.
pub const REACH: usize = 3;

/// Basis values and derivatives at the two points of a sample's cell, at -1/4 and +1/4 of the
/// sample. Each point sees four coefficients, beginning at `first`.
pub struct CellPoint {
    pub first: isize,
    pub value: [f32; 4],
    pub slope: [f32; 4],
}

/// The two points of a cell along one axis.
pub fn cell_points() -> [CellPoint; 2] {
    [(-2, 0.75f64), (-1, 0.25)].map(|(first, t)| CellPoint {
        first,
        value: cubic_weights(t).map(|v| v as f32),
        slope: cubic_weights_d1(t).map(|v| v as f32),
    })
}

/// Taps at offsets 0..3 of the symmetric factors `M` (values) and `K` (slopes).
pub fn factor_taps() -> ([f32; 4], [f32; 4]) {
    // By symmetry the point at +1/4 alone gives the mean over both.
    let auto = |w: [f64; 4]| {
        std::array::from_fn(|j| (0..4 - j).map(|k| w[k] * w[k + j]).sum::<f64>() as f32)
    };
    // The two halves together are symmetric in the offset, one half is too: w correlates with itself.
    (auto(cubic_weights(0.25)), auto(cubic_weights_d1(0.25)))
}

/// The operator on one frame.
pub struct SplineOperator<const D: usize> {
    pub frame: Frame<D>,
    /// `(h_ref / h_d)^2` per axis.
    pub alpha: [f32; D],
    /// Weight of the squared value per cell.
    pub screening: Vec<f32>,
    /// Weight of the squared gradient per cell, or empty where it is 1.
    pub gamma: Vec<f32>,
}

/// Buffers of one thread.
#[derive(Default)]
pub struct Scratch {
    pub input: Vec<f32>,
    pub output: Vec<f32>,
    pub weight: Vec<f32>,
    pub stack: Vec<Vec<f32>>,
    /// What is collapsed along the axes of constant weight.
    collapsed: [Vec<f32>; 2],
}

impl<const D: usize> SplineOperator<D> {
    /// `out = A c`, where `c` is mirrored or zero beyond the frame.
    pub fn apply(&self, c: &[f32], out: &mut [f32]) {
        out.par_chunks_mut(self.frame.slab_len()).enumerate().for_each_init(
            Scratch::default,
            |scratch, (slab, out)| {
                for tile in self.frame.tiles(slab, REACH) {
                    let mut input = std::mem::take(&mut scratch.input);
                    tile.load(c, Beyond::Zero, &mut input);
                    self.apply_tile(&tile, &input, scratch);
                    scratch.input = input;
                    tile.store(&scratch.output, out);
                }
            },
        );
    }

    /// `scratch.output = A c` on the core of a tile with halo [`REACH`].
    pub fn apply_tile(&self, tile: &Tile<D>, c: &[f32], scratch: &mut Scratch) {
        tile.load(&self.screening, Beyond::Edge, &mut scratch.weight);
        let uniform = uniform_value(&scratch.weight);
        self.apply_classified(tile, uniform, c, scratch);
    }

    /// [`SplineOperator::apply_tile`] for a tile on which the screening is known to be `uniform`.
    pub fn apply_classified(
        &self,
        tile: &Tile<D>,
        uniform: Option<f32>,
        c: &[f32],
        scratch: &mut Scratch,
    ) {
        scratch.output.resize(tile.len(), 0.0);
        if !self.gamma.is_empty() {
            scratch.output.fill(0.0);
        }
        if uniform.is_none() || !self.gamma.is_empty() {
            tile.load(&self.screening, Beyond::Edge, &mut scratch.weight);
        }
        scratch.stack.resize_with(2 * D + 2, Vec::new);
        if self.gamma.is_empty() {
            let (output, stack) = (&mut scratch.output, &mut scratch.stack);
            let s = uniform.unwrap_or(0.0);
            dispatch(Uniform { tile, alpha: self.alpha, s, c, output, stack });
        }
        if uniform.is_none() || (!self.gamma.is_empty() && uniform != Some(0.0)) {
            dispatch(Weighted { tile, slope_axis: None, scale: 1.0, c, scratch });
        }
        if !self.gamma.is_empty() {
            tile.load(&self.gamma, Beyond::Edge, &mut scratch.weight);
            if uniform_value(&scratch.weight) != Some(0.0) {
                for d in 0..D {
                    dispatch(Weighted {
                        tile,
                        slope_axis: Some(d),
                        scale: self.alpha[d],
                        c,
                        scratch,
                    });
                }
            }
        }
    }
}

/// `output = (sum_d alpha_d K_d prod M + s prod M) c`.
struct Uniform<'a, const D: usize> {
    tile: &'a Tile<D>,
    alpha: [f32; D],
    s: f32,
    c: &'a [f32],
    output: &'a mut [f32],
    stack: &'a mut [Vec<f32>],
}

impl<const D: usize> Kernel for Uniform<'_, D> {
    type Output = ();
    /// Plane by plane of the outermost axis: the axes within a plane first, then the last axis
    /// three planes behind, where its input is still in cache.
    #[inline(always)]
    fn run(self) {
        let (n, strides, planes) = (self.tile.len(), self.tile.strides(), self.tile.extent(D - 1));
        let (mass, stiff) = factor_taps();
        // Per axis: m' = M m and k' = M k + alpha K m, from m = c and k = 0.
        let [m0, k0, m1, k1, ..] = self.stack else { unreachable!("four work buffers") };
        for buffer in [&mut *m0, &mut *k0, &mut *m1, &mut *k1] {
            buffer.resize(n, 0.0);
        }
        let stride = strides[D - 1];
        let (mut m, mut k, mut m_next, mut k_next) = (m1, k1, m0, k0);
        for plane in 0..planes {
            for d in 0..D - 1 {
                let (lo, hi) = (
                    (plane * stride).max(REACH * strides[d]),
                    ((plane + 1) * stride).min(n - REACH * strides[d]),
                );
                let stiff = stiff.map(|v| v * self.alpha[d]);
                if d == 0 {
                    let src = shifts7(self.c, lo, hi - lo, strides[d]);
                    symmetric7_both(&mut m_next[lo..hi], &mut k_next[lo..hi], src, mass, stiff);
                } else {
                    let (x, y) =
                        (shifts7(m, lo, hi - lo, strides[d]), shifts7(k, lo, hi - lo, strides[d]));
                    symmetric7(&mut m_next[lo..hi], x, mass);
                    pair(&mut k_next[lo..hi], x, stiff, y, mass);
                }
                std::mem::swap(&mut m, &mut m_next);
                std::mem::swap(&mut k, &mut k_next);
            }
            if plane >= 2 * REACH {
                let lo = (plane - REACH) * stride;
                let out = &mut self.output[lo..lo + stride];
                // The screening joins before the last pass: M k + alpha K m + s M m.
                let taps: [f32; 4] =
                    std::array::from_fn(|j| self.alpha[D - 1] * stiff[j] + self.s * mass[j]);
                if D == 1 {
                    symmetric7(out, shifts7(self.c, lo, stride, stride), taps);
                } else {
                    let (x, y) = (shifts7(m, lo, stride, stride), shifts7(k, lo, stride, stride));
                    pair(out, x, taps, y, mass);
                }
            }
            if D.is_multiple_of(2) {
                // An odd number of swaps so far: every plane starts from the same buffers.
                std::mem::swap(&mut m, &mut m_next);
                std::mem::swap(&mut k, &mut k_next);
            }
        }
    }
}

/// The seven shifts of a flat buffer that a symmetric stencil along one axis reads.
#[inline(always)]
fn shifts7(src: &[f32], lo: usize, n: usize, stride: usize) -> [&[f32]; 7] {
    let shift = |k: usize| &src[lo + k * stride - REACH * stride..][..n];
    [shift(0), shift(1), shift(2), shift(3), shift(4), shift(5), shift(6)]
}

#[inline(always)]
pub fn symmetric7(dst: &mut [f32], src: [&[f32]; 7], t: [f32; 4]) {
    let n = dst.len();
    let [a, b, c, d, e, f, g] = src;
    let (a, b, c, d) = (&a[..n], &b[..n], &c[..n], &d[..n]);
    let (e, f, g) = (&e[..n], &f[..n], &g[..n]);
    for i in 0..n {
        dst[i] = t[0] * d[i] + t[1] * (c[i] + e[i]) + t[2] * (b[i] + f[i]) + t[3] * (a[i] + g[i]);
    }
}

/// Two stencils on the same input.
#[inline(always)]
pub fn symmetric7_both(
    first: &mut [f32],
    second: &mut [f32],
    src: [&[f32]; 7],
    t: [f32; 4],
    v: [f32; 4],
) {
    let n = first.len();
    let second = &mut second[..n];
    let [a, b, c, d, e, f, g] = src;
    let (a, b, c, d) = (&a[..n], &b[..n], &c[..n], &d[..n]);
    let (e, f, g) = (&e[..n], &f[..n], &g[..n]);
    for i in 0..n {
        let (ce, bf, ag) = (c[i] + e[i], b[i] + f[i], a[i] + g[i]);
        first[i] = t[0] * d[i] + t[1] * ce + t[2] * bf + t[3] * ag;
        second[i] = v[0] * d[i] + v[1] * ce + v[2] * bf + v[3] * ag;
    }
}

/// Two symmetric stencils on the shifts of two inputs, added.
#[inline(always)]
pub fn pair(dst: &mut [f32], x: [&[f32]; 7], t: [f32; 4], y: [&[f32]; 7], v: [f32; 4]) {
    let n = dst.len();
    let ([a, b, c, d, e, f, g], [h, j, k, l, m, o, p]) = (x, y);
    let (a, b, c, d) = (&a[..n], &b[..n], &c[..n], &d[..n]);
    let (e, f, g) = (&e[..n], &f[..n], &g[..n]);
    let (h, j, k, l) = (&h[..n], &j[..n], &k[..n], &l[..n]);
    let (m, o, p) = (&m[..n], &o[..n], &p[..n]);
    for i in 0..n {
        let x = t[0] * d[i] + t[1] * (c[i] + e[i]) + t[2] * (b[i] + f[i]) + t[3] * (a[i] + g[i]);
        let y = v[0] * l[i] + v[1] * (k[i] + m[i]) + v[2] * (j[i] + o[i]) + v[3] * (h[i] + p[i]);
        dst[i] = x + y;
    }
}

/// `output += scale * B^T weight B c` with the weight in `scratch.weight`, values or slopes along one axis.
pub struct Weighted<'a, const D: usize> {
    pub tile: &'a Tile<D>,
    pub slope_axis: Option<usize>,
    pub scale: f32,
    pub c: &'a [f32],
    pub scratch: &'a mut Scratch,
}

impl<const D: usize> Kernel for Weighted<'_, D> {
    type Output = ();
    /// Along axes on which the weight does not vary the two points of a cell collapse to one factor of
    /// seven taps; the others are visited point by point.
    #[inline(always)]
    fn run(self) {
        let Scratch { output, weight, stack, collapsed: [one, other], .. } = self.scratch;
        let (n, strides) = (self.tile.len(), self.tile.strides());
        let (mass, stiff) = factor_taps();
        let (mut axes, mut count, mut collapsed) = ([0; D], 0, 0);
        let (mut from, mut to) = (one, other);
        for d in 0..D {
            if is_constant_along(self.tile, weight, d) {
                to.resize(n, 0.0);
                let margin = REACH * strides[d];
                let src = if collapsed == 0 { self.c } else { &from[..] };
                let taps = if self.slope_axis == Some(d) { stiff } else { mass };
                let shifts = shifts7(src, margin, n - 2 * margin, strides[d]);
                symmetric7(&mut to[margin..n - margin], shifts, taps);
                std::mem::swap(&mut from, &mut to);
                collapsed += 1;
            } else {
                axes[count] = d;
                count += 1;
            }
        }
        let c = if collapsed == 0 { self.c } else { &from[..] };
        // Each axis halves the weight of a point: the form is a mean over the points of a cell.
        let scale = self.scale * 0.5f32.powi(count as i32);
        if count == 0 {
            for ((out, w), c) in output.iter_mut().zip(&*weight).zip(c) {
                *out += scale * w * c;
            }
            return;
        }
        stack.resize_with(2 * D + 2, Vec::new);
        nest(self.tile, &axes[..count], self.slope_axis, scale, c, weight, output, stack);
    }
}

/// Whether a tile's weights do not change along an axis.
#[inline(always)]
fn is_constant_along<const D: usize>(tile: &Tile<D>, weight: &[f32], d: usize) -> bool {
    let (stride, extent) = (tile.strides()[d], tile.extent(d));
    weight.chunks_exact(stride * extent).all(|block| {
        let (head, tail) = (&block[..stride * (extent - 1)], &block[stride..]);
        let pairs = head.iter().zip(tail);
        pairs.map(|(a, b)| u32::from(a != b)).sum::<u32>() == 0
    })
}

/// Runs over the points of a cell along some of the axes like a counter: an axis is interpolated
/// again only when its digit (or one above) has changed, and spread back once all digits below it
/// are done.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // All of them are parts of one struct at the only call.
fn nest<const D: usize>(
    tile: &Tile<D>,
    axes: &[usize],
    slope_axis: Option<usize>,
    scale: f32,
    c: &[f32],
    weight: &[f32],
    output: &mut [f32],
    stack: &mut [Vec<f32>],
) {
    let points = cell_points();
    let (n, strides, count) = (tile.len(), tile.strides(), axes.len());
    let (forward, backward) = stack.split_at_mut(D);
    for buffer in forward.iter_mut().chain(backward.iter_mut()) {
        buffer.resize(n, 0.0);
    }
    for half in 0..1usize << count {
        let digit = |k: usize| half >> k & 1;
        let taps = |k: usize| {
            let point = &points[digit(k)];
            (point.first, if slope_axis == Some(axes[k]) { point.slope } else { point.value })
        };
        for k in (0..count).rev().filter(|k| half & ((1 << k) - 1) == 0) {
            let (first, t) = taps(k);
            let (head, tail) = forward.split_at_mut(k + 1);
            let src = if k + 1 == count { c } else { &tail[0][..] };
            gather4(&mut head[k], src, first, strides[axes[k]], t);
        }
        for (v, w) in forward[0].iter_mut().zip(weight) {
            *v *= scale * w;
        }
        for k in 0..count {
            let (first, t) = taps(k);
            let (head, tail) = backward.split_at_mut(k);
            let src = if k == 0 { &forward[0][..] } else { &head[k - 1][..] };
            if k + 1 == count {
                scatter4(output, src, first, strides[axes[k]], t, true);
            } else {
                scatter4(&mut tail[0], src, first, strides[axes[k]], t, digit(k) == 1);
            }
            if digit(k) == 0 {
                break;
            }
        }
    }
}

/// `dst[i] = sum_k t[k] src[i + first + k]` along one axis.
#[inline(always)]
pub fn gather4(dst: &mut [f32], src: &[f32], first: isize, stride: usize, t: [f32; 4]) {
    let n = src.len() - 3 * stride;
    let dst = &mut dst[first.unsigned_abs() * stride..][..n];
    let shift = |k: usize| &src[k * stride..][..n];
    let (a, b, c, d) = (shift(0), shift(1), shift(2), shift(3));
    for i in 0..n {
        dst[i] = t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
    }
}

/// The adjoint of [`gather4`], replacing `dst` or adding to it.
#[inline(always)]
pub fn scatter4(dst: &mut [f32], src: &[f32], first: isize, stride: usize, t: [f32; 4], add: bool) {
    let n = src.len() - 3 * stride;
    let dst = &mut dst[(first + 3) as usize * stride..][..n];
    let shift = |k: usize| &src[(3 - k) * stride..][..n];
    let (a, b, c, d) = (shift(0), shift(1), shift(2), shift(3));
    if add {
        for i in 0..n {
            dst[i] += t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
        }
    } else {
        for i in 0..n {
            dst[i] = t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::End;

    /// Seven taps against eight points, in f32, for values of order one.
    const TOLERANCE: f32 = 2e-6;

    /// A weight that differs by a rounding along the axes that it would be constant on takes the way
    /// of the points.
    fn collapsed_axes_match_points<const D: usize>(shape: [usize; D], varies: [bool; D]) {
        let ends = std::array::from_fn(|d| [End::Zero, [End::Mirror, End::Zero][d % 2]]);
        let frame = Frame { shape, ends };
        let noise = |k: usize| (k * 7919 % 1009) as f32 / 504.5 - 1.0;
        let c: Vec<f32> = (0..frame.len()).map(noise).collect();
        let weight = |tilt: f32| -> Vec<f32> {
            let at = |mut k: usize| {
                let (mut weight, mut sum) = (1.0, 0);
                for d in 0..D {
                    weight *= if varies[d] { 1.0 + 0.5 * noise(k % shape[d]) } else { 1.0 };
                    sum += k % shape[d];
                    k /= shape[d];
                }
                weight * (1.0 + tilt * (sum % 2) as f32)
            };
            (0..frame.len()).map(at).collect()
        };
        let [fast, plain] = [0.0, f32::EPSILON].map(|tilt| {
            let operator = SplineOperator {
                frame,
                alpha: [1.5; D],
                screening: weight(tilt),
                gamma: weight(tilt),
            };
            let mut out = vec![0.0; c.len()];
            operator.apply(&c, &mut out);
            out
        });
        for (a, b) in fast.iter().zip(&plain) {
            assert!((a - b).abs() < TOLERANCE, "{shape:?} {varies:?}: {a}, by points {b}");
        }
    }

    #[test]
    fn axes_of_constant_weight_match_points() {
        collapsed_axes_match_points([33, 21], [true, false]);
        collapsed_axes_match_points([33, 21], [false, true]);
        collapsed_axes_match_points([21, 12, 19], [true, false, true]);
        collapsed_axes_match_points([21, 12, 19], [false, true, false]);
        collapsed_axes_match_points([5, 4, 20, 18], [false, false, true, true]);
        collapsed_axes_match_points([20, 5, 4, 18], [true, false, false, false]);
    }
}
