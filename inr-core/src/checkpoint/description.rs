use std::collections::BTreeMap;

use serde_json::Value;

use super::container::Container;
use super::records::{Header, VERSION};
use crate::{Architecture, Result, Unit};

/// What a checkpoint holds: enough to choose the `D` and `C` it is read with, and to print.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// Version of the format.
    pub version: u64,
    /// Coordinates, `D`.
    pub dimensions: usize,
    /// Channels, `C`.
    pub channels: usize,
    /// What the network computes.
    pub architecture: Architecture,
    /// Samples per axis of the signal, axis 0 first.
    pub shape: Vec<usize>,
    /// Distance between neighbouring samples per axis.
    pub pitch: Vec<f32>,
    /// Position of the first sample.
    pub origin: Vec<f32>,
    /// Unit of pitch and origin.
    pub unit: Unit,
    /// Lowest and highest value of the signal.
    pub range: [f32; 2],
    /// Conventions of the signal.
    pub notes: BTreeMap<String, String>,
    /// Trained numbers.
    pub parameters: usize,
    /// What the training says about itself, if it can go on.
    pub training: Option<Value>,
    /// Names and shapes of all tensors, in the order of the file.
    pub tensors: Vec<(String, Vec<usize>)>,
}

impl Description {
    /// Reads the header of a checkpoint. The tensors are not looked at: reading the network can still fail.
    ///
    /// # Errors
    /// Those of [`Checkpoint::from_bytes`](super::Checkpoint::from_bytes) about the file and its metadata.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let file = Container::read(bytes)?;
        let header = Header::read(&file)?;
        let [dimensions, channels] = header.dimensions();
        let tensors = file.tensors();
        let trained = tensors
            .iter()
            .filter(|(n, _)| n.starts_with("mlp.") || n.starts_with("encoding.level."));
        let parameters = trained.map(|(_, shape)| shape.iter().product::<usize>()).sum();
        Ok(Self {
            version: VERSION,
            dimensions,
            channels,
            architecture: header.architecture,
            shape: header.domain.shape,
            pitch: header.domain.pitch,
            origin: header.domain.origin,
            unit: header.domain.unit.into(),
            range: header.range,
            notes: header.notes,
            parameters,
            training: header.training,
            tensors,
        })
    }
}
