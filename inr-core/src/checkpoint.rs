//! Networks as files: everything needed to use one elsewhere, or to go on training it.

mod container;
mod description;
mod import;
mod records;

pub use description::Description;
pub use import::{AxisOrder, import_diner, import_siren};

use std::collections::BTreeMap;

use serde_json::Value;

use crate::network::{Tensor, tensors};
use crate::{Domain, Error, Network, Result};
use container::{Container, Entry};
use records::{DomainRecord, FrameRecord, Header, OutputRecord};

/// What the names of Adam's two averages begin with in a file.
const MOMENTS: [&str; 2] = ["adam.first_moment.", "adam.second_moment."];

/// How far frequencies in a file may be from those of the seed, relative to the larger: 4 units in the last
/// place, since logarithms and cosines of two machines may differ in the last bit.
const FREQUENCY_TOLERANCE: f32 = 5e-7;

/// A network with all that is needed to use it elsewhere, and to go on training it.
///
/// # Format
/// A [safetensors](https://huggingface.co/docs/safetensors) file of `f32` tensors, row by row without
/// padding. The same checkpoint always gives the same bytes, and reading gives back the same bits.
///
/// | tensor | shape |
/// |---|---|
/// | `encoding.level.{k}` | rows, features |
/// | `encoding.frequencies` | count, D: radians per unit of the scaled coordinates |
/// | `mlp.{k}.weight`, `mlp.{k}.bias` | units, inputs; units |
/// | `mlp.{k}.skip_weight` | units, features: adds to the layer with the skip connection |
/// | `mlp.output.weight`, `mlp.output.bias` | C, units; C |
/// | `adam.first_moment.{name}`, `adam.second_moment.{name}` | as `{name}`; in an unfinished training |
///
/// Tensors with other names may be added and are ignored. Metadata are texts: `format` ("npsolve-field"),
/// `version` ("1"), and in JSON `architecture` (the record [`Architecture`](crate::Architecture)), `domain`,
/// `frame`, `output`, `range`, `notes`, `training`.
///
/// A sine network needs little more than this to be evaluated elsewhere:
/// ```python
/// import json, numpy as np
/// from safetensors import safe_open
///
/// with safe_open("field.safetensors", "np") as file:
///     tensor = {name: file.get_tensor(name) for name in file.keys()}
///     meta = {k: json.loads(v) for k, v in file.metadata().items() if k != "format"}
///
/// mlp, frame, output = meta["architecture"]["mlp"], meta["frame"], meta["output"]
/// omega = mlp["activation"]["omega"]
/// h = (x - frame["center"]) / frame["half"]          # x: points, D
/// for k in range(mlp["depth"]):
///     u = h @ tensor[f"mlp.{k}.weight"].T + tensor[f"mlp.{k}.bias"]
///     h = np.sin(omega[min(k, len(omega) - 1)] * u)
/// y = h @ tensor["mlp.output.weight"].T + tensor["mlp.output.bias"]
/// value = output["offset"] + output["scale"] * y     # points, C
/// ```
///
/// In Rust:
/// ```
/// use inr_core::{Architecture, Checkpoint, Description, Domain, Frame, Network, Output};
///
/// let domain = Domain::unit([64, 48])?;
/// let (frame, output) = (Frame::of_cells(&domain), Output::of_range(0.0, 1.0));
/// let network = Network::<2, 3>::new(Architecture::siren(32, 2, 30.0), frame, output, 1)?;
/// let notes = [("encoding".to_string(), "srgb".to_string())].into();
/// let bytes = Checkpoint { network, domain, notes, range: [0.0, 1.0], training: None }.to_bytes()?;
///
/// let about = Description::from_bytes(&bytes)?;
/// assert_eq!((about.dimensions, about.channels, about.shape), (2, 3, vec![64, 48]));
/// let again = Checkpoint::<2, 3>::from_bytes(&bytes)?;
/// assert_eq!(again.notes["encoding"], "srgb");
/// # Ok::<(), inr_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Checkpoint<const D: usize, const C: usize> {
    /// The network.
    pub network: Network<D, C>,
    /// Lattice of the signal that the network stands for.
    pub domain: Domain<D>,
    /// Conventions of the signal, free text: names of channels, encoding ("srgb", "linear"), type of the
    /// numbers.
    pub notes: BTreeMap<String, String>,
    /// Lowest and highest value of the signal.
    pub range: [f32; 2],
    /// State of an unfinished training; `None` in a finished file.
    pub training: Option<Training>,
}

/// What a training needs beyond the parameters in order to go on as if it had never stopped.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// Adam's average of the gradient, in the layout of [`Network::params`].
    pub first_moment: Vec<f32>,
    /// Adam's average of the squared gradient, in the layout of [`Network::params`].
    pub second_moment: Vec<f32>,
    /// What the trainer writes about itself: steps done, options, seed. Its numbers come back exactly.
    pub state: Value,
}

impl<const D: usize, const C: usize> Checkpoint<D, C> {
    /// The file. What stands in the padding of parameters and moments is left out: it is zero.
    ///
    /// Takes one copy of all numbers; O(parameters).
    ///
    /// # Errors
    /// [`Error::TensorValues`] if a parameter or a moment is not finite, [`Error::Parameter`] if another
    /// number is not, or is out of range; [`Error::Length`] if the moments are not as many as the
    /// parameters; [`Error::CheckpointEntry`] if the notes are too long for the format (100 MB).
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let header = Header {
            architecture: self.network.architecture().clone(),
            domain: DomainRecord::of(&self.domain),
            frame: FrameRecord::of(self.network.frame()),
            output: OutputRecord::of(self.network.output()),
            range: self.range,
            notes: self.notes.clone(),
            training: self.training.as_ref().map(|t| t.state.clone()),
        };
        header.check()?;
        let (tensors, frequencies) = (self.network.tensors(), self.network.frequencies());
        let mut entries = Vec::new();
        if let Some((tensor, flat)) = &frequencies {
            entries.push(Entry { name: tensor.name.clone(), tensor, flat });
        }
        let params = self.network.params();
        let moments = self.training.iter().flat_map(Training::moments);
        for (prefix, flat) in std::iter::once(("", params)).chain(moments) {
            if flat.len() != params.len() {
                return Err(Error::Length { expected: params.len(), found: flat.len() });
            }
            for tensor in &tensors {
                let name = format!("{prefix}{}", tensor.name);
                if tensor.values(flat).any(|v| !v.is_finite()) {
                    return Err(Error::TensorValues { name, rule: "finite" });
                }
                entries.push(Entry { name, tensor, flat });
            }
        }
        container::write(header.to_texts(), &entries)
    }

    /// The checkpoint in a file.
    ///
    /// Sizes are compared with the file before memory is taken: at most 16 times what the file has for
    /// parameters (the padding of a network one unit wide), whatever its metadata claim.
    ///
    /// # Errors
    /// * [`Error::NotSafetensors`], [`Error::ForeignTensors`] and [`Error::CheckpointVersion`]: another kind
    ///   of file, a damaged one, or one of a later release;
    /// * [`Error::Dimensions`]: a checkpoint for another `D` or `C`;
    /// * [`Error::CheckpointEntry`], and those of [`Domain::new`] and [`Network::new`]: damaged metadata;
    /// * [`Error::TensorMissing`], [`Error::TensorUnexpected`], [`Error::TensorShape`],
    ///   [`Error::TensorType`] and [`Error::TensorValues`]: tensors that are not those of the architecture,
    ///   or with numbers that are not finite.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let file = Container::read(bytes)?;
        let header = Header::read(&file)?;
        let (expected, found) = ([D, C], header.dimensions());
        if expected != found {
            return Err(Error::Dimensions { expected, found });
        }
        let tensors = tensors::<D>(&header.architecture, C)?;
        check_tensors(&file, &tensors)?;
        let (frame, output) = (header.frame.to_frame(), header.output.to_output());
        let mut network = Network::zeros(header.architecture, frame, output)?;
        check_frequencies(&file, &network)?;
        read_tensors(&file, "", &tensors, network.params_mut())?;
        let read_moment = |prefix: &str| {
            let mut flat = vec![0.0; network.params().len()];
            read_tensors(&file, prefix, &tensors, &mut flat).map(|()| flat)
        };
        let training = match header.training {
            Some(state) => Some(Training {
                first_moment: read_moment(MOMENTS[0])?,
                second_moment: read_moment(MOMENTS[1])?,
                state,
            }),
            None => None,
        };
        let domain = header.domain.to_domain()?;
        Ok(Self { network, domain, notes: header.notes, range: header.range, training })
    }
}

impl Training {
    /// Both averages, with what the names of their tensors begin with.
    fn moments(&self) -> [(&'static str, &[f32]); 2] {
        [(MOMENTS[0], &self.first_moment), (MOMENTS[1], &self.second_moment)]
    }
}

/// Fails unless the network's part of the file is these tensors: all of them, and no more. One more means
/// that the architecture beside them is not the one they were trained with.
fn check_tensors(file: &Container<'_>, tensors: &[Tensor]) -> Result<()> {
    for tensor in tensors {
        file.check(&tensor.name, &tensor.shape)?;
    }
    let ours = |name: &str| name.starts_with("mlp.") || name.starts_with("encoding.level.");
    let known = |name: &str| tensors.iter().any(|t| t.name == name);
    match file.tensors().into_iter().find(|(name, _)| ours(name) && !known(name)) {
        Some((name, _)) => Err(Error::TensorUnexpected { name }),
        None => Ok(()),
    }
}

/// Puts the numbers of tensors into a buffer with the layout of the parameters.
fn read_tensors(
    file: &Container<'_>,
    prefix: &str,
    tensors: &[Tensor],
    flat: &mut [f32],
) -> Result<()> {
    for tensor in tensors {
        let name = format!("{prefix}{}", tensor.name);
        file.check(&name, &tensor.shape)?;
        tensor.set(flat, file.exact_values(&name)?);
    }
    Ok(())
}

/// Fails if a network was trained with other frequencies than its seed gives here.
fn check_frequencies<const D: usize, const C: usize>(
    file: &Container<'_>,
    network: &Network<D, C>,
) -> Result<()> {
    let Some((tensor, ours)) = network.frequencies() else { return Ok(()) };
    file.check(&tensor.name, &tensor.shape)?;
    let theirs = file.exact_values(&tensor.name)?;
    let close = |(a, b): (&f32, &f32)| (a - b).abs() <= FREQUENCY_TOLERANCE * a.abs().max(b.abs());
    if theirs.iter().zip(ours).all(close) {
        return Ok(());
    }
    Err(Error::TensorValues { name: tensor.name, rule: "those of the architecture" })
}

#[cfg(test)]
mod tests;
