use super::architecture::Encoding;
use super::fourier::Waves;
use super::frame::Frame;
use super::grid::Tables;
use crate::Scalar;

/// An [`Encoding`] ready for work.
#[derive(Debug, Clone)]
pub(crate) enum Encoder<const D: usize> {
    Identity,
    Waves(Waves<D>),
    Tables(Tables<D>),
}

impl<const D: usize> Encoder<D> {
    pub fn new(encoding: &Encoding) -> Self {
        match encoding {
            Encoding::Identity => Self::Identity,
            Encoding::Fourier(fourier) => Self::Waves(Waves::new(fourier)),
            Encoding::Grid(grid) => Self::Tables(Tables::new(grid)),
        }
    }

    /// Features.
    pub fn outputs(&self) -> usize {
        match self {
            Self::Identity => D,
            Self::Waves(waves) => waves.outputs(),
            Self::Tables(tables) => tables.outputs(),
        }
    }

    /// Trained numbers.
    pub fn len(&self) -> usize {
        match self {
            Self::Identity | Self::Waves(_) => 0,
            Self::Tables(tables) => tables.len(),
        }
    }

    /// The definition: features of one point for any scalar.
    pub fn plain<T: Scalar>(&self, params: &[f32], u: [T; D]) -> Vec<T> {
        let mut out = Vec::with_capacity(self.outputs());
        match self {
            Self::Identity => out.extend(u),
            Self::Waves(waves) => waves.plain(u, &mut out),
            Self::Tables(tables) => tables.plain(params, u, &mut out),
        }
        out
    }

    /// Features of a tile, `[block][point][stride]`; tangents if there are blocks for them.
    pub fn forward(
        &self,
        params: &[f32],
        frame: &Frame<D>,
        x: &[[f32; D]],
        out: &mut [f32],
        stride: usize,
    ) {
        match self {
            Self::Identity => identity(frame, x, out, stride),
            Self::Waves(waves) => waves.forward(frame, x, out, stride),
            Self::Tables(tables) => tables.forward(params, frame, x, out, stride),
        }
    }
}

fn identity<const D: usize>(frame: &Frame<D>, x: &[[f32; D]], out: &mut [f32], stride: usize) {
    let block = x.len() * stride;
    let tangents = out.len() > block;
    for (p, x) in x.iter().enumerate() {
        for d in 0..D {
            let at = p * stride + d;
            out[at] = (x[d] - frame.center[d]) * frame.inverse(d);
            if tangents {
                (0..D).for_each(|e| out[at + (1 + e) * block] = 0.0);
                out[at + (1 + d) * block] = frame.inverse(d);
            }
        }
    }
}
