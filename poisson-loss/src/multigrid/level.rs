//! One level: the operator, its smoother, and the next coarser one.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use super::transfer::{Prolongation, restrict};
use super::{PARALLEL_FROM, TASK};
use crate::axis::{Axis, Transfer};
use crate::ring::Ring;

/// Axes whose coupling is weaker than this share of the strongest are not coarsened yet.
const SEMI_COARSENING: f32 = 0.35;

/// The operator of one level.
pub struct Level<const D: usize> {
    pub axes: [Axis; D],
    /// Screening per node.
    pub screening: Vec<f32>,
    /// Weight of the squared gradient per node, or empty where it is 1; a link takes the mean of its ends.
    pub gamma: Vec<f32>,
    /// Empty on a level that is not smoothed, like its inverse.
    pub diagonal: Vec<f32>,
    pub inverse_diagonal: Vec<f32>,
    /// 1, 0, 1, 0 ...: one entry longer than a row.
    pub checker: Vec<f32>,
    /// Weights of the links to the previous and next node of a row: zero where there is none.
    pub along_rows: [Vec<f32>; 2],
    pub to_coarse: Option<[Transfer; D]>,
}

/// The vectors of one level.
#[derive(Default)]
pub struct Vectors {
    pub u: Vec<f32>,
    pub f: Vec<f32>,
    pub spare: Vec<f32>,
    pub residual: Vec<f32>,
    /// Work space of a smoother that is a single task.
    pub rings: Vec<Ring>,
}

impl Vectors {
    pub fn zeros(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self { u: zeros(), f: zeros(), spare: zeros(), residual: zeros(), rings: Vec::new() }
    }
}

impl<const D: usize> Level<D> {
    pub fn new(axes: [Axis; D], screening: Vec<f32>, gamma: Vec<f32>, smoothed: bool) -> Self {
        let n = if smoothed { screening.len() } else { 0 };
        let checker = (0..=axes[0].len()).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let mut along_rows = [axes[0].minus.clone(), axes[0].plus.clone()];
        along_rows[0][0] = 0.0;
        along_rows[1][axes[0].len() - 1] = 0.0;
        let mut level = Self {
            along_rows,
            axes,
            checker,
            screening,
            gamma,
            diagonal: vec![0.0; n],
            inverse_diagonal: Vec::new(),
            to_coarse: None,
        };
        let mut diagonal = std::mem::take(&mut level.diagonal);
        let (task, n0) = (level.task(), level.axes[0].len());
        diagonal.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            for (r, out) in out.chunks_exact_mut(n0).enumerate() {
                level.diagonal_row(k * task / n0 + r, out);
            }
        });
        level.inverse_diagonal = diagonal.par_iter().map(|d| 1.0 / d).collect();
        level.diagonal = diagonal;
        level
    }

    pub fn len(&self) -> usize {
        self.shape().iter().product()
    }

    pub fn shape(&self) -> [usize; D] {
        std::array::from_fn(|d| self.axes[d].len())
    }

    /// Samples per task: whole rows, fixed by the level's shape alone.
    fn task(&self) -> usize {
        let (n, n0) = (self.len(), self.axes[0].len());
        if n < PARALLEL_FROM { n } else { TASK.div_ceil(n0) * n0 }
    }

    /// The next coarser level, or `None` when no axis can be coarsened.
    pub fn coarsen(&mut self) -> Option<Self> {
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
        let shape: [usize; D] = std::array::from_fn(|d| axes[d].len());
        let restricted = |values: &[f32]| {
            if values.is_empty() {
                return Vec::new();
            }
            let mut coarse = vec![0.0; shape.iter().product()];
            restrict(&transfers, self.shape(), values, shape, &mut coarse);
            coarse
        };
        let (screening, gamma) = (restricted(&self.screening), restricted(&self.gamma));
        self.to_coarse = Some(transfers);
        Some(Level::new(axes, screening, gamma, true))
    }

    /// The interpolation of values of the next coarser level.
    pub fn prolongation<'a>(&'a self, coarse: &Self, src: &'a [f32]) -> Prolongation<'a, D> {
        let transfer = self.to_coarse.as_ref().expect("a coarser level exists");
        Prolongation { transfer, fine: self.shape(), coarse: coarse.shape(), src }
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
    fn sweep_row(&self, all: &[f32], f: &[f32], row: usize, active: &[f32], out: &mut [f32]) {
        let n0 = out.len();
        let at = row * n0;
        let (u, f, inverse) =
            (&all[at..][..n0], &f[at..][..n0], &self.inverse_diagonal[at..][..n0]);
        self.gather_row(all, row, out);
        for i in 0..n0 {
            out[i] = (1.0 - active[i]) * u[i] + active[i] * ((f[i] + out[i]) * inverse[i]);
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
    pub fn half_sweep(&self, work: &mut Vectors, colour: usize) {
        let (task, n0) = (self.task(), self.axes[0].len());
        let Vectors { u, f, spare, .. } = &mut *work;
        spare.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            dispatch(HalfSweep { level: self, u, f, colour, first_row: k * task / n0, out });
        });
        std::mem::swap(u, spare);
    }

    /// `residual = f - L u`.
    pub fn residual(&self, work: &mut Vectors) {
        let (task, n0) = (self.task(), self.axes[0].len());
        let Vectors { u, f, residual, .. } = &mut *work;
        residual.par_chunks_mut(task).enumerate().for_each(|(k, out)| {
            dispatch(Apply { level: self, u, f: Some(f), first_row: k * task / n0, out });
        });
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
    u: &'a [f32],
    f: &'a [f32],
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
            self.level.sweep_row(self.u, self.f, row, active, out);
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
            let diagonal = &self.level.diagonal[row * n0..][..n0];
            let u = &self.u[row * n0..][..n0];
            match self.f {
                Some(f) => {
                    let f = &f[row * n0..][..n0];
                    for i in 0..n0 {
                        out[i] += f[i] - u[i] * diagonal[i];
                    }
                }
                None => {
                    for i in 0..n0 {
                        out[i] -= u[i] * diagonal[i];
                    }
                }
            }
        }
    }
}
