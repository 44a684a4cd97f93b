use super::Network;
use super::architecture::Activation;
use super::layers;
use crate::random::Random;

/// Half width of a table's first values: small enough for the perceptron to begin nearly constant.
const TABLE_LIMIT: f32 = 1e-4;

impl<const D: usize, const C: usize> Network<D, C> {
    /// Draws all parameters anew; see [`Network::new`].
    pub fn randomise(&mut self, seed: u64) {
        let random = Random::new(seed, Random::PARAMETERS);
        let tables = self.tables();
        for (k, p) in self.params[tables].iter_mut().enumerate() {
            *p = random.symmetric(k as u64, TABLE_LIMIT);
        }
        let (first, layers, activation) =
            (self.perceptron().start, &self.layers, &self.architecture.mlp.activation);
        let (stride, width) = (layers.stride(), layers.width);
        let params = &mut self.params[first..];
        let mut fill = |at: usize, count: usize, limit: f32| {
            for (k, p) in params[at..at + count].iter_mut().enumerate() {
                *p = random.symmetric((first + at + k) as u64, limit);
            }
        };
        let sine = matches!(activation, Activation::Sine { .. });
        for (k, layer) in layers.hidden().iter().enumerate() {
            let skipped = if layer.skip.is_some() { layers.features } else { 0 };
            let n = (layer.inputs + skipped) as f32;
            let limit = match (sine, k) {
                (true, 0) => 1.0 / n,
                (true, _) => (6.0 / n).sqrt() / activation.omega(k),
                (false, _) => (6.0 / n).sqrt(),
            };
            (0..layer.inputs).for_each(|row| fill(layer.weights + row * stride, width, limit));
            if let Some(skip) = layer.skip {
                (0..skipped).for_each(|row| fill(skip + row * stride, width, limit));
            }
            if sine {
                fill(layer.bias, width, 1.0 / n.sqrt());
            }
        }
        let (weights, _) = layers.output();
        let n = width as f32;
        let last = layers.hidden().len() - 1;
        let limit = if sine { (6.0 / n).sqrt() / activation.omega(last) } else { (1.0 / n).sqrt() };
        for row in 0..C {
            fill(weights.start + row * layers::padded(width), width, limit);
        }
        if let Some(bypass) = layers.bypass() {
            let (n, stride) = (layers.features, layers::padded(layers.features));
            let limit = (1.0 / n as f32).sqrt();
            (0..C).for_each(|row| fill(bypass.start + row * stride, n, limit));
        }
    }
}
