use serde::{Deserialize, Serialize};

use super::state::Watch;
use super::{Adam, Decay, Schedule};
use crate::{Error, Jet, Network, Order, Result, Workspace};

/// How a network is trained: everything that, with the seed, decides the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainOptions {
    /// Learning rate of the tables at the beginning.
    pub table_rate: f32,
    /// Learning rate of the perceptron at the beginning.
    pub rate: f32,
    /// Decay of Adam's first moment.
    pub beta1: f32,
    /// Decay of Adam's second moment.
    pub beta2: f32,
    /// Adam's epsilon.
    pub epsilon: f32,
    /// How parameters are drawn towards zero.
    pub decay: Decay,
    /// How the rates change.
    pub schedule: Schedule,
    /// Points per step.
    pub batch: usize,
    /// Seed of the batches.
    pub seed: u64,
}

impl Default for TrainOptions {
    /// What worked best for grids with small perceptrons: 3e-2 for tables, 9e-3 for the perceptron, a short
    /// memory of squares (0.99), cosine to 2 %.
    fn default() -> Self {
        Self {
            table_rate: 3e-2,
            rate: 9e-3,
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-12,
            decay: Decay::None,
            schedule: Schedule::COSINE,
            batch: 8192,
            seed: 1,
        }
    }
}

/// Steps between copies of a good state.
const KEEP_EVERY: u64 = 64;
/// A running mean of the loss this many times its lowest value is a divergence.
const DIVERGED: f64 = 100.0;
/// Weight of the newest loss in the running mean.
const NEWEST: f64 = 0.1;

/// A network in training. Resumed from the same parts, it goes on bit for bit as if it had never stopped.
#[derive(Debug)]
pub struct Trainer<const D: usize, const C: usize> {
    /// The network.
    pub network: Network<D, C>,
    /// The optimiser.
    pub adam: Adam,
    /// How it is trained.
    pub options: TrainOptions,
    work: Workspace,
    gradient: Vec<f32>,
    /// Running mean of the loss, and its lowest value so far.
    pub(super) mean: Option<f64>,
    pub(super) lowest: f64,
    /// Losses below this are all as good as the lowest.
    pub(super) negligible: f64,
    pub(super) watch: Watch,
    good: Option<(Vec<f32>, Adam)>,
}

impl<const D: usize, const C: usize> Trainer<D, C> {
    /// A training from its beginning.
    pub fn new(network: Network<D, C>, options: TrainOptions) -> Self {
        let TrainOptions { beta1, beta2, epsilon, decay, .. } = options;
        let adam = Adam::new(network.params().len(), beta1, beta2, epsilon, decay);
        Self::resume(network, adam, options)
    }

    /// A training that goes on.
    ///
    /// # Panics
    /// If the optimiser has another number of parameters than the network.
    pub fn resume(network: Network<D, C>, adam: Adam, options: TrainOptions) -> Self {
        let n = network.params().len();
        assert!(adam.moments.iter().all(|m| m.len() == n), "moments for {n} parameters");
        let work = Workspace::default();
        let gradient = vec![0.0; n];
        Self {
            network,
            adam,
            options,
            work,
            gradient,
            mean: None,
            lowest: f64::INFINITY,
            negligible: 0.0,
            watch: Watch::default(),
            good: None,
        }
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.adam.steps
    }

    /// Seconds spent in fits, those before a resumption included.
    pub fn seconds(&self) -> f64 {
        self.watch.seconds
    }

    /// Adds a part of the next step's loss and gradient; see [`Network::loss_gradient`].
    pub fn accumulate(
        &mut self,
        x: &[[f32; D]],
        order: Order,
        loss: &(impl Fn(usize, &[Jet<D, C>], &mut [Jet<D, C>]) -> f64 + Sync),
    ) -> f64 {
        self.network.loss_gradient(x, order, loss, &mut self.work, &mut self.gradient)
    }

    /// Takes the step for what was accumulated; `loss` is its sum, `progress` (0..1) how far the training is.
    ///
    /// # Errors
    /// [`Error::Diverged`] if the loss is not finite or has grown a hundredfold; the network and the optimiser
    /// are back at the last good state then.
    pub fn step(&mut self, loss: f64, progress: f64) -> Result<()> {
        let mean = self.mean.map_or(loss, |mean| mean + NEWEST * (loss - mean));
        if !mean.is_finite() || mean > DIVERGED * self.lowest.max(self.negligible) {
            let step = self.adam.steps;
            if let Some((params, adam)) = self.good.take() {
                self.network.params_mut().copy_from_slice(&params);
                self.adam = adam;
            }
            self.gradient.fill(0.0);
            return Err(Error::Diverged { step, loss, kept: self.adam.steps });
        }
        (self.mean, self.lowest) = (Some(mean), self.lowest.min(mean));
        if self.adam.steps.is_multiple_of(KEEP_EVERY) {
            self.keep();
        }
        let factor = self.options.schedule.factor(self.adam.steps, progress);
        let groups = [
            (self.network.perceptron().start, factor * self.options.table_rate),
            (self.gradient.len(), factor * self.options.rate),
        ];
        self.adam.step(self.network.params_mut(), &self.gradient, &groups);
        self.gradient.fill(0.0);
        Ok(())
    }

    /// Forgets earlier losses, which divergence is judged by: for a loss that means something else from here on.
    pub fn forget_losses(&mut self) {
        (self.mean, self.lowest, self.negligible) = (None, f64::INFINITY, 0.0);
        (self.watch.recent, self.watch.next_check) = (None, 0);
    }

    fn keep(&mut self) {
        match &mut self.good {
            Some((params, adam)) => {
                params.copy_from_slice(self.network.params());
                for (to, from) in adam.moments.iter_mut().zip(&self.adam.moments) {
                    to.copy_from_slice(from);
                }
                adam.steps = self.adam.steps;
            }
            None => self.good = Some((self.network.params().to_vec(), self.adam.clone())),
        }
    }
}
