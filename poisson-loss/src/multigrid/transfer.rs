//! Restriction and prolongation between two levels, separable in the axes.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use super::{PARALLEL_FROM, TASK};
use crate::axis::Transfer;

/// Whether a prolongation replaces the fine values or is added to them.
#[derive(Clone, Copy, PartialEq)]
pub enum Prolong {
    Replace,
    Add,
}

/// Applies the separable restriction: for every coarse row the weighted sum of the fine rows
/// around it, then the same along the row.
pub fn restrict<const D: usize>(
    transfer: &[Transfer; D],
    fine: [usize; D],
    src: &[f32],
    coarse: [usize; D],
    dst: &mut [f32],
) {
    let (n0, m0) = (fine[0], coarse[0]);
    let rows_per_task =
        if src.len() < PARALLEL_FROM { dst.len() / m0 } else { (TASK / 4).div_ceil(m0) };
    dst.par_chunks_mut(rows_per_task.max(1) * m0).enumerate().for_each_init(
        || vec![0.0f32; n0],
        |sum, (task, dst)| {
            for (r, dst) in dst.chunks_exact_mut(m0).enumerate() {
                dispatch(RestrictRow {
                    transfer,
                    fine,
                    coarse,
                    src,
                    row: task * rows_per_task + r,
                    sum,
                    dst,
                });
            }
        },
    );
}

struct RestrictRow<'a, const D: usize> {
    transfer: &'a [Transfer; D],
    fine: [usize; D],
    coarse: [usize; D],
    src: &'a [f32],
    row: usize,
    sum: &'a mut [f32],
    dst: &'a mut [f32],
}

impl<const D: usize> Kernel for RestrictRow<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let n0 = self.fine[0];
        let (mut rest, mut taps, mut combinations) = (self.row, [(0usize, &[][..]); D], 1);
        for d in 1..D {
            let (start, weights) = &self.transfer[d].restrict[rest % self.coarse[d]];
            taps[d] = (*start, weights);
            combinations *= weights.len();
            rest /= self.coarse[d];
        }
        self.sum.fill(0.0);
        for combination in 0..combinations {
            let (mut rest, mut row, mut weight, mut stride) = (combination, 0, 1.0f32, 1);
            for d in 1..D {
                let tap = rest % taps[d].1.len();
                rest /= taps[d].1.len();
                row += (taps[d].0 + tap) * stride;
                weight *= taps[d].1[tap];
                stride *= self.fine[d];
            }
            let src = &self.src[row * n0..][..n0];
            for i in 0..n0 {
                self.sum[i] += weight * src[i];
            }
        }
        restrict_line(&self.transfer[0].restrict, self.sum, self.dst);
    }
}

/// The restriction along one line. Almost all nodes have the weights 1/4, 1/2, 1/4 at stride 2.
#[inline(always)]
fn restrict_line(table: &[(usize, Vec<f32>)], src: &[f32], dst: &mut [f32]) {
    const FULL: [f32; 3] = [0.25, 0.5, 0.25];
    let full = |k: usize| table[k].1 == FULL;
    let m = dst.len();
    let one = |k: usize| -> f32 {
        let (start, weights) = &table[k];
        weights.iter().zip(&src[*start..]).map(|(w, v)| w * v).sum()
    };
    let (mut lo, mut hi) = (0, m);
    while lo < m && !full(lo) {
        dst[lo] = one(lo);
        lo += 1;
    }
    while hi > lo && !full(hi - 1) {
        hi -= 1;
        dst[hi] = one(hi);
    }
    if lo < hi {
        let src = &src[table[lo].0..];
        for (v, s) in dst[lo..hi].iter_mut().zip(src.windows(3).step_by(2)) {
            *v = 0.25 * (s[0] + s[2]) + 0.5 * s[1];
        }
    }
}

/// Linear interpolation to the finer nodes, replacing or adding to `dst`.
pub fn prolong<const D: usize>(
    transfer: &[Transfer; D],
    fine: [usize; D],
    src: &[f32],
    coarse: [usize; D],
    dst: &mut [f32],
    mode: Prolong,
) {
    let (n0, m0) = (fine[0], coarse[0]);
    let rows = if dst.len() < PARALLEL_FROM { dst.len() / n0 } else { TASK.div_ceil(n0) };
    dst.par_chunks_mut(rows.max(1) * n0).enumerate().for_each_init(
        || (vec![0.0f32; m0], vec![0.0f32; n0]),
        |(sum, line), (task, dst)| {
            for (r, dst) in dst.chunks_exact_mut(n0).enumerate() {
                dispatch(ProlongRow {
                    transfer,
                    fine,
                    src,
                    coarse,
                    row: task * rows + r,
                    sum,
                    line,
                    dst,
                    mode,
                });
            }
        },
    );
}

struct ProlongRow<'a, const D: usize> {
    transfer: &'a [Transfer; D],
    fine: [usize; D],
    src: &'a [f32],
    coarse: [usize; D],
    row: usize,
    sum: &'a mut [f32],
    line: &'a mut [f32],
    dst: &'a mut [f32],
    mode: Prolong,
}

impl<const D: usize> Kernel for ProlongRow<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let m0 = self.sum.len();
        let mut entries = [(0usize, 0.0f32, 0.0f32); D];
        let mut rest = self.row;
        for d in 1..D {
            entries[d] = self.transfer[d].prolong[rest % self.fine[d]];
            rest /= self.fine[d];
        }
        self.sum.fill(0.0);
        for combination in 0..1usize << (D - 1) {
            let (mut row, mut weight, mut stride) = (0, 1.0f32, 1);
            for d in 1..D {
                let next = combination >> (d - 1) & 1;
                row += (entries[d].0 + next) * stride;
                weight *= if next == 0 { entries[d].1 } else { entries[d].2 };
                stride *= self.coarse[d];
            }
            if weight != 0.0 {
                let src = &self.src[row * m0..][..m0];
                for i in 0..m0 {
                    self.sum[i] += weight * src[i];
                }
            }
        }
        prolong_line(&self.transfer[0], self.sum, self.line);
        match self.mode {
            Prolong::Replace => self.dst.copy_from_slice(self.line),
            Prolong::Add => self.dst.iter_mut().zip(&*self.line).for_each(|(a, b)| *a += b),
        }
    }
}

/// Interpolation along one line. In the regular part nodes take turns: a copy, then a mean.
#[inline(always)]
fn prolong_line(transfer: &Transfer, src: &[f32], dst: &mut [f32]) {
    let (first, pairs) = transfer.regular;
    let end = first + 2 * pairs;
    for i in (0..first).chain(end..dst.len()) {
        let (k, a, b) = transfer.prolong[i];
        dst[i] = a * src[k] + if b == 0.0 { 0.0 } else { b * src[k + 1] };
    }
    if pairs > 0 {
        let src = &src[transfer.prolong[first].0..];
        for (pair, s) in dst[first..end].chunks_exact_mut(2).zip(src.windows(2)) {
            pair[0] = s[0];
            pair[1] = 0.5 * (s[0] + s[1]);
        }
    }
}
