//! The trained numbers as named tensors without padding: how a network looks from outside.

use super::Network;
use super::architecture::Architecture;
use super::encoder::Encoder;
use super::frame::Frame;
use super::layers::{self, Layers};
use crate::buffer::Buffer;
use crate::{Output, Result};

/// A named tensor of one or two axes, and where its numbers are in a flat buffer: the parameters, or
/// anything else with their layout.
#[derive(Debug, Clone)]
pub(crate) struct Tensor {
    pub name: String,
    pub shape: Vec<usize>,
    first: usize,
    /// Distance in the buffer between neighbours along each axis.
    strides: [usize; 2],
}

impl Tensor {
    fn new(name: impl Into<String>, shape: &[usize], first: usize, strides: [usize; 2]) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), first, strides }
    }

    /// Numbers in it.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Where in the buffer its numbers are, row by row.
    pub fn indices(&self) -> impl Iterator<Item = usize> + use<> {
        let columns = self.shape.get(1).copied().unwrap_or(1);
        let ([row, column], first) = (self.strides, self.first);
        (0..self.shape[0])
            .flat_map(move |i| (0..columns).map(move |j| first + i * row + j * column))
    }

    /// Its numbers in a buffer, row by row.
    pub fn values<'a>(&self, flat: &'a [f32]) -> impl Iterator<Item = f32> + use<'a> {
        self.indices().map(|i| flat[i])
    }

    /// Puts its numbers, row by row, into a buffer.
    pub fn set(&self, flat: &mut [f32], values: impl IntoIterator<Item = f32>) {
        self.indices().zip(values).for_each(|(i, v)| flat[i] = v);
    }
}

/// The tensors of a network of `D` coordinates with this architecture, in the order of the flat buffer.
/// Takes no memory for their numbers, so that sizes can be compared with what a file holds before.
///
/// Weights are `[out, in]`, tables `[rows, features]`.
pub(crate) fn tensors<const D: usize>(
    architecture: &Architecture,
    channels: usize,
) -> Result<Vec<Tensor>> {
    architecture.check(D)?;
    let encoder = Encoder::<D>::new(&architecture.encoding);
    let layers = Layers::new(&architecture.mlp, encoder.outputs(), channels);
    let mut list = Vec::new();
    if let Encoder::Tables(tables) = &encoder {
        let n = tables.features;
        list.extend(tables.levels.iter().enumerate().map(|(k, table)| {
            Tensor::new(format!("encoding.level.{k}"), &[table.rows, n], table.offset, [n, 1])
        }));
    }
    let (first, stride, width) = (layers::padded(encoder.len()), layers.stride(), layers.width);
    for (k, layer) in layers.hidden().iter().enumerate() {
        // In the buffer an input's weights are side by side; here a unit's are.
        let weights = |name: &str, inputs: usize, at: usize| {
            Tensor::new(format!("mlp.{k}.{name}"), &[width, inputs], first + at, [1, stride])
        };
        list.push(weights("weight", layer.inputs, layer.weights));
        list.extend(layer.skip.map(|at| weights("skip_weight", layers.features, at)));
        list.push(Tensor::new(format!("mlp.{k}.bias"), &[width], first + layer.bias, [1, 1]));
    }
    let (weights, bias) = layers.output();
    let shape = [channels, width];
    list.push(Tensor::new("mlp.output.weight", &shape, first + weights.start, [stride, 1]));
    list.push(Tensor::new("mlp.output.bias", &[channels], first + bias.start, [1, 1]));
    list.extend(layers.bypass().map(|at| {
        let (features, stride) = (layers.features, layers::padded(layers.features));
        Tensor::new("mlp.bypass.weight", &[channels, features], first + at.start, [stride, 1])
    }));
    Ok(list)
}

impl<const D: usize, const C: usize> Network<D, C> {
    /// A network whose parameters are all zero.
    pub(crate) fn zeros(
        architecture: Architecture,
        frame: Frame<D>,
        output: Output<C>,
    ) -> Result<Self> {
        architecture.check(D)?;
        let encoder = Encoder::new(&architecture.encoding);
        let layers = Layers::new(&architecture.mlp, encoder.outputs(), C);
        let params = Buffer::zeros(layers::padded(encoder.len()) + layers.len);
        Ok(Self { architecture, frame, output, encoder, layers, params })
    }

    /// Its tensors; see [`tensors`].
    pub(crate) fn tensors(&self) -> Vec<Tensor> {
        tensors::<D>(&self.architecture, C).expect("a network's architecture was checked")
    }

    /// The frequency vectors of its encoding, `[count, D]`, with their numbers, if it has any.
    pub(crate) fn frequencies(&self) -> Option<(Tensor, &[f32])> {
        let Encoder::Waves(waves) = &self.encoder else { return None };
        let vectors = waves.frequencies();
        let tensor = Tensor::new("encoding.frequencies", &[vectors.len(), D], 0, [D, 1]);
        Some((tensor, vectors.as_flattened()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Interpolation;

    /// Every number that can be anything but zero belongs to exactly one tensor.
    fn tensors_partition_the_parameters<const D: usize, const C: usize>() {
        let shape = vec![9; D];
        let mut skip = Architecture::nerf();
        (skip.mlp.width, skip.mlp.depth, skip.mlp.skip) = (19, 3, Some(1));
        for architecture in [
            Architecture::siren(37, 3, 5.0),
            skip,
            Architecture::grid(&shape, 1 << 6),
            Architecture::spline_grid(&shape, C),
            Architecture::diner(&shape, Interpolation::Nearest, 3, 20, 1, 5.0),
        ] {
            let frame = Frame { center: [0.0; D], half: [1.0; D] };
            let output = Output::<C>::of_range(0.0, 1.0);
            let network = Network::new(architecture, frame, output, 1).unwrap();
            let mut seen = vec![0; network.params().len()];
            let tensors = network.tensors();
            tensors.iter().flat_map(Tensor::indices).for_each(|i| seen[i] += 1);
            assert!(seen.iter().all(|n| *n < 2), "a number belongs to two tensors");
            let total: usize = tensors.iter().map(Tensor::len).sum();
            assert_eq!(total, network.parameter_count());
            let outside = seen.iter().zip(network.params()).filter(|(n, _)| **n == 0);
            assert!(outside.into_iter().all(|(_, p)| *p == 0.0), "a parameter in no tensor");
        }
    }

    #[test]
    fn tensors_partition_the_parameters_audio() {
        tensors_partition_the_parameters::<1, 1>();
    }
    #[test]
    fn tensors_partition_the_parameters_image() {
        tensors_partition_the_parameters::<2, 3>();
    }
}
