//! What both passes of the preconditioner share: the finest level's right-hand side and its first
//! sweep, as a pipeline over the planes of a tile.

use super::blocks::Class;
use crate::axis::End;
use crate::plain::FILTER;
use crate::ring::Ring;
use crate::tile::{Beyond, Tile};

/// Reach of the filter.
pub const F: usize = 2;

/// Buffers of one thread, sized so that all live planes of a two-dimensional tile fit the
/// first-level cache.
#[derive(Default)]
pub struct Rings {
    /// What is loaded: the residual.
    pub load: Ring,
    pub spare: Ring,
    /// The filter along all axes but the last, of the residual and of the smoothed values.
    filtered: Ring,
    pub filtered_again: Ring,
    pub f: Ring,
    g: Ring,
    pub u: [Ring; 3],
    pub inverse: Ring,
    /// 1 at even columns and 0 at odd ones, then the other way round.
    pub checker: [Vec<f32>; 2],
    pub zeros: Vec<f32>,
    /// The nodal residual of a whole tile.
    pub nodal: Vec<f32>,
    /// A row on the way to or from the coarse level.
    pub sum: Vec<f32>,
}

/// The geometry of a tile's pipeline and the smoother's weights on it.
pub struct Smoother<'a, const D: usize> {
    pub tile: Tile<D>,
    pub strides: [usize; D],
    /// Rows per plane.
    rows: usize,
    pub alpha: [f32; D],
    uniform: bool,
    /// Over the frame.
    inverse: &'a [f32],
    pub rings: &'a mut Rings,
}

impl<'a, const D: usize> Smoother<'a, D> {
    pub fn new(
        tile: Tile<D>,
        alpha: [f32; D],
        inverse: &'a [f32],
        class: &Class,
        rings: &'a mut Rings,
    ) -> Self {
        let (e0, strides) = (tile.extent(0), tile.strides());
        let plane = strides[D - 1];
        // Margins for the largest shift within a plane.
        let reach = if D > 2 { F * strides[D - 2] } else { F };
        let Rings { load, spare, filtered, filtered_again, f, g, u: [u0, u1, u2], .. } =
            &mut *rings;
        for ring in [load, spare, u2] {
            ring.reset(1, plane, reach);
        }
        for ring in [u0, u1, g] {
            ring.reset(4, plane, reach);
        }
        for ring in [filtered, filtered_again, f] {
            ring.reset(8, plane, reach);
        }
        for (k, row) in rings.checker.iter_mut().enumerate() {
            if row.len() != e0 {
                *row = (0..e0).map(|i| if (i + k) % 2 == 0 { 1.0 } else { 0.0 }).collect();
            }
        }
        rings.zeros.resize(e0, 0.0);
        // One row serves a uniform tile; a mixed one is filled plane by plane.
        match class.uniform {
            None => rings.inverse.reset(8, plane, reach),
            Some(s) => {
                rings.inverse.reset(1, e0, reach);
                let row = rings.inverse.at_mut(0);
                row.fill(inverse_diagonal(alpha, s));
                clear_columns_beyond(&tile, row);
            }
        }
        Self {
            tile,
            strides,
            rows: plane / e0,
            alpha,
            uniform: class.uniform.is_some(),
            inverse,
            rings,
        }
    }

    /// Where the rows of a plane begin in it.
    #[inline(always)]
    pub fn rows(&self) -> impl Iterator<Item = (usize, usize)> + use<D> {
        let e0 = self.tile.extent(0);
        (0..self.rows).map(move |row| (row, row * e0))
    }

    /// Number of a row of a plane among all rows of the tile.
    #[inline(always)]
    pub fn row_of_tile(&self, plane: usize, row: usize) -> usize {
        plane * self.rows + row
    }

    /// Loads a plane of `r - alpha q`, and the inverse diagonal of a mixed tile.
    #[inline(always)]
    pub fn load_plane(&mut self, plane: usize, r: &[f32], alpha: f32, q: &[f32]) {
        let e0 = self.tile.extent(0);
        for (row, at) in self.rows() {
            let of_tile = self.row_of_tile(plane, row);
            let load = &mut self.rings.load.at_mut(plane)[at..][..e0];
            if alpha == 0.0 {
                self.tile.load_row(of_tile, r, Beyond::Zero, load);
            } else {
                self.tile.load_row_sum(of_tile, r, -alpha, q, load);
            }
            if !self.uniform {
                let inverse = &mut self.rings.inverse.at_mut(plane)[at..][..e0];
                self.tile.load_row(of_tile, self.inverse, Beyond::Edge, inverse);
                clear_columns_beyond(&self.tile, inverse);
            }
        }
    }

    /// The filter along all axes but the last, on one plane: of what is loaded, or of `u[2]`.
    #[inline(always)]
    pub fn filter_in_plane(&mut self, plane: usize, of_u: bool) {
        let Rings { load, filtered, filtered_again, spare, u: [.., u], .. } = &mut *self.rings;
        let (src, dst) = if of_u { (u, filtered_again) } else { (load, filtered) };
        for d in 0..D - 1 {
            // Buffers take turns so that the last of these axes writes `dst`.
            let stride = self.strides[d] as isize;
            match (d == 0, (D - 2 - d).is_multiple_of(2)) {
                (true, true) => filter_axis(dst, src, plane, stride),
                (true, false) => filter_axis(spare, src, plane, stride),
                (false, true) => filter_axis(dst, spare, plane, stride),
                (false, false) => filter_axis(spare, dst, plane, stride),
            }
        }
    }

    /// `f` and `g` on one plane, from the filtered residual around it.
    #[inline(always)]
    pub fn right_hand_side(&mut self, plane: usize) {
        let e0 = self.tile.extent(0);
        for (row, at) in self.rows() {
            let inverse = self.inverse_row(plane, row);
            let Rings { filtered, f, g, inverse: inverses, zeros, .. } = &mut *self.rings;
            let inverse = inverse.of(inverses, zeros, e0);
            let (f, g) = (&mut f.at_mut(plane)[at..][..e0], &mut g.at_mut(plane)[at..][..e0]);
            let shift = |k: usize| &filtered.at(plane + k - F)[at..][..e0];
            filter(f, [shift(0), shift(1), shift(2), shift(3), shift(4)]);
            for i in 0..e0 {
                g[i] = f[i] * inverse[i];
            }
        }
    }

    /// The first black half sweep on one plane: from `g` into `u[0]`.
    #[inline(always)]
    pub fn first_black(&mut self, plane: usize) {
        let e0 = self.tile.extent(0);
        for (row, at) in self.rows() {
            let inverse = self.inverse_row(plane, row);
            let red = self.red_phase(plane, row);
            let Rings { g, u: [u, ..], inverse: inverses, zeros, checker, .. } = &mut *self.rings;
            let inverse = inverse.of(inverses, zeros, e0);
            let black = &checker[1 - red][..e0];
            let (centre, out) = (&g.at(plane)[at..][..e0], &mut u.at_mut(plane)[at..][..e0]);
            let links = Links::new(g, plane, at, e0, self.strides);
            for i in 0..e0 {
                out[i] = centre[i] + black[i] * inverse[i] * links.sum(i, self.alpha);
            }
        }
    }

    /// Where the inverse diagonal of a row is: zero where values are fixed.
    #[inline(always)]
    pub fn inverse_row(&self, plane: usize, row: usize) -> InverseRow {
        if self.tile.row_is_beyond(self.row_of_tile(plane, row)) {
            InverseRow::Fixed
        } else if self.uniform {
            InverseRow::Kept { plane: 0, at: 0 }
        } else {
            InverseRow::Kept { plane, at: row * self.tile.extent(0) }
        }
    }

    /// Which checker row is 1 on the red nodes of a row: those whose index sum is even.
    #[inline(always)]
    pub fn red_phase(&self, plane: usize, row: usize) -> usize {
        let tile = &self.tile;
        let (mut sum, mut rest) = (tile.start.iter().sum::<usize>() + D * tile.halo + plane, row);
        for d in 1..D - 1 {
            sum += rest % tile.extent(d);
            rest /= tile.extent(d);
        }
        sum % 2
    }
}

/// The finest level's inverse diagonal where the screening is `s`.
#[inline(always)]
pub fn inverse_diagonal<const D: usize>(alpha: [f32; D], s: f32) -> f32 {
    1.0 / (alpha.iter().map(|a| 2.0 * a).sum::<f32>() + s)
}

/// A row of the inverse diagonal.
#[derive(Clone, Copy)]
pub enum InverseRow {
    Fixed,
    Kept { plane: usize, at: usize },
}

impl InverseRow {
    #[inline(always)]
    pub fn of<'a>(self, inverses: &'a Ring, zeros: &'a [f32], n: usize) -> &'a [f32] {
        match self {
            Self::Fixed => &zeros[..n],
            Self::Kept { plane, at } => &inverses.at(plane)[at..][..n],
        }
    }
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
pub struct Links<'a, const D: usize> {
    before: [&'a [f32]; D],
    after: [&'a [f32]; D],
}

impl<'a, const D: usize> Links<'a, D> {
    #[inline(always)]
    pub fn new(src: &'a Ring, plane: usize, at: usize, n: usize, strides: [usize; D]) -> Self {
        let at = at as isize;
        let before = |d: usize| {
            if d + 1 == D {
                src.shifted(plane.wrapping_sub(1), at, n)
            } else {
                src.shifted(plane, at - strides[d] as isize, n)
            }
        };
        let after = |d: usize| {
            if d + 1 == D {
                src.shifted(plane + 1, at, n)
            } else {
                src.shifted(plane, at + strides[d] as isize, n)
            }
        };
        Self { before: std::array::from_fn(before), after: std::array::from_fn(after) }
    }

    #[inline(always)]
    pub fn sum(&self, i: usize, alpha: [f32; D]) -> f32 {
        let mut sum = 0.0;
        for d in 0..D {
            sum += alpha[d] * (self.before[d][i] + self.after[d][i]);
        }
        sum
    }
}

/// `dst = F src` along one axis of a plane.
#[inline(always)]
fn filter_axis(dst: &mut Ring, src: &Ring, plane: usize, stride: isize) {
    let dst = dst.at_mut(plane);
    let n = dst.len();
    let shift = |k: usize| src.shifted(plane, (k as isize - F as isize) * stride, n);
    filter(dst, [shift(0), shift(1), shift(2), shift(3), shift(4)]);
}

/// The filter, from the five shifts that it reads.
#[inline(always)]
pub fn filter(dst: &mut [f32], src: [&[f32]; 5]) {
    let n = dst.len();
    let [a, b, c, d, e] = src;
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);
    for i in 0..n {
        dst[i] = FILTER[0] * c[i] + FILTER[1] * (b[i] + d[i]) + FILTER[2] * (a[i] + e[i]);
    }
}
