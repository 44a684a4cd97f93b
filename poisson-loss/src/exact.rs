use inr_core::Samples;
use rayon::prelude::*;

use crate::assembly::Initial;
use crate::axis::{Axis, ghost};
use crate::banded;
use crate::cg::{self, Convergence};
use crate::fused::FusedSystem;
use crate::multigrid::Multigrid;
use crate::operator::SplineOperator;
use crate::plain::PlainSystem;
use crate::plan::Plan;
use crate::problem::{Problem, put_box};
use crate::tile::Frame;
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
    progress: &mut (dyn FnMut(f32) + Send),
) -> Result<Blend<D, C>> {
    // Hundreds of short parallel loops: they start faster from inside the thread pool.
    rayon::scope(|_| solve_here(problem, progress))
}

fn solve_here<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    progress: &mut (dyn FnMut(f32) + Send),
) -> Result<Blend<D, C>> {
    let plan = Plan::new(problem)?;
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
    let mut samples = Samples::zeros(*problem.background.domain());
    copy(problem.background.as_planar(), samples.as_planar_mut());
    if D == 1 {
        let (changes, residual) = banded::solve(problem, &plan)?;
        for (c, change) in changes.iter().enumerate() {
            add_nodal(&plan, change, samples.plane_mut(c), problem.background.domain().shape());
        }
        (report.iterations, report.residual) = (1, residual);
        return Ok(Blend { samples, report });
    }
    let initial = Initial::new(problem, &plan)?;
    let mut system = Engine::new(&plan);
    let (inner, outer) = (initial.frame.shape, plan.frame.shape);
    let place: [usize; D] = std::array::from_fn(|d| initial.start[d] - plan.start[d]);
    for (c, (residual, change)) in initial.residual.into_iter().zip(initial.change).enumerate() {
        system.restart(|r| put_box(&residual, inner, place, outer, r, |r, v| *r = v));
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
        put_box(&change, inner, place, outer, system.x_mut(), |x, e| *x += e);
        add_nodal(&plan, system.x_mut(), samples.plane_mut(c), problem.background.domain().shape());
    }
    Ok(Blend { samples, report })
}

/// A copy by all threads: most of its time is the first touch of the new memory.
fn copy(src: &[f32], dst: &mut [f32]) {
    dst.par_chunks_mut(1 << 16)
        .zip(src.par_chunks(1 << 16))
        .for_each(|(d, s)| d.copy_from_slice(s));
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

    fn restart(&mut self, fill: impl FnOnce(&mut [f32])) {
        match self {
            Self::Plain(system) => system.restart(fill),
            Self::Fused(system) => system.restart(fill),
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

    fn x_mut(&mut self) -> &mut [f32] {
        match self {
            Self::Plain(system) => &mut system.x,
            Self::Fused(system) => &mut system.x,
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
    shape: [usize; D],
) {
    let frame = plan.frame;
    let n0 = frame.shape[0];
    let outermost: usize = shape[..D - 1].iter().product();
    let (first, count) = if D == 1 { (0, 1) } else { (plan.start[D - 1], frame.shape[D - 1]) };
    let slices = plane.par_chunks_mut(if D == 1 { shape[0] } else { outermost });
    slices.skip(first).take(count).enumerate().for_each_init(
        || vec![0.0f32; n0 + 2],
        |sum, (k, slice)| {
            let rows: usize = frame.shape[1..].iter().product::<usize>() / count;
            for row in k * rows..(k + 1) * rows {
                let at = plane_offset(plan, row, shape) % slice.len();
                nodal_row(&frame, coefficients, row, sum, &mut slice[at..at + n0]);
            }
        },
    );
}

/// Where a row of the box begins in a plane of the whole signal.
fn plane_offset<const D: usize>(plan: &Plan<D>, mut row: usize, shape: [usize; D]) -> usize {
    let (mut at, mut stride) = (plan.start[0], shape[0]);
    for d in 1..D {
        at += (plan.start[d] + row % plan.frame.shape[d]) * stride;
        row /= plan.frame.shape[d];
        stride *= shape[d];
    }
    at
}

/// Adds `P c`, `P = [1 4 1] / 6` along every axis, on one row of the box.
fn nodal_row<const D: usize>(
    frame: &Frame<D>,
    c: &[f32],
    row: usize,
    sum: &mut [f32],
    out: &mut [f32],
) {
    const TAPS: [f32; 3] = [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0];
    let n0 = out.len();
    sum.fill(0.0);
    for combination in 0..3usize.pow(D as u32 - 1) {
        let (mut rest, mut taps, mut at, mut stride, mut weight) =
            (row, combination, Some(0), n0, 1.0);
        for d in 1..D {
            let i = (rest % frame.shape[d]) as isize + (taps % 3) as isize - 1;
            at = at.zip(ghost(i, frame.shape[d], frame.ends[d])).map(|(at, i)| at + i * stride);
            weight *= TAPS[taps % 3];
            (rest, taps) = (rest / frame.shape[d], taps / 3);
            stride *= frame.shape[d];
        }
        let Some(at) = at else { continue };
        sum[1..=n0].iter_mut().zip(&c[at..at + n0]).for_each(|(s, c)| *s += weight * c);
    }
    for (edge, i) in [(0, -1), (n0 + 1, n0 as isize)] {
        sum[edge] = ghost(i, n0, frame.ends[0]).map_or(0.0, |i| sum[i + 1]);
    }
    for (v, s) in out.iter_mut().zip(sum.windows(3)) {
        *v += TAPS[0] * (s[0] + s[2]) + TAPS[1] * s[1];
    }
}
