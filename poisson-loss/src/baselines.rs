//! The methods that the project compares itself with, on nearest-neighbour links where they are
//! gradient methods: what is in the literature and in other tools, solved exactly.

mod links;
mod neumann;
mod paste;
mod stage;

use crate::exact::Report;
use crate::problem::Support;
use crate::{Blend, Error, Problem, Result};

/// A method to compare with.
///
/// Links join neighbouring samples along an axis; `diff` on a link of axis `d` is
/// `h_ref / h_d * (c_j - c_i)`, the change per reference pitch. All links inside the signal count
/// the same, and none leads out of it: its border is free. Guidance is evaluated on links:
/// `strongest` compares the differences along one link (over all channels for
/// [`Strongest::Joint`](crate::Strongest::Joint); the other two rules coincide), and custom guidance sees the
/// jets of both signals' splines at the link's midpoint. The patch is mirrored beyond its border.
///
/// Of the problem's options only `tolerance` and `max_iterations` play a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Baseline {
    /// The patch's values, weighted by the region: `c_S + m (c_T - c_S)`.
    Paste,
    /// Classical Poisson image editing: the samples whose region weight is at least 1/2 follow
    /// `v` on every link they touch; all others keep the background's values, bit for bit.
    ///
    /// Source: Perez, Gangnet and Blake, "Poisson image editing", 2003, equations 7 to 13.
    Pie,
    /// The whole signal follows `grad c_S + m (v - grad c_S)` on links (`m`: mean of the ends'
    /// region weights) with free borders. The gradient leaves a constant open: the mean over the
    /// samples outside, weighted by `1 - m`, is the background's.
    Neumann,
    /// The paper's functional on links,
    /// `mean_Omega |diff - v|^2 + lambda mean_{S-Omega} |c - c_S|^2`; a link belongs to the region
    /// with the mean of its ends' weights, and the means are per sample.
    ///
    /// Source: Wu et al., "Neural Poisson Solver", 2024, section 3.2.
    PaperLinks {
        /// Weight of the colour term: positive and finite, useful from 1 to 10.
        lambda: f32,
    },
}

/// Solves a baseline, for any dimension and guidance; the result is float and not clipped.
///
/// `Pie` and `PaperLinks` take a linear-time iteration on the box around the region (to the
/// tolerance in the problem's options); `Neumann` is direct, `O(n log n)` in the samples of the whole background,
/// with two f64 buffers of its size. Results have the same bits for any number of threads. In the
/// report `residual` is relative: preconditioned for the iterations, the 2-norm for `Neumann`
/// (one "iteration"); `Paste` has neither.
///
/// # Errors
/// [`Error::NoAnchor`] when nothing is outside the region (not for `Paste`),
/// [`Error::EmptyRegion`], [`Error::Parameter`], [`Error::NotFinite`] and
/// [`Error::NotConverged`].
pub fn solve_baseline<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    baseline: Baseline,
) -> Result<Blend<D, C>> {
    problem.options.validate()?;
    let support = problem.support()?;
    match baseline {
        Baseline::Paste => paste::solve(problem, &support),
        Baseline::Pie => links::solve_pie(problem, &support),
        Baseline::Neumann => neumann::solve(problem, &support),
        Baseline::PaperLinks { lambda } if lambda > 0.0 && lambda.is_finite() => {
            links::solve_paper(problem, &support, lambda)
        }
        Baseline::PaperLinks { lambda } => Err(Error::Parameter {
            name: "lambda",
            rule: "positive and finite",
            value: f64::from(lambda),
        }),
    }
}

/// A report on nothing done yet.
fn report<const D: usize>(support: &Support<D>, start: [usize; D], shape: [usize; D]) -> Report {
    Report {
        iterations: 0,
        residual: 0.0,
        excess: 0.0,
        box_start: start.to_vec(),
        box_shape: shape.to_vec(),
        region_samples: support.measure,
        length: None,
        warnings: support.warnings.clone(),
    }
}

/// Flat indices, in an array of shape `whole`, where the rows of a box begin.
fn row_starts<const D: usize>(
    start: [usize; D],
    shape: [usize; D],
    whole: [usize; D],
) -> impl Iterator<Item = usize> {
    let rows: usize = shape[1..].iter().product();
    (0..rows).map(move |row| {
        let (mut rest, mut at, mut stride) = (row, start[0], whole[0]);
        for d in 1..D {
            at += (start[d] + rest % shape[d]) * stride;
            rest /= shape[d];
            stride *= whole[d];
        }
        at
    })
}
