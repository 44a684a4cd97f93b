//! Several half sweeps, and the residual they leave, in one pass over a level's vectors: a
//! pipeline over the planes of the outermost axis in which every half sweep follows one plane
//! behind the last, while its input is still in cache.
//!
//! Does what [`Level::half_sweep`] and [`Level::residual`] do, for a gradient weight of 1.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use super::{Level, PARALLEL_FROM, TASK, Vectors};
use crate::ring::Ring;

/// Half sweeps of one pass, and planes of the smallest task. A task recomputes one plane per half
/// sweep beyond both its ends.
const fn pass(dimension: usize) -> (usize, usize) {
    if dimension > 2 { (2, 24) } else { (4, 64) }
}

/// Relaxes `work.u` on the colours given, from zero if asked, and leaves `f - L u` in
/// `work.residual` if asked.
pub fn smooth<const D: usize>(
    level: &Level<D>,
    work: &mut Vectors,
    colours: &[usize],
    from_zero: bool,
    residual: bool,
) {
    if !level.gamma.is_empty() {
        return smooth_plainly(level, work, colours, from_zero, residual);
    }
    let planes = planes(level);
    let plane = level.len() / planes;
    let (group, least) = pass(D);
    let planes_per_task =
        if level.len() < PARALLEL_FROM { planes } else { TASK.div_ceil(plane).max(least) };
    let groups = colours.len().div_ceil(group);
    for (k, colours) in colours.chunks(group).enumerate() {
        let Vectors { u, f, spare, residual: left, rings } = &mut *work;
        let u_or_zero: &[f32] = if from_zero && k == 0 { &[] } else { u };
        let leaves = residual && k + 1 == groups;
        let pass = |rings: &mut Vec<Ring>, task: usize, out: &mut [f32], left: &mut [f32]| {
            dispatch(Pass {
                level,
                rows: plane / level.axes[0].len(),
                u: u_or_zero,
                f,
                colours,
                first: task * planes_per_task,
                out,
                residual: leaves.then_some(left),
                rings,
            });
        };
        if planes_per_task >= planes {
            pass(rings, 0, spare, left);
        } else {
            let tasks = spare.par_chunks_mut(planes_per_task * plane);
            let tasks = tasks.zip(left.par_chunks_mut(planes_per_task * plane)).enumerate();
            tasks.for_each_init(Vec::new, |rings, (task, (out, left))| {
                pass(rings, task, out, left);
            });
        }
        std::mem::swap(u, spare);
    }
}

/// Planes of the outermost axis; one dimension is a single plane.
fn planes<const D: usize>(level: &Level<D>) -> usize {
    if D > 1 { level.shape()[D - 1] } else { 1 }
}

/// The same, one pass per half sweep.
fn smooth_plainly<const D: usize>(
    level: &Level<D>,
    work: &mut Vectors,
    colours: &[usize],
    from_zero: bool,
    residual: bool,
) {
    if from_zero {
        work.u.fill(0.0);
    }
    colours.iter().for_each(|colour| level.half_sweep(work, *colour));
    if residual {
        level.residual(work);
    }
}

struct Pass<'a, const D: usize> {
    level: &'a Level<D>,
    /// Rows per plane.
    rows: usize,
    /// Empty for zero.
    u: &'a [f32],
    f: &'a [f32],
    colours: &'a [usize],
    /// First plane of the task.
    first: usize,
    out: &'a mut [f32],
    residual: Option<&'a mut [f32]>,
    /// What is loaded, and the result of every half sweep.
    rings: &'a mut Vec<Ring>,
}

impl<const D: usize> Pass<'_, D> {
    /// Loads a plane of `u`.
    #[inline(always)]
    fn load(&mut self, plane: usize) {
        let load = self.rings[0].at_mut(plane);
        let n = load.len();
        if !self.u.is_empty() {
            load.copy_from_slice(&self.u[plane * n..][..n]);
        }
    }

    /// A half sweep on one plane, from ring `stage - 1` into ring `stage`.
    #[inline(always)]
    fn half_sweep(&mut self, plane: usize, stage: usize) {
        let n0 = self.level.axes[0].len();
        let rows = self.rows;
        let (head, tail) = self.rings.split_at_mut(stage);
        let (src, dst) = (&head[stage - 1], &mut tail[0]);
        for row in 0..rows {
            let stencil = Stencil::new(self.level, src, plane, row, n0);
            let colour = stencil.index_sum + self.colours[stage - 1];
            let active = &self.level.checker[colour % 2..][..n0];
            let passive = &self.level.checker[(colour + 1) % 2..][..n0];
            let of_level = (plane * rows + row) * n0;
            let inverse = &self.level.inverse_diagonal[of_level..][..n0];
            let f = &self.f[of_level..][..n0];
            let u = src.shifted(plane, (row * n0) as isize, n0);
            let out = &mut dst.at_mut(plane)[row * n0..][..n0];
            if stage == 1 && self.u.is_empty() {
                for i in 0..n0 {
                    out[i] = active[i] * (f[i] * inverse[i]);
                }
            } else {
                for i in 0..n0 {
                    let new = (f[i] + stencil.sum(i)) * inverse[i];
                    out[i] = passive[i] * u[i] + active[i] * new;
                }
            }
        }
    }

    /// `f - L u` on one plane, into its place `at`.
    #[inline(always)]
    fn leave_residual(&mut self, plane: usize, at: usize) {
        let Some(residual) = &mut self.residual else { return };
        let n0 = self.level.axes[0].len();
        let src = &self.rings[self.colours.len()];
        let rows = self.rows;
        for row in 0..rows {
            let stencil = Stencil::new(self.level, src, plane, row, n0);
            let of_level = (plane * rows + row) * n0;
            let diagonal = &self.level.diagonal[of_level..][..n0];
            let f = &self.f[of_level..][..n0];
            let u = src.shifted(plane, (row * n0) as isize, n0);
            let out = &mut residual[at + row * n0..][..n0];
            for i in 0..n0 {
                out[i] = f[i] + stencil.sum(i) - u[i] * diagonal[i];
            }
        }
    }
}

impl<const D: usize> Kernel for Pass<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(mut self) {
        let planes = planes(self.level);
        let n = self.level.len() / planes;
        let (first, count, stages) = (self.first, self.out.len() / n, self.colours.len());
        let reach = if D > 2 { n / self.level.shape()[D - 2] } else { 1 };
        self.rings.resize_with(stages + 1, Ring::default);
        self.rings.iter_mut().for_each(|ring| ring.reset(4, n, reach));
        let extra = usize::from(self.residual.is_some());
        for step in first.saturating_sub(stages + extra)..first + count + stages + extra {
            for stage in 0..=stages {
                let beyond = stages - stage + extra;
                let needed = first.saturating_sub(beyond)..(first + count + beyond).min(planes);
                let Some(plane) = step.checked_sub(stage).filter(|k| needed.contains(k)) else {
                    continue;
                };
                if stage == 0 {
                    self.load(plane);
                } else {
                    self.half_sweep(plane, stage);
                }
                if stage == stages && (first..first + count).contains(&plane) {
                    self.out[(plane - first) * n..][..n]
                        .copy_from_slice(self.rings[stages].at(plane));
                }
            }
            let own = first..first + count;
            if let Some(plane) = step.checked_sub(stages + 1).filter(|k| own.contains(k)) {
                self.leave_residual(plane, (plane - first) * n);
            }
        }
    }
}

/// The neighbours of a row and the weights of their links.
struct Stencil<'a, const D: usize> {
    minus: &'a [f32],
    plus: &'a [f32],
    left: &'a [f32],
    right: &'a [f32],
    /// Along the other axes; entry 0 is not used.
    before: [&'a [f32]; D],
    after: [&'a [f32]; D],
    weights: [[f32; 2]; D],
    /// Sum of the row's indices: its parity is the colour of the first node.
    index_sum: usize,
}

impl<'a, const D: usize> Stencil<'a, D> {
    #[inline(always)]
    fn new(level: &'a Level<D>, src: &'a Ring, plane: usize, row: usize, n0: usize) -> Self {
        let at = (row * n0) as isize;
        let (left, right) = (src.shifted(plane, at - 1, n0), src.shifted(plane, at + 1, n0));
        let (mut before, mut after, mut weights) = ([left; D], [left; D], [[0.0; 2]; D]);
        let (mut rest, mut stride, mut index_sum) = (row, n0 as isize, 0);
        for d in 1..D {
            let axis = &level.axes[d];
            let mut i = plane;
            if d + 1 < D {
                i = rest % axis.len();
                rest /= axis.len();
            }
            index_sum += i;
            // A missing neighbour has no weight: what is read in its place is finite.
            weights[d] = [
                if i > 0 { axis.minus[i] } else { 0.0 },
                if i + 1 < axis.len() { axis.plus[i] } else { 0.0 },
            ];
            if d + 1 == D {
                before[d] = src.shifted(plane.wrapping_sub(1), at, n0);
                after[d] = src.shifted(plane + 1, at, n0);
            } else {
                before[d] = src.shifted(plane, at - stride, n0);
                after[d] = src.shifted(plane, at + stride, n0);
            }
            stride *= axis.len() as isize;
        }
        let [minus, plus] = &level.along_rows;
        let (minus, plus) = (&minus[..n0], &plus[..n0]);
        Self { minus, plus, left, right, before, after, weights, index_sum }
    }

    #[inline(always)]
    fn sum(&self, i: usize) -> f32 {
        let mut sum = self.minus[i] * self.left[i] + self.plus[i] * self.right[i];
        for d in 1..D {
            sum += self.weights[d][0] * self.before[d][i] + self.weights[d][1] * self.after[d][i];
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::{Axis, End};

    fn passes_match_single_sweeps<const D: usize>(shape: [usize; D], ends: [End; 2]) {
        let axes: [Axis; D] =
            std::array::from_fn(|d| Axis::uniform(shape[d], ends, 1.0 + d as f32));
        let n = shape.iter().product::<usize>();
        let wave = |k: usize, step: usize| (k * step % 101) as f32 / 50.0 - 1.0;
        let screening = (0..n).map(|k| 0.1 + 0.1 * wave(k, 7)).collect();
        let level = Level::new(axes, screening, Vec::new(), true);
        let start = || Vectors {
            u: (0..n).map(|k| wave(k, 13)).collect(),
            f: (0..n).map(|k| wave(k, 29)).collect(),
            ..Vectors::zeros(n)
        };
        for (colours, from_zero) in [(vec![0, 1, 0, 1, 0, 1], true), (vec![1, 0], false)] {
            let (mut fast, mut plain) = (start(), start());
            smooth(&level, &mut fast, &colours, from_zero, true);
            smooth_plainly(&level, &mut plain, &colours, from_zero, true);
            for (a, b) in [(&fast.u, &plain.u), (&fast.residual, &plain.residual)] {
                // Values of order one, summed in another order.
                let error = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(error < 1e-5, "{shape:?} {ends:?}: off by {error}");
            }
        }
    }

    #[test]
    fn passes_of_several_half_sweeps_match_single_ones() {
        for ends in [[End::Zero, End::Mirror], [End::Mirror, End::Zero], [End::Zero; 2]] {
            passes_match_single_sweeps([57], ends);
            passes_match_single_sweeps([33, 21], ends);
            // Several tasks.
            passes_match_single_sweeps([131, 301], ends);
            passes_match_single_sweeps([23, 29, 61], ends);
        }
    }
}
