//! The correction of what blocks cannot see: a change of the whole region on a coarse lattice.

use super::local::{HALO, Local, Part};
use super::state::State;
use super::transfer::{Coarse, Table, apply};
use super::{BlockProblem, Boxed, COARSE_TOLERANCE};
use crate::engine::Engine;
use crate::plan::Plan;
use crate::problem::{copy_box, put_box};
use crate::{Error, Options, Result};

/// Coarse coefficients to be added to the change, one plane per channel.
pub struct Correction<const D: usize> {
    coarse: Coarse<D>,
    planes: Vec<Vec<f32>>,
}

impl<const D: usize> Correction<D> {
    /// Restricts the residual of all equations and solves for it; `done` hears of every block and may end it.
    pub fn solve<const C: usize>(
        problem: &BlockProblem<'_, D, C>,
        boxed: &Boxed<D>,
        coarse: &Coarse<D>,
        blocks: &[Part<D>],
        file: &State<D>,
        done: &mut dyn FnMut(usize) -> Result<()>,
    ) -> Result<Self> {
        let zeros = || vec![0.0f32; coarse.frame.len()];
        let (mut residuals, mut region) = (vec![zeros(); C], zeros());
        for (k, core) in blocks.iter().enumerate() {
            let wide = core.widened(HALO, boxed.frame.shape);
            let local = Local::load(problem, boxed, wide)?;
            let tables = |table: fn(&Coarse<D>, usize, usize, usize) -> Table| {
                std::array::from_fn(|d| table(coarse, d, core.start[d], core.shape[d]))
            };
            let weights = core.cut(&local.plan.region, &wide);
            add_restricted(coarse, core, &weights, tables(Coarse::means), &mut region);
            let operator = local.operator();
            for (c, sum) in residuals.iter_mut().enumerate() {
                let r = local.residual(&operator, c, &file.read(c, &wide)?);
                let r = core.cut(&r, &wide);
                add_restricted(coarse, core, &r, tables(Coarse::restriction), sum);
            }
            done(k + 1)?;
        }
        let step = coarse.step as f32;
        let keep = boxed.keep.map(|l| l / step);
        let plan = Plan::of_block(coarse.frame, region, boxed.length / step, keep);
        let engine = Engine::new(&plan);
        let options = Options { tolerance: COARSE_TOLERANCE, ..problem.options };
        // In coarse units the gradient's integral is `step^(2 - D)` times as large.
        let scale = step.powi(2 - D as i32);
        let mut planes = Vec::with_capacity(C);
        for mut r in residuals {
            r.iter_mut().for_each(|r| *r *= scale);
            let (x, convergence) = engine.solve(r, &options, &mut |_, _| {});
            if !convergence.converged {
                let (iterations, residual) = (convergence.iterations, convergence.residual);
                return Err(Error::NotConverged { iterations, residual });
            }
            planes.push(x);
        }
        Ok(Self { coarse: *coarse, planes })
    }

    /// Adds the correction to the change; returns its largest value.
    pub fn add(&self, boxed: &Boxed<D>, blocks: &[Part<D>], file: &mut State<D>) -> Result<f32> {
        let (mut largest, shape) = (0.0f32, self.coarse.frame.shape);
        debug_assert_eq!(boxed.frame, self.coarse.fine);
        for part in blocks {
            let tables: [Table; D] =
                std::array::from_fn(|d| self.coarse.prolongation(d, part.start[d], part.shape[d]));
            // The coarse knots that this part sees.
            let (lo, hi) = seen(&tables);
            let seen: [usize; D] = std::array::from_fn(|d| hi[d] - lo[d]);
            let tables = std::array::from_fn(|d| shifted(&tables[d], lo[d]));
            for (c, plane) in self.planes.iter().enumerate() {
                let from = copy_box(plane, shape, lo.map(|v| v as isize), seen, |_, _| None);
                let change = apply(&from, seen, &tables);
                largest = change.iter().fold(largest, |a, v| a.max(v.abs()));
                file.add(c, part, &change)?;
            }
        }
        Ok(largest)
    }
}

/// Adds what a part's values give to the coarse lattice.
fn add_restricted<const D: usize>(
    coarse: &Coarse<D>,
    part: &Part<D>,
    values: &[f32],
    tables: [Table; D],
    sum: &mut [f32],
) {
    if values.iter().all(|v| *v == 0.0) {
        return;
    }
    // The coarse knots that see anything of it.
    let bounds = |table: &Table| {
        let seen = |row: &&(usize, Vec<f32>)| !row.1.is_empty();
        let first = table.iter().position(|row| seen(&row)).unwrap_or(0);
        first..table.iter().rposition(|row| seen(&row)).map_or(first, |k| k + 1)
    };
    let ranges: [std::ops::Range<usize>; D] = std::array::from_fn(|d| bounds(&tables[d]));
    let tables: [Table; D] = std::array::from_fn(|d| tables[d][ranges[d].clone()].to_vec());
    let shape: [usize; D] = std::array::from_fn(|d| ranges[d].len());
    let start: [usize; D] = std::array::from_fn(|d| ranges[d].start);
    let restricted = apply(values, part.shape, &tables);
    put_box(&restricted, shape, start, coarse.frame.shape, sum, |s, v| *s += v);
}

/// First source entry of any row, and the one after the last, per axis.
fn seen<const D: usize>(tables: &[Table; D]) -> ([usize; D], [usize; D]) {
    let rows = |d: usize| tables[d].iter().filter(|row| !row.1.is_empty());
    let lo = std::array::from_fn(|d| rows(d).map(|row| row.0).min().unwrap_or(0));
    let hi = std::array::from_fn(|d| rows(d).map(|row| row.0 + row.1.len()).max().unwrap_or(1));
    (lo, hi)
}

/// The table for sources that begin with entry `first`.
fn shifted(table: &Table, first: usize) -> Table {
    table.iter().map(|(start, weights)| (start.saturating_sub(first), weights.clone())).collect()
}
