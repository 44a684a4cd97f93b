//! Fields with trained parameters.

mod activation;
mod architecture;
mod encoder;
mod fourier;
mod frame;
mod gradient;
mod grid;
mod init;
mod layers;
mod sincos;
mod splines;
mod tensors;

pub use architecture::{
    Activation, Alignment, Architecture, Encoding, Fourier, Frequencies, Grid, Interpolation,
    Level, Mlp,
};
pub use frame::Frame;
pub use gradient::{Order, Workspace};
pub(crate) use tensors::{Tensor, tensors};

use std::ops::Range;

use rayon::prelude::*;

use encoder::Encoder;
use layers::{Layers, Tape};

use crate::buffer::Buffer;
use crate::{Field, Jet, Result, Scalar};

/// Points handed to one task of the batched evaluation.
const BATCH: usize = 1024;

/// What a network's last layer means: `value = offset + scale * y`, so that networks work near 0 and 1
/// whatever the signal's range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output<const C: usize> {
    /// Value per channel where the last layer is 0.
    pub offset: [f32; C],
    /// Change per channel where the last layer grows by 1.
    pub scale: [f32; C],
}

impl<const C: usize> Output<C> {
    /// -1..1 becomes `low..high` in every channel.
    pub fn of_range(low: f32, high: f32) -> Self {
        Self { offset: [0.5 * (low + high); C], scale: [0.5 * (high - low); C] }
    }
}

/// A field computed by a small network: an encoding of the coordinates, then a perceptron.
///
/// All trained parameters are in one flat buffer: the tables of a grid, then the perceptron. Rows are
/// padded to whole vectors with zeros; they stay zero in training.
///
/// Gradients are exact: tangents go forward with the values. Results depend on the machine's vector
/// unit in their last bits ([`cpu::Unit`](crate::cpu::Unit)), never on the number of threads or on what
/// else is in a batch.
#[derive(Debug, Clone)]
pub struct Network<const D: usize, const C: usize> {
    architecture: Architecture,
    frame: Frame<D>,
    output: Output<C>,
    encoder: Encoder<D>,
    layers: Layers,
    params: Buffer,
}

impl<const D: usize, const C: usize> Network<D, C> {
    /// A network with random parameters.
    ///
    /// Tables are uniform in +-1e-4. Sine layers follow Sitzmann et al. 2020, section 3.2 (first layer
    /// uniform in +-1/n, the others and the output in +-sqrt(6/n)/omega, n inputs), with biases in
    /// +-1/sqrt(n); other layers are uniform in +-sqrt(6/n) (He et al. 2015) without biases, the output
    /// in +-sqrt(1/n).
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) and [`Error::Length`](crate::Error::Length) if a number
    /// of the architecture is out of range.
    pub fn new(
        architecture: Architecture,
        frame: Frame<D>,
        output: Output<C>,
        seed: u64,
    ) -> Result<Self> {
        let mut network = Self::zeros(architecture, frame, output)?;
        network.randomise(seed);
        Ok(network)
    }

    /// What the network computes.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Where its coordinates are -1..1.
    pub fn frame(&self) -> &Frame<D> {
        &self.frame
    }

    /// What its last layer means.
    pub fn output(&self) -> &Output<C> {
        &self.output
    }

    /// All parameters.
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// All parameters.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    /// The part of the parameters that is tables of features.
    pub fn tables(&self) -> Range<usize> {
        0..self.encoder.len()
    }

    /// The part of the parameters that is the perceptron.
    pub fn perceptron(&self) -> Range<usize> {
        let first = layers::padded(self.encoder.len());
        first..first + self.layers.len
    }

    /// Trained numbers, without padding.
    pub fn parameter_count(&self) -> usize {
        let (width, mut n) = (self.layers.width, self.encoder.len());
        for layer in self.layers.hidden() {
            let skip = if layer.skip.is_some() { self.layers.features } else { 0 };
            n += (layer.inputs + skip + 1) * width;
        }
        let past = if self.layers.bypass().is_some() { self.layers.features * C } else { 0 };
        n + (width + 1) * C + past
    }

    /// Value at `x` (physical coordinates) for any scalar type: with dual numbers it gives exact gradients,
    /// with nested ones Laplacians. This is the definition; `eval` and `eval_jet` are its fast forms.
    pub fn eval_scalar<T: Scalar>(&self, x: [T; D]) -> [T; C] {
        let c = |v: f32| T::from_f64(f64::from(v));
        let features = self.encoder.plain(&self.params, self.frame.scale(x));
        let y =
            self.layers.plain(&self.architecture.mlp, &self.params[self.perceptron()], &features);
        std::array::from_fn(|k| c(self.output.offset[k]) + c(self.output.scale[k]) * y[k])
    }

    /// Runs one tile forward; the outputs are in `tape.y`.
    fn forward(&self, x: &[[f32; D]], blocks: usize, keep: bool, tape: &mut Tape) {
        let stride = layers::padded(self.layers.features);
        (tape.points, tape.blocks) = (x.len(), blocks);
        tape.features.resize(x.len() * blocks * stride);
        // Columns of padding stay zero from the first resize on: nothing writes them.
        self.encoder.forward(&self.params, &self.frame, x, &mut tape.features, stride);
        self.layers.forward(&self.params[self.perceptron()], tape, keep);
    }

    /// Outputs of a tile as jets.
    fn jets(&self, tape: &Tape, jets: &mut [Jet<D, C>]) {
        let block = tape.points * C;
        for (p, jet) in jets.iter_mut().enumerate() {
            for c in 0..C {
                jet.value[c] = self.output.offset[c] + self.output.scale[c] * tape.y[p * C + c];
                for d in 0..D {
                    jet.grad[c][d] = if tape.blocks > 1 {
                        self.output.scale[c] * tape.y[(1 + d) * block + p * C + c]
                    } else {
                        0.0
                    };
                }
            }
        }
    }

    fn for_tiles<Y: Send>(
        &self,
        x: &[[f32; D]],
        y: &mut [Y],
        blocks: usize,
        write: impl Fn(&Tape, &mut [Y]) + Sync,
    ) {
        assert_eq!(x.len(), y.len(), "one result per point");
        let tile = self.layers.tile(blocks);
        let work = |tape: &mut Tape, x: &[[f32; D]], y: &mut [Y]| {
            for (x, y) in x.chunks(tile).zip(y.chunks_mut(tile)) {
                self.forward(x, blocks, false, tape);
                write(tape, y);
            }
        };
        if x.len() <= BATCH {
            work(&mut Tape::default(), x, y);
        } else {
            let batch = BATCH.next_multiple_of(tile);
            x.par_chunks(batch)
                .zip(y.par_chunks_mut(batch))
                .for_each_init(Tape::default, |tape, (x, y)| work(tape, x, y));
        }
    }
}

impl<const D: usize, const C: usize> Field<D, C> for Network<D, C> {
    fn eval(&self, x: &[[f32; D]], y: &mut [[f32; C]]) {
        self.for_tiles(x, y, 1, |tape, y| {
            for (y, out) in y.iter_mut().zip(tape.y.chunks_exact(C)) {
                *y = std::array::from_fn(|c| self.output.offset[c] + self.output.scale[c] * out[c]);
            }
        });
    }

    fn eval_jet(&self, x: &[[f32; D]], y: &mut [Jet<D, C>]) {
        self.for_tiles(x, y, 1 + D, |tape, y| self.jets(tape, y));
    }
}

#[cfg(test)]
mod tests;
