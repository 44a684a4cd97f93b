//! The paper's own solver for pictures, for reproduction: a table of features per pixel behind a small sine
//! network (DINER), trained on differences of neighbouring pixels.

mod differences;
mod minimum;
#[cfg(test)]
mod tests;

use std::time::Instant;

use inr_core::{
    Architecture, Decay, Domain, Field, FitOptions, Frame, Interpolation, Jet, Network, Order,
    Output, Samples, Schedule, Shape, TrainOptions, Trainer, fit,
};

use crate::problem::put_box;
use crate::{Error, Patch, Problem, Result};
use differences::Differences;

pub use minimum::{DiscreteMinimum, discrete_minimum};

/// Everything about the paper's solver that is not the problem itself. The default is the released configuration
/// for pictures.
///
/// Source: Wu et al., "Neural Poisson Solver", 2024, section 3.2, and the released configuration where the text
/// leaves something open: three stencils, weights, erosion, decay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperOptions {
    /// Steps; each sees every sample.
    pub steps: u64,
    /// Adam's rate at the beginning, for table and perceptron; a cosine takes it down to 1e-8.
    pub rate: f32,
    /// Weight of Adam's coupled decay. It pulls harder the larger the picture is, because the loss is a mean.
    pub decay: f32,
    /// Factor in the blend's sine layers.
    pub omega: f32,
    /// Weight of the colour term.
    pub weights: PaperWeights,
    /// Which differences are compared.
    pub stencil: Stencil,
    /// Where colours are compared.
    pub color: ColorTerm,
    /// Samples by which the region shrinks (in all directions, diagonals included) before the guidance is made:
    /// in the rim the background's own differences are followed.
    pub erode: usize,
    /// What the network is at the first step.
    pub start: PaperStart,
    /// What stands for background and patch.
    pub signals: PaperSignals,
    /// Seed of the networks.
    pub seed: u64,
}

impl Default for PaperOptions {
    /// 2500 steps at 5e-4, decay 1e-2, omega 3, all stencils, erosion by one sample, from a random network.
    fn default() -> Self {
        Self {
            steps: 2500,
            rate: 5e-4,
            decay: 1e-2,
            omega: 3.0,
            weights: PaperWeights::Released,
            stencil: Stencil::All,
            color: ColorTerm::Outside,
            erode: 1,
            start: PaperStart::Random,
            signals: PaperSignals::Samples,
            seed: 1,
        }
    }
}

/// The weight of the colour term against the gradient term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PaperWeights {
    /// `0.2 L_color + L_grad` in the scale of [`PaperLoss`]: a lambda of `0.4 |S - Omega| / |Omega|`.
    Released,
    /// `mean_Omega |grad c - v|^2 + lambda mean_{S-Omega} |c - c_S|^2`, times the factor that gives the gradient
    /// term its released scale, so that rate and decay mean the same.
    Lambda(f32),
}

/// Which differences of neighbours stand for a gradient. Where the signal ends, forward and backward differences
/// that would leave it are left out, and centred ones are one-sided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stencil {
    /// `c[i + 1] - c[i]`.
    Forward,
    /// `c[i] - c[i - 1]`.
    Backward,
    /// `(c[i + 1] - c[i - 1]) / 2`.
    Centred,
    /// The mean of the three squared errors, as released.
    #[default]
    All,
}

/// Where colours are compared with the background's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorTerm {
    /// At all samples outside the region.
    #[default]
    Outside,
    /// Only at those next to it, diagonals included: the paper's ablation. Nothing then holds the others.
    Boundary,
}

/// What the network is at the first step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PaperStart {
    /// Random, as released.
    #[default]
    Random,
    /// The background, fitted in so many steps of the same rate without decay.
    Background {
        /// Steps.
        steps: u64,
    },
}

/// What stands for background and patch in the loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PaperSignals {
    /// Their samples: a table with a row per sample represents them as well as it is trained.
    #[default]
    Samples,
    /// Networks of the same kind with omega 6, fitted first in so many steps of the same rate without decay. A
    /// patch that is a field is taken as it is.
    Fitted {
        /// Steps for each.
        steps: u64,
    },
}

/// The discrete loss in its released scale, for values in 0..1: `N` samples, `C` channels, sums over samples,
/// channels, axes and (as a mean) stencils.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PaperLoss {
    /// `L_grad = 500 / (N C) sum_Omega |grad c - v|^2`.
    pub gradient: f64,
    /// `L_color = 1000 / (N C) sum_{S-Omega} |c - c_S|^2`.
    pub color: f64,
    /// What is minimised: `gradient` plus `color` times the weight in use.
    pub total: f64,
}

/// Where a training stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperProgress {
    /// Steps taken.
    pub step: u64,
    /// Seconds since the call.
    pub seconds: f64,
    /// The loss before the next step.
    pub loss: PaperLoss,
}

/// A blend by the paper's solver.
#[derive(Debug, Clone)]
pub struct PaperBlend<const D: usize, const C: usize> {
    /// The network's values in place of the background's on the part it was trained on; not clamped.
    pub samples: Samples<D, C>,
    /// The network.
    pub network: Network<D, C>,
    /// The loss of the result.
    pub loss: PaperLoss,
    /// Steps taken.
    pub steps: u64,
    /// Seconds of the training, without the fits before it.
    pub seconds: f64,
    /// Seconds of the fits before it.
    pub fitting: f64,
}

/// Runs the paper's solver on a part of the background's lattice, `on`, that holds the region; as published, the
/// whole of it. The part is treated as a picture of its own: differences do not leave it.
///
/// Works on samples, unlike everything else in this crate: its network has no gradient between them. Each step
/// costs two evaluations forward and one back at every sample. The problem's guidance is applied to differences
/// of one stencil at a time ([`Strongest::PerComponent`](crate::Strongest::PerComponent) is the paper's rule); of
/// the problem's options none plays a part. The same bits for any number of threads.
///
/// `report` is called before each step; if it returns false, the training stops there.
///
/// # Errors
/// [`Error::Parameter`], [`Error::EmptyRegion`], [`Error::NoAnchor`], [`Error::NotFinite`], and
/// [`Error::Network`] for a divergence.
///
/// # Panics
/// If `on` is not a part of the background's lattice that holds the region.
pub fn train_paper<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    on: &Domain<D>,
    options: &PaperOptions,
    mut report: impl FnMut(&PaperProgress) -> bool,
) -> Result<PaperBlend<D, C>> {
    options.validate()?;
    let begin = Instant::now();
    let fitted = Fitted::new(problem, options)?;
    let differences = Differences::new(&fitted.problem(problem), on, options)?;
    let architecture = diner(&on.shape(), options.omega);
    let mut network = Network::new(architecture, Frame::of_cells(on), colors(), options.seed)?;
    if let PaperStart::Background { steps } = options.start {
        network = fit_to(network, &differences.background(), steps, options)?;
    }
    let fitting = begin.elapsed().as_secs_f64();

    let begin = Instant::now();
    let mut trainer = Trainer::new(network, train_options(options, Decay::Coupled(options.decay)));
    let x: Vec<[f32; D]> = (0..on.len()).map(|k| on.position(on.unflatten(k))).collect();
    let (mut y, mut bar) = (vec![[0.0f32; C]; x.len()], vec![[0.0f64; C]; x.len()]);
    while trainer.steps() < options.steps {
        trainer.network.eval(&x, &mut y);
        let loss = differences.evaluate(&y, &mut bar);
        let (step, seconds) = (trainer.steps(), begin.elapsed().as_secs_f64());
        if !report(&PaperProgress { step, seconds, loss }) {
            break;
        }
        let hand_out = |first: usize, y: &[Jet<D, C>], y_bar: &mut [Jet<D, C>]| {
            for (y_bar, bar) in y_bar.iter_mut().zip(&bar[first..first + y.len()]) {
                y_bar.value = bar.map(|v| v as f32);
            }
            0.0
        };
        trainer.accumulate(&x, Order::Value, &hand_out);
        trainer.step(loss.total, step as f64 / options.steps as f64)?;
    }
    trainer.network.eval(&x, &mut y);
    let (steps, loss) = (trainer.steps(), differences.evaluate(&y, &mut bar));
    let samples = put(problem.background, on, &y);
    let seconds = begin.elapsed().as_secs_f64();
    Ok(PaperBlend { samples, network: trainer.network, loss, steps, seconds, fitting })
}

/// The discrete loss of any result, ours or somebody else's, on a part of the background's lattice.
///
/// # Errors
/// As [`train_paper`], and [`Error::Shape`] if the result has another shape than the background.
///
/// # Panics
/// If `on` is not a part of the background's lattice that holds the region.
pub fn paper_loss<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    on: &Domain<D>,
    options: &PaperOptions,
    result: &Samples<D, C>,
) -> Result<PaperLoss> {
    options.validate()?;
    let (expected, found) = (problem.background.domain().shape(), result.domain().shape());
    if expected != found {
        return Err(Error::Shape { expected: expected.to_vec(), found: found.to_vec() });
    }
    let differences = Differences::new(problem, on, options)?;
    let part = differences::cropped(result, on);
    let mut bar = vec![[0.0; C]; part.len()];
    Ok(differences.evaluate(&part, &mut bar))
}

impl PaperOptions {
    fn validate(&self) -> Result<()> {
        let good = |name, value: f32, zero: bool| match value {
            v if (v > 0.0 || zero && v == 0.0) && v.is_finite() => Ok(()),
            v => Err(Error::Parameter { name, rule: "positive and finite", value: f64::from(v) }),
        };
        good("rate", self.rate, false)?;
        good("decay", self.decay, true)?;
        good("omega", self.omega, false)?;
        match self.weights {
            PaperWeights::Released => Ok(()),
            PaperWeights::Lambda(lambda) => good("lambda", lambda, false),
        }
    }
}

/// Factor in the sine layers of the networks for background and patch, as released.
const OMEGA_OF_SIGNALS: f32 = 6.0;
/// The cosine's last rate, as released.
const LAST_RATE: f32 = 1e-8;

/// The last layer is the colour itself.
fn colors<const C: usize>() -> Output<C> {
    Output { offset: [0.0; C], scale: [1.0; C] }
}

fn diner(shape: &[usize], omega: f32) -> Architecture {
    Architecture::diner(shape, Interpolation::Nearest, 3, 64, 3, omega)
}

fn train_options(options: &PaperOptions, decay: Decay) -> TrainOptions {
    let floor = LAST_RATE.min(options.rate) / options.rate;
    TrainOptions {
        table_rate: options.rate,
        rate: options.rate,
        beta1: 0.9,
        beta2: 0.999,
        epsilon: 1e-8,
        decay,
        schedule: Schedule { shape: Shape::Cosine, floor, warm_up: 0 },
        batch: usize::MAX,
        seed: options.seed,
    }
}

/// Fits a network to samples with every sample in each step.
fn fit_to<const D: usize, const C: usize>(
    network: Network<D, C>,
    samples: &Samples<D, C>,
    steps: u64,
    options: &PaperOptions,
) -> Result<Network<D, C>> {
    let mut trainer = Trainer::new(network, train_options(options, Decay::None));
    let fitting = FitOptions { steps, budget: None, target_psnr: None, peak: 1.0 };
    fit(&mut trainer, samples, &fitting, |_, _| true)?;
    Ok(trainer.network)
}

/// Networks in place of the signals, sampled again where the signals were.
struct Fitted<const D: usize, const C: usize> {
    background: Option<Samples<D, C>>,
    patch: Option<Samples<D, C>>,
}

impl<const D: usize, const C: usize> Fitted<D, C> {
    fn new(problem: &Problem<'_, D, C>, options: &PaperOptions) -> Result<Self> {
        let PaperSignals::Fitted { steps } = options.signals else {
            return Ok(Self { background: None, patch: None });
        };
        let again = |samples: &Samples<D, C>, seed: u64| -> Result<Samples<D, C>> {
            let domain = *samples.domain();
            let architecture = diner(&domain.shape(), OMEGA_OF_SIGNALS);
            let network = Network::new(architecture, Frame::of_cells(&domain), colors(), seed)?;
            let network = fit_to(network, samples, steps, options)?;
            let x: Vec<_> =
                (0..domain.len()).map(|k| domain.position(domain.unflatten(k))).collect();
            let mut y = vec![[0.0; C]; x.len()];
            network.eval(&x, &mut y);
            Ok(Samples::from_interleaved(domain, y.as_flattened())?)
        };
        let patch = match problem.patch {
            Patch::Samples { samples, .. } => Some(again(samples, options.seed + 2)?),
            Patch::Field { .. } => None,
        };
        Ok(Self { background: Some(again(problem.background, options.seed + 1)?), patch })
    }

    fn problem<'a>(&'a self, problem: &Problem<'a, D, C>) -> Problem<'a, D, C> {
        let patch = match (&self.patch, problem.patch) {
            (Some(samples), Patch::Samples { offset, .. }) => Patch::Samples { samples, offset },
            (_, patch) => patch,
        };
        let background = self.background.as_ref().unwrap_or(problem.background);
        Problem { background, patch, ..problem.clone() }
    }
}

/// Values on a part of the lattice in a copy of the background.
fn put<const D: usize, const C: usize>(
    background: &Samples<D, C>,
    on: &Domain<D>,
    values: &[[f32; C]],
) -> Samples<D, C> {
    let (mut out, whole) = (background.clone(), background.domain().shape());
    let start = super::first_sample(background.domain(), on);
    for c in 0..C {
        let plane: Vec<f32> = values.iter().map(|v| v[c]).collect();
        put_box(&plane, on.shape(), start, whole, out.plane_mut(c), |to, from| *to = from);
    }
    out
}
