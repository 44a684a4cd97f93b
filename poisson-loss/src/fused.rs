//! The spline system in three passes per iteration over cache-sized tiles, each reading and
//! writing every vector once. Does what [`PlainSystem`](crate::plain::PlainSystem) does for
//! problems whose gradient weight is 1 and whose coefficients are all free.
//!
//! The finest multigrid level never exists in memory: its right-hand side `f = F r` and its
//! smoothed values are local functions of the residual, so a tile recomputes them where needed.
//! With `g = f / diagonal` the first red-black sweep from zero is `u = g` on red nodes and
//! `u = g + sum w g_neighbours / diagonal` on black ones, and the residual it leaves is
//! `sum w u_neighbours` on red nodes and zero on black ones.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::axis::End;
use crate::cg::System;
use crate::multigrid::{Multigrid, Prolong, prolong, restrict};
use crate::operator::{REACH, Scratch, SplineOperator, uniform_value};
use crate::plain::{FILTER, line_dot, row_weight};
use crate::tile::{Beyond, Tile};

/// Halo of the pass before the coarse correction: filter 2, black 1, residual 1.
const HALO_DOWN: usize = 4;
/// Halo of the pass after it: filter 2, black 1, black 1, red 1, filter 2.
const HALO_UP: usize = 7;

/// The fused system. Vectors change roles instead of being copied.
pub struct FusedSystem<const D: usize> {
    operator: SplineOperator<D>,
    multigrid: Multigrid<D>,
    /// Per slab and tile: the screening, if it is the same on the tile and its halo.
    uniform: Vec<Vec<Option<f32>>>,
    pub x: Vec<f32>,
    r: Vec<f32>,
    /// The next residual while passing down, then the preconditioned residual `z`.
    r_or_z: Vec<f32>,
    p: Vec<f32>,
    /// The next direction; in between the nodal residual and the coarse correction.
    p_or_nodal: Vec<f32>,
    q: Vec<f32>,
    pending_alpha: f32,
}

/// Buffers of one thread.
#[derive(Default)]
struct Buffers {
    scratch: Scratch,
    a: Vec<f32>,
    b: Vec<f32>,
    c: Vec<f32>,
    f: Vec<f32>,
    inverse: Vec<f32>,
    inverse_black: Vec<f32>,
    red: Vec<f32>,
}

impl<const D: usize> FusedSystem<D> {
    /// `operator.gamma` must be empty; `multigrid` may lack the work vectors of its finest level.
    pub fn new(operator: SplineOperator<D>, multigrid: Multigrid<D>) -> Self {
        assert!(operator.gamma.is_empty(), "the fused system takes a gradient weight of 1");
        let frame = operator.frame;
        let slabs = frame.len().div_ceil(frame.slab_len());
        let classify = |slab: usize| {
            let class = |tile: Tile<D>| {
                let mut buffer = Vec::new();
                tile.load(&operator.screening, Beyond::Edge, &mut buffer);
                uniform_value(&buffer)
            };
            frame.tiles(slab, HALO_UP).into_iter().map(class).collect()
        };
        let uniform = (0..slabs).into_par_iter().map(classify).collect();
        let zeros = || vec![0.0f32; frame.len()];
        Self {
            multigrid,
            uniform,
            x: zeros(),
            r: zeros(),
            r_or_z: zeros(),
            p: zeros(),
            p_or_nodal: zeros(),
            q: zeros(),
            operator,
            pending_alpha: 0.0,
        }
    }

    /// Starts on another right-hand side, written by `fill` into a zeroed vector.
    pub fn restart(&mut self, fill: impl FnOnce(&mut [f32])) {
        for v in [&mut self.x, &mut self.r, &mut self.p, &mut self.q] {
            v.par_chunks_mut(1 << 16).for_each(|c| c.fill(0.0));
        }
        self.pending_alpha = 0.0;
        fill(&mut self.r);
    }

    /// `x += alpha p`, `r -= alpha q`, and the residual after smoothing from zero.
    fn pass_down(&mut self) {
        let (frame, alpha) = (self.operator.frame, self.pending_alpha);
        let len = frame.slab_len();
        let (r, p, q, operator, uniform) =
            (&self.r, &self.p, &self.q, &self.operator, &self.uniform);
        let outputs = self.x.par_chunks_mut(len).zip(self.r_or_z.par_chunks_mut(len));
        outputs.zip(self.p_or_nodal.par_chunks_mut(len)).enumerate().for_each_init(
            Buffers::default,
            |b, (slab, ((x, r_next), nodal))| {
                for (tile, class) in frame.tiles(slab, HALO_DOWN).into_iter().zip(&uniform[slab]) {
                    tile.load_sum(r, -alpha, q, &mut b.a);
                    tile.store(&b.a, r_next);
                    let first = slab * len;
                    for (_, at) in tile.core_rows() {
                        let p = &p[first + at..][..tile.core[0]];
                        x[at..at + tile.core[0]]
                            .iter_mut()
                            .zip(p)
                            .for_each(|(x, p)| *x += alpha * p);
                    }
                    smoother_weights(&tile, operator, *class, b);
                    dispatch(Down { tile: &tile, alpha: operator.alpha, b });
                    tile.store(&b.c, nodal);
                }
            },
        );
        std::mem::swap(&mut self.r, &mut self.r_or_z);
    }

    /// `z = F u` from the residual and the coarse correction; returns `r . z`.
    fn pass_up(&mut self) -> f64 {
        let frame = self.operator.frame;
        let len = frame.slab_len();
        let (r, correction, operator, uniform) =
            (&self.r, &self.p_or_nodal, &self.operator, &self.uniform);
        let partial: Vec<f64> = self
            .r_or_z
            .par_chunks_mut(len)
            .enumerate()
            .map_init(Buffers::default, |b, (slab, z)| {
                let mut dot = 0.0;
                for (tile, class) in frame.tiles(slab, HALO_UP).into_iter().zip(&uniform[slab]) {
                    tile.load(r, Beyond::Zero, &mut b.a);
                    tile.load(correction, Beyond::Zero, &mut b.scratch.input);
                    smoother_weights(&tile, operator, *class, b);
                    dispatch(Up { tile: &tile, alpha: operator.alpha, b });
                    tile.store(&b.c, z);
                    dot += core_dot(&tile, &b.a, &b.c);
                }
                dot
            })
            .collect();
        partial.iter().sum()
    }
}

impl<const D: usize> System for FusedSystem<D> {
    fn precondition(&mut self) -> f64 {
        self.pass_down();
        let (finest, coarse) = self.multigrid.levels.split_at_mut(1);
        restrict(&finest[0], &self.p_or_nodal, &mut coarse[0]);
        self.multigrid.cycle(1);
        let finest = &self.multigrid.levels[0];
        let transfer = finest.to_coarse.as_ref().expect("the fused system has a coarser level");
        prolong(
            transfer,
            &finest.axes,
            &self.multigrid.levels[1],
            &mut self.p_or_nodal,
            Prolong::Replace,
        );
        self.pass_up()
    }

    fn direction(&mut self, beta: f32) -> f64 {
        let frame = self.operator.frame;
        let len = frame.slab_len();
        let (z, p, operator, uniform) = (&self.r_or_z, &self.p, &self.operator, &self.uniform);
        let partial: Vec<f64> = self
            .p_or_nodal
            .par_chunks_mut(len)
            .zip(self.q.par_chunks_mut(len))
            .enumerate()
            .map_init(Buffers::default, |b, (slab, (p_next, q))| {
                let mut dot = 0.0;
                for (tile, class) in frame.tiles(slab, REACH).into_iter().zip(&uniform[slab]) {
                    tile.load_sum(z, beta, p, &mut b.a);
                    tile.store(&b.a, p_next);
                    operator.apply_classified(&tile, *class, &b.a, &mut b.scratch);
                    tile.store(&b.scratch.output, q);
                    dot += core_dot(&tile, &b.a, &b.scratch.output);
                }
                dot
            })
            .collect();
        std::mem::swap(&mut self.p, &mut self.p_or_nodal);
        partial.iter().sum()
    }

    fn advance(&mut self, alpha: f32) {
        // The update itself is part of the next pass down.
        self.pending_alpha = alpha;
    }
}

/// Inner product of two buffers over the core of a tile.
fn core_dot<const D: usize>(tile: &Tile<D>, a: &[f32], b: &[f32]) -> f64 {
    struct RowDot<'a, const D: usize>(&'a Tile<D>, &'a [f32], &'a [f32]);
    impl<const D: usize> Kernel for RowDot<'_, D> {
        type Output = f64;
        #[inline(always)]
        fn run(self) -> f64 {
            let Self(tile, a, b) = self;
            let n = tile.core[0];
            let mut sum = 0.0;
            for (row, (local, _)) in tile.core_rows().enumerate() {
                let (a, b) = (&a[local..local + n], &b[local..local + n]);
                sum += tile.row_weight(row) * line_dot(&tile.frame, tile.start[0], a, b);
            }
            sum
        }
    }
    dispatch(RowDot(tile, a, b))
}

impl<const D: usize> Tile<D> {
    fn row_weight(&self, mut row: usize) -> f64 {
        let (mut global, mut stride) = (0, 1);
        for d in 1..D {
            global += (self.start[d] + row % self.core[d]) * stride;
            row /= self.core[d];
            stride *= self.frame.shape[d];
        }
        row_weight(&self.frame, global)
    }

    /// Zeroes what lies beyond `Zero` sides.
    fn clear_beyond(&self, values: &mut [f32]) {
        let strides = self.strides();
        for d in 0..D {
            let n = self.frame.shape[d];
            for k in 0..self.extent(d) {
                let i = (self.start[d] + k) as isize - self.halo as isize;
                let beyond = i < 0 && self.frame.ends[d][0] == End::Zero
                    || i >= n as isize && self.frame.ends[d][1] == End::Zero;
                if beyond {
                    let run = strides[d];
                    let period = run * self.extent(d);
                    for block in values.chunks_exact_mut(period) {
                        block[k * run..(k + 1) * run].fill(0.0);
                    }
                }
            }
        }
    }
}

/// Fills the inverse diagonal (zero where values are fixed), its black half, and the red mask.
fn smoother_weights<const D: usize>(
    tile: &Tile<D>,
    operator: &SplineOperator<D>,
    class: Option<f32>,
    b: &mut Buffers,
) {
    let diagonal: f32 = operator.alpha.iter().map(|a| 2.0 * a).sum();
    let n = tile.len();
    match class {
        Some(s) => {
            b.inverse.clear();
            b.inverse.resize(n, 1.0 / (diagonal + s));
        }
        None => {
            tile.load(&operator.screening, Beyond::Edge, &mut b.inverse);
            b.inverse.iter_mut().for_each(|v| *v = 1.0 / (diagonal + *v));
        }
    }
    tile.clear_beyond(&mut b.inverse);
    b.red.resize(n, 0.0);
    b.inverse_black.resize(n, 0.0);
    let e0 = tile.extent(0);
    let shift: usize = tile.start.iter().sum::<usize>() + D * tile.halo;
    for row in 0..n / e0 {
        let (mut rest, mut sum) = (row, shift);
        for d in 1..D {
            sum += rest % tile.extent(d);
            rest /= tile.extent(d);
        }
        let at = row * e0;
        let (red, black) = (&mut b.red[at..at + e0], &mut b.inverse_black[at..at + e0]);
        let inverse = &b.inverse[at..at + e0];
        for i in 0..e0 {
            let is_red = (sum + i) % 2 == 0;
            red[i] = if is_red { 1.0 } else { 0.0 };
            black[i] = if is_red { 0.0 } else { inverse[i] };
        }
    }
}

/// Loop bounds of a nearest-neighbour stencil on a flat tile.
#[inline(always)]
fn interior<const D: usize>(tile: &Tile<D>) -> (usize, usize) {
    let reach = tile.strides()[D - 1];
    (reach, tile.len() - 2 * reach)
}

/// `sum_d w_d (src[-1] + src[+1])` handed to `put(index, sum)` for the tile's interior.
#[inline(always)]
fn neighbour_sums<const D: usize>(
    tile: &Tile<D>,
    alpha: [f32; D],
    src: &[f32],
    mut put: impl FnMut(usize, f32),
) {
    let ((lo, n), strides) = (interior(tile), tile.strides());
    let before: [&[f32]; D] = std::array::from_fn(|d| &src[lo - strides[d]..][..n]);
    let after: [&[f32]; D] = std::array::from_fn(|d| &src[lo + strides[d]..][..n]);
    for i in 0..n {
        let mut sum = 0.0;
        for d in 0..D {
            sum += alpha[d] * (before[d][i] + after[d][i]);
        }
        put(i, sum);
    }
}

/// `dst = F src` along one axis of a flat tile.
#[inline(always)]
fn filter_axis(dst: &mut [f32], src: &[f32], stride: usize) {
    let n = src.len() - 4 * stride;
    let [a, b, c, d, e]: [&[f32]; 5] = std::array::from_fn(|k| &src[k * stride..][..n]);
    let dst = &mut dst[2 * stride..][..n];
    for i in 0..n {
        dst[i] = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
    }
}

/// `dst = F src` along every axis; `spare` is overwritten.
#[inline(always)]
fn filter<const D: usize>(tile: &Tile<D>, src: &[f32], dst: &mut Vec<f32>, spare: &mut Vec<f32>) {
    let strides = tile.strides();
    dst.resize(src.len(), 0.0);
    spare.resize(src.len(), 0.0);
    for d in 0..D {
        // The last axis writes `dst`; the buffers take turns before.
        let into_dst = (D - 1 - d) % 2 == 0;
        match (d, into_dst) {
            (0, true) => filter_axis(dst, src, strides[0]),
            (0, false) => filter_axis(spare, src, strides[0]),
            (_, true) => filter_axis(dst, spare, strides[d]),
            (_, false) => filter_axis(spare, dst, strides[d]),
        }
    }
}

/// From the residual in `a`: `f`, `g` (in `b`), the first sweep `u` (in `c`).
#[inline(always)]
fn smooth_from_zero<const D: usize>(tile: &Tile<D>, alpha: [f32; D], b: &mut Buffers) {
    filter(tile, &b.a, &mut b.f, &mut b.b);
    for ((g, f), inverse) in b.b.iter_mut().zip(&b.f).zip(&b.inverse) {
        *g = f * inverse;
    }
    b.c.resize(b.a.len(), 0.0);
    let (lo, n) = interior(tile);
    let (u, g, black) = (&mut b.c[lo..lo + n], &b.b[lo..lo + n], &b.inverse_black[lo..lo + n]);
    neighbour_sums(tile, alpha, &b.b, |i, sum| u[i] = g[i] + black[i] * sum);
}

struct Down<'a, const D: usize> {
    tile: &'a Tile<D>,
    alpha: [f32; D],
    b: &'a mut Buffers,
}

impl<const D: usize> Kernel for Down<'_, D> {
    type Output = ();
    /// Leaves the nodal residual in `c`.
    #[inline(always)]
    fn run(self) {
        let Self { tile, alpha, b } = self;
        smooth_from_zero(tile, alpha, b);
        let (lo, n) = interior(tile);
        let (out, red) = (&mut b.b[lo..lo + n], &b.red[lo..lo + n]);
        neighbour_sums(tile, alpha, &b.c, |i, sum| out[i] = red[i] * sum);
        std::mem::swap(&mut b.b, &mut b.c);
    }
}

struct Up<'a, const D: usize> {
    tile: &'a Tile<D>,
    alpha: [f32; D],
    b: &'a mut Buffers,
}

impl<const D: usize> Kernel for Up<'_, D> {
    type Output = ();
    /// Leaves `z` in `c`; the coarse correction comes in `scratch.input`.
    #[inline(always)]
    fn run(self) {
        let Self { tile, alpha, b } = self;
        smooth_from_zero(tile, alpha, b);
        for (u, e) in b.c.iter_mut().zip(&b.scratch.input) {
            *u += e;
        }
        let (lo, n) = interior(tile);
        {
            let (out, u, f) = (&mut b.b[lo..lo + n], &b.c[lo..lo + n], &b.f[lo..lo + n]);
            let (red, black) = (&b.red[lo..lo + n], &b.inverse_black[lo..lo + n]);
            neighbour_sums(tile, alpha, &b.c, |i, sum| {
                out[i] = red[i] * u[i] + black[i] * (f[i] + sum)
            });
        }
        {
            let (out, u, f) = (&mut b.c[lo..lo + n], &b.b[lo..lo + n], &b.f[lo..lo + n]);
            let (red, inverse) = (&b.red[lo..lo + n], &b.inverse[lo..lo + n]);
            neighbour_sums(tile, alpha, &b.b, |i, sum| {
                out[i] = u[i] + red[i] * (inverse[i] * (f[i] + sum) - u[i]);
            });
        }
        filter(tile, &b.c, &mut b.f, &mut b.b);
        std::mem::swap(&mut b.f, &mut b.c);
    }
}
