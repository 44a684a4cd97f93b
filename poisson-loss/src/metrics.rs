//! Numbers that say how good a blend is, for results of this crate and of others alike: one
//! operator, one `v`, float and unclipped.

pub(crate) mod points;
mod quadrature;
mod residual;
mod samples;
pub(crate) mod scene;

use inr_core::Samples;

use crate::{Error, Problem, Result};
use scene::Scene;

/// What a blend scores. `c` is the cubic spline through the result, `c_S` that through the
/// background, `Omega` the region, `v` the guidance.
///
/// Gradients are in value per reference pitch `h_ref`. Integrals over the signal are sums over
/// the reference discretisation: two points per knot interval and axis, at 1/4 and 3/4, none
/// beyond the outermost samples, and each with the region weight `m` of the sample cell it is in.
/// For soft masks and `feather` the gradient to follow is `grad c_S + guide (v - grad c_S)`, as
/// in the objective; it is called `v` below, and is `grad c_S` outside the region. Different
/// operators give different numbers: pixel differences do not compare with these.
#[derive(Debug, Clone, PartialEq)]
pub struct Metrics {
    /// Mean over the region of `|grad c - v|^2`, summed over channels and axes: squared value per
    /// squared reference pitch.
    pub m1: f64,
    /// Mean outside the region of `|c - c_S|^2`, summed over channels: squared value. 0 where
    /// nothing is outside.
    pub m2: f64,
    /// `500 |Omega| / |S| / C * m1`: the scale of the paper's tables.
    pub m1_paper: f64,
    /// `1000 (1 - |Omega| / |S|) / C * m2`: the scale of the paper's tables.
    pub m2_paper: f64,
    /// The problem's functional `J` with all its weights (`keep`, `ramp`, `band`), divided by
    /// `|Omega|`, the sum of the region's weights in samples. Dirichlet: the gradient term alone.
    pub objective: f64,
    /// `(J - J*) / J*`, where `J*` is the objective of the exact result. The difference is summed
    /// point by point, so that it keeps its digits when it is small; exactly 0 for equal results.
    pub excess_energy: Option<f64>,
    /// Root mean square difference to the exact result over all samples and channels.
    pub rmse_to_exact: Option<f64>,
    /// The same over the region's samples, weighted by the region.
    pub rmse_inside: Option<f64>,
    /// Root mean square over points and channels of the Poisson equation's residual
    /// `div (grad c - v) - (h_ref / l_in)^2 (c - c_T)` inside (the second term if the patch's
    /// colours are kept): value per squared reference pitch.
    ///
    /// Taken at knots and at the corners between them, where no quadrature point is, more than 3
    /// reference pitches (plus `feather`) inside cells of weight 1. Guidance may jump, so
    /// the divergence is that of a knot interval: along each axis the difference of
    /// `grad c - v` between half a pitch ahead and half a pitch behind. 0 without such points.
    pub pde_inside: f64,
    /// The same outside, of `-div grad (c - c_S) + (h_ref / l)^2 (c - c_S)`, over all of the
    /// signal more than 3 reference pitches away from the region. In the paper's objective the
    /// first term does not exist, with Dirichlet values the second.
    pub pde_outside: f64,
    /// Root mean square of `|grad c - v|` (norm over axes; mean over points and channels) in the
    /// cells whose centre is within 3 reference pitches of the region's boundary, on both sides.
    /// The boundary runs between samples of weight below and from 1/2. 0 without a boundary.
    pub seam_rms: f64,
    /// Largest `|grad c - v|` (norm over axes) of any channel at those points.
    pub seam_max: f64,
    /// Peak signal-to-noise ratio of the samples against the background's, weighted by `1 - m`,
    /// in decibels for a peak of 1. Infinite when nothing differs, as with fixed values.
    pub psnr_outside: f64,
    /// Share of the region's samples, weighted by the region, that have a channel outside
    /// `[0, 1]`: what an 8-bit export would clip.
    pub outside_unit_range: f64,
}

/// Measures a result, ours or somebody else's, as the cubic spline through its samples.
///
/// `exact` is the problem's exact solution ([`crate::solve`]); with it come the excess energy and
/// the distances. The whole background is compared, also where a solver does not look. Linear
/// time; memory is a few planes of the box around the region and everything that differs. The
/// numbers do not depend on the number of threads.
///
/// # Errors
/// As [`crate::solve`] for the problem itself; [`Error::Shape`] when a result has another shape
/// than the background, and [`Error::NotFinite`].
pub fn measure<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    result: &Samples<D, C>,
    exact: Option<&Samples<D, C>>,
) -> Result<Metrics> {
    let shape = problem.background.domain().shape();
    for samples in [Some(result), exact].into_iter().flatten() {
        let found = samples.domain().shape();
        if found != shape {
            return Err(Error::Shape { expected: shape.to_vec(), found: found.to_vec() });
        }
    }
    let scene = Scene::new(problem, result, exact)?;
    let integrals = quadrature::integrate(&scene);
    let pde = residual::residuals(&scene);
    let (plan, channels) = (&scene.plan, C as f64);
    let share = plan.measure / plan.total as f64;
    let whole: f64 = shape.iter().map(|n| (*n as f64 - 1.0).max(1.0)).product();
    let m1 = mean(integrals.gradient, integrals.inside);
    let m2 = mean(integrals.colour, whole - integrals.inside);
    let excess = |of_exact: f64| match integrals.gain {
        0.0 => 0.0,
        gain => gain / of_exact,
    };
    let on_samples = samples::compare(&scene, problem, result, exact);
    Ok(Metrics {
        m1,
        m2,
        m1_paper: 500.0 * share / channels * m1,
        m2_paper: 1000.0 * (1.0 - share) / channels * m2,
        objective: integrals.objective / plan.measure,
        excess_energy: exact.map(|_| excess(integrals.objective_of_exact)),
        rmse_to_exact: on_samples.to_exact,
        rmse_inside: on_samples.inside,
        pde_inside: pde.inside,
        pde_outside: pde.outside,
        seam_rms: mean(integrals.seam, channels * integrals.near).sqrt(),
        seam_max: integrals.seam_max,
        psnr_outside: on_samples.psnr_outside,
        outside_unit_range: on_samples.outside_unit_range,
    })
}

/// A mean; 0 over nothing.
fn mean(sum: f64, weight: f64) -> f64 {
    if weight > 0.0 { sum / weight } else { 0.0 }
}
