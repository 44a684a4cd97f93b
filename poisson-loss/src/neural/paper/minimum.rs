//! The least value that the paper's discrete loss has: a quadratic in the samples, solved without a network.

use inr_core::{Domain, Samples};
use rayon::prelude::*;

use super::super::first_sample;
use super::differences::{Differences, cropped};
use super::{PaperLoss, PaperOptions, put};
use crate::{Error, Problem, Result};

/// The minimum of the paper's discrete loss.
#[derive(Debug, Clone)]
pub struct DiscreteMinimum<const D: usize, const C: usize> {
    /// The values, in place of the background's on the part that was asked for.
    pub samples: Samples<D, C>,
    /// Their loss, before they were rounded to f32: no network can go below it.
    pub loss: PaperLoss,
    /// Iterations.
    pub iterations: usize,
    /// Residual reached, relative to that of the background.
    pub residual: f64,
}

/// Relative residual to stop at.
const TOLERANCE: f64 = 1e-8;
/// Rounds of f64 per iteration and unknown leave a residual of this size where there is nothing to do.
const FLOOR: f64 = 1e-14;
/// Terms of one partial sum; fixed, so that sums do not depend on the threads.
const CHUNK: usize = 1 << 12;

/// The minimum of the loss that [`train_paper`](super::train_paper) trains for, among all values of the samples: the
/// same differences, guidance, region and weights. Plain conjugate gradients in f64 from the background, to a
/// relative residual of 1e-8; the iterations grow with the region's diameter. Samples that the loss does not look
/// at ([`ColorTerm::Boundary`](super::ColorTerm::Boundary)) stay the background's. Signals are taken as samples,
/// whatever the options say.
///
/// # Errors
/// As [`train_paper`](super::train_paper), and [`Error::NotConverged`].
///
/// # Panics
/// If `on` is not a part of the background's lattice that holds the region.
pub fn discrete_minimum<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    on: &Domain<D>,
    options: &PaperOptions,
) -> Result<DiscreteMinimum<D, C>> {
    options.validate()?;
    // Beyond the samples that differences reach, the minimum is the background.
    let part = surroundings(problem, on)?;
    let differences = Differences::new(problem, on, options)?.on_part(problem, &part, options)?;
    let background = cropped(problem.background, &part);
    let mut x: Vec<[f64; C]> = background.iter().map(|v| v.map(f64::from)).collect();
    let zeros = || vec![[0.0f64; C]; x.len()];
    let (mut r, mut q) = (zeros(), zeros());
    differences.evaluate(&x, &mut r);
    r.iter_mut().flatten().for_each(|v| *v = -*v);
    let mut p = r.clone();
    let (mut rr, mut iterations) = (dot(&r, &r), 0);
    let first = rr;
    let target = (TOLERANCE * TOLERANCE * first).max(FLOOR * FLOOR);
    // Ten times the samples: in exact arithmetic one time would do.
    while rr > target {
        if iterations > 10 * x.len() {
            return Err(Error::NotConverged { iterations, residual: (rr / first).sqrt() });
        }
        differences.apply(&p, &mut q);
        let alpha = rr / dot(&p, &q);
        add(&mut x, alpha, &p);
        add(&mut r, -alpha, &q);
        let before = std::mem::replace(&mut rr, dot(&r, &r));
        let beta = rr / before;
        p.par_iter_mut().zip(&r).for_each(|(p, r)| (0..C).for_each(|c| p[c] = r[c] + beta * p[c]));
        iterations += 1;
    }
    let loss = differences.evaluate(&x, &mut q);
    let values: Vec<[f32; C]> = x.iter().map(|v| v.map(|v| v as f32)).collect();
    let samples = put(problem.background, &part, &values);
    let residual = if first > 0.0 { (rr / first).sqrt() } else { 0.0 };
    Ok(DiscreteMinimum { samples, loss, iterations, residual })
}

/// The region with two samples around it, within `on`.
fn surroundings<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    on: &Domain<D>,
) -> Result<Domain<D>> {
    let (support, start) = (problem.support()?, first_sample(problem.background.domain(), on));
    let low: [usize; D] = std::array::from_fn(|d| (support.start[d] - start[d]).saturating_sub(2));
    let high: [usize; D] = std::array::from_fn(|d| {
        (support.start[d] - start[d] + support.shape[d] + 2).min(on.shape()[d])
    });
    let shape = std::array::from_fn(|d| high[d] - low[d]);
    Ok(on.cropped(low, shape).expect("a part of a valid domain"))
}

fn dot<const C: usize>(a: &[[f64; C]], b: &[[f64; C]]) -> f64 {
    let part = |(a, b): (&[[f64; C]], &[[f64; C]])| -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let parts: Vec<f64> = a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).map(part).collect();
    parts.iter().sum()
}

fn add<const C: usize>(y: &mut [[f64; C]], factor: f64, x: &[[f64; C]]) {
    y.par_iter_mut().zip(x).for_each(|(y, x)| (0..C).for_each(|c| y[c] += factor * x[c]));
}
