//! Pieces of a box, copied with a halo into buffers that stay in cache.
//!
//! Inside a piece a shift along an axis is one constant offset in the flat buffer, so every
//! stencil is a plain loop over a range of it, in any dimension. Entries whose stencil wraps
//! round the piece's border are meaningless; the halo is wide enough that none reaches the core.

use std::ops::Range;

use crate::axis::{End, ghost};

/// Samples of the widest vector.
const LANES: usize = 16;

/// Largest core of a piece along the first axis and along the middle ones, by dimension.
const fn core_limits(dimension: usize) -> [usize; 2] {
    match dimension {
        1 => [4096, 1],
        2 => [352, 1],
        3 => [128, 32],
        _ => [64, 16],
    }
}

/// Core of a piece along the outermost axis: about `aim` samples, an even number of pieces (two
/// threads get the same share), and fixed by the shape alone.
fn thickness(n: usize, dimension: usize) -> usize {
    let aim = match dimension {
        1 => return 4096,
        2 => 96,
        3 => 32,
        _ => 16,
    };
    let pairs = ((n as f64 / (2 * aim) as f64).round() as usize).max(1);
    n.div_ceil(2 * pairs).max(8)
}

/// A box of samples and what lies beyond its sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame<const D: usize> {
    pub shape: [usize; D],
    pub ends: [[End; 2]; D],
}

impl<const D: usize> Frame<D> {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Samples of one slab: the piece of an array that one task writes.
    pub fn slab_len(&self) -> usize {
        self.shape[..D - 1].iter().product::<usize>() * thickness(self.shape[D - 1], D)
    }

    /// The tiles of slab number `slab`, with the given halo: full rows of samples as far as the
    /// first-level cache allows.
    pub fn tiles(&self, slab: usize, halo: usize) -> Vec<Tile<D>> {
        let (thickness, limits) = (thickness(self.shape[D - 1], D), core_limits(D));
        let size = std::array::from_fn(|d| match d {
            _ if d + 1 == D => thickness,
            0 => {
                let even = self.shape[0].div_ceil(self.shape[0].div_ceil(limits[0]));
                even.next_multiple_of(LANES)
            }
            _ => limits[1],
        });
        self.pieces(slab, halo, size)
    }

    /// The same slab in smaller tiles, for work that most of them do not need; with the place in
    /// the slab where each of them begins along the outermost axis.
    pub fn small_tiles(&self, slab: usize, halo: usize) -> Vec<(Tile<D>, usize)> {
        let size = std::array::from_fn(|d| match d {
            0 => 4 * LANES,
            _ => 2 * LANES,
        });
        let plane: usize = self.shape[..D - 1].iter().product();
        let first = slab * thickness(self.shape[D - 1], D);
        let placed = |tile: Tile<D>| (tile, (tile.start[D - 1] - first) * plane);
        self.pieces(slab, halo, size).into_iter().map(placed).collect()
    }

    fn pieces(&self, slab: usize, halo: usize, size: [usize; D]) -> Vec<Tile<D>> {
        let thickness = thickness(self.shape[D - 1], D);
        let (mut lo, mut hi) = ([0; D], self.shape);
        lo[D - 1] = slab * thickness;
        hi[D - 1] = hi[D - 1].min(lo[D - 1] + thickness);
        let mut starts = vec![[0usize; D]];
        for d in 0..D {
            starts = (lo[d]..hi[d])
                .step_by(size[d])
                .flat_map(|s| starts.iter().map(move |t| (s, *t)).collect::<Vec<_>>())
                .map(|(s, mut t)| {
                    t[d] = s;
                    t
                })
                .collect();
        }
        let tile = |start: [usize; D]| {
            let core = std::array::from_fn(|d| size[d].min(hi[d] - start[d]));
            Tile { frame: *self, start, core, halo }
        };
        starts.into_iter().map(tile).collect()
    }
}

/// What a buffer holds beyond a [`End::Zero`] side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beyond {
    /// The change: zero.
    Zero,
    /// Weights of the objective: the value at the side.
    Edge,
}

/// One piece: `core` samples from `start` on, and `halo` more on every side.
#[derive(Debug, Clone, Copy)]
pub struct Tile<const D: usize> {
    pub frame: Frame<D>,
    pub start: [usize; D],
    pub core: [usize; D],
    pub halo: usize,
}

impl<const D: usize> Tile<D> {
    /// Samples of the buffer along an axis: the core and both halos, and along the first axis as
    /// many more after them as make a row whole vectors.
    #[inline(always)]
    pub fn extent(&self, d: usize) -> usize {
        let n = self.core[d] + 2 * self.halo;
        if d == 0 && D > 1 { n.next_multiple_of(LANES) } else { n }
    }

    /// Samples of the buffer.
    pub fn len(&self) -> usize {
        (0..D).map(|d| self.extent(d)).product()
    }

    /// Offsets in the buffer of a step along each axis.
    pub fn strides(&self) -> [usize; D] {
        let mut strides = [1; D];
        for d in 1..D {
            strides[d] = strides[d - 1] * self.extent(d - 1);
        }
        strides
    }

    /// The value that all weights on the piece and its halo share, if they do.
    pub fn uniform(&self, weights: &[f32]) -> Option<f32> {
        let lo: [usize; D] = std::array::from_fn(|d| self.start[d].saturating_sub(self.halo));
        let hi: [usize; D] = std::array::from_fn(|d| {
            (self.start[d] + self.core[d] + self.halo).min(self.frame.shape[d])
        });
        let rows: usize = (1..D).map(|d| hi[d] - lo[d]).product();
        let mut value = None;
        for row in 0..rows {
            let (mut rest, mut at, mut stride) = (row, lo[0], self.frame.shape[0]);
            for d in 1..D {
                at += (lo[d] + rest % (hi[d] - lo[d])) * stride;
                rest /= hi[d] - lo[d];
                stride *= self.frame.shape[d];
            }
            let of_row = uniform_value(&weights[at..at + hi[0] - lo[0]])?;
            if *value.get_or_insert(of_row) != of_row {
                return None;
            }
        }
        value
    }

    /// Copies the piece and its halo out of an array over the whole frame.
    pub fn load(&self, src: &[f32], beyond: Beyond, dst: &mut Vec<f32>) {
        dst.resize(self.len(), 0.0);
        for (row, dst) in dst.chunks_exact_mut(self.extent(0)).enumerate() {
            self.load_row(row, src, beyond, dst);
        }
    }

    /// Copies one row of the piece, halo included; `row` counts the buffer's rows.
    #[inline(always)]
    pub fn load_row(&self, row: usize, src: &[f32], beyond: Beyond, dst: &mut [f32]) {
        match self.source_row(row, beyond) {
            None => dst.fill(0.0),
            Some(at) => {
                let src = &src[at..at + self.frame.shape[0]];
                let copy = |columns: Range<usize>, dst: &mut [f32]| {
                    dst.copy_from_slice(&src[columns]);
                };
                self.fill_row(beyond, dst, copy, |i| src[i]);
            }
        }
    }

    /// Like [`Tile::load_row`] for `a + scale * b`.
    #[inline(always)]
    pub fn load_row_sum(&self, row: usize, a: &[f32], scale: f32, b: &[f32], dst: &mut [f32]) {
        match self.source_row(row, Beyond::Zero) {
            None => dst.fill(0.0),
            Some(at) => {
                let (a, b) = (&a[at..at + self.frame.shape[0]], &b[at..at + self.frame.shape[0]]);
                let sum = |columns: Range<usize>, dst: &mut [f32]| {
                    let n = dst.len();
                    let (a, b) = (&a[columns.start..][..n], &b[columns.start..][..n]);
                    for i in 0..n {
                        dst[i] = a[i] + scale * b[i];
                    }
                };
                self.fill_row(Beyond::Zero, dst, sum, |i| a[i] + scale * b[i]);
            }
        }
    }

    /// Fills a row of the buffer: `inside` the columns of the frame, `value` one by one those that
    /// are mirrored.
    #[inline(always)]
    pub fn fill_row(
        &self,
        beyond: Beyond,
        dst: &mut [f32],
        inside: impl FnOnce(Range<usize>, &mut [f32]),
        value: impl Fn(usize) -> f32,
    ) {
        let columns = self.columns();
        let first = self.start[0] as isize - self.halo as isize;
        let left = (columns.start as isize - first) as usize;
        let right = left + columns.len();
        inside(columns, &mut dst[left..right]);
        for (end, outside) in self.frame.ends[0].into_iter().zip([0..left, right..dst.len()]) {
            if end == End::Zero && beyond == Beyond::Zero {
                dst[outside].fill(0.0);
            } else {
                for k in outside {
                    dst[k] = self.inside(first + k as isize, 0, beyond).map_or(0.0, &value);
                }
            }
        }
    }

    /// The columns of the frame that the buffer holds.
    #[inline(always)]
    pub fn columns(&self) -> Range<usize> {
        let end = (self.start[0] + self.extent(0) - self.halo).min(self.frame.shape[0]);
        self.start[0].saturating_sub(self.halo)..end
    }

    /// Which row of the frame a row of the buffer is or mirrors; `None` beyond a `Zero` side.
    #[inline(always)]
    pub fn frame_row(&self, row: usize) -> Option<usize> {
        self.source_row(row, Beyond::Zero).map(|at| at / self.frame.shape[0])
    }

    /// Whether a row of the buffer lies beyond a `Zero` side.
    #[inline(always)]
    pub fn row_is_beyond(&self, row: usize) -> bool {
        self.source_row(row, Beyond::Zero).is_none()
    }

    /// Where a row of the buffer begins in an array over the frame, or `None` where it is zero.
    #[inline(always)]
    fn source_row(&self, row: usize, beyond: Beyond) -> Option<usize> {
        let (mut rest, mut at, mut stride) = (row, 0, self.frame.shape[0]);
        for d in 1..D {
            let i = (self.start[d] + rest % self.extent(d)) as isize - self.halo as isize;
            rest /= self.extent(d);
            at += self.inside(i, d, beyond)? * stride;
            stride *= self.frame.shape[d];
        }
        Some(at)
    }

    #[inline(always)]
    fn inside(&self, i: isize, d: usize, beyond: Beyond) -> Option<usize> {
        let n = self.frame.shape[d];
        if i >= 0 && (i as usize) < n {
            return Some(i as usize);
        }
        ghost(i, n, self.frame.ends[d])
            .or_else(|| (beyond == Beyond::Edge).then(|| i.clamp(0, n as isize - 1) as usize))
    }

    /// For every row of the core: its offset in the buffer and in a slab (an array piece that
    /// begins at the slab's first sample).
    pub fn core_rows(&self) -> impl Iterator<Item = (usize, usize)> + use<D> {
        let tile = *self;
        let strides = tile.strides();
        let rows: usize = tile.core[1..].iter().product();
        (0..rows).map(move |row| {
            let (mut rest, mut local, mut global, mut stride) =
                (row, tile.halo, tile.start[0], tile.frame.shape[0]);
            for d in 1..D {
                let i = rest % tile.core[d];
                rest /= tile.core[d];
                local += (i + tile.halo) * strides[d];
                global += (i + if d + 1 == D { 0 } else { tile.start[d] }) * stride;
                stride *= tile.frame.shape[d];
            }
            (local, if D == 1 { 0 } else { global })
        })
    }

    /// The rows of the core that lie in one plane of the outermost axis: row in the plane, and
    /// place in the slab.
    #[inline(always)]
    pub fn core_rows_of(&self, plane: usize) -> impl Iterator<Item = (usize, usize)> + use<D> {
        let tile = *self;
        let rows: usize = (1..D - 1).map(|d| tile.core[d]).product();
        (0..rows).map(move |mut rest| {
            let (mut row, mut rows) = (0, 1);
            let (mut at, mut stride) = (tile.start[0], tile.frame.shape[0]);
            for d in 1..D - 1 {
                let i = rest % tile.core[d];
                rest /= tile.core[d];
                row += (i + tile.halo) * rows;
                at += (tile.start[d] + i) * stride;
                rows *= tile.extent(d);
                stride *= tile.frame.shape[d];
            }
            (row, at + (plane - tile.halo) * stride)
        })
    }

    /// Copies the core of a buffer into its place in the slab.
    pub fn store(&self, src: &[f32], slab: &mut [f32]) {
        for (local, global) in self.core_rows() {
            slab[global..global + self.core[0]].copy_from_slice(&src[local..local + self.core[0]]);
        }
    }
}

/// The value that all entries share, if they do.
pub fn uniform_value(values: &[f32]) -> Option<f32> {
    let first = *values.first()?;
    let different: u32 = values.iter().map(|v| u32::from(*v != first)).sum();
    (different == 0).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_frame_once_and_halos_match_ghosts() {
        let frame =
            Frame { shape: [700, 150], ends: [[End::Mirror, End::Zero], [End::Zero, End::Mirror]] };
        let src: Vec<f32> = (0..frame.len()).map(|k| k as f32 + 1.0).collect();
        let mut out = vec![0.0; frame.len()];
        let len = frame.slab_len();
        for (slab, piece) in out.chunks_mut(len).enumerate() {
            for tile in frame.tiles(slab, 3) {
                let mut buffer = Vec::new();
                tile.load(&src, Beyond::Zero, &mut buffer);
                for (k, v) in buffer.iter().enumerate() {
                    let i = (tile.start[0] + k % tile.extent(0)) as isize - 3;
                    let j = (tile.start[1] + k / tile.extent(0)) as isize - 3;
                    let x = ghost(i, 700, frame.ends[0]).zip(ghost(j, 150, frame.ends[1]));
                    assert_eq!(*v, x.map_or(0.0, |(x, y)| src[y * 700 + x]), "{i} {j}");
                }
                tile.store(&buffer, piece);
            }
        }
        assert_eq!(out, src);
        out.fill(0.0);
        for (slab, piece) in out.chunks_mut(len).enumerate() {
            for (tile, at) in frame.small_tiles(slab, 3) {
                let mut buffer = Vec::new();
                tile.load(&src, Beyond::Zero, &mut buffer);
                tile.store(&buffer, &mut piece[at..]);
            }
        }
        assert_eq!(out, src);
    }

    #[test]
    fn one_and_three_dimensions() {
        fn copy<const D: usize>(shape: [usize; D]) {
            let frame = Frame { shape, ends: [[End::Zero; 2]; D] };
            let src: Vec<f32> = (0..frame.len()).map(|k| k as f32).collect();
            let mut out = vec![-1.0; frame.len()];
            for (slab, piece) in out.chunks_mut(frame.slab_len()).enumerate() {
                for tile in frame.tiles(slab, 2) {
                    let mut buffer = Vec::new();
                    tile.load(&src, Beyond::Zero, &mut buffer);
                    tile.store(&buffer, piece);
                }
            }
            assert_eq!(out, src);
        }
        copy([10_000]);
        copy([130, 40, 70]);
        copy([70, 5, 20, 33]);
    }
}
