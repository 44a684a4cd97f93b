use std::sync::Mutex;

use inr_core::Samples;
use rayon::prelude::*;

use crate::assembly::Initial;
use crate::axis::ghost;
use crate::cg::Convergence;
use crate::engine::Engine;
use crate::line;
use crate::plan::Plan;
use crate::problem::{Problem, put_box};
use crate::tile::Frame;
use crate::{Error, Result};

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
    let mut plan = Plan::new(problem)?;
    let options = &problem.options;
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
    if D == 1 {
        // The weights are in the plan; a long line has no room for them twice.
        plan.support.weight = Vec::new();
        let (changes, residual) = line::solve(problem, &plan)?;
        (report.iterations, report.residual) = (1, residual);
        let mut samples = copied(problem.background);
        for (c, change) in changes.iter().enumerate() {
            line::add_nodal(&plan, change, &mut samples.plane_mut(c)[plan.start[0]..]);
        }
        return Ok(Blend { samples, report });
    }
    let mut samples = copied(problem.background);
    let Initial { start, frame, change, residual } = Initial::new(problem, &plan)?;
    let place: [usize; D] = std::array::from_fn(|d| start[d] - plan.start[d]);
    let engine = Engine::new(&plan);
    let domain = *problem.background.domain();
    let shared = Mutex::new((progress, [0.0; C]));
    let solve_channel = |c: usize, plane: &mut [f32], residual: Vec<f32>, change: Vec<f32>| {
        let step = &mut |_: usize, residual: f64| {
            let share = (residual.ln() / f64::from(options.tolerance).ln()).clamp(0.0, 1.0);
            if let Ok(mut shared) = shared.lock() {
                let (progress, shares) = &mut *shared;
                shares[c] = share as f32;
                progress(shares.iter().sum::<f32>() / C as f32);
            }
        };
        let mut r = vec![0.0; plan.frame.len()];
        put_box(&residual, frame.shape, place, plan.frame.shape, &mut r, |r, v| *r = v);
        drop(residual);
        let (mut x, convergence) = engine.solve(r, options, step);
        put_box(&change, frame.shape, place, plan.frame.shape, &mut x, |x, e| *x += e);
        add_nodal(&plan, &x, plane, domain.shape());
        convergence
    };
    // Channels are independent: solved side by side they share their idle moments.
    let channels = samples.as_planar_mut().par_chunks_mut(domain.len());
    let channels = channels.zip(residual.into_par_iter().zip(change)).enumerate().with_max_len(1);
    let solved: Vec<Convergence> = channels
        .map(|(c, (plane, (residual, change)))| solve_channel(c, plane, residual, change))
        .collect();
    for Convergence { iterations, residual, energy, converged } in solved {
        if !converged {
            return Err(Error::NotConverged { iterations, residual });
        }
        report.iterations = report.iterations.max(iterations);
        report.residual = report.residual.max(residual);
        report.excess += energy / plan.measure;
    }
    Ok(Blend { samples, report })
}

/// A copy by all threads: most of its time is the first touch of the new memory.
fn copied<const D: usize, const C: usize>(src: &Samples<D, C>) -> Samples<D, C> {
    let mut dst = Samples::zeros(*src.domain());
    let pieces = dst.as_planar_mut().par_chunks_mut(1 << 16);
    pieces.zip(src.as_planar().par_chunks(1 << 16)).for_each(|(d, s)| d.copy_from_slice(s));
    dst
}

/// Adds the spline with these coefficients, at its knots, to the box's part of a plane.
pub(crate) fn add_nodal<const D: usize>(
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
