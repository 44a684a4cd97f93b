//! Between the box and a coarse lattice of splines on it: every `step`-th knot.
//!
//! Coarse splines are splines on the fine lattice too, so prolongation is exact: the coefficients of
//! `[1 4 6 4 1] / 8`, once per halving. Restriction is its adjoint.

use rayon::prelude::*;

use crate::axis::{End, ghost};
use crate::tile::Frame;

/// Samples of one task.
const TASK: usize = 1 << 14;

/// For every entry of the result along an axis: the first source entry and the weights from there.
pub type Table = Vec<(usize, Vec<f32>)>;

/// A coarse lattice on a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coarse<const D: usize> {
    /// Fine knots per coarse one, a power of two.
    pub step: usize,
    pub fine: Frame<D>,
    pub frame: Frame<D>,
}

impl<const D: usize> Coarse<D> {
    /// Every `step`-th knot. Beyond `Zero` ends the fixed zero is a coarse knot; at an upper end that the
    /// step does not meet the coarse lattice ends a little outside.
    pub fn new(fine: Frame<D>, step: usize) -> Self {
        assert!(step.is_power_of_two(), "halved again and again, not {step}");
        let shape = std::array::from_fn(|d| {
            let from = first_knot(fine.ends[d][0], step);
            let last = fine.shape[d] as isize - 1;
            match fine.ends[d][1] {
                End::Zero => ((last - from).max(0) as usize) / step + 1,
                End::Mirror => ((last - from).max(0) as usize).div_ceil(step) + 1,
            }
        });
        Self { step, fine, frame: Frame { shape, ends: fine.ends } }
    }

    /// Fine knot of coarse knot `j` along axis `d`.
    fn knot(&self, d: usize, j: isize) -> isize {
        first_knot(self.fine.ends[d][0], self.step) + j * self.step as isize
    }

    /// Prolongation along axis `d` of fine knots `start..start + len` from all coarse ones.
    pub fn prolongation(&self, d: usize, start: usize, len: usize) -> Table {
        let mask = two_scale(self.step);
        let reach = 2 * self.step as isize - 2;
        let (m, ends) = (self.frame.shape[d], self.frame.ends[d]);
        let row = |i: usize| {
            let i = i as isize;
            let nearest = (i - self.knot(d, 0)).div_euclid(self.step as isize);
            let mut entries = Vec::new();
            for j in nearest - 2..=nearest + 3 {
                let distance = i - self.knot(d, j);
                if let (true, Some(node)) = (distance.abs() <= reach, ghost(j, m, ends)) {
                    entries.push((node, mask[(distance + reach) as usize]));
                }
            }
            gathered(&entries)
        };
        (start..start + len).map(row).collect()
    }

    /// Restriction along axis `d`: what fine knots `start..start + len` give to all coarse ones.
    pub fn restriction(&self, d: usize, start: usize, len: usize) -> Table {
        let mask = two_scale(self.step);
        let reach = 2 * self.step as isize - 2;
        let (n, ends) = (self.fine.shape[d], self.fine.ends[d]);
        let row = |j: usize| {
            let knot = self.knot(d, j as isize);
            let mut entries = Vec::new();
            for i in knot - reach..=knot + reach {
                let inside = ghost(i, n, ends).and_then(|i| i.checked_sub(start));
                if let Some(inside) = inside.filter(|i| *i < len) {
                    entries.push((inside, mask[(i - knot + reach) as usize]));
                }
            }
            gathered(&entries)
        };
        (0..self.frame.shape[d]).map(row).collect()
    }

    /// Means over coarse cells along axis `d`: the share of fine samples `start..start + len`.
    pub fn means(&self, d: usize, start: usize, len: usize) -> Table {
        let n = self.fine.shape[d] as isize;
        let half = self.step as isize / 2;
        let row = |j: usize| {
            let knot = self.knot(d, j as isize);
            // Both ends of an even cell belong to two cells. A cell outside takes the nearest sample.
            let weight = |i: isize| if (i - knot).abs() == half && half > 0 { 0.5 } else { 1.0 };
            let cell = (knot - half).min(n - 1)..=(knot + half).max(0);
            let inside: Vec<isize> = cell.filter(|i| (0..n).contains(i)).collect();
            let total: f32 = inside.iter().map(|i| weight(*i)).sum();
            let of_block = inside.iter().filter(|i| (start..start + len).contains(&(**i as usize)));
            let entries: Vec<(usize, f32)> =
                of_block.map(|i| (*i as usize - start, weight(*i) / total)).collect();
            gathered(&entries)
        };
        (0..self.frame.shape[d]).map(row).collect()
    }
}

/// Fine knot of the first coarse one.
fn first_knot(end: End, step: usize) -> isize {
    match end {
        End::Zero => step as isize - 1,
        End::Mirror => 0,
    }
}

/// Fine coefficients of a coarse B-spline, at offsets `-(2 step - 2)..=2 step - 2`.
fn two_scale(step: usize) -> Vec<f32> {
    const MASK: [f64; 5] = [0.125, 0.5, 0.75, 0.5, 0.125];
    let mut mask = vec![1.0f64];
    for _ in 0..step.trailing_zeros() {
        let mut finer = vec![0.0; 2 * mask.len() + 3];
        for (k, v) in mask.iter().enumerate() {
            for (j, m) in MASK.iter().enumerate() {
                finer[2 * k + j] += v * m;
            }
        }
        mask = finer;
    }
    mask.into_iter().map(|v| v as f32).collect()
}

/// One row from entries in any order, added where they meet.
fn gathered(entries: &[(usize, f32)]) -> (usize, Vec<f32>) {
    let first = entries.iter().map(|e| e.0).min().unwrap_or(0);
    let end = entries.iter().map(|e| e.0 + 1).max().unwrap_or(0);
    let mut weights = vec![0.0; end - first];
    for (i, w) in entries {
        weights[i - first] += w;
    }
    (first, weights)
}

/// Applies one table per axis.
pub fn apply<const D: usize>(src: &[f32], shape: [usize; D], tables: &[Table; D]) -> Vec<f32> {
    let (mut shape, mut values) = (shape, src.to_vec());
    for (d, table) in tables.iter().enumerate() {
        let inner: usize = shape[..d].iter().product();
        let (n, m) = (shape[d], table.len());
        let mut next = vec![0.0f32; values.len() / n.max(1) * m];
        let rows = TASK.div_ceil(inner);
        next.par_chunks_mut(rows * inner).enumerate().for_each(|(task, out)| {
            for (row, out) in out.chunks_exact_mut(inner).enumerate() {
                let row = task * rows + row;
                let (line, (first, weights)) = (row / m, &table[row % m]);
                for (k, w) in weights.iter().enumerate() {
                    let src = &values[(line * n + first + k) * inner..][..inner];
                    out.iter_mut().zip(src).for_each(|(o, v)| *o += w * v);
                }
            }
        });
        (values, shape[d]) = (next, m);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_lattice(check: impl Fn(Coarse<1>)) {
        for n in [9, 21, 40, 64] {
            for lo in [End::Zero, End::Mirror] {
                for hi in [End::Zero, End::Mirror] {
                    for step in [1, 2, 4, 8] {
                        check(Coarse::new(Frame { shape: [n], ends: [[lo, hi]] }, step));
                    }
                }
            }
        }
    }

    fn spline(c: &[f32], ends: [End; 2], x: f64) -> f64 {
        let knot = x.floor();
        let weights = inr_core::cubic_weights(x - knot);
        let at = |k: usize| ghost(knot as isize - 1 + k as isize, c.len(), ends);
        (0..4).map(|k| at(k).map_or(0.0, |i| weights[k] * f64::from(c[i]))).sum()
    }

    #[test]
    fn prolongation_is_the_same_spline() {
        every_lattice(|coarse| {
            let (n, ends) = (coarse.fine.shape[0], coarse.fine.ends[0]);
            let m = coarse.frame.shape[0];
            let c: Vec<f32> = (0..m).map(|k| (k * 37 % 11) as f32 / 11.0).collect();
            let fine = apply(&c, [m], &[coarse.prolongation(0, 0, n)]);
            // Away from upper ends that the step does not meet.
            for i in 2..coarse.knot(0, m as isize - 3).min(n as isize - 3).max(2) {
                let x = (i as f64 + 0.3 - coarse.knot(0, 0) as f64) / coarse.step as f64;
                let (got, want) = (spline(&fine, ends, i as f64 + 0.3), spline(&c, ends, x));
                assert!((got - want).abs() < 1e-5, "{coarse:?} at {i}: {got}, expected {want}");
            }
        });
    }

    #[test]
    fn parts_of_restrictions_and_means_add_up() {
        every_lattice(|coarse| {
            let n = coarse.fine.shape[0];
            let values: Vec<f32> = (0..n).map(|k| (k * 29 % 13) as f32 / 13.0).collect();
            let parts = [(0, n / 3), (n / 3, n - n / 3)];
            for table in [Coarse::restriction, Coarse::means] {
                let whole = apply(&values, [n], &[table(&coarse, 0, 0, n)]);
                let part = |(a, len): (usize, usize)| {
                    apply(&values[a..a + len], [len], &[table(&coarse, 0, a, len)])
                };
                let (one, other) = (part(parts[0]), part(parts[1]));
                for k in 0..whole.len() {
                    assert!((whole[k] - one[k] - other[k]).abs() < 1e-5, "{coarse:?} at {k}");
                }
            }
            let ones = apply(&vec![1.0; n], [n], &[coarse.means(0, 0, n)]);
            assert!(ones.iter().all(|v| (v - 1.0).abs() < 1e-6), "{coarse:?}: {ones:?}");
        });
    }

    #[test]
    fn restriction_is_the_adjoint_of_prolongation() {
        every_lattice(|coarse| {
            let (n, m) = (coarse.fine.shape[0], coarse.frame.shape[0]);
            let last = coarse.knot(0, m as isize - 1);
            if coarse.fine.ends[0] == [End::Zero; 2] {
                let p = coarse.prolongation(0, 0, n);
                let r = coarse.restriction(0, 0, n);
                let entry = |(first, w): &(usize, Vec<f32>), k: usize| {
                    k.checked_sub(*first).and_then(|k| w.get(k)).copied().unwrap_or(0.0)
                };
                for i in 0..n.min(last as usize) {
                    for j in 0..m {
                        assert!((entry(&p[i], j) - entry(&r[j], i)).abs() < 1e-6);
                    }
                }
            }
        });
    }
}
