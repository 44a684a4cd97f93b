use std::ops::Range;

use inr_core::{Domain, Field, Region, Samples};

use crate::{Error, Guidance, Options, Result};

/// The signal whose gradients are pasted in, and where it goes: a point `x` of the patch lies at
/// `x + offset` of the background, both in physical units. Offsets need not be whole samples.
#[derive(Clone, Copy)]
pub enum Patch<'a, const D: usize, const C: usize> {
    /// A sampled signal, made continuous by cubic B-splines. What lies outside the background, or
    /// outside the patch's own cells, does not take part.
    Samples {
        /// The values.
        samples: &'a Samples<D, C>,
        /// Translation into the background.
        offset: [f32; D],
    },
    /// Any continuous field, defined wherever the region is.
    Field {
        /// The field.
        field: &'a dyn Field<D, C>,
        /// Translation into the background.
        offset: [f32; D],
    },
}

/// One blend: a region of a patch goes into a background.
#[derive(Clone)]
pub struct Problem<'a, const D: usize, const C: usize> {
    /// The signal that stays outside the region; its lattice is the lattice of the result.
    pub background: &'a Samples<D, C>,
    /// The signal that gives its gradients.
    pub patch: Patch<'a, D, C>,
    /// Where the gradients come from the guidance, in the background's coordinates. Its weights
    /// (soft masks) are taken at the background's samples, one per sample cell.
    pub region: &'a dyn Region<D>,
    /// The gradient to follow inside.
    pub guidance: Guidance<D, C>,
    /// Functional, lengths, tolerance.
    pub options: Options,
}

/// A box of background samples with region weights on it.
#[derive(Debug, Clone)]
pub(crate) struct Support<const D: usize> {
    pub start: [usize; D],
    pub shape: [usize; D],
    /// Region weight per sample of the box.
    pub weight: Vec<f32>,
    /// Sum of the weights: the measure of the region in samples.
    pub measure: f64,
    pub warnings: Vec<String>,
}

/// Samples of a row that one task weighs.
const ROW_PIECE: usize = 1 << 16;

/// The patch's lattice is the background's, shifted by whole samples.
pub(crate) fn aligned_shift<const D: usize>(
    background: &Domain<D>,
    patch: &Domain<D>,
    offset: &[f32; D],
) -> Option<[isize; D]> {
    // 1e-4 samples: a placement typed with a few digits counts as whole.
    const SLACK: f64 = 1e-4;
    let mut shift = [0; D];
    for d in 0..D {
        let h = f64::from(background.pitch()[d]);
        if (f64::from(patch.pitch()[d]) / h - 1.0).abs() > 1e-6 {
            return None;
        }
        let origin = |g: &Domain<D>| f64::from(g.origin()[d]);
        let s = (origin(patch) + f64::from(offset[d]) - origin(background)) / h;
        if (s - s.round()).abs() > SLACK {
            return None;
        }
        shift[d] = s.round() as isize;
    }
    Some(shift)
}

impl<const D: usize, const C: usize> Problem<'_, D, C> {
    /// Background samples per axis whose centre lies in the patch's cells, and on which sides the patch
    /// reaches beyond the background.
    fn reach_of_patch(&self) -> ([Range<usize>; D], [[bool; 2]; D]) {
        let domain = self.background.domain();
        let whole = || std::array::from_fn(|d| 0..domain.shape()[d]);
        let Patch::Samples { samples, offset } = self.patch else {
            return (whole(), [[false; 2]; D]);
        };
        let patch = samples.domain();
        let mut cut = [[false; 2]; D];
        let ranges = std::array::from_fn(|d| {
            let (h, n) = (f64::from(domain.pitch()[d]), domain.shape()[d]);
            let edge =
                f64::from(patch.origin()[d]) + f64::from(offset[d]) - f64::from(domain.origin()[d]);
            let half = 0.5 * f64::from(patch.pitch()[d]);
            let lo = (edge - half) / h;
            let hi = (edge - half + f64::from(patch.pitch()[d]) * patch.shape()[d] as f64) / h;
            // A sample exactly on the outer edge belongs to the patch's side that is closed: the lower one.
            let inside = |v: f64| (v - 1e-4).ceil().clamp(0.0, n as f64) as usize;
            cut[d] = [lo < -0.5 - 1e-3, hi > n as f64 - 0.5 + 1e-3];
            inside(lo)..inside(hi).max(inside(lo))
        });
        (ranges, cut)
    }

    /// The smallest box that holds the region, with its weights.
    ///
    /// # Errors
    /// [`Error::EmptyRegion`] and [`Error::NotFinite`].
    pub(crate) fn support(&self) -> Result<Support<D>> {
        let domain = *self.background.domain();
        let (mut reach, cut) = self.reach_of_patch();
        if let Some([low, high]) = self.region.bounds() {
            for d in 0..D {
                let (origin, pitch) = (f64::from(domain.origin()[d]), f64::from(domain.pitch()[d]));
                // Corners are f32: wider by their rounding and a sample; casts saturate.
                let slack = |v: f32| f64::from(v.abs()) * f64::from(f32::EPSILON) / pitch + 2.0;
                let index = |v: f32| (f64::from(v) - origin) / pitch;
                let low = (index(low[d]) - slack(low[d])) as usize;
                let high = (index(high[d]) + slack(high[d]) + 1.0) as usize;
                let end = reach[d].end.min(high);
                reach[d] = reach[d].start.max(low).min(end)..end.max(reach[d].start);
            }
        }
        let mut support = Support {
            start: std::array::from_fn(|d| reach[d].start),
            shape: std::array::from_fn(|d| reach[d].len()),
            weight: Vec::new(),
            measure: 0.0,
            warnings: Vec::new(),
        };
        if support.shape.contains(&0) {
            return Err(Error::EmptyRegion);
        }
        support.weight = self.region_weights(&domain, &support)?;
        let (lo, hi) = support.bounds();
        if support.measure == 0.0 {
            return Err(Error::EmptyRegion);
        }
        // The region ends where the background does, and the patch goes on.
        let at_end = |d: usize| {
            [support.start[d] + lo[d] == 0, support.start[d] + hi[d] == domain.shape()[d]]
        };
        if (0..D).any(|d| (0..2).any(|side| cut[d][side] && at_end(d)[side])) {
            let what = "the region reaches beyond the background; what lies outside is cut off";
            support.warnings.push(what.to_owned());
        }
        Ok(support.cropped(lo, std::array::from_fn(|d| hi[d] - lo[d])))
    }

    fn region_weights(&self, domain: &Domain<D>, support: &Support<D>) -> Result<Vec<f32>> {
        use rayon::prelude::*;
        let mut weight = vec![0.0f32; support.shape.iter().product()];
        let rows = &support.shape[1..];
        let index_of = |row: usize, column: usize| {
            let (mut index, mut rest) = (support.start, row);
            index[0] += column;
            for (d, n) in rows.iter().enumerate() {
                index[d + 1] += rest % n;
                rest /= n;
            }
            index
        };
        let n0 = support.shape[0];
        // Long rows, as of sound, are pieces of work of their own.
        let bad = weight.par_chunks_mut(n0).enumerate().find_map_first(|(row, out)| {
            out.par_chunks_mut(ROW_PIECE).enumerate().find_map_first(|(piece, out)| {
                let column = piece * ROW_PIECE;
                self.region.weights_on(domain, index_of(row, column), out);
                let i = out.iter().position(|w| !(0.0..=1.0).contains(w))?;
                Some((index_of(row, column + i), out[i]))
            })
        });
        match bad {
            None => Ok(weight),
            Some((_, value)) if value.is_finite() => {
                let name = "a region weight";
                Err(Error::Parameter { name, rule: "between 0 and 1", value: f64::from(value) })
            }
            Some((index, value)) => {
                Err(Error::NotFinite { signal: "region", index: index.to_vec(), channel: 0, value })
            }
        }
    }
}

impl<const D: usize> Support<D> {
    /// Sets the measure and returns the corners of the box that holds all positive weights.
    fn bounds(&mut self) -> ([usize; D], [usize; D]) {
        use rayon::prelude::*;
        let piece_bounds = |weights: &[f32]| {
            let first = weights.iter().position(|w| *w > 0.0)?;
            let last = weights.iter().rposition(|w| *w > 0.0)?;
            let sum = weights[first..=last].iter().map(|w| f64::from(*w)).sum::<f64>();
            Some((first, last + 1, sum))
        };
        let row_bounds = |weights: &[f32]| {
            if weights.len() <= ROW_PIECE {
                return piece_bounds(weights);
            }
            let pieces: Vec<_> = weights.par_chunks(ROW_PIECE).map(piece_bounds).collect();
            let placed = |(k, piece): (usize, Option<(usize, usize, f64)>)| {
                piece.map(|(a, b, sum)| (a + k * ROW_PIECE, b + k * ROW_PIECE, sum))
            };
            let pieces = pieces.into_iter().enumerate().filter_map(placed);
            pieces.reduce(|one, next| (one.0, next.1, one.2 + next.2))
        };
        let rows: Vec<_> = self.weight.par_chunks(self.shape[0]).map(row_bounds).collect();
        let (mut lo, mut hi) = (self.shape, [0; D]);
        for (row, bounds) in rows.into_iter().enumerate() {
            let Some((first, end, sum)) = bounds else { continue };
            self.measure += sum;
            (lo[0], hi[0]) = (lo[0].min(first), hi[0].max(end));
            let mut rest = row;
            for d in 1..D {
                let i = rest % self.shape[d];
                rest /= self.shape[d];
                (lo[d], hi[d]) = (lo[d].min(i), hi[d].max(i + 1));
            }
        }
        (lo, hi)
    }

    /// The smallest box that holds this one's region, without weights; and these.
    pub(crate) fn measured(mut self) -> (Self, Vec<f32>) {
        let (lo, hi) = self.bounds();
        let weight = std::mem::take(&mut self.weight);
        for d in 0..D {
            self.start[d] += lo[d].min(hi[d]);
            self.shape[d] = hi[d].saturating_sub(lo[d]);
        }
        (self, weight)
    }

    /// The part of this box that begins at `lo` (relative to it).
    fn cropped(mut self, lo: [usize; D], shape: [usize; D]) -> Self {
        if shape == self.shape {
            return self;
        }
        let lo_signed = lo.map(|v| v as isize);
        self.weight = copy_box(&self.weight, self.shape, lo_signed, shape, |_, _| None);
        for d in 0..D {
            self.start[d] += lo[d];
        }
        self.shape = shape;
        self
    }

    /// The weights on another box, zero where this one has none.
    pub(crate) fn weights_on(&self, start: [usize; D], shape: [usize; D]) -> Vec<f32> {
        let lo = std::array::from_fn(|d| start[d] as isize - self.start[d] as isize);
        copy_box(&self.weight, self.shape, lo, shape, |_, _| None)
    }
}

/// Copies a box out of an array; indices outside are first handed to `outside(index, axis)`, and
/// are zero where that returns `None`.
pub(crate) fn copy_box<const D: usize>(
    src: &[f32],
    src_shape: [usize; D],
    start: [isize; D],
    shape: [usize; D],
    outside: impl Fn(isize, usize) -> Option<usize> + Sync,
) -> Vec<f32> {
    use rayon::prelude::*;
    let mut dst = vec![0.0f32; shape.iter().product()];
    let place = |i: isize, d: usize| match usize::try_from(i) {
        Ok(i) if i < src_shape[d] => Some(i),
        _ => outside(i, d),
    };
    let columns: Vec<Option<usize>> =
        (0..shape[0]).map(|i| place(start[0] + i as isize, 0)).collect();
    let first = columns.iter().position(Option::is_some).unwrap_or(0);
    let straight = (first..shape[0])
        .take_while(|k| {
            columns[*k].is_some() && columns[*k] == columns[first].map(|c| c + k - first)
        })
        .count();
    dst.par_chunks_mut(shape[0]).enumerate().for_each(|(row, dst)| {
        let (mut rest, mut at, mut stride) = (row, Some(0), src_shape[0]);
        for d in 1..D {
            let i = place(start[d] + (rest % shape[d]) as isize, d);
            rest /= shape[d];
            at = at.zip(i).map(|(at, i)| at + i * stride);
            stride *= src_shape[d];
        }
        let Some(at) = at else { return };
        let src = &src[at..at + src_shape[0]];
        for k in (0..first).chain(first + straight..shape[0]) {
            dst[k] = columns[k].map_or(0.0, |i| src[i]);
        }
        if let Some(from) = columns[first] {
            let pieces = dst[first..first + straight].par_chunks_mut(ROW_PIECE);
            let sources = src[from..from + straight].par_chunks(ROW_PIECE);
            pieces.zip(sources).for_each(|(dst, src)| dst.copy_from_slice(src));
        }
    });
    dst
}

/// Combines an array with the box of a larger one that begins at `start`.
pub(crate) fn zip_box<const D: usize>(
    src: &[f32],
    src_shape: [usize; D],
    start: [usize; D],
    shape: [usize; D],
    dst: &mut [f32],
    zip: impl Fn(&mut f32, f32) + Sync,
) {
    use rayon::prelude::*;
    dst.par_chunks_mut(shape[0]).enumerate().for_each(|(row, dst)| {
        let (mut rest, mut at, mut stride) = (row, start[0], src_shape[0]);
        for d in 1..D {
            at += (start[d] + rest % shape[d]) * stride;
            rest /= shape[d];
            stride *= src_shape[d];
        }
        dst.iter_mut().zip(&src[at..at + shape[0]]).for_each(|(d, s)| zip(d, *s));
    });
}

/// Combines a box with the part of an array that begins at `start`.
pub(crate) fn put_box<const D: usize>(
    src: &[f32],
    src_shape: [usize; D],
    start: [usize; D],
    shape: [usize; D],
    dst: &mut [f32],
    put: impl Fn(&mut f32, f32) + Sync,
) {
    use rayon::prelude::*;
    dst.par_chunks_mut(shape[0]).enumerate().for_each(|(row, dst)| {
        let (mut rest, mut at, mut stride) = (row, 0, src_shape[0]);
        for d in 1..D {
            let i = (rest % shape[d]).wrapping_sub(start[d]);
            rest /= shape[d];
            if i >= src_shape[d] {
                return;
            }
            at += i * stride;
            stride *= src_shape[d];
        }
        let (dst, src) = (&mut dst[start[0]..start[0] + src_shape[0]], &src[at..at + src_shape[0]]);
        dst.iter_mut().zip(src).for_each(|(d, s)| put(d, *s));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_copied_with_zeros_or_mirrors_around() {
        let src: Vec<f32> = (1..=12).map(|v| v as f32).collect();
        let zero = copy_box(&src, [4, 3], [-1, 1], [3, 3], |_, _| None);
        assert_eq!(zero, [0.0, 5.0, 6.0, 0.0, 9.0, 10.0, 0.0, 0.0, 0.0]);
        let shape = [4, 3];
        let mirrored =
            copy_box(&src, shape, [-2, -1], [8, 2], |i, d| Some(inr_core::mirror(i, shape[d])));
        assert_eq!(mirrored[..8], [7.0, 6.0, 5.0, 6.0, 7.0, 8.0, 7.0, 6.0]);
        assert_eq!(mirrored[8..], [3.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0]);
    }

    #[test]
    fn alignment_needs_equal_pitch_and_whole_shifts() {
        let a = Domain::unit([10, 10]).unwrap();
        let b = Domain::unit([4, 4]).unwrap();
        assert_eq!(aligned_shift(&a, &b, &[3.0, -2.0]), Some([3, -2]));
        assert_eq!(aligned_shift(&a, &b, &[3.5, 0.0]), None);
        assert_eq!(aligned_shift(&a, &b.resized([8, 8]).unwrap(), &[3.0, 0.0]), None);
    }
}
