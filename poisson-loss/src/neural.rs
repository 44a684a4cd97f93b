//! Blends as networks: trained on the exact solution, then on the objective itself.

mod paper;
mod stage;

use std::time::{Duration, Instant};

use inr_core::{Domain, Field, Jet, Lattice, Order, Samples, Trainer};

use crate::{Blend, Error, Problem, Result};
use stage::Stage;

pub use paper::{
    ColorTerm, DiscreteMinimum, PaperBlend, PaperLoss, PaperOptions, PaperProgress, PaperSignals,
    PaperStart, PaperWeights, Stencil, discrete_minimum, paper_loss, train_paper,
};

/// When a neural blend ends, and how it gets there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeuralOptions {
    /// Steps in all; the schedule is laid over them.
    pub steps: u64,
    /// Time from the call, staging included; the schedule is laid over it if it is the tighter limit, and then
    /// the result depends on the machine.
    pub budget: Option<Duration>,
    /// Stop when the root mean square distance to the exact solution on the last batches is below this, in units of
    /// the values.
    pub tolerance: Option<f64>,
    /// Share of the training (0..1) that follows the exact solution, value and gradient; the rest minimises the
    /// objective as it is. Both have the same minimum, because the objective of a field exceeds that of the exact
    /// solution by the squared distance of the two in the objective's own norm; but a batch of the first has no
    /// noise from what cannot be fitted.
    pub distill: f64,
}

impl Default for NeuralOptions {
    /// 2000 steps, nine tenths of them on the exact solution.
    fn default() -> Self {
        Self { steps: 2000, budget: None, tolerance: None, distill: 0.9 }
    }
}

/// Where a neural blend stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeuralProgress {
    /// Steps taken.
    pub step: u64,
    /// How far along, 0..1.
    pub progress: f64,
    /// Seconds since the call.
    pub seconds: f64,
    /// Mean of the loss over the last batches, per sample: first of the distance in the objective's norm, then
    /// of the objective.
    pub loss: f64,
    /// Root mean square, over channels too, of what the gradient misses of the exact solution's, per reference pitch.
    pub residual: f64,
    /// Root mean square distance to the exact solution, over channels too, in units of the values.
    pub distance: f64,
}

/// How a neural blend ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeuralReport {
    /// The last progress.
    pub last: NeuralProgress,
    /// Seconds of the staging: evaluation of everything that batches need.
    pub staging: f64,
}

/// The lattice that a network should be trained on to stand for the blend where it differs from the background: the
/// box the exact solver worked on.
///
/// # Panics
/// If the blend is not one of this problem.
pub fn neural_box<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    exact: &Blend<D, C>,
) -> Domain<D> {
    let box_of = |v: &[usize]| -> [usize; D] { std::array::from_fn(|d| v[d]) };
    let (start, shape) = (box_of(&exact.report.box_start), box_of(&exact.report.box_shape));
    problem.background.domain().cropped(start, shape).expect("a box of the background")
}

/// Trains a network to be the blend on a part of the background's lattice, `on`: [`neural_box`], or the whole domain.
///
/// The quadrature of the objective is the reference discretisation's: two points per knot interval and axis, one of
/// the `2^D` sub-lattices per step, thinned to the trainer's batch. Everything batches need is evaluated once; that
/// takes `2^D (2 C (1 + D) + 3)` floats per sample of `on`.
///
/// `report` is called before each step; if it returns false, the training stops there.
///
/// # Errors
/// As [`solve`](crate::solve); [`Error::NoGradient`] for a network whose gradient cannot stand in a loss;
/// [`Error::Network`] for a divergence, with the trainer at its last good state.
///
/// # Panics
/// If `on` is not a part of the background's lattice that holds the region.
pub fn train_blend<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    exact: &Blend<D, C>,
    on: &Domain<D>,
    trainer: &mut Trainer<D, C>,
    options: &NeuralOptions,
    mut report: impl FnMut(&NeuralProgress) -> bool,
) -> Result<NeuralReport> {
    if !trainer.network.architecture().has_continuous_gradient() {
        return Err(Error::NoGradient);
    }
    let begin = Instant::now();
    let stage = Stage::new(problem, exact, on)?;
    let staging = begin.elapsed().as_secs_f64();
    let lattice = Lattice::new(on.shape(), trainer.options.batch);
    let (mut indices, mut x) = (Vec::new(), Vec::new());
    let mut last = NeuralProgress {
        step: trainer.steps(),
        progress: 0.0,
        seconds: staging,
        loss: 0.0,
        residual: 0.0,
        distance: 0.0,
    };
    let first = trainer.steps();
    let mut was_distill = true;
    while trainer.steps() < options.steps {
        let spent = begin.elapsed().as_secs_f64();
        let of_time = options.budget.map_or(0.0, |b| spent / b.as_secs_f64().max(1e-9));
        if of_time >= 1.0 {
            break;
        }
        let step = trainer.steps();
        let progress = (step as f64 / options.steps as f64).max(of_time);
        lattice.batch(trainer.options.seed, step >> D, &mut indices);
        let half = step as usize & ((1 << D) - 1);
        x.clear();
        x.extend(indices.iter().map(|k| stage.position(half, *k)));
        let distill = stage.is_fixed() || progress < options.distill;
        let loss = |first: usize, y: &[Jet<D, C>], y_bar: &mut [Jet<D, C>]| {
            stage.loss(half, &indices[first..], y, y_bar, distill)
        };
        let scale = 1.0 / indices.len().max(1) as f64;
        let per_channel = scale / C as f64;
        let sums = stage.with_sums(|| trainer.accumulate(&x, Order::Jet, &loss));
        // Means over about ten batches.
        let taken = step - first;
        let mean = |old: f64, new: f64| if taken == 0 { new } else { old + 0.1 * (new - old) };
        last = NeuralProgress {
            step,
            progress,
            seconds: begin.elapsed().as_secs_f64(),
            loss: mean(last.loss, sums.loss * scale),
            residual: mean(last.residual, (sums.gradient * per_channel).sqrt()),
            distance: mean(last.distance, (sums.value * per_channel).sqrt()),
        };
        // A network that begins there needs no training; one that comes there has to stay a while.
        let close =
            options.tolerance.is_some_and(|t| last.distance < t && (taken == 0 || taken > 20));
        if !report(&last) || close {
            break;
        }
        if distill != was_distill {
            trainer.forget_losses();
            was_distill = distill;
        }
        trainer.step(sums.loss * scale, progress)?;
    }
    Ok(NeuralReport { last, staging })
}

/// Where a part of a lattice begins in it.
fn first_sample<const D: usize>(whole: &Domain<D>, part: &Domain<D>) -> [usize; D] {
    whole.to_index(&part.origin()).map(|i| i.round() as usize)
}

/// Samples of a field on a part of the background's lattice put into a copy of the background. Where that part ends
/// inside the background the two are cross-faded over `fade` samples, so that what the field misses there leaves no
/// edge; 0 for none.
///
/// # Panics
/// If `on` is not a part of the background's lattice.
pub fn insert<const D: usize, const C: usize>(
    background: &Samples<D, C>,
    field: &impl Field<D, C>,
    on: &Domain<D>,
    fade: usize,
) -> Samples<D, C> {
    let (domain, shape) = (*background.domain(), on.shape());
    let start = first_sample(&domain, on);
    let mut out = background.clone();
    let x: Vec<[f32; D]> = (0..on.len()).map(|k| on.position(on.unflatten(k))).collect();
    let mut y = vec![[0.0; C]; x.len()];
    field.eval(&x, &mut y);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    for (k, y) in y.iter().enumerate() {
        let (index, mut at, mut stride, mut weight) = (on.unflatten(k), 0, 1, 1.0);
        for d in 0..D {
            let n = domain.shape()[d];
            at += (start[d] + index[d]) * stride;
            stride *= n;
            for (cut, depth) in
                [(start[d] > 0, index[d]), (start[d] + shape[d] < n, shape[d] - 1 - index[d])]
            {
                if cut && depth < fade {
                    weight *= ease((depth as f32 + 0.5) / fade as f32);
                }
            }
        }
        for c in 0..C {
            let value = &mut out.plane_mut(c)[at];
            *value += weight * (y[c] - *value);
        }
    }
    out
}
