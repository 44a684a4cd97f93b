//! Conjugate gradients in spline coefficients, one pass per operation: every option, any
//! dimension, and the oracle of the fused version.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::axis::{End, ghost};
use crate::cg::System;
use crate::multigrid::{Multigrid, Vectors};
use crate::operator::SplineOperator;
use crate::tile::Frame;

/// Symmetric 5-tap stand-in for `P^-1` along one axis: condition 2.19 against the 5-point
/// Laplacian, where the exact recursion has 2.24.
pub const FILTER: [f32; 3] = [1.71229, -0.51891, 0.14280];

/// Samples of one partial sum; fixed, so that dot products do not depend on the threads.
const CHUNK: usize = 1 << 14;

/// The spline system of one right-hand side, with vectors of its own.
pub struct PlainSystem<'a, const D: usize> {
    operator: &'a SplineOperator<D>,
    multigrid: &'a Multigrid<D>,
    work: Vec<Vectors>,
    /// Coefficients that may change; empty where all may.
    free: &'a [bool],
    pub x: Vec<f32>,
    pub r: Vec<f32>,
    p: Vec<f32>,
    q: Vec<f32>,
    z: Vec<f32>,
}

impl<'a, const D: usize> PlainSystem<'a, D> {
    /// Starts on the right-hand side `r`.
    pub fn new(
        operator: &'a SplineOperator<D>,
        multigrid: &'a Multigrid<D>,
        free: &'a [bool],
        mut r: Vec<f32>,
    ) -> Self {
        mask(free, &mut r);
        let zeros = || vec![0.0; r.len()];
        let (x, p, q, z) = (zeros(), zeros(), zeros(), zeros());
        Self { operator, multigrid, work: multigrid.vectors(0), free, x, r, p, q, z }
    }

    #[cfg(test)]
    pub fn z(&self) -> &[f32] {
        &self.z
    }

    #[cfg(test)]
    pub fn q(&self) -> &[f32] {
        &self.q
    }

    fn dot(&self, a: &[f32], b: &[f32]) -> f64 {
        weighted_dot(&self.operator.frame, a, b)
    }
}

impl<const D: usize> System for PlainSystem<'_, D> {
    fn precondition(&mut self) -> f64 {
        filter(&self.operator.frame, &self.r, &mut self.z, &mut self.q);
        std::mem::swap(&mut self.work[0].f, &mut self.z);
        self.multigrid.cycle(&mut self.work, 0);
        std::mem::swap(&mut self.work[0].f, &mut self.z);
        filter(&self.operator.frame, &self.work[0].u, &mut self.z, &mut self.q);
        mask(self.free, &mut self.z);
        self.dot(&self.r, &self.z)
    }

    fn direction(&mut self, beta: f32) -> f64 {
        self.p.par_iter_mut().zip(&self.z).for_each(|(p, z)| *p = z + beta * *p);
        self.operator.apply(&self.p, &mut self.q);
        mask(self.free, &mut self.q);
        self.dot(&self.p, &self.q)
    }

    fn advance(&mut self, alpha: f32) {
        self.x.par_iter_mut().zip(&self.p).for_each(|(x, p)| *x += alpha * p);
        self.r.par_iter_mut().zip(&self.q).for_each(|(r, q)| *r -= alpha * q);
    }
}

/// Zeroes what may not change.
pub fn mask(free: &[bool], values: &mut [f32]) {
    if !free.is_empty() {
        values.par_iter_mut().zip(free).for_each(|(v, f)| *v = if *f { *v } else { 0.0 });
    }
}

/// Inner product under which all operators here are symmetric: samples on a mirror border count
/// half per axis.
pub fn weighted_dot<const D: usize>(frame: &Frame<D>, a: &[f32], b: &[f32]) -> f64 {
    let n0 = frame.shape[0];
    let rows = CHUNK.div_ceil(n0);
    let partial: Vec<f64> = a
        .par_chunks(rows * n0)
        .zip(b.par_chunks(rows * n0))
        .enumerate()
        .map(|(chunk, (a, b))| {
            let row_dot = |(r, (a, b)): (usize, (&[f32], &[f32]))| {
                row_weight(frame, chunk * rows + r) * line_dot(frame, 0, a, b)
            };
            a.chunks_exact(n0).zip(b.chunks_exact(n0)).enumerate().map(row_dot).sum()
        })
        .collect();
    partial.iter().sum()
}

/// Share of a row's samples that lies inside the signal's border, from the outer axes.
pub fn row_weight<const D: usize>(frame: &Frame<D>, mut row: usize) -> f64 {
    let mut weight = 1.0;
    for d in 1..D {
        weight *= border_weight(frame, d, row % frame.shape[d]);
        row /= frame.shape[d];
    }
    weight
}

/// 1/2 on a mirror border, 1 elsewhere. An axis with one sample has no border.
fn border_weight<const D: usize>(frame: &Frame<D>, d: usize, i: usize) -> f64 {
    use End::Mirror;
    let n = frame.shape[d];
    let half =
        n > 1 && (i == 0 && frame.ends[d][0] == Mirror || i + 1 == n && frame.ends[d][1] == Mirror);
    if half { 0.5 } else { 1.0 }
}

/// The weighted inner product of a piece of a row that begins at sample `start`, summed in
/// f64 lanes.
#[inline(always)]
pub fn line_dot<const D: usize>(frame: &Frame<D>, start: usize, a: &[f32], b: &[f32]) -> f64 {
    let n = a.len();
    let border =
        |i: usize| (1.0 - border_weight(frame, 0, start + i)) * f64::from(a[i]) * f64::from(b[i]);
    let ends = border(0) + if n > 1 { border(n - 1) } else { 0.0 };
    lanes_dot(a, b) - ends
}

/// `sum a b` in f64 lanes, in a fixed order.
#[inline(always)]
pub fn lanes_dot(a: &[f32], b: &[f32]) -> f64 {
    // Enough for the additions of a vector unit to overlap.
    const LANES: usize = 32;
    let mut lanes = [0.0f64; LANES];
    let ((a_lanes, a_rest), (b_lanes, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for k in 0..LANES {
            lanes[k] += f64::from(a[k]) * f64::from(b[k]);
        }
    }
    for (lane, (a, b)) in lanes.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *lane += f64::from(*a) * f64::from(*b);
    }
    let mut half = LANES / 2;
    while half > 0 {
        for k in 0..half {
            lanes[k] += lanes[k + half];
        }
        half /= 2;
    }
    lanes[0]
}

/// `dst = F src` along every axis; `spare` is a work vector.
fn filter<const D: usize>(frame: &Frame<D>, src: &[f32], dst: &mut [f32], spare: &mut Vec<f32>) {
    spare.resize(src.len(), 0.0);
    let mut inner = 1;
    for axis in 0..D {
        let ends = frame.ends[axis];
        // Buffers take turns so that the last axis writes `dst`.
        let last_in_dst = (D - 1 - axis).is_multiple_of(2);
        let (from, to) =
            if last_in_dst { (&spare[..], &mut *dst) } else { (&*dst, &mut spare[..]) };
        let from = if axis == 0 { src } else { from };
        let n = frame.shape[axis];
        let rows = CHUNK.div_ceil(inner.max(frame.shape[0]));
        if axis == 0 {
            let lines = to.par_chunks_mut(rows * n).zip(from.par_chunks(rows * n));
            lines.for_each_init(Vec::new, |padded, (to, from)| {
                dispatch(FilterLines { n, ends, from, to, padded });
            });
        } else {
            to.par_chunks_mut(rows * inner).enumerate().for_each(|(task, to)| {
                dispatch(FilterRows { n, ends, inner, from, first: task * rows, to });
            });
        }
        inner *= n;
    }
}

/// The filter along contiguous lines of `n` samples.
struct FilterLines<'a> {
    n: usize,
    ends: [End; 2],
    from: &'a [f32],
    to: &'a mut [f32],
    padded: &'a mut Vec<f32>,
}

impl Kernel for FilterLines<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { n, ends, from, to, padded } = self;
        padded.resize(n + 4, 0.0);
        let beyond = [-2, -1, n as isize, n as isize + 1].map(|i| (i, ghost(i, n, ends)));
        for (from, to) in from.chunks_exact(n).zip(to.chunks_exact_mut(n)) {
            padded[2..n + 2].copy_from_slice(from);
            for (i, inside) in beyond {
                padded[(i + 2) as usize] = inside.map_or(0.0, |i| from[i]);
            }
            let (a, b, c) = (&padded[..n], &padded[1..][..n], &padded[2..][..n]);
            let (d, e) = (&padded[3..][..n], &padded[4..][..n]);
            for i in 0..n {
                to[i] = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
            }
        }
    }
}

/// The filter along an axis of `n` rows of `inner` samples each, on some of all rows.
struct FilterRows<'a> {
    n: usize,
    ends: [End; 2],
    inner: usize,
    from: &'a [f32],
    first: usize,
    to: &'a mut [f32],
}

impl Kernel for FilterRows<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { n, ends, inner, from, first, to } = self;
        for (row, to) in to.chunks_exact_mut(inner).enumerate() {
            let (line, i) = ((first + row) / n, (first + row) % n);
            let shift = |k: isize| {
                let inside = ghost(i as isize + k, n, ends);
                // Where there is nothing the row itself is read, without weight.
                let row = &from[(line * n + inside.unwrap_or(i)) * inner..][..inner];
                (row, FILTER[k.unsigned_abs()] * f32::from(inside.is_some()))
            };
            let ((a, ta), (b, tb), (c, tc)) = (shift(-2), shift(-1), shift(0));
            let ((d, td), (e, te)) = (shift(1), shift(2));
            for i in 0..inner {
                to[i] = tc * c[i] + (tb * b[i] + td * d[i]) + (ta * a[i] + te * e[i]);
            }
        }
    }
}
