use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// What a network computes: an encoding of the coordinates and a small multi-layer perceptron. A
/// plain record, written into checkpoints as it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Architecture {
    /// Coordinates to features.
    pub encoding: Encoding,
    /// Features to channels.
    pub mlp: Mlp,
}

/// Coordinates to features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Encoding {
    /// The coordinates themselves, scaled to -1..1.
    Identity,
    /// Sines and cosines of fixed frequencies.
    Fourier(Fourier),
    /// Tables of trained features, interpolated.
    Grid(Grid),
}

/// Sines and cosines of fixed frequencies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fourier {
    /// Which frequencies.
    pub frequencies: Frequencies,
    /// Whether the coordinates come first among the features.
    pub include_input: bool,
}

/// Angular frequencies, in radians per unit of the scaled coordinates (whose range is -1..1).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Frequencies {
    /// `base * 2^k` along every axis by itself, `k = 0 .. octaves`; per octave first the sines of all
    /// axes, then the cosines. Source: Mildenhall et al. 2020, eq. 4, where `base` is pi.
    Axis {
        /// Number of octaves.
        octaves: usize,
        /// The lowest frequency.
        base: f32,
    },
    /// `2 pi` times normally distributed vectors; first all sines, then all cosines. Source: Tancik et
    /// al. 2020, section 6.
    Gaussian {
        /// Number of vectors.
        count: usize,
        /// Standard deviation of each component, in cycles per unit.
        sigma: f32,
        /// Seed of the vectors.
        seed: u64,
    },
}

/// Tables of trained features on lattices of one or several resolutions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// How features between the nodes come about.
    pub interpolation: Interpolation,
    /// Where the nodes are.
    pub alignment: Alignment,
    /// Features per level: 1, 2, 3, 4 or 8.
    pub features: usize,
    /// One table each.
    pub levels: Vec<Level>,
}

/// One table of a [`Grid`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// Nodes along every axis.
    pub nodes: Vec<usize>,
    /// Rows of the table: the number of nodes, or a smaller power of two that the nodes are hashed
    /// into.
    pub rows: usize,
}

/// How features between nodes come about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// The nearest node's: constant pieces, no gradient.
    Nearest,
    /// Multilinear; the gradient jumps between cells.
    Linear,
    /// Multilinear in `3 t^2 - 2 t^3`; the gradient is continuous and vanishes at the nodes.
    Smoothstep,
    /// Cubic B-spline with the features as coefficients; C2.
    Cubic,
}

impl Interpolation {
    /// Nodes along each axis that a point depends on.
    pub fn taps(self) -> usize {
        match self {
            Self::Nearest => 1,
            Self::Linear | Self::Smoothstep => 2,
            Self::Cubic => 4,
        }
    }
}

/// Where the nodes of a grid are along an axis of scaled coordinates, -1..1. Beyond the outermost
/// nodes their features are repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Alignment {
    /// From -1 to 1 inclusive; cubic grids have one node more on either side.
    Vertices,
    /// At the centres of `nodes` equal cells: the samples of a signal.
    Centres,
}

/// A multi-layer perceptron: `depth` hidden layers of `width` units and a linear output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mlp {
    /// Units of a hidden layer.
    pub width: usize,
    /// Hidden layers, at least 1.
    pub depth: usize,
    /// What a unit does.
    pub activation: Activation,
    /// The hidden layer (1 .. depth) that gets the features once more beside the previous layer.
    pub skip: Option<usize>,
    /// Whether the output gets a linear map of the features as well. With it, a cubic level with a node per
    /// sample holds every spline of the signal; see [`Network::load_spline`](crate::Network::load_spline).
    #[serde(default)]
    pub bypass: bool,
}

/// What a unit does with its weighted sum `u`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Activation {
    /// `sin(omega u)`. Source: Sitzmann et al. 2020, eq. 1 and section 3.2.
    Sine {
        /// One factor per hidden layer; the last one repeats.
        omega: Vec<f32>,
    },
    /// `max(u, 0)`.
    Relu,
    /// `u / (1 + e^-u)`.
    Silu,
}

impl Activation {
    /// The factor of a hidden layer; 1 where there is none.
    pub fn omega(&self, layer: usize) -> f32 {
        match self {
            Self::Sine { omega } => omega.get(layer).or(omega.last()).copied().unwrap_or(1.0),
            Self::Relu | Self::Silu => 1.0,
        }
    }
}

impl Architecture {
    /// Sine network: `depth` hidden layers of `width`; 30 is the usual `omega`.
    pub fn siren(width: usize, depth: usize, omega: f32) -> Self {
        let activation = Activation::Sine { omega: vec![omega] };
        Self {
            encoding: Encoding::Identity,
            mlp: Mlp { width, depth, activation, skip: None, bypass: false },
        }
    }

    /// Gaussian Fourier features and a ReLU network.
    pub fn fourier(count: usize, sigma: f32, width: usize, depth: usize) -> Self {
        let frequencies = Frequencies::Gaussian { count, sigma, seed: 0 };
        Self {
            encoding: Encoding::Fourier(Fourier { frequencies, include_input: false }),
            mlp: Mlp { width, depth, activation: Activation::Relu, skip: None, bypass: false },
        }
    }

    /// The original NeRF network for positions: 10 octaves, 8 layers of 256, the features once more
    /// in layer 5.
    pub fn nerf() -> Self {
        let frequencies = Frequencies::Axis { octaves: 10, base: 1.0 };
        Self {
            encoding: Encoding::Fourier(Fourier { frequencies, include_input: true }),
            mlp: Mlp {
                width: 256,
                depth: 8,
                activation: Activation::Relu,
                skip: Some(5),
                bypass: false,
            },
        }
    }

    /// Linear hash grid and a ReLU network of two layers of 64: for values, not for gradients.
    ///
    /// `shape` is the signal's; tables have at most `rows` rows (a power of two). Few levels of eight features, from 64
    /// cells on the longest side (16 beyond two dimensions, fewer for small signals) to 1.4 per sample: a photograph
    /// of 512 x 512 took 450 steps to 40.4 dB, against 38.3 dB for ten levels of four and 36.2 dB for nine of two.
    ///
    /// Source: Müller et al. 2022, section 3.
    pub fn hash(shape: &[usize], rows: usize) -> Self {
        Self::grid_of(Interpolation::Linear, fine_levels(shape, 1, rows), 8, Activation::Relu)
    }

    /// Cubic B-spline grid and a SiLU network of two layers of 64: the choice where gradients count.
    ///
    /// `shape`, `rows` and the levels as in [`Architecture::hash`].
    pub fn grid(shape: &[usize], rows: usize) -> Self {
        Self::grid_of(Interpolation::Cubic, fine_levels(shape, 3, rows), 8, Activation::Silu)
    }

    /// A network that can hold the cubic spline through the samples of a signal exactly, and coarser cubic levels
    /// with a SiLU network of two layers of 64 to change it with: what blends of gridded signals are made of. For
    /// `channels` of 1, 2, 3, 4 or 8, in the frame [`Frame::of_samples`](crate::Frame::of_samples).
    pub fn spline_grid(shape: &[usize], channels: usize) -> Self {
        let quarter: Vec<usize> = shape.iter().map(|n| n.div_ceil(4)).collect();
        let mut levels = pyramid(&quarter, 8.0, 2.0, 3, usize::MAX);
        let nodes: Vec<usize> = shape.iter().map(|n| n + 2).collect();
        levels.push(Level { rows: nodes.iter().product(), nodes });
        let mut all = Self::grid_of(Interpolation::Cubic, levels, channels, Activation::Silu);
        all.mlp.bypass = true;
        all
    }

    /// One row of `features` per sample and a sine network: DINER. As published, interpolation is
    /// [`Interpolation::Nearest`] and the field has no gradient; [`Interpolation::Cubic`] gives it one.
    ///
    /// Source: Xie et al., "DINER: Disorder-Invariant Implicit Neural Representation", 2023.
    pub fn diner(
        shape: &[usize],
        interpolation: Interpolation,
        features: usize,
        width: usize,
        depth: usize,
        omega: f32,
    ) -> Self {
        let levels = vec![Level { nodes: shape.to_vec(), rows: shape.iter().product() }];
        let activation = Activation::Sine { omega: vec![omega] };
        Self {
            encoding: Encoding::Grid(Grid {
                interpolation,
                alignment: Alignment::Centres,
                features,
                levels,
            }),
            mlp: Mlp { width, depth, activation, skip: None, bypass: false },
        }
    }

    fn grid_of(
        interpolation: Interpolation,
        levels: Vec<Level>,
        features: usize,
        activation: Activation,
    ) -> Self {
        let alignment = Alignment::Vertices;
        Self {
            encoding: Encoding::Grid(Grid { interpolation, alignment, features, levels }),
            mlp: Mlp { width: 64, depth: 2, activation, skip: None, bypass: false },
        }
    }

    /// Whether the gradient of a network like this one can stand in a loss: it is continuous, so that
    /// sampling the loss sees all of it.
    pub fn has_continuous_gradient(&self) -> bool {
        let smooth = match &self.encoding {
            Encoding::Identity | Encoding::Fourier(_) => true,
            Encoding::Grid(g) => {
                matches!(g.interpolation, Interpolation::Smoothstep | Interpolation::Cubic)
            }
        };
        smooth && !matches!(self.mlp.activation, Activation::Relu)
    }

    /// Checks every number for `dimensions` coordinates.
    pub(crate) fn check(&self, dimensions: usize) -> Result<()> {
        let bad =
            |what, rule, value: usize| Err(Error::Parameter { what, rule, value: value as f32 });
        let mlp = &self.mlp;
        // 2^14 units and 2^10 layers: far beyond use, small enough that no size overflows.
        if !(1..=1 << 14).contains(&mlp.width) {
            return bad("the width of the network", "1 to 16384", mlp.width);
        }
        if !(1..=1 << 10).contains(&mlp.depth) {
            return bad("the depth of the network", "1 to 1024", mlp.depth);
        }
        if let Some(skip) = mlp.skip
            && !(1..mlp.depth).contains(&skip)
        {
            return bad("the layer of the skip connection", "1 to depth - 1", skip);
        }
        if let Activation::Sine { omega } = &mlp.activation {
            let wrong = omega.iter().find(|w| !(**w > 0.0 && w.is_finite()));
            if omega.is_empty() || wrong.is_some() {
                let value = wrong.copied().unwrap_or(f32::NAN);
                return Err(Error::Parameter { what: "omega", rule: "positive and finite", value });
            }
        }
        match &self.encoding {
            Encoding::Identity => Ok(()),
            Encoding::Fourier(fourier) => fourier.check(),
            Encoding::Grid(grid) => grid.check(dimensions),
        }
    }
}

impl Fourier {
    fn check(&self) -> Result<()> {
        let (what, rule, value, good) = match self.frequencies {
            Frequencies::Axis { octaves, .. } if !(1..=30).contains(&octaves) => {
                ("the number of octaves", "1 to 30", octaves as f32, false)
            }
            Frequencies::Axis { base, .. } => {
                ("the base frequency", "positive and finite", base, base > 0.0 && base.is_finite())
            }
            Frequencies::Gaussian { count, .. } if !(1..=1 << 14).contains(&count) => {
                ("the number of frequencies", "1 to 16384", count as f32, false)
            }
            Frequencies::Gaussian { sigma, .. } => {
                ("sigma", "positive and finite", sigma, sigma > 0.0 && sigma.is_finite())
            }
        };
        if good { Ok(()) } else { Err(Error::Parameter { what, rule, value }) }
    }
}

impl Grid {
    fn check(&self, dimensions: usize) -> Result<()> {
        let bad =
            |what, rule, value: usize| Err(Error::Parameter { what, rule, value: value as f32 });
        if ![1, 2, 3, 4, 8].contains(&self.features) {
            return bad("the number of features per level", "1, 2, 3, 4 or 8", self.features);
        }
        if !(1..=64).contains(&self.levels.len()) {
            return bad("the number of levels", "1 to 64", self.levels.len());
        }
        for level in &self.levels {
            if level.nodes.len() != dimensions {
                return Err(Error::Length { expected: dimensions, found: level.nodes.len() });
            }
            let smallest =
                if self.alignment == Alignment::Vertices { self.interpolation.taps() } else { 1 };
            if let Some(n) = level.nodes.iter().find(|n| !(smallest..=1 << 24).contains(n)) {
                return bad(
                    "the number of nodes along an axis",
                    "at least what a cell needs, at most 2^24",
                    *n,
                );
            }
            let nodes = level.node_count();
            let fits = level.rows.checked_mul(self.features).is_some_and(|n| n < 1 << 34);
            let hashed = level.rows.is_power_of_two() && nodes.is_none_or(|n| level.rows < n);
            if !fits || (Some(level.rows) != nodes && !hashed) {
                return bad(
                    "the rows of a table",
                    "the number of nodes or a smaller power of two",
                    level.rows,
                );
            }
        }
        Ok(())
    }
}

impl Level {
    /// Nodes in all; `None` beyond the range of numbers.
    pub(crate) fn node_count(&self) -> Option<usize> {
        self.nodes.iter().try_fold(1usize, |n, m| n.checked_mul(*m))
    }
}

/// The levels of [`Architecture::hash`].
fn fine_levels(shape: &[usize], extra: usize, rows: usize) -> Vec<Level> {
    let finest: Vec<usize> = shape.iter().map(|n| (1.4 * *n as f64).round() as usize).collect();
    let longest = finest.iter().copied().max().unwrap_or(1) as f64;
    // Small signals keep a few levels: one fine level alone learns its smooth parts slowly.
    let coarsest = (if shape.len() > 2 { 16.0_f64 } else { 64.0 }).min(longest / 4.0).max(1.0);
    pyramid(&finest, coarsest, 1.8, extra, rows)
}

/// Levels from `coarsest` cells on the longest side, each `growth` times finer, to `shape` cells; every
/// axis has `extra` nodes more than cells.
fn pyramid(shape: &[usize], coarsest: f64, growth: f64, extra: usize, rows: usize) -> Vec<Level> {
    let longest = shape.iter().copied().max().unwrap_or(1).max(1) as f64;
    let steps = ((longest / coarsest).ln() / growth.ln()).round().max(0.0) as usize;
    (0..=steps)
        .map(|k| {
            let scale = growth.powf(k as f64 - steps as f64);
            let cells = |n: &usize| ((*n as f64 * scale).round() as usize).max(1);
            let nodes: Vec<usize> = shape.iter().map(|n| cells(n) + extra).collect();
            let mut level = Level { nodes, rows };
            level.rows = level.node_count().map_or(rows, |n| n.min(rows));
            level
        })
        .collect()
}
