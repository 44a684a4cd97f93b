//! Multigrid for the screened nearest-neighbour Laplacian in any dimension:
//! `L u = sum_d w_d (u - neighbours) + s u` on the nodes of a box.
//!
//! One V-cycle is the preconditioner of every iterative solver of this crate. It is symmetric
//! under the node volumes: red-black sweeps before the coarse correction, black-red after it.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::axis::{Axis, Transfer};

/// Levels below this many samples are not worth a second thread.
const PARALLEL_FROM: usize = 20_000;
/// Samples of one task on larger levels; fixed, so that results do not depend on the threads.
const TASK: usize = 16_384;
/// Sweeps before and after the coarse correction: doubled per level up to this. One sweep
/// everywhere lets the iteration count grow with the size (13, 14, 16, 18 for 256..2048).
const MOST_SWEEPS: usize = 8;
/// Axes whose coupling is weaker than this share of the strongest are not coarsened yet.
const SEMI_COARSENING: f32 = 0.35;

/// One level: the operator and its work vectors.
pub struct Level<const D: usize> {
    pub axes: [Axis; D],
    /// Screening per node.
    pub screening: Vec<f32>,
    /// Weight of the squared gradient per node, or empty where it is 1; a link takes the mean of its ends.
    pub gamma: Vec<f32>,
    inverse_diagonal: Vec<f32>,
    /// 1, 0, 1, 0 ...: one entry longer than a row.
    checker: Vec<f32>,
    pub u: Vec<f32>,
    pub f: Vec<f32>,
    spare: Vec<f32>,
    pub to_coarse: Option<[Transfer; D]>,
}

/// The hierarchy below (and including) its finest level.
pub struct Multigrid<const D: usize> {
    pub levels: Vec<Level<D>>,
    coarsest: Dense,
}

impl<const D: usize> Multigrid<D> {
    /// Builds all levels from the finest one. `gamma` may be empty (weight 1 everywhere).
    pub fn new(axes: [Axis; D], screening: Vec<f32>, gamma: Vec<f32>) -> Self {
        Self::below(Level::new(axes, screening, gamma, true))
    }

    /// The same without work vectors on the finest level, for a solver that has its own.
    pub fn without_finest(axes: [Axis; D], screening: Vec<f32>) -> Self {
        Self::below(Level::new(axes, screening, Vec::new(), false))
    }

    fn below(finest: Level<D>) -> Self {
        let mut levels = vec![finest];
        while let Some(coarse) = levels.last_mut().expect("finest level").coarsen() {
            levels.push(coarse);
        }
        let coarsest = Dense::factor(levels.last().expect("finest level"));
        Self { levels, coarsest }
    }

    /// One V-cycle from `level` down: `levels[level].u` becomes an approximation of `L^-1 f`.
    pub fn cycle(&mut self, level: usize) {
        if level + 1 == self.levels.len() {
            let last = &mut self.levels[level];
            self.coarsest.solve(&last.f, &mut last.u);
            return;
        }
        let sweeps = (1usize << level.min(10)).min(MOST_SWEEPS);
        let fine = &mut self.levels[level];
        fine.u.fill(0.0);
        for _ in 0..sweeps {
            fine.half_sweep(0);
            fine.half_sweep(1);
        }
        fine.residual();
        let (head, tail) = self.levels.split_at_mut(level + 1);
        restrict(&head[level], &head[level].spare, &mut tail[0]);
        self.cycle(level + 1);
        let (head, tail) = self.levels.split_at_mut(level + 1);
        let fine = &mut head[level];
        let transfer = fine.to_coarse.as_ref().expect("a coarser level exists");
        prolong(transfer, &fine.axes, &tail[0], &mut fine.u, Prolong::Add);
        for _ in 0..sweeps {
            fine.half_sweep(1);
            fine.half_sweep(0);
        }
    }
}

/// Whether a prolongation replaces the fine values or is added to them.
#[derive(Clone, Copy, PartialEq)]
pub enum Prolong {
    Replace,
    Add,
}

impl<const D: usize> Level<D> {
    fn new(axes: [Axis; D], screening: Vec<f32>, gamma: Vec<f32>, vectors: bool) -> Self {
        let n = if vectors { screening.len() } else { 0 };
        let checker = (0..=axes[0].len()).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let mut level = Self {
            axes,
            checker,
            screening,
            gamma,
            inverse_diagonal: vec![0.0; n],
            u: vec![0.0; n],
            f: vec![0.0; n],
            spare: vec![0.0; n],
            to_coarse: None,
        };
        let mut diagonal = std::mem::take(&mut level.inverse_diagonal);
        let task = level.task();
        diagonal.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            let (rows, n0) = (out.len() / level.axes[0].len(), level.axes[0].len());
            for r in 0..rows {
                level.diagonal_row(k * task / n0 + r, &mut out[r * n0..(r + 1) * n0]);
            }
            out.iter_mut().for_each(|d| *d = 1.0 / *d);
        });
        level.inverse_diagonal = diagonal;
        level
    }

    pub fn shape(&self) -> [usize; D] {
        std::array::from_fn(|d| self.axes[d].len())
    }

    /// Samples per task: whole rows, fixed by the level's shape alone.
    fn task(&self) -> usize {
        let (n, n0) = (self.screening.len(), self.axes[0].len());
        if n < PARALLEL_FROM { n } else { TASK.div_ceil(n0) * n0 }
    }

    /// The next coarser level, or `None` when no axis can be coarsened.
    fn coarsen(&mut self) -> Option<Self> {
        let candidates: [Option<(Axis, Transfer)>; D] =
            std::array::from_fn(|d| self.axes[d].coarsen());
        let strongest = (0..D)
            .filter(|d| candidates[*d].is_some())
            .map(|d| self.axes[d].strength())
            .fold(0.0f32, f32::max);
        if candidates.iter().all(Option::is_none) {
            return None;
        }
        let mut axes = self.axes.clone();
        let mut candidates = candidates;
        let transfers = std::array::from_fn(|d| match candidates[d].take() {
            Some((axis, transfer)) if self.axes[d].strength() >= SEMI_COARSENING * strongest => {
                axes[d] = axis;
                transfer
            }
            _ => self.axes[d].identity(),
        });
        self.to_coarse = Some(transfers);
        let n = axes.iter().map(Axis::len).product();
        let mut screening = vec![0.0; n];
        restrict_into(self, &self.screening, &axes, &mut screening);
        let mut gamma = Vec::new();
        if !self.gamma.is_empty() {
            gamma = vec![0.0; n];
            restrict_into(self, &self.gamma, &axes, &mut gamma);
        }
        Some(Level::new(axes, screening, gamma, true))
    }

    /// Coordinates of a row: one index per axis, that of axis 0 being 0.
    fn row_index(&self, mut row: usize) -> [usize; D] {
        let mut index = [0; D];
        for d in 1..D {
            index[d] = row % self.axes[d].len();
            row /= self.axes[d].len();
        }
        index
    }

    /// Row numbers of the neighbours along axis `d >= 1` and their link weights; a missing
    /// neighbour is the row itself with weight 0.
    fn neighbours(&self, row: usize, index: &[usize; D], d: usize) -> [(usize, f32); 2] {
        let stride: usize = self.axes[1..d].iter().map(Axis::len).product();
        let (i, axis) = (index[d], &self.axes[d]);
        [
            if i > 0 { (row - stride, axis.minus[i]) } else { (row, 0.0) },
            if i + 1 < axis.len() { (row + stride, axis.plus[i]) } else { (row, 0.0) },
        ]
    }

    fn diagonal_row(&self, row: usize, out: &mut [f32]) {
        let n0 = out.len();
        let index = self.row_index(row);
        let at = row * n0;
        // A link to the fixed zero beyond a Zero end has no neighbour but counts in the diagonal.
        let outer: f32 =
            (1..D).map(|d| self.axes[d].minus[index[d]] + self.axes[d].plus[index[d]]).sum();
        for i in 0..n0 {
            out[i] = self.screening[at + i] + self.axes[0].minus[i] + self.axes[0].plus[i] + outer;
        }
        if self.gamma.is_empty() {
            return;
        }
        let g = |k: usize| self.gamma[k];
        for i in 0..n0 {
            let k = at + i;
            let axis = &self.axes[0];
            let mut diagonal = self.screening[k];
            diagonal += axis.minus[i] * if i > 0 { 0.5 * (g(k) + g(k - 1)) } else { g(k) };
            diagonal += axis.plus[i] * if i + 1 < n0 { 0.5 * (g(k) + g(k + 1)) } else { g(k) };
            for d in 1..D {
                let weights = [self.axes[d].minus[index[d]], self.axes[d].plus[index[d]]];
                for ((r, _), w) in self.neighbours(row, &index, d).into_iter().zip(weights) {
                    diagonal += w * 0.5 * (g(k) + g(r * n0 + i));
                }
            }
            // 1e-6: keeps a node finite that neither term reaches.
            out[i] = diagonal.max(1e-6);
        }
    }

    /// One row of a half sweep: Gauss-Seidel where `active` is 1, the old value where it is 0.
    #[inline(always)]
    fn sweep_row(&self, row: usize, active: &[f32], out: &mut [f32]) {
        let n0 = out.len();
        let at = row * n0;
        let (u, f, inverse) =
            (&self.u[at..at + n0], &self.f[at..at + n0], &self.inverse_diagonal[at..at + n0]);
        if n0 < 3 || !self.gamma.is_empty() {
            self.gather_row(&self.u, row, out);
            for i in 0..n0 {
                out[i] = (1.0 - active[i]) * u[i] + active[i] * ((f[i] + out[i]) * inverse[i]);
            }
            return;
        }
        let index = self.row_index(row);
        let outer =
            |d: usize| if d == 0 { [(row, 0.0); 2] } else { self.neighbours(row, &index, d) };
        let links: [[(usize, f32); 2]; D] = std::array::from_fn(outer);
        let (minus, plus) = (&self.axes[0].minus[..n0], &self.axes[0].plus[..n0]);
        for i in [0, n0 - 1] {
            let mut sum = f[i];
            for d in 1..D {
                let [(before, a), (after, b)] = links[d];
                sum += a * self.u[before * n0 + i] + b * self.u[after * n0 + i];
            }
            sum += if i == 0 { plus[i] * u[i + 1] } else { minus[i] * u[i - 1] };
            out[i] = (1.0 - active[i]) * u[i] + active[i] * (sum * inverse[i]);
        }
        let n = n0 - 2;
        let before: [&[f32]; D] = std::array::from_fn(|d| &self.u[links[d][0].0 * n0 + 1..][..n]);
        let after: [&[f32]; D] = std::array::from_fn(|d| &self.u[links[d][1].0 * n0 + 1..][..n]);
        let (left, right) = (&u[..n], &u[2..][..n]);
        let (u, f, inverse, active) =
            (&u[1..][..n], &f[1..][..n], &inverse[1..][..n], &active[1..][..n]);
        let (minus, plus, out) = (&minus[1..][..n], &plus[1..][..n], &mut out[1..][..n]);
        for i in 0..n {
            let mut sum = f[i] + minus[i] * left[i] + plus[i] * right[i];
            for d in 1..D {
                sum += links[d][0].1 * before[d][i] + links[d][1].1 * after[d][i];
            }
            out[i] = (1.0 - active[i]) * u[i] + active[i] * (sum * inverse[i]);
        }
    }

    /// `out[i] = ` weighted sum of the neighbours of node `i` of a row of `u`.
    #[inline(always)]
    fn gather_row(&self, u: &[f32], row: usize, out: &mut [f32]) {
        let n0 = out.len();
        let at = row * n0;
        let index = self.row_index(row);
        if !self.gamma.is_empty() {
            out.fill(0.0);
            return self.gather_row_weighted(u, row, &index, out);
        }
        let outer =
            |d: usize| if d == 0 { [(row, 0.0); 2] } else { self.neighbours(row, &index, d) };
        let links: [[(usize, f32); 2]; D] = std::array::from_fn(outer);
        let before: [&[f32]; D] = std::array::from_fn(|d| &u[links[d][0].0 * n0..][..n0]);
        let after: [&[f32]; D] = std::array::from_fn(|d| &u[links[d][1].0 * n0..][..n0]);
        for i in 0..n0 {
            let mut sum = 0.0;
            for d in 1..D {
                sum += links[d][0].1 * before[d][i] + links[d][1].1 * after[d][i];
            }
            out[i] = sum;
        }
        if n0 > 1 {
            let (u, minus, plus) =
                (&u[at..at + n0], &self.axes[0].minus[..n0], &self.axes[0].plus[..n0]);
            out[0] += plus[0] * u[1];
            out[n0 - 1] += minus[n0 - 1] * u[n0 - 2];
            let n = n0 - 2;
            let (left, right, out) = (&u[..n], &u[2..][..n], &mut out[1..][..n]);
            let (minus, plus) = (&minus[1..][..n], &plus[1..][..n]);
            for i in 0..n {
                out[i] += minus[i] * left[i] + plus[i] * right[i];
            }
        }
    }

    fn gather_row_weighted(&self, u: &[f32], row: usize, index: &[usize; D], out: &mut [f32]) {
        let n0 = out.len();
        let (at, g) = (row * n0, &self.gamma);
        for d in 1..D {
            for (r, w) in self.neighbours(row, index, d) {
                for i in 0..n0 {
                    out[i] += w * 0.5 * (g[at + i] + g[r * n0 + i]) * u[r * n0 + i];
                }
            }
        }
        for i in 0..n0 {
            let k = at + i;
            if i > 0 {
                out[i] += self.axes[0].minus[i] * 0.5 * (g[k] + g[k - 1]) * u[k - 1];
            }
            if i + 1 < n0 {
                out[i] += self.axes[0].plus[i] * 0.5 * (g[k] + g[k + 1]) * u[k + 1];
            }
        }
    }

    /// Gauss-Seidel on the nodes whose index sum has the parity of `colour`.
    fn half_sweep(&mut self, colour: usize) {
        let mut out = std::mem::take(&mut self.spare);
        let (task, n0) = (self.task(), self.axes[0].len());
        let this = &*self;
        if task >= out.len() {
            dispatch(HalfSweep { level: this, colour, first_row: 0, out: &mut out });
            self.spare = std::mem::replace(&mut self.u, out);
            return;
        }
        out.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            dispatch(HalfSweep { level: this, colour, first_row: k * task / n0, out });
        });
        self.spare = std::mem::replace(&mut self.u, out);
    }

    /// `spare = f - L u`.
    fn residual(&mut self) {
        let mut out = std::mem::take(&mut self.spare);
        let (task, n0) = (self.task(), self.axes[0].len());
        let this = &*self;
        out.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            dispatch(Apply {
                level: this,
                u: &this.u,
                f: Some(&this.f),
                first_row: k * task / n0,
                out,
            });
        });
        self.spare = out;
    }

    /// `out = L u`, the operator itself.
    pub fn apply(&self, u: &[f32], out: &mut [f32]) {
        let (task, n0) = (self.task(), self.axes[0].len());
        out.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            let first_row = k * task / n0;
            dispatch(Apply { level: self, u, f: None, first_row, out: &mut *out });
            out.iter_mut().for_each(|v| *v = -*v);
        });
    }

    /// The volume of a node: what makes `L` and the V-cycle symmetric.
    pub fn volume_row(&self, row: usize) -> f32 {
        let index = self.row_index(row);
        (1..D).map(|d| self.axes[d].volume[index[d]]).product()
    }
}

struct HalfSweep<'a, const D: usize> {
    level: &'a Level<D>,
    colour: usize,
    first_row: usize,
    out: &'a mut [f32],
}

impl<const D: usize> Kernel for HalfSweep<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let n0 = self.level.axes[0].len();
        for (r, out) in self.out.chunks_exact_mut(n0).enumerate() {
            let row = self.first_row + r;
            let index_sum: usize = self.level.row_index(row).iter().sum();
            let active = &self.level.checker[(index_sum + self.colour) % 2..][..n0];
            self.level.sweep_row(row, active, out);
        }
    }
}

struct Apply<'a, const D: usize> {
    level: &'a Level<D>,
    u: &'a [f32],
    f: Option<&'a [f32]>,
    first_row: usize,
    out: &'a mut [f32],
}

impl<const D: usize> Kernel for Apply<'_, D> {
    type Output = ();
    /// `out = f - L u`.
    #[inline(always)]
    fn run(self) {
        let n0 = self.level.axes[0].len();
        for (r, out) in self.out.chunks_exact_mut(n0).enumerate() {
            let row = self.first_row + r;
            self.level.gather_row(self.u, row, out);
            let inverse = &self.level.inverse_diagonal[row * n0..][..n0];
            let u = &self.u[row * n0..][..n0];
            match self.f {
                Some(f) => {
                    let f = &f[row * n0..][..n0];
                    for i in 0..n0 {
                        out[i] += f[i] - u[i] / inverse[i];
                    }
                }
                None => {
                    for i in 0..n0 {
                        out[i] -= u[i] / inverse[i];
                    }
                }
            }
        }
    }
}

/// `coarse.f = R fine_residual`.
pub fn restrict<const D: usize>(fine: &Level<D>, residual: &[f32], coarse: &mut Level<D>) {
    let mut f = std::mem::take(&mut coarse.f);
    restrict_into(fine, residual, &coarse.axes, &mut f);
    coarse.f = f;
}

fn restrict_into<const D: usize>(
    fine: &Level<D>,
    src: &[f32],
    coarse: &[Axis; D],
    dst: &mut [f32],
) {
    let transfer = fine.to_coarse.as_ref().expect("transfer is set before restriction");
    restrict_rows(transfer, fine.shape(), src, std::array::from_fn(|d| coarse[d].len()), dst);
}

/// Applies the separable restriction: for every coarse row the weighted sum of the fine rows
/// around it, then the same along the row.
pub fn restrict_rows<const D: usize>(
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

/// Linear interpolation of `coarse.u` to the finer nodes, replacing or adding to `dst`.
pub fn prolong<const D: usize>(
    transfer: &[Transfer; D],
    fine: &[Axis; D],
    coarse: &Level<D>,
    dst: &mut [f32],
    mode: Prolong,
) {
    let (n0, m0) = (fine[0].len(), coarse.axes[0].len());
    let rows = if dst.len() < PARALLEL_FROM { dst.len() / n0 } else { TASK.div_ceil(n0) };
    dst.par_chunks_mut(rows.max(1) * n0).enumerate().for_each_init(
        || (vec![0.0f32; m0], vec![0.0f32; n0]),
        |(sum, line), (task, dst)| {
            for (r, dst) in dst.chunks_exact_mut(n0).enumerate() {
                dispatch(ProlongRow {
                    transfer,
                    fine,
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
    fine: &'a [Axis; D],
    coarse: &'a Level<D>,
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
            entries[d] = self.transfer[d].prolong[rest % self.fine[d].len()];
            rest /= self.fine[d].len();
        }
        self.sum.fill(0.0);
        for combination in 0..1usize << (D - 1) {
            let (mut row, mut weight, mut stride) = (0, 1.0f32, 1);
            for d in 1..D {
                let next = combination >> (d - 1) & 1;
                row += (entries[d].0 + next) * stride;
                weight *= if next == 0 { entries[d].1 } else { entries[d].2 };
                stride *= self.coarse.axes[d].len();
            }
            if weight != 0.0 {
                let src = &self.coarse.u[row * m0..][..m0];
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

/// The coarsest level, solved directly by Cholesky factorisation in f64.
struct Dense {
    n: usize,
    lower: Vec<f64>,
    volume: Vec<f64>,
}

impl Dense {
    fn factor<const D: usize>(level: &Level<D>) -> Self {
        let (n, n0) = (level.u.len(), level.axes[0].len());
        let volume: Vec<f64> = (0..n)
            .map(|k| f64::from(level.volume_row(k / n0)) * f64::from(level.axes[0].volume[k % n0]))
            .collect();
        let (mut unit, mut column, mut a) = (vec![0.0f32; n], vec![0.0f32; n], vec![0.0f64; n * n]);
        for j in 0..n {
            unit.fill(0.0);
            unit[j] = 1.0;
            level.apply(&unit, &mut column);
            for i in 0..n {
                a[i * n + j] = volume[i] * f64::from(column[i]);
            }
        }
        for j in 0..n {
            let pivot = a[j * n + j] - (0..j).map(|k| a[j * n + k].powi(2)).sum::<f64>();
            // Without any screening the constant is free: a tiny pivot then leaves it at zero.
            let pivot = if pivot > 1e-7 * a[j * n + j] { pivot.sqrt() } else { f64::INFINITY };
            a[j * n + j] = pivot;
            for i in j + 1..n {
                let off = 0.5 * (a[i * n + j] + a[j * n + i]);
                let dot: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
                a[i * n + j] = (off - dot) / pivot;
            }
        }
        Self { n, lower: a, volume }
    }

    fn solve(&self, f: &[f32], u: &mut [f32]) {
        let n = self.n;
        let mut x: Vec<f64> = (0..n).map(|i| self.volume[i] * f64::from(f[i])).collect();
        for i in 0..n {
            let dot: f64 = (0..i).map(|k| self.lower[i * n + k] * x[k]).sum();
            x[i] = (x[i] - dot) / self.lower[i * n + i];
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| self.lower[k * n + i] * x[k]).sum();
            x[i] = (x[i] - dot) / self.lower[i * n + i];
        }
        for i in 0..n {
            u[i] = x[i] as f32;
        }
    }
}
