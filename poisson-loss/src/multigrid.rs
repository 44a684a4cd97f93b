//! Multigrid for the screened nearest-neighbour Laplacian in any dimension:
//! `L u = sum_d w_d (u - neighbours) + s u` on the nodes of a box.
//!
//! One V-cycle is the preconditioner of every iterative solver of this crate. It is symmetric
//! under the node volumes: red-black sweeps before the coarse correction, black-red after it.

mod dense;
mod level;
mod smooth;
mod transfer;

use dense::Dense;
pub use level::{Level, Vectors};
use smooth::smooth;
pub use transfer::{Prolongation, Restriction};
use transfer::{prolong, restrict};

use crate::axis::Axis;

/// Levels below this many samples are not worth a second thread.
const PARALLEL_FROM: usize = 20_000;
/// Samples of one task on larger levels; fixed, so that results do not depend on the threads.
const TASK: usize = 16_384;
/// Sweeps before and after the coarse correction: doubled per level up to this. One sweep
/// everywhere lets the iteration count grow with the size (13, 14, 16, 18 for 256..2048).
const MOST_SWEEPS: usize = 8;

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

    /// The same without a smoother on the finest level, for a solver that has its own.
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

    /// Vectors for [`Multigrid::cycle`], those of levels finer than `from` empty.
    pub fn vectors(&self, from: usize) -> Vec<Vectors> {
        let sized =
            |(k, level): (usize, &Level<D>)| Vectors::zeros(if k < from { 0 } else { level.len() });
        self.levels.iter().enumerate().map(sized).collect()
    }

    /// One V-cycle from `level` down: `work[level].u` becomes an approximation of `L^-1 f`.
    pub fn cycle(&self, work: &mut [Vectors], level: usize) {
        let fine = &self.levels[level];
        let Some(coarse) = self.levels.get(level + 1) else {
            let Vectors { u, f, .. } = &mut work[level];
            return self.coarsest.solve(f, u);
        };
        let sweeps = (1usize << level.min(10)).min(MOST_SWEEPS);
        smooth(fine, &mut work[level], &[0, 1].repeat(sweeps), true, true);
        let transfer = fine.to_coarse.as_ref().expect("a coarser level exists");
        let (head, tail) = work.split_at_mut(level + 1);
        restrict(transfer, fine.shape(), &head[level].residual, coarse.shape(), &mut tail[0].f);
        self.cycle(work, level + 1);
        let (head, tail) = work.split_at_mut(level + 1);
        prolong(fine.prolongation(coarse, &tail[0].u), &mut head[level].u);
        smooth(fine, &mut work[level], &[1, 0].repeat(sweeps), false, false);
    }
}
