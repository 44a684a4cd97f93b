//! The file of a fit: written while it goes on, read when it is taken up again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use inr_core::{Checkpoint, Domain, Trainer};
use serde_json::Value;

use super::recipe::Recipe;
use crate::{field_file, files};

/// Key of the recipe in the state of a training.
pub const RECIPE: &str = "recipe";
/// Key of the mark of a finished training whose state was kept.
pub const FINISHED: &str = "finished";

/// Writes the states of one training to one file, each whole or not at all.
pub struct TrainingFile<const D: usize> {
    /// Where it is.
    pub path: PathBuf,
    /// Lattice of the signal.
    pub domain: Domain<D>,
    /// What signals of the field are like.
    pub notes: BTreeMap<String, String>,
    /// Lowest and highest value of the signal.
    pub range: [f32; 2],
    /// How the training came about.
    pub recipe: Recipe,
    /// Time between two states.
    pub every: Duration,
    /// Whether an earlier file may be replaced; true once this training has written one.
    pub replace: bool,
    /// When the last state was written.
    pub last: Instant,
    /// Whether the file holds a state of this training.
    pub has_state: bool,
}

impl<const D: usize> TrainingFile<D> {
    /// Writes the unfinished training if it is time.
    pub fn write_if_due<const C: usize>(&mut self, trainer: &Trainer<D, C>) -> Result<()> {
        if self.last.elapsed() >= self.every {
            self.write(trainer, true, false)?;
        }
        Ok(())
    }

    /// Writes the network, with the training's state or without; gives the size of the file.
    pub fn write<const C: usize>(
        &mut self,
        trainer: &Trainer<D, C>,
        with_training: bool,
        finished: bool,
    ) -> Result<usize> {
        let training = match with_training {
            true => Some(self.with_recipe(trainer.to_training(), finished)?),
            false => None,
        };
        let mut notes = self.notes.clone();
        notes.insert("field".to_owned(), self.recipe.field.name().to_owned());
        let checkpoint = Checkpoint {
            network: trainer.network.clone(),
            domain: self.domain,
            notes,
            range: self.range,
            training,
        };
        let bytes = checkpoint.to_bytes().with_context(|| {
            format!("cannot write {}; choose a smaller --rate", self.path.display())
        })?;
        files::write_bytes(&self.path, &bytes, self.replace)?;
        (self.replace, self.has_state, self.last) = (true, true, Instant::now());
        Ok(bytes.len())
    }

    fn with_recipe(
        &self,
        mut training: inr_core::Training,
        finished: bool,
    ) -> Result<inr_core::Training> {
        if let Value::Object(state) = &mut training.state {
            state.insert(RECIPE.into(), serde_json::to_value(&self.recipe)?);
            state.insert(FINISHED.into(), finished.into());
        }
        Ok(training)
    }
}

/// A training taken from its file.
pub struct Unfinished<const D: usize, const C: usize> {
    /// The training.
    pub trainer: Trainer<D, C>,
    /// How it was begun.
    pub recipe: Recipe,
}

impl<const D: usize, const C: usize> Unfinished<D, C> {
    /// Reads the file of an unfinished fit of this signal; `signal` names it in messages.
    pub fn read(path: &Path, signal: &str, fingerprint: &str) -> Result<Self> {
        let file = path.display();
        let bytes = files::read_bytes(path)?;
        let about = field_file::describe(path, &bytes)?;
        let Some(state) = &about.training else {
            bail!("{file} is finished; begin again with --force, or choose another name");
        };
        if state[FINISHED] == true {
            bail!("{file} is finished after step {}; begin again with --force", state["steps"]);
        }
        let recipe: Recipe = serde_json::from_value(state[RECIPE].clone()).map_err(|_| {
            anyhow!("{file} holds a training that fit did not begin; go on with it where it began")
        })?;
        if recipe.signal != fingerprint || [about.dimensions, about.channels] != [D, C] {
            bail!(
                "{file} was begun with other values than those of {signal}; give the same file, or \
                 begin again with --force"
            );
        }
        let checkpoint = field_file::checkpoint::<D, C>(path, &bytes)?;
        let training = checkpoint.training.with_context(|| format!("{file} is finished"))?;
        let trainer = Trainer::from_training(checkpoint.network, training)
            .with_context(|| format!("{file} is damaged; begin again with --force"))?;
        Ok(Self { trainer, recipe })
    }
}
