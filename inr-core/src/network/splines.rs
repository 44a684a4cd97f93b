use super::Network;
use super::architecture::{Alignment, Encoding, Interpolation, Level};
use super::layers;
use crate::{Error, Result, Spline, mirror};

impl<const D: usize, const C: usize> Network<D, C> {
    /// Makes the network equal to a spline within its frame: the spline's coefficients go into the finest level, the
    /// linear map past the layers picks them out, and the last layer of the perceptron begins at zero. From there it
    /// can be trained; nothing of the spline is lost before.
    ///
    /// For networks of [`Architecture::spline_grid`](crate::Architecture::spline_grid), in the frame
    /// [`Frame::of_samples`](crate::Frame::of_samples) of the spline's lattice or of a part of it.
    ///
    /// # Errors
    /// [`Error::NoSplineLevel`] if the network has no such level or map, or another frame.
    pub fn load_spline(&mut self, spline: &Spline<D, C>) -> Result<()> {
        let (first_knot, nodes) = self.knots(spline);
        let no_level = || Error::NoSplineLevel { nodes: nodes.to_vec() };
        let Encoding::Grid(grid) = &self.architecture.encoding else { return Err(no_level()) };
        let bypass = self.layers.bypass().ok_or_else(no_level)?;
        let fits = grid.interpolation == Interpolation::Cubic
            && grid.alignment == Alignment::Vertices
            && grid.features >= C;
        let holds = |l: &Level| l.nodes == nodes && l.node_count() == Some(l.rows);
        let level = grid.levels.iter().position(holds).filter(|_| fits).ok_or_else(no_level)?;
        let first_knot = first_knot.ok_or_else(no_level)?;
        let features = grid.features;
        let first: usize = grid.levels[..level].iter().map(|l| l.rows * features).sum();
        let shape = spline.domain().shape();
        for row in 0..nodes.iter().product::<usize>() {
            // Node 0 lies one knot before the frame; beyond the outermost knots a spline is its mirror image.
            let (mut rest, mut at, mut stride) = (row, 0, 1);
            for d in 0..D {
                at += mirror((rest % nodes[d]) as isize - 1 + first_knot[d], shape[d]) * stride;
                (rest, stride) = (rest / nodes[d], stride * shape[d]);
            }
            for c in 0..C {
                let value = spline.coefficients().plane(c)[at];
                self.params[first + row * features + c] =
                    (value - self.output.offset[c]) / self.output.scale[c];
            }
        }
        let stride = layers::padded(self.layers.features);
        let of_layers = self.perceptron().start;
        let (weights, bias) = self.layers.output();
        let params = &mut self.params[of_layers..];
        params[bypass.clone()].fill(0.0);
        for c in 0..C {
            params[bypass.start + c * stride + level * features + c] = 1.0;
        }
        params[weights].fill(0.0);
        params[bias].fill(0.0);
        Ok(())
    }

    /// The knot at the lower end of the frame, if there is one, and the nodes that a level with a node per knot needs.
    fn knots(&self, spline: &Spline<D, C>) -> (Option<[isize; D]>, [usize; D]) {
        /// Knots: rounding of positions in f32.
        const SLACK: f32 = 1e-2;
        let (pitch, frame) = (spline.domain().pitch(), &self.frame);
        let low = std::array::from_fn(|d| frame.center[d] - frame.half[d]);
        let first = spline.domain().to_index(&low);
        // A single sample has a frame of one pitch around it.
        let cells: [f32; D] = std::array::from_fn(|d| 2.0 * frame.half[d] / pitch[d]);
        let single = |d: usize| spline.domain().shape()[d] == 1;
        let on_knots = (0..D).all(|d| {
            single(d)
                || ((first[d] - first[d].round()).abs() < SLACK
                    && (cells[d] - cells[d].round()).abs() < SLACK)
        });
        let knot = first.map(|i| i.round() as isize);
        let nodes =
            std::array::from_fn(|d| if single(d) { 3 } else { cells[d].round() as usize + 3 });
        (on_knots.then_some(knot), nodes)
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        Architecture, Domain, Error, Field, Frame, Jet, Network, Output, Samples, Spline, Unit,
    };

    fn network_is_the_spline<const D: usize, const C: usize>() {
        let shape = std::array::from_fn(|d| 9 + 2 * d);
        let pitch = std::array::from_fn(|d| 0.5 + d as f32);
        let domain = Domain::new(shape, pitch, [3.0; D], Unit::Sample).unwrap();
        let samples = Samples::<D, C>::from_fn(domain, |x| {
            std::array::from_fn(|c| (x.iter().sum::<f32>() * 1.3 + c as f32).sin())
        });
        let spline = Spline::interpolate(&samples);
        let build = |frame| {
            let output = Output::of_range(-1.0, 2.0);
            Network::<D, C>::new(Architecture::spline_grid(&shape, C), frame, output, 1).unwrap()
        };
        let mut network = build(Frame::of_samples(&domain));
        network.load_spline(&spline).unwrap();
        let x: Vec<[f32; D]> = (0..200)
            .map(|k| {
                let t = |d: usize| ((k * (7 + 4 * d)) % 200) as f32 / 199.0;
                std::array::from_fn(|d| 3.0 + t(d) * pitch[d] * (shape[d] - 1) as f32)
            })
            .collect();
        let (mut a, mut b) = (vec![Jet::ZERO; x.len()], vec![Jet::ZERO; x.len()]);
        spline.eval_jet(&x, &mut a);
        network.eval_jet(&x, &mut b);
        for (a, b) in a.iter().zip(&b) {
            for c in 0..C {
                // f32 rounding of values and positions of order 10.
                assert!((a.value[c] - b.value[c]).abs() < 2e-5, "{a:?} {b:?}");
                (0..D).for_each(|d| assert!((a.grad[c][d] - b.grad[c][d]).abs() < 1e-4));
            }
        }
        let other = build(Frame::of_cells(&domain)).load_spline(&spline);
        assert!(matches!(other, Err(Error::NoSplineLevel { .. })));
    }

    #[test]
    fn network_is_the_spline_audio() {
        network_is_the_spline::<1, 1>();
    }
    #[test]
    fn network_is_the_spline_image() {
        network_is_the_spline::<2, 3>();
    }
    #[test]
    fn network_is_the_spline_volume() {
        network_is_the_spline::<3, 1>();
    }
}
