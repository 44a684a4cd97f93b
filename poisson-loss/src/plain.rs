//! Conjugate gradients in spline coefficients, one pass per operation: every option, any
//! dimension, and the oracle of the fused version.

use rayon::prelude::*;

use crate::cg::System;
use crate::multigrid::{Multigrid, Vectors};
use crate::operator::SplineOperator;
use crate::tile::{Beyond, Frame};

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
    use crate::axis::End::Mirror;
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
    spare.copy_from_slice(src);
    for axis in 0..D {
        dst.par_chunks_mut(frame.slab_len()).enumerate().for_each_init(
            Vec::new,
            |buffer, (slab, dst)| {
                for tile in frame.tiles(slab, 2) {
                    tile.load(spare, Beyond::Zero, buffer);
                    let stride = tile.strides()[axis];
                    for (local, global) in tile.core_rows() {
                        for i in 0..tile.core[0] {
                            let at = |k: isize| {
                                buffer[(local + i).wrapping_add_signed(k * stride as isize)]
                            };
                            dst[global + i] = FILTER[0] * at(0)
                                + FILTER[1] * (at(-1) + at(1))
                                + FILTER[2] * (at(-2) + at(2));
                        }
                    }
                }
            },
        );
        if axis + 1 < D {
            spare.copy_from_slice(dst);
        }
    }
}
