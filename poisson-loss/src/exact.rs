use inr_core::Samples;

use crate::assembly::Initial;
use crate::axis::Axis;
use crate::cg::{self, Convergence};
use crate::fused::FusedSystem;
use crate::multigrid::Multigrid;
use crate::operator::SplineOperator;
use crate::plain::PlainSystem;
use crate::plan::Plan;
use crate::problem::{Problem, copy_box};
use crate::{Error, Result};

/// Screening that stands for a fixed value in the preconditioner of Dirichlet problems, in units
/// of the Laplacian's coefficients.
const FIXED: f32 = 100.0;

/// Residual of a problem that f32 input leaves solved: rounding of values of order one.
const FLOOR: f64 = 1e-7;

/// What a solve did, for the user to read.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Most iterations of any channel.
    pub iterations: usize,
    /// Largest relative residual of any channel.
    pub residual: f64,
    /// Estimate of the objective's excess over its minimum, all channels (absolute).
    pub excess: f64,
    /// First background sample of the solved box.
    pub box_start: Vec<usize>,
    /// Samples of the solved box per axis.
    pub box_shape: Vec<usize>,
    /// Sum of the region's weights: its measure in samples.
    pub region_samples: f64,
    /// The coupling length in use, in the units of the domain.
    pub length: Option<f32>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// A blend.
#[derive(Debug, Clone, PartialEq)]
pub struct Blend<const D: usize, const C: usize> {
    /// The blended signal on the background's lattice. Outside the solved box it is the
    /// background bit for bit; inside it is not clamped to any range.
    pub samples: Samples<D, C>,
    /// What the solver did.
    pub report: Report,
}

impl<const D: usize, const C: usize> Blend<D, C> {
    /// The blend as a continuous field.
    pub fn to_field(&self) -> inr_core::Spline<D, C> {
        inr_core::Spline::interpolate(&self.samples)
    }
}

/// Blends exactly: the minimiser of the objective among all cubic splines with knots at the
/// background's samples, to the tolerance in the problem's options.
///
/// Cost is linear in the samples of the box around the region; the result has the same bits for
/// any number of threads.
///
/// # Errors
/// Every way in which the input can be wrong, and [`Error::NotConverged`].
pub fn solve<const D: usize, const C: usize>(problem: &Problem<'_, D, C>) -> Result<Blend<D, C>> {
    solve_with_progress(problem, &mut |_| {})
}

/// [`solve`] with a callback: the share of the work done, 0 to 1, as far as it can be told.
///
/// # Errors
/// As [`solve`].
pub fn solve_with_progress<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    progress: &mut dyn FnMut(f32),
) -> Result<Blend<D, C>> {
    let plan = Plan::new(problem)?;
    let initial = Initial::new(problem, &plan)?;
    let options = problem.options;
    let mut report = Report {
        iterations: 0,
        residual: 0.0,
        excess: 0.0,
        box_start: plan.start.to_vec(),
        box_shape: plan.frame.shape.to_vec(),
        region_samples: plan.measure,
        length: plan.length,
        warnings: plan.warnings.clone(),
    };
    let mut samples = problem.background.clone();
    let mut system = Engine::new(&plan);
    let to_box: [isize; D] =
        std::array::from_fn(|d| plan.start[d] as isize - initial.start[d] as isize);
    for c in 0..C {
        let widen = |values: &[f32]| {
            copy_box(values, initial.frame.shape, to_box, plan.frame.shape, |_, _| None)
        };
        system.restart(&widen(&initial.residual[c]));
        let step = &mut |_: usize, residual: f64| {
            let share = (residual.ln() / f64::from(options.tolerance).ln()).clamp(0.0, 1.0);
            progress((c as f32 + share as f32) / C as f32);
        };
        let Convergence { iterations, residual, energy, converged } =
            system.solve(f64::from(options.tolerance), options.max_iterations, FLOOR, step);
        if !converged {
            return Err(Error::NotConverged { iterations, residual });
        }
        report.iterations = report.iterations.max(iterations);
        report.residual = report.residual.max(residual);
        report.excess += energy / plan.measure;
        let mut change = widen(&initial.change[c]);
        change.iter_mut().zip(system.x()).for_each(|(e, x)| *e += x);
        add_nodal(&plan, &change, samples.plane_mut(c), &problem.background.domain().shape());
    }
    Ok(Blend { samples, report })
}

/// The fused system where it applies, the plain one elsewhere.
enum Engine<const D: usize> {
    Plain(Box<PlainSystem<D>>),
    Fused(Box<FusedSystem<D>>),
}

impl<const D: usize> Engine<D> {
    fn new(plan: &Plan<D>) -> Self {
        let small = (0..D).all(|d| plan.frame.shape[d] < 8);
        if !plan.gamma.is_empty() || !plan.free.is_empty() || small {
            return Self::Plain(Box::new(plain_system(plan)));
        }
        let screening = plan.screening();
        let axes = axes(plan);
        let multigrid = Multigrid::without_finest(axes, screening.clone());
        if multigrid.levels.len() < 2 {
            return Self::Plain(Box::new(plain_system(plan)));
        }
        let operator =
            SplineOperator { frame: plan.frame, alpha: plan.alpha, screening, gamma: Vec::new() };
        Self::Fused(Box::new(FusedSystem::new(operator, multigrid)))
    }

    fn restart(&mut self, residual: &[f32]) {
        match self {
            Self::Plain(system) => system.restart(residual.to_vec()),
            Self::Fused(system) => system.restart(|r| r.copy_from_slice(residual)),
        }
    }

    fn solve(
        &mut self,
        tolerance: f64,
        most: usize,
        floor: f64,
        step: &mut dyn FnMut(usize, f64),
    ) -> Convergence {
        match self {
            Self::Plain(system) => cg::solve(&mut **system, tolerance, most, floor, step),
            Self::Fused(system) => cg::solve(&mut **system, tolerance, most, floor, step),
        }
    }

    fn x(&self) -> &[f32] {
        match self {
            Self::Plain(system) => &system.x,
            Self::Fused(system) => &system.x,
        }
    }
}

fn axes<const D: usize>(plan: &Plan<D>) -> [Axis; D] {
    std::array::from_fn(|d| Axis::uniform(plan.frame.shape[d], plan.frame.ends[d], plan.alpha[d]))
}

fn plain_system<const D: usize>(plan: &Plan<D>) -> PlainSystem<D> {
    let screening = plan.screening();
    let axes = std::array::from_fn(|d| {
        Axis::uniform(plan.frame.shape[d], plan.frame.ends[d], plan.alpha[d])
    });
    let nodal = if plan.free.is_empty() {
        screening.clone()
    } else {
        plan.free.iter().zip(&screening).map(|(f, s)| if *f { *s } else { FIXED }).collect()
    };
    let multigrid = Multigrid::new(axes, nodal, plan.gamma.clone());
    let operator = SplineOperator {
        frame: plan.frame,
        alpha: plan.alpha,
        screening,
        gamma: plan.gamma.clone(),
    };
    PlainSystem::new(operator, multigrid, plan.free.clone())
}

/// Adds the spline with these coefficients, at its knots, to the box's part of a plane.
fn add_nodal<const D: usize>(
    plan: &Plan<D>,
    coefficients: &[f32],
    plane: &mut [f32],
    shape: &[usize; D],
) {
    let frame = plan.frame;
    let mut nodal = coefficients.to_vec();
    let mut stride = 1;
    for d in 0..D {
        let old = nodal.clone();
        let (n, ends) = (frame.shape[d], frame.ends[d]);
        for (k, v) in nodal.iter_mut().enumerate() {
            let i = k / stride % n;
            let at = |j: isize| {
                crate::axis::ghost(i as isize + j, n, ends)
                    .map_or(0.0, |p| old[k - i * stride + p * stride])
            };
            *v = (at(-1) + 4.0 * at(0) + at(1)) / 6.0;
        }
        stride *= n;
    }
    let n0 = frame.shape[0];
    for (row, values) in nodal.chunks_exact(n0).enumerate() {
        let (mut rest, mut at, mut stride) = (row, plan.start[0], shape[0]);
        for d in 1..D {
            at += (plan.start[d] + rest % frame.shape[d]) * stride;
            rest /= frame.shape[d];
            stride *= shape[d];
        }
        plane[at..at + n0].iter_mut().zip(values).for_each(|(v, e)| *v += e);
    }
}
