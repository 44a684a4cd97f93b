use serde::{Deserialize, Serialize};

use super::{Adam, Decay, TrainOptions, Trainer};
use crate::{Error, Network, Result, Training};

/// What a fit remembers from one call to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Watch {
    /// Mean of the squared error over the last batches, relative to the peak's square.
    pub recent: Option<f64>,
    /// Step before which the target is not measured again.
    pub next_check: u64,
    /// Time spent.
    pub seconds: f64,
}

/// What a trainer writes about itself; the large parts are tensors.
#[derive(Serialize, Deserialize)]
struct State {
    options: TrainOptions,
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    decay: Decay,
    steps: u64,
    mean_loss: Option<f64>,
    lowest_loss: Option<f64>,
    fit: Watch,
}

impl<const D: usize, const C: usize> Trainer<D, C> {
    /// What a checkpoint needs, besides the network, for [`Trainer::from_training`]. The state is a JSON object
    /// with `steps` and `options` among its keys; others may be added.
    ///
    /// Takes a copy of both moments; O(parameters).
    pub fn to_training(&self) -> Training {
        let Adam { beta1, beta2, epsilon, decay, steps, moments: [first, second] } = &self.adam;
        let state = State {
            options: self.options.clone(),
            beta1: *beta1,
            beta2: *beta2,
            epsilon: *epsilon,
            decay: *decay,
            steps: *steps,
            mean_loss: self.mean,
            // JSON has no infinity, which it is before the first step.
            lowest_loss: Some(self.lowest).filter(|l| l.is_finite()),
            fit: self.watch,
        };
        Training {
            first_moment: first.clone(),
            second_moment: second.clone(),
            state: serde_json::to_value(state).expect("a record of numbers"),
        }
    }

    /// The training that a checkpoint holds: it goes on bit for bit as if it had never stopped.
    ///
    /// # Errors
    /// [`Error::CheckpointEntry`] if the state is not one of [`Trainer::to_training`], [`Error::Length`] if the
    /// moments are not as many as the parameters.
    pub fn from_training(network: Network<D, C>, training: Training) -> Result<Self> {
        let reason = |e: serde_json::Error| Error::CheckpointEntry {
            entry: "training".into(),
            reason: e.to_string(),
        };
        let state: State = serde_json::from_value(training.state).map_err(reason)?;
        let State { options, beta1, beta2, epsilon, decay, steps, .. } = state;
        let moments = [training.first_moment, training.second_moment];
        let expected = network.params().len();
        if let Some(m) = moments.iter().find(|m| m.len() != expected) {
            return Err(Error::Length { expected, found: m.len() });
        }
        let adam = Adam { beta1, beta2, epsilon, decay, steps, moments };
        let mut trainer = Self::resume(network, adam, options);
        trainer.mean = state.mean_loss;
        trainer.lowest = state.lowest_loss.unwrap_or(f64::INFINITY);
        trainer.watch = state.fit;
        Ok(trainer)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::{
        Architecture, Checkpoint, Domain, FitOptions, Frame, Interpolation, Output, Samples, fit,
    };

    fn signal() -> Samples<2, 2> {
        let domain = Domain::unit([23, 17]).unwrap();
        Samples::from_fn(domain, |[x, y]| [(0.4 * x).sin() * y, (0.3 * y).cos() - x])
    }

    fn trainer(architecture: Architecture) -> Trainer<2, 2> {
        let (frame, output) = (Frame::of_cells(signal().domain()), Output::of_range(-23.0, 17.0));
        let network = Network::new(architecture, frame, output, 3).unwrap();
        let options =
            TrainOptions { batch: 100, decay: Decay::Decoupled(1e-3), ..TrainOptions::default() };
        Trainer::new(network, options)
    }

    /// Fits up to step `last` of 60, through a file if `stop` says so.
    fn fitted(architecture: Architecture, stop: Option<u64>, target: Option<f64>) -> Trainer<2, 2> {
        let options = FitOptions { steps: 60, budget: None, target_psnr: target, peak: 40.0 };
        let mut trainer = trainer(architecture);
        let go_on = |t: &Trainer<2, 2>, _| Some(t.steps()) != stop;
        fit(&mut trainer, &signal(), &options, go_on).unwrap();
        if stop.is_some() {
            let (network, domain) = (trainer.network.clone(), *signal().domain());
            let training = Some(trainer.to_training());
            let checkpoint = Checkpoint {
                network,
                domain,
                notes: Default::default(),
                range: [-23.0, 17.0],
                training,
            };
            let bytes = checkpoint.to_bytes().unwrap();
            let read = Checkpoint::<2, 2>::from_bytes(&bytes).unwrap();
            trainer = Trainer::from_training(read.network, read.training.unwrap()).unwrap();
            fit(&mut trainer, &signal(), &options, |_, _| true).unwrap();
        }
        trainer
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|v| v.to_bits()).collect()
    }

    fn all_bits(trainer: &Trainer<2, 2>) -> [Vec<u32>; 3] {
        let [m, v] = &trainer.adam.moments;
        [bits(trainer.network.params()), bits(m), bits(v)]
    }

    #[test]
    fn a_training_stopped_and_resumed_has_the_same_bits() {
        let shape = signal().domain().shape();
        for architecture in [
            Architecture::grid(&shape, 64),
            Architecture::hash(&shape, 64),
            Architecture::siren(20, 2, 10.0),
            Architecture::fourier(13, 2.0, 20, 2),
            Architecture::diner(&shape, Interpolation::Nearest, 3, 20, 2, 6.0),
        ] {
            let whole = fitted(architecture.clone(), None, None);
            for stop in [1, 30] {
                let parts = fitted(architecture.clone(), Some(stop), None);
                assert_eq!(all_bits(&whole), all_bits(&parts), "{architecture:?} at {stop}");
                assert_eq!((whole.mean, whole.lowest), (parts.mean, parts.lowest));
            }
        }
    }

    #[test]
    fn a_target_is_reached_at_the_same_step() {
        let architecture = Architecture::siren(20, 2, 10.0);
        let whole = fitted(architecture.clone(), None, Some(20.0));
        assert!((6..60).contains(&whole.steps()), "{} steps", whole.steps());
        for before in [1, 2, 5] {
            let parts = fitted(architecture.clone(), Some(whole.steps() - before), Some(20.0));
            assert_eq!(all_bits(&whole), all_bits(&parts));
        }
    }

    #[test]
    fn damaged_states_are_typed_errors() {
        let trainer = trainer(Architecture::siren(8, 1, 10.0));
        let good = trainer.to_training();
        for state in [json!(null), json!({"steps": 3}), json!([1, 2])] {
            let bad = Training { state, ..good.clone() };
            let result = Trainer::from_training(trainer.network.clone(), bad);
            assert!(matches!(result, Err(Error::CheckpointEntry { .. })), "{result:?}");
        }
        let short = Training { first_moment: vec![0.0], ..good };
        let result = Trainer::from_training(trainer.network.clone(), short);
        assert!(matches!(result, Err(Error::Length { found: 1, .. })), "{result:?}");
    }
}
