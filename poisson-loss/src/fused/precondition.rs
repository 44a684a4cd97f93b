//! The two passes of the preconditioner, before and after the coarse correction.

use std::ops::Range;

use inr_core::cpu::Kernel;

use super::smoother::{F, Links, Rings, Smoother, filter};
use crate::axis::Transfer;
use crate::multigrid::{Prolongation, Restriction};
use crate::tile::Beyond;

/// Halo of the pass before the coarse correction: filter, black, residual, restriction.
pub const HALO_DOWN: usize = F + 1 + 1 + 2;
/// How far the residual follows behind what is loaded.
const BEHIND: usize = F + 1 + 1;
/// Halo of the pass after it: filter, black, black, red, filter.
pub const HALO_UP: usize = F + 1 + 1 + 1 + F;

/// Columns by which a row of a tile may reach beyond the frame: its halo, and what makes it whole
/// vectors.
const MIRRORED: usize = HALO_UP + 16;

/// Before the coarse correction, on one tile: the updates of CG, and the coarse right-hand side
/// from the nodal residual after smoothing from zero.
pub struct Down<'a, const D: usize> {
    pub smoother: Smoother<'a, D>,
    pub r: &'a [f32],
    pub q: &'a [f32],
    /// From the slab on.
    pub p: &'a [f32],
    pub alpha: f32,
    pub x: &'a mut [f32],
    pub r_next: &'a mut [f32],
    pub transfer: &'a [Transfer; D],
    /// Shape of the coarse level, and its right-hand side from this plane of it on.
    pub coarse: ([usize; D], usize),
    pub f: &'a mut [f32],
}

impl<const D: usize> Down<'_, D> {
    /// Keeps the updated residual and solution of a plane.
    #[inline(always)]
    fn store_updates(&mut self, plane: usize) {
        let tile = self.smoother.tile;
        let (e0, n0, halo, alpha) = (tile.extent(0), tile.core[0], tile.halo, self.alpha);
        for (row, at) in tile.core_rows_of(plane) {
            let residual = &self.smoother.rings.load.at(plane)[row * e0 + halo..][..n0];
            self.r_next[at..][..n0].copy_from_slice(residual);
            if alpha != 0.0 {
                let (x, p) = (&mut self.x[at..][..n0], &self.p[at..][..n0]);
                for i in 0..n0 {
                    x[i] += alpha * p[i];
                }
            }
        }
    }

    /// The nodal residual of a plane: zero on black nodes.
    #[inline(always)]
    fn nodal_residual(&mut self, plane: usize) {
        let s = &mut self.smoother;
        let e0 = s.tile.extent(0);
        for (row, at) in s.rows() {
            let red = s.red_phase(plane, row);
            let Rings { u: [u, ..], checker, nodal, .. } = &mut *s.rings;
            let red = &checker[red][..e0];
            let out = &mut nodal[plane * s.strides[D - 1] + at..][..e0];
            let links = Links::new(u, plane, at, e0, s.strides);
            for i in 0..e0 {
                out[i] = red[i] * links.sum(i, s.alpha);
            }
        }
    }

    /// Restricts the tile's nodal residual to the coarse nodes that lie in its core.
    #[inline(always)]
    fn restrict(&mut self) {
        let tile = self.smoother.tile;
        let (coarse, first_plane) = self.coarse;
        let Rings { nodal, sum, .. } = &mut *self.smoother.rings;
        let from = Restriction {
            transfer: self.transfer,
            origin: std::array::from_fn(|d| tile.start[d] as isize - tile.halo as isize),
            shape: std::array::from_fn(|d| tile.extent(d)),
            src: nodal,
        };
        let owned: [Range<usize>; D] = std::array::from_fn(|d| {
            let core = tile.start[d]..tile.start[d] + tile.core[d];
            Restriction::<D>::owned(&self.transfer[d], core)
        });
        let rows: usize = owned[1..].iter().map(Range::len).product();
        for row in 0..rows {
            let (mut rest, mut index) = (row, [0; D]);
            let (mut at, mut stride) = (owned[0].start, coarse[0]);
            for d in 1..D {
                index[d] = owned[d].start + rest % owned[d].len();
                rest /= owned[d].len();
                at += (index[d] - if d + 1 == D { first_plane } else { 0 }) * stride;
                stride *= coarse[d];
            }
            from.row(index, owned[0].clone(), sum, &mut self.f[at..][..owned[0].len()]);
        }
    }
}

impl<const D: usize> Kernel for Down<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(mut self) {
        let planes = self.smoother.tile.extent(D - 1);
        let tile_len = self.smoother.tile.len();
        self.smoother.rings.nodal.resize(tile_len, 0.0);
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
            if step >= 2 * BEHIND {
                self.nodal_residual(step - BEHIND);
            }
        }
        self.restrict();
    }
}

/// After the coarse correction, on one tile: `z = F u`; returns `r . z`.
pub struct Up<'a, const D: usize> {
    pub smoother: Smoother<'a, D>,
    pub whole_r: &'a [f32],
    /// From the slab on.
    pub r: &'a [f32],
    pub correction: Prolongation<'a, D>,
    pub z: &'a mut [f32],
}

impl<const D: usize> Up<'_, D> {
    /// Adds the coarse correction to a plane of `u[0]`.
    #[inline(always)]
    fn correct(&mut self, plane: usize) {
        let s = &mut self.smoother;
        let (e0, n0) = (s.tile.extent(0), s.tile.frame.shape[0]);
        // Mirrored columns lie within a tile's margins of those that it holds.
        let columns = s.tile.columns();
        let near = columns.start.saturating_sub(MIRRORED)..(columns.end + MIRRORED).min(n0);
        let seen = self.correction.seen(near);
        let first = seen.start;
        for (row, at) in s.rows() {
            let Some(of_frame) = s.tile.frame_row(s.row_of_tile(plane, row)) else { continue };
            let Rings { u: [u, ..], spare, sum, .. } = &mut *s.rings;
            sum.resize(seen.len(), 0.0);
            self.correction.across_rows(of_frame, seen.clone(), sum);
            let line = &mut spare.at_mut(0)[..e0];
            let inside = |columns: Range<usize>, line: &mut [f32]| {
                self.correction.along_row(columns, sum, first, line);
            };
            s.tile.fill_row(Beyond::Zero, line, inside, |i| self.correction.at(i, sum, first));
            let u = &mut u.at_mut(plane)[at..][..e0];
            for i in 0..e0 {
                u[i] += line[i];
            }
        }
    }

    /// A half sweep on one plane, from `u[stage]` into `u[stage + 1]`: black, then red.
    #[inline(always)]
    fn half_sweep(&mut self, plane: usize, stage: usize) {
        let s = &mut self.smoother;
        let e0 = s.tile.extent(0);
        for (row, at) in s.rows() {
            let red = s.red_phase(plane, row);
            let inverse = s.inverse_row(plane, row);
            let Rings { u, f, inverse: inverses, zeros, checker, .. } = &mut *s.rings;
            let inverse = inverse.of(inverses, zeros, e0);
            // 1 on the nodes of the colour that is updated, and on the others.
            let (active, passive) =
                (&checker[red ^ (1 - stage)][..e0], &checker[red ^ stage][..e0]);
            let (head, tail) = u.split_at_mut(stage + 1);
            let (u, f) = (&head[stage].at(plane)[at..][..e0], &f.at(plane)[at..][..e0]);
            let out = &mut tail[0].at_mut(plane)[at..][..e0];
            let links = Links::new(&head[stage], plane, at, e0, s.strides);
            for i in 0..e0 {
                let new = inverse[i] * (f[i] + links.sum(i, s.alpha));
                out[i] = passive[i] * u[i] + active[i] * new;
            }
        }
    }

    /// `z` and `r . z` on one plane, from the filtered `u[2]` around it.
    #[inline(always)]
    fn finish(&mut self, plane: usize) -> f64 {
        let (s, mut dot) = (&self.smoother, 0.0);
        let (tile, n) = (s.tile, s.tile.core[0]);
        for (row, at) in tile.core_rows_of(plane) {
            let local = row * tile.extent(0) + tile.halo;
            let shift = |k: usize| &s.rings.filtered_again.at(plane + k - F)[local..][..n];
            let z = &mut self.z[at..][..n];
            filter(z, [shift(0), shift(1), shift(2), shift(3), shift(4)]);
            dot += super::weigh_row(&tile, plane, row, &self.r[at..][..n], z);
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
