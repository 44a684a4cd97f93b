//! The spline system in three passes per iteration over cache-sized tiles, each reading and
//! writing every vector once. Does what [`PlainSystem`](crate::plain::PlainSystem) does for
//! problems of two and more dimensions whose gradient weight is 1 and whose coefficients are all
//! free.
//!
//! The finest multigrid level never exists in memory: its right-hand side `f = F r` and its
//! smoothed values are local functions of the residual, so a tile recomputes them where needed.
//! With `g = f / diagonal` the first red-black sweep from zero is `u = g` on red nodes and
//! `u = g + sum w g_neighbours / diagonal` on black ones, and the residual it leaves is
//! `sum w u_neighbours` on red nodes and zero on black ones.
//!
//! Inside a tile the stages run as a pipeline over the planes of the outermost axis (rows, in two
//! dimensions): a stage that looks `k` planes ahead follows `k` planes behind, while its input is
//! still in the first-level cache.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::axis::End;
use crate::cg::System;
use crate::multigrid::{Multigrid, Prolong, prolong, restrict};
use crate::operator::{
    REACH, Scratch, SplineOperator, cell_points, factor_taps, gather4, pair, scatter4, symmetric7,
    symmetric7_both, symmetric7_pair, uniform_value,
};
use crate::plain::{FILTER, line_dot, row_weight};
use crate::tile::{Beyond, Tile};

/// Reach of the filter.
const F: usize = 2;
/// Halo of the pass before the coarse correction: filter, black, residual.
const HALO_DOWN: usize = F + 1 + 1;
/// Halo of the pass after it: filter, black, black, red, filter.
const HALO_UP: usize = F + 1 + 1 + 1 + F;

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

impl<const D: usize> FusedSystem<D> {
    /// `operator.gamma` must be empty; `multigrid` may lack the work vectors of its finest level.
    pub fn new(operator: SplineOperator<D>, multigrid: Multigrid<D>) -> Self {
        assert!(
            D >= 2 && operator.gamma.is_empty(),
            "a gradient weight of 1 in two or more dimensions"
        );
        let frame = operator.frame;
        let slabs = frame.len().div_ceil(frame.slab_len());
        let classify = |buffer: &mut Vec<f32>, slab: usize| {
            let class = |tile: Tile<D>| {
                tile.load(&operator.screening, Beyond::Edge, buffer);
                uniform_value(buffer)
            };
            frame.tiles(slab, HALO_UP).into_iter().map(class).collect()
        };
        let uniform = (0..slabs).into_par_iter().map_init(Vec::new, classify).collect();
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

    /// `x += alpha p`, `r -= alpha q`, and the nodal residual after smoothing from zero.
    fn pass_down(&mut self) {
        let (frame, alpha) = (self.operator.frame, self.pending_alpha);
        let len = frame.slab_len();
        let (r, p, q, operator, uniform) =
            (&self.r, &self.p, &self.q, &self.operator, &self.uniform);
        let outputs = self.x.par_chunks_mut(len).zip(self.r_or_z.par_chunks_mut(len));
        outputs.zip(self.p_or_nodal.par_chunks_mut(len)).enumerate().for_each_init(
            Rings::default,
            |rings, (slab, ((x, r_next), nodal))| {
                for (tile, class) in frame.tiles(slab, HALO_DOWN).into_iter().zip(&uniform[slab]) {
                    let smoother = Smoother::new(tile, operator, *class, rings);
                    let p = &p[slab * len..];
                    dispatch(Down {
                        smoother,
                        r,
                        q,
                        p,
                        alpha,
                        x: &mut *x,
                        r_next: &mut *r_next,
                        nodal: &mut *nodal,
                    });
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
        let up = |rings: &mut Rings, (slab, z): (usize, &mut [f32])| {
            let tiles = frame.tiles(slab, HALO_UP).into_iter().zip(&uniform[slab]);
            let dot = |(tile, class): (Tile<D>, &Option<f32>)| {
                let smoother = Smoother::new(tile, operator, *class, rings);
                dispatch(Up { smoother, r: &r[slab * len..], whole_r: r, correction, z: &mut *z })
            };
            tiles.map(dot).sum::<f64>()
        };
        let slabs = self.r_or_z.par_chunks_mut(len).enumerate();
        let partial: Vec<f64> = slabs.map_init(Rings::default, up).collect();
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
        let along = |work: &mut Work, (slab, (p_next, q)): (usize, (&mut [f32], &mut [f32]))| {
            let tiles = frame.tiles(slab, REACH).into_iter().zip(&uniform[slab]);
            let dot = |(tile, class): (Tile<D>, &Option<f32>)| {
                let (p_next, q) = (&mut *p_next, &mut *q);
                if D == 2 || class.is_some() {
                    let rings = &mut work.rings;
                    return dispatch(Along {
                        tile,
                        operator,
                        class: *class,
                        z,
                        p,
                        beta,
                        p_next,
                        q,
                        rings,
                    });
                }
                let mut buffer = std::mem::take(&mut work.scratch.input);
                dispatch(Combine { tile: &tile, z, p, beta, buffer: &mut buffer, p_next });
                operator.apply_classified(&tile, None, &buffer, &mut work.scratch);
                let dot =
                    dispatch(StoreDot { tile: &tile, p: &buffer, q: &work.scratch.output, out: q });
                work.scratch.input = buffer;
                dot
            };
            tiles.map(dot).sum::<f64>()
        };
        let outputs = self.p_or_nodal.par_chunks_mut(len).zip(self.q.par_chunks_mut(len));
        let partial: Vec<f64> = outputs.enumerate().map_init(Work::default, along).collect();
        std::mem::swap(&mut self.p, &mut self.p_or_nodal);
        partial.iter().sum()
    }

    fn advance(&mut self, alpha: f32) {
        // The update itself is part of the next pass down.
        self.pending_alpha = alpha;
    }
}

/// The last few planes of a stage. A power of two of them, so that a plane finds its place by masking.
#[derive(Default)]
struct Ring {
    data: Vec<f32>,
    plane: usize,
    mask: usize,
}

impl Ring {
    fn reset(&mut self, planes: usize, plane: usize) {
        self.data.resize(planes * plane, 0.0);
        (self.plane, self.mask) = (plane, planes - 1);
    }

    #[inline(always)]
    fn at(&self, k: usize) -> &[f32] {
        &self.data[(k & self.mask) * self.plane..][..self.plane]
    }

    #[inline(always)]
    fn at_mut(&mut self, k: usize) -> &mut [f32] {
        &mut self.data[(k & self.mask) * self.plane..][..self.plane]
    }
}

/// Buffers of one thread, sized so that all live planes of a two-dimensional tile fit the
/// first-level cache.
#[derive(Default)]
struct Rings {
    /// What is loaded: the residual, later the correction.
    load: Ring,
    spare: Ring,
    /// The filter along all axes but the last, of the residual and of the smoothed values.
    filtered: Ring,
    filtered_again: Ring,
    f: Ring,
    g: Ring,
    u: [Ring; 3],
    inverse: Ring,
    /// 1 at even columns and 0 at odd ones, then the other way round.
    checker: [Vec<f32>; 2],
    zeros: Vec<f32>,
}

/// The geometry of a tile's pipeline and the smoother's weights on it.
struct Smoother<'a, const D: usize> {
    tile: Tile<D>,
    strides: [usize; D],
    alpha: [f32; D],
    diagonal: f32,
    class: Option<f32>,
    screening: &'a [f32],
    rings: &'a mut Rings,
}

impl<'a, const D: usize> Smoother<'a, D> {
    fn new(
        tile: Tile<D>,
        operator: &'a SplineOperator<D>,
        class: Option<f32>,
        rings: &'a mut Rings,
    ) -> Self {
        let (e0, strides) = (tile.extent(0), tile.strides());
        let plane = strides[D - 1];
        let Rings { load, spare, filtered, filtered_again, f, g, u: [u0, u1, u2], .. } =
            &mut *rings;
        for ring in [load, spare, u2] {
            ring.reset(1, plane);
        }
        for ring in [u0, u1, g] {
            ring.reset(4, plane);
        }
        for ring in [filtered, filtered_again, f] {
            ring.reset(8, plane);
        }
        for (k, row) in rings.checker.iter_mut().enumerate() {
            if row.len() != e0 {
                *row = (0..e0).map(|i| if (i + k) % 2 == 0 { 1.0 } else { 0.0 }).collect();
            }
        }
        rings.zeros.resize(e0, 0.0);
        let diagonal: f32 = operator.alpha.iter().map(|a| 2.0 * a).sum();
        // One row serves a uniform tile; a mixed one is filled plane by plane.
        match class {
            None => rings.inverse.reset(8, plane),
            Some(s) => {
                rings.inverse.reset(1, e0);
                rings.inverse.data.fill(1.0 / (diagonal + s));
                clear_columns_beyond(&tile, &mut rings.inverse.data);
            }
        }
        Self {
            tile,
            strides,
            alpha: operator.alpha,
            diagonal,
            class,
            screening: &operator.screening,
            rings,
        }
    }

    /// Rows of one plane, leaving `reach` at the borders inside it.
    #[inline(always)]
    fn rows(&self, reach: usize) -> std::ops::Range<usize> {
        let e0 = self.tile.extent(0);
        let skip = if D > 2 { reach * (self.strides[D - 2] / e0) } else { 0 };
        skip..self.strides[D - 1] / e0 - skip
    }

    /// Loads a plane of `r - alpha q`, and the inverse diagonal of a mixed tile.
    #[inline(always)]
    fn load_plane(&mut self, plane: usize, r: &[f32], alpha: f32, q: &[f32]) {
        let e0 = self.tile.extent(0);
        let rows = self.rows(0);
        let first = plane * rows.len();
        for row in rows {
            let line = row * e0..(row + 1) * e0;
            let load = &mut self.rings.load.at_mut(plane)[line.clone()];
            if alpha == 0.0 {
                self.tile.load_row(first + row, r, Beyond::Zero, load);
            } else {
                self.tile.load_row_sum(first + row, r, -alpha, q, load);
            }
            if self.class.is_none() {
                let inverse = &mut self.rings.inverse.at_mut(plane)[line];
                self.tile.load_row(first + row, self.screening, Beyond::Edge, inverse);
                for v in inverse.iter_mut() {
                    *v = 1.0 / (self.diagonal + *v);
                }
                clear_columns_beyond(&self.tile, inverse);
            }
        }
    }

    /// The filter along all axes but the last, on one plane: of what is loaded, or of `u[2]`.
    #[inline(always)]
    fn filter_in_plane(&mut self, plane: usize, of_u: bool) {
        let Rings { load, filtered, filtered_again, spare, u: [.., u], .. } = &mut *self.rings;
        let (src, dst) = if of_u { (u, filtered_again) } else { (load, filtered) };
        let (src, dst, spare) = (src.at(plane), dst.at_mut(plane), spare.at_mut(plane));
        for d in 0..D - 1 {
            // Buffers take turns so that the last of these axes writes `dst`.
            match (d == 0, (D - 2 - d).is_multiple_of(2)) {
                (true, true) => filter_axis(dst, src, self.strides[d]),
                (true, false) => filter_axis(spare, src, self.strides[d]),
                (false, true) => filter_axis(dst, spare, self.strides[d]),
                (false, false) => filter_axis(spare, dst, self.strides[d]),
            }
        }
    }

    /// `f` and `g` on one plane, from the filtered residual around it.
    #[inline(always)]
    fn right_hand_side(&mut self, plane: usize) {
        let e0 = self.tile.extent(0);
        for row in self.rows(0) {
            let line = row * e0..(row + 1) * e0;
            let Rings { filtered, f, g, inverse, zeros, .. } = &mut *self.rings;
            let inverse = inverse_row(&self.tile, self.class, inverse, zeros, plane, row);
            let [a, b, c, d, e]: [&[f32]; 5] =
                std::array::from_fn(|k| &filtered.at(plane + k - F)[line.clone()]);
            let (f, g) = (&mut f.at_mut(plane)[line.clone()], &mut g.at_mut(plane)[line]);
            for i in 0..e0 {
                let v = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
                f[i] = v;
                g[i] = v * inverse[i];
            }
        }
    }

    /// The first black half sweep on one plane: from `g` into `u[0]`.
    #[inline(always)]
    fn first_black(&mut self, plane: usize) {
        let (e0, n) = (self.tile.extent(0), self.tile.extent(0) - 2);
        for row in self.rows(1) {
            let at = row * e0 + 1;
            let Rings { g, u: [u, ..], inverse, zeros, checker, .. } = &mut *self.rings;
            let inverse = &inverse_row(&self.tile, self.class, inverse, zeros, plane, row)[1..=n];
            let black = &checker[1 - red_phase(&self.tile, plane, row)][1..=n];
            let (centre, out) = (&g.at(plane)[at..at + n], &mut u.at_mut(plane)[at..at + n]);
            let links = Links::new(g, plane, at, n, self.strides);
            for i in 0..n {
                out[i] = centre[i] + black[i] * inverse[i] * links.sum(i, self.alpha);
            }
        }
    }
}

/// Inverse diagonal of a row: zero where values are fixed.
#[inline(always)]
fn inverse_row<'a, const D: usize>(
    tile: &Tile<D>,
    class: Option<f32>,
    inverse: &'a Ring,
    zeros: &'a [f32],
    plane: usize,
    row: usize,
) -> &'a [f32] {
    let e0 = tile.extent(0);
    let rows: usize = (1..D - 1).map(|d| tile.extent(d)).product();
    if tile.row_is_beyond(plane * rows + row) {
        &zeros[..e0]
    } else if class.is_some() {
        &inverse.data[..e0]
    } else {
        &inverse.at(plane)[row * e0..(row + 1) * e0]
    }
}

/// Which checker row is 1 on the red nodes of a row: those whose index sum is even.
#[inline(always)]
fn red_phase<const D: usize>(tile: &Tile<D>, plane: usize, row: usize) -> usize {
    let (mut sum, mut rest) = (tile.start.iter().sum::<usize>() + D * tile.halo + plane, row);
    for d in 1..D - 1 {
        sum += rest % tile.extent(d);
        rest /= tile.extent(d);
    }
    sum % 2
}

/// Zeroes the columns of a row beyond `Zero` sides.
#[inline(always)]
fn clear_columns_beyond<const D: usize>(tile: &Tile<D>, row: &mut [f32]) {
    let (halo, n) = (tile.halo as isize, tile.frame.shape[0] as isize);
    let first = tile.start[0] as isize - halo;
    if tile.frame.ends[0][0] == End::Zero && first < 0 {
        row[..(-first) as usize].fill(0.0);
    }
    if tile.frame.ends[0][1] == End::Zero && first + row.len() as isize > n {
        row[(n - first) as usize..].fill(0.0);
    }
}

/// The neighbours of `n` entries of a plane, along every axis.
struct Links<'a, const D: usize> {
    before: [&'a [f32]; D],
    after: [&'a [f32]; D],
}

impl<'a, const D: usize> Links<'a, D> {
    #[inline(always)]
    fn new(src: &'a Ring, plane: usize, at: usize, n: usize, strides: [usize; D]) -> Self {
        let (here, below, above) =
            (src.at(plane), src.at(plane.wrapping_sub(1)), src.at(plane + 1));
        let before =
            |d: usize| if d + 1 == D { &below[at..at + n] } else { &here[at - strides[d]..][..n] };
        let after =
            |d: usize| if d + 1 == D { &above[at..at + n] } else { &here[at + strides[d]..][..n] };
        Self { before: std::array::from_fn(before), after: std::array::from_fn(after) }
    }

    #[inline(always)]
    fn sum(&self, i: usize, alpha: [f32; D]) -> f32 {
        let mut sum = 0.0;
        for d in 0..D {
            sum += alpha[d] * (self.before[d][i] + self.after[d][i]);
        }
        sum
    }
}

/// `dst = F src` along one axis of a plane, less the ends of the buffer.
#[inline(always)]
fn filter_axis(dst: &mut [f32], src: &[f32], stride: usize) {
    let n = src.len() - 2 * F * stride;
    let [a, b, c, d, e]: [&[f32]; 5] = std::array::from_fn(|k| &src[k * stride..][..n]);
    let dst = &mut dst[F * stride..][..n];
    for i in 0..n {
        dst[i] = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
    }
}

/// The rows of a tile's core that lie in one plane: row in the plane and place in the slab.
#[inline(always)]
fn core_rows_of<const D: usize>(
    tile: &Tile<D>,
    plane: usize,
) -> impl Iterator<Item = (usize, usize)> + use<D> {
    let per_plane: usize = tile.core[1..D - 1].iter().product();
    let e0 = tile.extent(0);
    let rows: usize = (1..D - 1).map(|d| tile.extent(d)).product();
    let first = (plane - tile.halo) * per_plane;
    tile.core_rows().skip(first).take(per_plane).map(move |(local, at)| (local / e0 % rows, at))
}

struct Down<'a, const D: usize> {
    smoother: Smoother<'a, D>,
    r: &'a [f32],
    q: &'a [f32],
    /// From the slab on.
    p: &'a [f32],
    alpha: f32,
    x: &'a mut [f32],
    r_next: &'a mut [f32],
    nodal: &'a mut [f32],
}

impl<const D: usize> Down<'_, D> {
    /// Keeps the updated residual and solution of a plane.
    #[inline(always)]
    fn store_updates(&mut self, plane: usize) {
        let tile = self.smoother.tile;
        let (e0, n0, halo) = (tile.extent(0), tile.core[0], tile.halo);
        for (row, at) in core_rows_of(&tile, plane) {
            let residual = &self.smoother.rings.load.at(plane)[row * e0 + halo..][..n0];
            self.r_next[at..at + n0].copy_from_slice(residual);
            let (x, p) = (&mut self.x[at..at + n0], &self.p[at..at + n0]);
            for i in 0..n0 {
                x[i] += self.alpha * p[i];
            }
        }
    }

    /// Stores the nodal residual of a plane.
    #[inline(always)]
    fn store_nodal(&mut self, plane: usize) {
        let s = &self.smoother;
        let (tile, n) = (s.tile, s.tile.core[0]);
        for (row, at) in core_rows_of(&tile, plane) {
            let red = &s.rings.checker[red_phase(&tile, plane, row)][tile.halo..][..n];
            let out = &mut self.nodal[at..at + n];
            let links =
                Links::new(&s.rings.u[0], plane, row * tile.extent(0) + tile.halo, n, s.strides);
            for i in 0..n {
                out[i] = red[i] * links.sum(i, s.alpha);
            }
        }
    }
}

impl<const D: usize> Kernel for Down<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(mut self) {
        let planes = self.smoother.tile.extent(D - 1);
        let (r, q, alpha) = (self.r, self.q, self.alpha);
        for step in 0..planes {
            self.smoother.load_plane(step, r, alpha, q);
            self.smoother.filter_in_plane(step, false);
            if (HALO_DOWN..planes - HALO_DOWN).contains(&step) {
                self.store_updates(step);
            }
            if step >= 2 * F {
                self.smoother.right_hand_side(step - F);
            }
            if step >= 2 * (F + 1) {
                self.smoother.first_black(step - F - 1);
            }
            if step >= 2 * HALO_DOWN {
                self.store_nodal(step - HALO_DOWN);
            }
        }
    }
}

struct Up<'a, const D: usize> {
    smoother: Smoother<'a, D>,
    whole_r: &'a [f32],
    /// From the slab on.
    r: &'a [f32],
    correction: &'a [f32],
    z: &'a mut [f32],
}

impl<const D: usize> Up<'_, D> {
    /// Adds the coarse correction to a plane of `u[0]`.
    #[inline(always)]
    fn correct(&mut self, plane: usize) {
        let s = &mut self.smoother;
        let e0 = s.tile.extent(0);
        let first = plane * s.rows(0).len();
        for row in s.rows(1) {
            let Rings { u: [u, ..], spare, .. } = &mut *s.rings;
            let load = &mut spare.at_mut(0)[..e0];
            s.tile.load_row(first + row, self.correction, Beyond::Zero, load);
            let u = &mut u.at_mut(plane)[row * e0..(row + 1) * e0];
            for i in 0..e0 {
                u[i] += load[i];
            }
        }
    }

    /// A half sweep on one plane, from `u[stage]` into `u[stage + 1]`: black, then red.
    #[inline(always)]
    fn half_sweep(&mut self, plane: usize, stage: usize) {
        let s = &mut self.smoother;
        let (e0, n) = (s.tile.extent(0), s.tile.extent(0) - 2);
        for row in s.rows(stage + 2) {
            let at = row * e0 + 1;
            let Rings { u, f, inverse, zeros, checker, .. } = &mut *s.rings;
            let inverse = &inverse_row(&s.tile, s.class, inverse, zeros, plane, row)[1..=n];
            // 1 on the nodes of the colour that is updated.
            let active = &checker[red_phase(&s.tile, plane, row) ^ (1 - stage)][1..=n];
            let (head, tail) = u.split_at_mut(stage + 1);
            let (u, f) = (&head[stage].at(plane)[at..at + n], &f.at(plane)[at..at + n]);
            let out = &mut tail[0].at_mut(plane)[at..at + n];
            let links = Links::new(&head[stage], plane, at, n, s.strides);
            for i in 0..n {
                let new = inverse[i] * (f[i] + links.sum(i, s.alpha));
                out[i] = (1.0 - active[i]) * u[i] + active[i] * new;
            }
        }
    }

    /// `z` and `r . z` on one plane, from the filtered `u[2]` around it.
    #[inline(always)]
    fn finish(&mut self, plane: usize) -> f64 {
        let (s, mut dot) = (&self.smoother, 0.0);
        let (tile, n) = (s.tile, s.tile.core[0]);
        for (row, at) in core_rows_of(&tile, plane) {
            let local = row * tile.extent(0) + tile.halo;
            let [a, b, c, d, e]: [&[f32]; 5] = std::array::from_fn(|k| {
                &s.rings.filtered_again.at(plane + k - F)[local..local + n]
            });
            let z = &mut self.z[at..at + n];
            for i in 0..n {
                z[i] = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
            }
            dot += tile.weigh_row(plane * s.strides[D - 1] + local, &self.r[at..at + n], z);
        }
        dot
    }
}

impl<const D: usize> Kernel for Up<'_, D> {
    type Output = f64;
    #[inline(always)]
    fn run(mut self) -> f64 {
        let (planes, r, mut dot) = (self.smoother.tile.extent(D - 1), self.whole_r, 0.0);
        for step in 0..planes {
            self.smoother.load_plane(step, r, 0.0, &[]);
            self.smoother.filter_in_plane(step, false);
            if step >= 2 * F {
                self.smoother.right_hand_side(step - F);
            }
            if step >= 2 * (F + 1) {
                self.smoother.first_black(step - F - 1);
                self.correct(step - F - 1);
            }
            if step >= 2 * (F + 2) {
                self.half_sweep(step - F - 2, 0);
            }
            if step >= 2 * (F + 3) {
                self.half_sweep(step - F - 3, 1);
                self.smoother.filter_in_plane(step - F - 3, true);
            }
            if step >= 2 * HALO_UP {
                dot += self.finish(step - HALO_UP);
            }
        }
        dot
    }
}

/// Buffers of one thread for the operator: rings where the screening is uniform, whole tiles elsewhere.
#[derive(Default)]
struct Work {
    scratch: Scratch,
    rings: OperatorRings,
}

/// The last planes of the operator's two products; see [`SplineOperator`].
#[derive(Default)]
struct OperatorRings {
    load: Ring,
    mass: [Ring; 2],
    stiff: [Ring; 2],
    /// Two dimensions, mixed screening: the weights of a row of cells, and what the points below
    /// and above its samples give back.
    weight: Ring,
    points: [Ring; 2],
    line: [Vec<f32>; 2],
}

/// `p_next = z + beta p`, `q = A p_next`, and `p_next . q`, on a tile; one of mixed screening only
/// in two dimensions.
struct Along<'a, const D: usize> {
    tile: Tile<D>,
    operator: &'a SplineOperator<D>,
    class: Option<f32>,
    z: &'a [f32],
    p: &'a [f32],
    beta: f32,
    p_next: &'a mut [f32],
    q: &'a mut [f32],
    rings: &'a mut OperatorRings,
}

impl<const D: usize> Along<'_, D> {
    /// Loads a plane and applies all axes but the last: `m' = M m`, `k' = M k + alpha K m`.
    #[inline(always)]
    fn load_plane(&mut self, plane: usize) {
        let (e0, n0, halo) = (self.tile.extent(0), self.tile.core[0], self.tile.halo);
        let strides = self.tile.strides();
        let rows = strides[D - 1] / e0;
        let OperatorRings { load, mass: [mass, mass_spare], stiff: [stiff, stiff_spare], .. } =
            &mut *self.rings;
        for row in 0..rows {
            let line = &mut load.at_mut(plane)[row * e0..(row + 1) * e0];
            self.tile.load_row_sum(plane * rows + row, self.z, self.beta, self.p, line);
        }
        if (halo..self.tile.extent(D - 1) - halo).contains(&plane) {
            for (row, at) in core_rows_of(&self.tile, plane) {
                let line = &load.at(plane)[row * e0 + halo..][..n0];
                self.p_next[at..at + n0].copy_from_slice(line);
            }
        }
        let (m_taps, k_taps) = factor_taps();
        let (mut m, mut k) = (mass.at_mut(plane), stiff.at_mut(plane));
        let (mut m_other, mut k_other) = (mass_spare.at_mut(plane), stiff_spare.at_mut(plane));
        if D % 2 == 1 {
            // The last of these axes must write the rings that are kept.
            std::mem::swap(&mut m, &mut m_other);
            std::mem::swap(&mut k, &mut k_other);
        }
        for d in 0..D - 1 {
            let (lo, hi) = (REACH * strides[d], m.len() - REACH * strides[d]);
            let k_taps = k_taps.map(|v| v * self.operator.alpha[d]);
            if d == 0 {
                let src = load.at(plane);
                symmetric7_both(
                    &mut m[lo..hi],
                    &mut k[lo..hi],
                    src,
                    lo,
                    strides[d],
                    m_taps,
                    k_taps,
                );
            } else {
                symmetric7(&mut m[lo..hi], m_other, lo, strides[d], m_taps);
                symmetric7_pair(&mut k[lo..hi], m_other, k_taps, k_other, m_taps, lo, strides[d]);
            }
            std::mem::swap(&mut m, &mut m_other);
            std::mem::swap(&mut k, &mut k_other);
        }
    }

    /// The weights of one row of cells, each shared by the cell's four points.
    #[inline(always)]
    fn load_weights(&mut self, row: usize) {
        let line = self.rings.weight.at_mut(row);
        self.tile.load_row(row, &self.operator.screening, Beyond::Edge, line);
        line.iter_mut().for_each(|w| *w *= 0.25);
    }

    /// `sum over the cell's points at this height of B^T s B c`, still at that height: what a row
    /// of cells gives to the coefficient rows around it. `half` 0 is below the samples, 1 above.
    #[inline(always)]
    fn cell_row(&mut self, row: usize, half: usize) {
        let points = cell_points();
        let OperatorRings { load, weight, points: rings, line: [values, across], .. } =
            &mut *self.rings;
        let taps = &points[half];
        let rows: [&[f32]; 4] =
            std::array::from_fn(|k| load.at((row + k).wrapping_add_signed(taps.first)));
        let n = values.len();
        let ([a, b, c, d], t) = (rows.map(|row| &row[..n]), taps.value);
        let line = &mut values[..n];
        for i in 0..n {
            line[i] = t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
        }
        let (weight, out) = (&weight.at(row)[..n], rings[half].at_mut(row));
        for (column, point) in points.iter().enumerate() {
            gather4(across, values, point.first, 1, point.value);
            for (v, w) in across.iter_mut().zip(weight) {
                *v *= w;
            }
            scatter4(out, across, point.first, 1, point.value, column == 1);
        }
    }

    /// The last axis on one plane, and its share of the inner product.
    #[inline(always)]
    fn finish(&mut self, plane: usize) -> f64 {
        let (tile, n0) = (self.tile, self.tile.core[0]);
        let (mass, stiff) = factor_taps();
        let alpha = self.operator.alpha[D - 1];
        let taps: [f32; 4] =
            std::array::from_fn(|j| alpha * stiff[j] + self.class.unwrap_or(0.0) * mass[j]);
        let mut dot = 0.0;
        for (row, at) in core_rows_of(&tile, plane) {
            let local = row * tile.extent(0) + tile.halo;
            let m: [&[f32]; 7] = std::array::from_fn(|k| {
                &self.rings.mass[0].at(plane + k - REACH)[local..local + n0]
            });
            let k: [&[f32]; 7] = std::array::from_fn(|k| {
                &self.rings.stiff[0].at(plane + k - REACH)[local..local + n0]
            });
            let q = &mut self.q[at..at + n0];
            pair(q, m, taps, k, mass);
            if self.class.is_none() {
                self.rings.add_points(plane, local, q);
            }
            dot +=
                tile.weigh_row(plane * tile.strides()[D - 1] + local, &self.p_next[at..at + n0], q);
        }
        dot
    }
}

impl OperatorRings {
    /// Adds what the cell rows around a coefficient row give to it.
    #[inline(always)]
    fn add_points(&self, row: usize, local: usize, q: &mut [f32]) {
        let n = q.len();
        for (point, ring) in cell_points().iter().zip(&self.points) {
            let [a, b, c, d]: [&[f32]; 4] = std::array::from_fn(|k| {
                &ring.at((row - k).wrapping_add_signed(-point.first))[local..local + n]
            });
            let t = point.value;
            for i in 0..n {
                q[i] += t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
            }
        }
    }
}

impl<const D: usize> Kernel for Along<'_, D> {
    type Output = f64;
    #[inline(always)]
    fn run(mut self) -> f64 {
        let plane = self.tile.strides()[D - 1];
        let OperatorRings { load, mass, stiff, weight, points: [below, above], line } =
            &mut *self.rings;
        load.reset(8, plane);
        if self.class.is_none() {
            for ring in [weight, below, above] {
                ring.reset(8, plane);
            }
            line.iter_mut().for_each(|l| l.resize(plane, 0.0));
        }
        for [kept, spare] in [mass, stiff] {
            kept.reset(8, plane);
            spare.reset(1, plane);
        }
        let mut dot = 0.0;
        for step in 0..self.tile.extent(D - 1) {
            self.load_plane(step);
            if self.class.is_none() && step >= REACH {
                // Points above a row of samples see one coefficient row more than points below it.
                if step == REACH {
                    self.load_weights(step - 2);
                }
                self.load_weights(step - 1);
                self.cell_row(step - 1, 0);
                self.cell_row(step - 2, 1);
            }
            if step >= 2 * REACH {
                dot += self.finish(step - REACH);
            }
        }
        dot
    }
}

/// Loads `z + beta p` and stores its core as the next direction.
struct Combine<'a, const D: usize> {
    tile: &'a Tile<D>,
    z: &'a [f32],
    p: &'a [f32],
    beta: f32,
    buffer: &'a mut Vec<f32>,
    p_next: &'a mut [f32],
}

impl<const D: usize> Kernel for Combine<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.buffer.resize(self.tile.len(), 0.0);
        for (row, line) in self.buffer.chunks_exact_mut(self.tile.extent(0)).enumerate() {
            self.tile.load_row_sum(row, self.z, self.beta, self.p, line);
        }
        self.tile.store(self.buffer, self.p_next);
    }
}

/// Stores `q` and returns `p . q` over the core.
struct StoreDot<'a, const D: usize> {
    tile: &'a Tile<D>,
    p: &'a [f32],
    q: &'a [f32],
    out: &'a mut [f32],
}

impl<const D: usize> Kernel for StoreDot<'_, D> {
    type Output = f64;
    #[inline(always)]
    fn run(self) -> f64 {
        self.tile.store(self.q, self.out);
        let n0 = self.tile.core[0];
        let row = |(local, _)| {
            self.tile.weigh_row(local, &self.p[local..local + n0], &self.q[local..local + n0])
        };
        self.tile.core_rows().map(row).sum()
    }
}

impl<const D: usize> Tile<D> {
    /// The weighted inner product of two core rows that begin at `local` in the buffer.
    #[inline(always)]
    fn weigh_row(&self, local: usize, a: &[f32], b: &[f32]) -> f64 {
        let (mut rest, mut global, mut stride) = (local / self.extent(0), 0, 1);
        for d in 1..D {
            global += (self.start[d] + rest % self.extent(d) - self.halo) * stride;
            rest /= self.extent(d);
            stride *= self.frame.shape[d];
        }
        row_weight(&self.frame, global) * line_dot(&self.frame, self.start[0], a, b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::plain::PlainSystem;
    use crate::tile::Frame;

    /// Same sums in another order: a few f32 roundings of values of order one.
    const TOLERANCE: f32 = 2e-5;

    fn noise(n: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        (0..n)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 23) as f32 - 1.0
            })
            .collect()
    }

    fn operator<const D: usize>(frame: Frame<D>, mixed: bool) -> SplineOperator<D> {
        let random = noise(frame.len(), 7);
        let screening = random.iter().map(|v| if mixed && *v > 0.0 { 0.3 } else { 0.06 }).collect();
        let alpha = std::array::from_fn(|d| 1.0 + 0.5 * d as f32);
        SplineOperator { frame, alpha, screening, gamma: Vec::new() }
    }

    fn close(name: &str, got: &[f32], want: &[f32]) {
        let scale = want.iter().fold(1e-3f32, |a, b| a.max(b.abs()));
        for (k, (g, w)) in got.iter().zip(want).enumerate() {
            assert!((g - w).abs() <= TOLERANCE * scale, "{name} at {k}: got {g}, expected {w}");
        }
    }

    /// Every operation of the fused system against the plain one, on the same vectors.
    fn fused_matches_plain<const D: usize>(shape: [usize; D], ends: [[End; 2]; D], mixed: bool) {
        let frame = Frame { shape, ends };
        let axes: [Axis; D] = std::array::from_fn(|d| {
            Axis::uniform(shape[d], ends[d], operator(frame, mixed).alpha[d])
        });
        let make = || operator(frame, mixed);
        let mut plain = PlainSystem::new(
            make(),
            Multigrid::new(axes.clone(), make().screening, Vec::new()),
            Vec::new(),
        );
        let mut fused = FusedSystem::new(make(), Multigrid::without_finest(axes, make().screening));
        let residual = noise(frame.len(), 3);
        plain.restart(|r| r.copy_from_slice(&residual));
        fused.restart(|r| r.copy_from_slice(&residual));
        let mut beta = 0.0;
        for _ in 0..3 {
            let (a, b) = (plain.precondition(), fused.precondition());
            assert!((a - b).abs() < 1e-4 * a, "{shape:?}: r.z {b}, expected {a}");
            close("z", &fused.r_or_z, plain.z());
            let (a, b) = (plain.direction(beta), fused.direction(beta));
            assert!((a - b).abs() < 1e-4 * a, "{shape:?}: p.q {b}, expected {a}");
            close("q", &fused.q, plain.q());
            plain.advance(0.4);
            fused.advance(0.4);
            beta = 0.3;
        }
        fused.precondition();
        close("r", &fused.r, &plain.r);
        close("x", &fused.x, &plain.x);
    }

    #[test]
    fn fused_matches_plain_images() {
        use End::{Mirror, Zero};
        for mixed in [false, true] {
            fused_matches_plain([33, 27], [[Zero, Zero], [Zero, Zero]], mixed);
            fused_matches_plain([28, 23], [[Mirror, Mirror], [Mirror, Mirror]], mixed);
            fused_matches_plain([300, 211], [[Mirror, Zero], [Zero, Mirror]], mixed);
        }
    }

    #[test]
    fn fused_matches_plain_volumes() {
        use End::{Mirror, Zero};
        for mixed in [false, true] {
            fused_matches_plain(
                [21, 18, 35],
                [[Mirror, Zero], [Zero, Zero], [Mirror, Mirror]],
                mixed,
            );
        }
    }
}
