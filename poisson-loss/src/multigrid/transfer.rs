//! Restriction and prolongation between two levels, separable in the axes.

use std::ops::Range;

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use super::{PARALLEL_FROM, TASK};
use crate::axis::Transfer;

/// The restriction of a level's values: for every coarse row the weighted sum of the fine rows
/// around it, then the same along the row.
pub fn restrict<const D: usize>(
    transfer: &[Transfer; D],
    fine: [usize; D],
    src: &[f32],
    coarse: [usize; D],
    dst: &mut [f32],
) {
    let m0 = coarse[0];
    let rows = if src.len() < PARALLEL_FROM { dst.len() / m0 } else { (TASK / 4).div_ceil(m0) };
    let rows = rows.max(1);
    dst.par_chunks_mut(rows * m0).enumerate().for_each_init(Vec::new, |sum, (task, dst)| {
        let from = Restriction { transfer, origin: [0; D], shape: fine, src };
        dispatch(RestrictRows { from, coarse, first: task * rows, sum, dst });
    });
}

struct RestrictRows<'a, const D: usize> {
    from: Restriction<'a, D>,
    coarse: [usize; D],
    first: usize,
    sum: &'a mut Vec<f32>,
    dst: &'a mut [f32],
}

impl<const D: usize> Kernel for RestrictRows<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let m0 = self.coarse[0];
        for (row, dst) in self.dst.chunks_exact_mut(m0).enumerate() {
            let (mut rest, mut index) = (self.first + row, [0; D]);
            for d in 1..D {
                index[d] = rest % self.coarse[d];
                rest /= self.coarse[d];
            }
            self.from.row(index, 0..m0, self.sum, dst);
        }
    }
}

/// Restriction from fine values on a box, by coarse rows.
#[derive(Clone, Copy)]
pub struct Restriction<'a, const D: usize> {
    pub transfer: &'a [Transfer; D],
    /// Fine index of the box's first node; negative beyond the level.
    pub origin: [isize; D],
    pub shape: [usize; D],
    pub src: &'a [f32],
}

impl<const D: usize> Restriction<'_, D> {
    /// The coarse indices along an axis whose middle fine node is one of `fine`.
    pub fn owned(transfer: &Transfer, fine: Range<usize>) -> Range<usize> {
        let before = |end: usize| {
            transfer.restrict.partition_point(|(start, weights)| start + weights.len() / 2 < end)
        };
        before(fine.start)..before(fine.end)
    }

    /// Coarse `columns` of the row at `index` (entry 0 is not used).
    #[inline(always)]
    pub fn row(
        &self,
        index: [usize; D],
        columns: Range<usize>,
        sum: &mut Vec<f32>,
        dst: &mut [f32],
    ) {
        let n0 = self.shape[0];
        let (mut taps, mut combinations) = ([(0usize, &[][..]); D], 1);
        for d in 1..D {
            let (start, weights) = &self.transfer[d].restrict[index[d]];
            taps[d] = (start.wrapping_add_signed(-self.origin[d]), weights);
            combinations *= weights.len();
        }
        sum.resize(n0, 0.0);
        let sum = &mut sum[..n0];
        sum.fill(0.0);
        for combination in 0..combinations {
            let (mut rest, mut row, mut weight, mut stride) = (combination, 0, 1.0f32, 1);
            for d in 1..D {
                let tap = rest % taps[d].1.len();
                rest /= taps[d].1.len();
                row += (taps[d].0 + tap) * stride;
                weight *= taps[d].1[tap];
                stride *= self.shape[d];
            }
            let src = &self.src[row * n0..][..n0];
            for i in 0..n0 {
                sum[i] += weight * src[i];
            }
        }
        restrict_line(&self.transfer[0].restrict[columns], sum, self.origin[0], dst);
    }
}

/// The restriction along one line that begins at fine index `origin`. Almost all nodes have the
/// weights 1/4, 1/2, 1/4 at stride 2.
#[inline(always)]
fn restrict_line(table: &[(usize, Vec<f32>)], src: &[f32], origin: isize, dst: &mut [f32]) {
    const FULL: [f32; 3] = [0.25, 0.5, 0.25];
    let full = |k: usize| table[k].1 == FULL;
    let place = |k: usize| table[k].0.wrapping_add_signed(-origin);
    let one =
        |k: usize| -> f32 { table[k].1.iter().zip(&src[place(k)..]).map(|(w, v)| w * v).sum() };
    let (mut lo, mut hi) = (0, dst.len());
    while lo < hi && !full(lo) {
        dst[lo] = one(lo);
        lo += 1;
    }
    while hi > lo && !full(hi - 1) {
        hi -= 1;
        dst[hi] = one(hi);
    }
    if lo < hi {
        for (v, s) in dst[lo..hi].iter_mut().zip(src[place(lo)..].windows(3).step_by(2)) {
            *v = 0.25 * (s[0] + s[2]) + 0.5 * s[1];
        }
    }
}

/// Adds the linear interpolation of coarse values to the finer nodes.
pub fn prolong<const D: usize>(prolongation: Prolongation<'_, D>, dst: &mut [f32]) {
    let (n0, m0) = (prolongation.fine[0], prolongation.coarse[0]);
    let rows = if dst.len() < PARALLEL_FROM { dst.len() / n0 } else { TASK.div_ceil(n0) }.max(1);
    dst.par_chunks_mut(rows * n0).enumerate().for_each_init(
        || (vec![0.0f32; m0], vec![0.0f32; n0]),
        |(sum, line), (task, dst)| {
            dispatch(ProlongRows { prolongation, first: task * rows, sum, line, dst });
        },
    );
}

struct ProlongRows<'a, const D: usize> {
    prolongation: Prolongation<'a, D>,
    first: usize,
    sum: &'a mut [f32],
    line: &'a mut [f32],
    dst: &'a mut [f32],
}

impl<const D: usize> Kernel for ProlongRows<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (n0, m0) = (self.line.len(), self.sum.len());
        for (row, dst) in self.dst.chunks_exact_mut(n0).enumerate() {
            self.prolongation.across_rows(self.first + row, 0..m0, self.sum);
            self.prolongation.along_row(0..n0, self.sum, 0, self.line);
            dst.iter_mut().zip(&*self.line).for_each(|(a, b)| *a += b);
        }
    }
}

/// Linear interpolation from a coarser level, by rows: first the outer axes, then along the row.
#[derive(Clone, Copy)]
pub struct Prolongation<'a, const D: usize> {
    pub transfer: &'a [Transfer; D],
    pub fine: [usize; D],
    pub coarse: [usize; D],
    /// Coarse values.
    pub src: &'a [f32],
}

impl<const D: usize> Prolongation<'_, D> {
    /// The coarse columns that fine ones see.
    #[inline(always)]
    pub fn seen(&self, columns: Range<usize>) -> Range<usize> {
        let table = &self.transfer[0].prolong;
        table[columns.start].0..(table[columns.end - 1].0 + 2).min(self.coarse[0])
    }

    /// Interpolates a fine row along the outer axes, on some coarse columns.
    #[inline(always)]
    pub fn across_rows(&self, row: usize, columns: Range<usize>, sum: &mut [f32]) {
        let mut entries = [(0usize, 0.0f32, 0.0f32); D];
        let mut rest = row;
        for d in 1..D {
            entries[d] = self.transfer[d].prolong[rest % self.fine[d]];
            rest /= self.fine[d];
        }
        let n = columns.len();
        let sum = &mut sum[..n];
        sum.fill(0.0);
        for combination in 0..1usize << (D - 1) {
            let (mut row, mut weight, mut stride) = (0, 1.0f32, 1);
            for d in 1..D {
                let next = combination >> (d - 1) & 1;
                row += (entries[d].0 + next) * stride;
                weight *= if next == 0 { entries[d].1 } else { entries[d].2 };
                stride *= self.coarse[d];
            }
            if weight != 0.0 {
                let src = &self.src[row * self.coarse[0] + columns.start..][..n];
                for i in 0..n {
                    sum[i] += weight * src[i];
                }
            }
        }
    }

    /// Interpolates along a row: fine columns from values at coarse columns that begin with
    /// `first`. In the regular part nodes take turns: a copy, then a mean.
    #[inline(always)]
    pub fn along_row(&self, columns: Range<usize>, sum: &[f32], first: usize, dst: &mut [f32]) {
        let (regular, pairs) = self.transfer[0].regular;
        let end = (regular + 2 * pairs).min(columns.end);
        let start = columns.start.max(regular);
        let start = start + (start - regular) % 2;
        let pairs = end.saturating_sub(start) / 2;
        let (from, to) =
            if pairs > 0 { (start, start + 2 * pairs) } else { (columns.end, columns.end) };
        for i in (columns.start..from).chain(to..columns.end) {
            dst[i - columns.start] = self.at(i, sum, first);
        }
        if pairs > 0 {
            let sum = &sum[self.transfer[0].prolong[start].0 - first..];
            let dst = &mut dst[from - columns.start..to - columns.start];
            for (pair, s) in dst.as_chunks_mut::<2>().0.iter_mut().zip(sum.windows(2)) {
                *pair = [s[0], 0.5 * (s[0] + s[1])];
            }
        }
    }

    /// One fine column of [`Prolongation::along_row`].
    #[inline(always)]
    pub fn at(&self, i: usize, sum: &[f32], first: usize) -> f32 {
        let (k, a, b) = self.transfer[0].prolong[i];
        a * sum[k - first] + if b == 0.0 { 0.0 } else { b * sum[k - first + 1] }
    }
}
