//! Nearest-neighbour links with unit weight, solved by conjugate gradients with the multigrid
//! V-cycle: Poisson image editing and the paper's functional.

use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use super::stage::Stage;
use super::{report, row_starts};
use crate::axis::Axis;
use crate::cg::{self, Convergence, System};
use crate::multigrid::{Multigrid, Vectors};
use crate::plain::mask;
use crate::problem::Support;
use crate::{Blend, Error, Problem, Result};

/// Screening that stands for a fixed value in the preconditioner, per unit of the Laplacian's
/// diagonal: large against the smooth errors that the coarse levels treat.
const FIXED: f32 = 25.0;
/// Residual of a problem that f32 input leaves solved: rounding of values of order one.
const FLOOR: f64 = 1e-7;
/// Samples of one partial sum, at least; fixed, so that sums do not depend on the threads.
const CHUNK: usize = 1 << 14;

/// Equations 7 to 13 of Perez et al.
pub fn solve_pie<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    support: &Support<D>,
) -> Result<Blend<D, C>> {
    let inside = |m: f32| m >= 0.5;
    let whole = support.shape == problem.background.domain().shape();
    if whole && support.weight.iter().all(|m| inside(*m)) {
        return Err(Error::NoAnchor);
    }
    if !support.weight.iter().any(|m| inside(*m)) {
        return Err(Error::EmptyRegion);
    }
    let stage = Stage::new(problem, support)?;
    let free: Vec<bool> = stage.region.iter().map(|m| inside(*m)).collect();
    let fixed = FIXED * 2.0 * stage.alpha.iter().sum::<f32>();
    let screening = free.iter().map(|f| if *f { 0.0 } else { fixed }).collect();
    let links = Links {
        shape: stage.frame.shape,
        alpha: stage.alpha,
        screening: vec![0.0; free.len()],
        gamma: Vec::new(),
    };
    let system = LinkSystem::new(links, &stage, screening, free);
    let touching = |a: f32, b: f32| f32::from(inside(a) || inside(b));
    finish(problem, support, &stage, system, touching)
}

/// Per sample `|Omega|` times the paper's functional: link weight `gamma`, colour weight
/// `lambda |Omega| / |S - Omega| (1 - m)`.
pub fn solve_paper<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    support: &Support<D>,
    lambda: f32,
) -> Result<Blend<D, C>> {
    let outside = problem.background.domain().len() as f64 - support.measure;
    if outside <= 0.0 {
        return Err(Error::NoAnchor);
    }
    let stage = Stage::new(problem, support)?;
    let weight = (f64::from(lambda) * support.measure / outside) as f32;
    let screening: Vec<f32> = stage.region.iter().map(|m| weight * (1.0 - m)).collect();
    let links = Links {
        shape: stage.frame.shape,
        alpha: stage.alpha,
        screening: screening.clone(),
        gamma: stage.region.clone(),
    };
    let system = LinkSystem::new(links, &stage, screening, Vec::new());
    finish(problem, support, &stage, system, |a, b| 0.5 * (a + b))
}

/// Solves channel by channel and adds the change to the background.
fn finish<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    support: &Support<D>,
    stage: &Stage<'_, D, C>,
    mut system: LinkSystem<D>,
    share: impl Fn(f32, f32) -> f32 + Sync,
) -> Result<Blend<D, C>> {
    let (start, shape) = (stage.start, stage.frame.shape);
    let mut report = report(support, start, shape);
    let mut samples = problem.background.clone();
    let whole = samples.domain().shape();
    let (rhs, guess) = (stage.divergence(share), stage.guess());
    let options = &problem.options;
    for (c, (rhs, mut change)) in rhs.into_iter().zip(guess).enumerate() {
        mask(&system.free, &mut change);
        system.restart(rhs, &change);
        let Convergence { iterations, residual, energy, converged } = cg::solve(
            &mut system,
            f64::from(options.tolerance),
            options.max_iterations,
            FLOOR,
            &mut |_, _| {},
        );
        if !converged {
            return Err(Error::NotConverged { iterations, residual });
        }
        report.iterations = report.iterations.max(iterations);
        report.residual = report.residual.max(residual);
        report.excess += energy / support.measure;
        let plane = samples.plane_mut(c);
        for (row, at) in row_starts(start, shape, whole).enumerate() {
            for i in 0..shape[0] {
                let k = row * shape[0] + i;
                let change = change[k] + system.x[k];
                // Adding zero would turn a negative zero of the background.
                if change != 0.0 {
                    plane[at + i] += change;
                }
            }
        }
    }
    Ok(Blend { samples, report })
}

/// `A u = sum over links of alpha gamma (u_i - u_j) + s u`: every link counts the same, and none
/// leads out of the box.
///
/// This differs from a multigrid level on the signal's border only, where that halves the links
/// which lie in the border.
struct Links<const D: usize> {
    shape: [usize; D],
    alpha: [f32; D],
    screening: Vec<f32>,
    /// Region weight, or empty for links of weight 1; a link takes the mean of its ends.
    gamma: Vec<f32>,
}

impl<const D: usize> Links<D> {
    fn apply(&self, u: &[f32], out: &mut [f32]) {
        let (n0, rows) = (self.shape[0], CHUNK.div_ceil(self.shape[0]));
        out.par_chunks_mut(rows * n0).enumerate().for_each(|(task, out)| {
            dispatch(Apply { links: self, u, first_row: task * rows, out });
        });
    }

    #[inline(always)]
    fn couple(&self, a: usize, b: usize, alpha: f32, u: &[f32], out: &mut [f32]) {
        let n = out.len();
        let (ua, ub) = (&u[a..a + n], &u[b..b + n]);
        if self.gamma.is_empty() {
            for i in 0..n {
                out[i] += alpha * (ua[i] - ub[i]);
            }
        } else {
            let (ga, gb) = (&self.gamma[a..a + n], &self.gamma[b..b + n]);
            for i in 0..n {
                out[i] += alpha * 0.5 * (ga[i] + gb[i]) * (ua[i] - ub[i]);
            }
        }
    }
}

struct Apply<'a, const D: usize> {
    links: &'a Links<D>,
    u: &'a [f32],
    first_row: usize,
    out: &'a mut [f32],
}

impl<const D: usize> Kernel for Apply<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Links { shape, alpha, screening, .. } = self.links;
        let n0 = shape[0];
        for (r, out) in self.out.chunks_exact_mut(n0).enumerate() {
            let at = (self.first_row + r) * n0;
            let (s, u) = (&screening[at..at + n0], &self.u[at..at + n0]);
            for i in 0..n0 {
                out[i] = s[i] * u[i];
            }
            self.links.couple(at + 1, at, alpha[0], self.u, &mut out[1..]);
            self.links.couple(at, at + 1, alpha[0], self.u, &mut out[..n0 - 1]);
            let (mut rest, mut stride) = (self.first_row + r, n0);
            for d in 1..D {
                let i = rest % shape[d];
                rest /= shape[d];
                if i > 0 {
                    self.links.couple(at, at - stride, alpha[d], self.u, out);
                }
                if i + 1 < shape[d] {
                    self.links.couple(at, at + stride, alpha[d], self.u, out);
                }
                stride *= shape[d];
            }
        }
    }
}

/// The link system with its vectors.
struct LinkSystem<const D: usize> {
    links: Links<D>,
    multigrid: Multigrid<D>,
    work: Vec<Vectors>,
    /// Samples that may change; empty where all may.
    free: Vec<bool>,
    x: Vec<f32>,
    r: Vec<f32>,
    p: Vec<f32>,
    q: Vec<f32>,
    z: Vec<f32>,
}

impl<const D: usize> LinkSystem<D> {
    fn new<const C: usize>(
        links: Links<D>,
        stage: &Stage<'_, D, C>,
        screening: Vec<f32>,
        free: Vec<bool>,
    ) -> Self {
        let frame = stage.frame;
        let axes =
            std::array::from_fn(|d| Axis::uniform(frame.shape[d], frame.ends[d], stage.alpha[d]));
        let multigrid = Multigrid::new(axes, screening, links.gamma.clone());
        let zeros = || vec![0.0; frame.len()];
        let work = multigrid.vectors(0);
        Self {
            links,
            multigrid,
            work,
            free,
            x: zeros(),
            r: zeros(),
            p: zeros(),
            q: zeros(),
            z: zeros(),
        }
    }

    /// Starts on another right-hand side, from a first guess that is kept apart from `x`.
    fn restart(&mut self, rhs: Vec<f32>, guess: &[f32]) {
        self.r = rhs;
        self.links.apply(guess, &mut self.q);
        self.r.par_iter_mut().zip(&self.q).for_each(|(r, q)| *r -= q);
        mask(&self.free, &mut self.r);
        self.x.fill(0.0);
        self.p.fill(0.0);
    }
}

impl<const D: usize> System for LinkSystem<D> {
    /// The V-cycle approximates the inverse of `W^-1 A`, with `W` the node volumes: it is given
    /// `W^-1 r`, which makes the whole symmetric in the plain inner product.
    fn precondition(&mut self) -> f64 {
        let finest = &self.multigrid.levels[0];
        let n0 = self.links.shape[0];
        let f = &mut self.work[0].f;
        f.par_chunks_mut(n0).zip(self.r.par_chunks(n0)).enumerate().for_each(|(row, (f, r))| {
            let outer = finest.volume_row(row);
            for ((f, r), v) in f.iter_mut().zip(r).zip(&finest.axes[0].volume) {
                *f = r / (outer * v);
            }
        });
        self.multigrid.cycle(&mut self.work, 0);
        self.z.copy_from_slice(&self.work[0].u);
        mask(&self.free, &mut self.z);
        dot(&self.r, &self.z)
    }

    fn direction(&mut self, beta: f32) -> f64 {
        self.p.par_iter_mut().zip(&self.z).for_each(|(p, z)| *p = z + beta * *p);
        self.links.apply(&self.p, &mut self.q);
        mask(&self.free, &mut self.q);
        dot(&self.p, &self.q)
    }

    fn advance(&mut self, alpha: f32) {
        self.x.par_iter_mut().zip(&self.p).for_each(|(x, p)| *x += alpha * p);
        self.r.par_iter_mut().zip(&self.q).for_each(|(r, q)| *r -= alpha * q);
    }
}

/// `sum a b` in f64, in an order that the length alone decides.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let partial: Vec<f64> = a
        .par_chunks(CHUNK)
        .zip(b.par_chunks(CHUNK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum())
        .collect();
    partial.iter().sum()
}
