//! Tables of features on lattices: interpolation with tangents, and the way back into the tables.

mod kernels;

use std::ops::Range;

use self::kernels::{Gather, Of, Place, Scatter, SizedKernel};
use super::architecture::{Alignment, Grid, Interpolation};
use super::frame::Frame;
use crate::cpu::dispatch_simd;
use crate::{Scalar, cubic_weights};

/// One factor per axis; the first is 1, so that neighbours along axis 0 stay neighbours in the table.
/// Source: Teschner et al. 2003, eq. 1 with the constants of Müller et al. 2022, eq. 4, and two more primes.
const PRIMES: [u64; 8] = [
    1,
    2_654_435_761,
    805_459_861,
    3_674_653_429,
    2_097_192_037,
    1_434_869_437,
    2_165_219_737,
    3_367_900_313,
];

/// One level of a grid, as plain numbers.
#[derive(Debug, Clone)]
pub(crate) struct Table<const D: usize> {
    nodes: [usize; D],
    strides: [usize; D],
    pub rows: usize,
    hashed: bool,
    /// Position in nodes = `scale * u + shift` for scaled coordinates `u`.
    scale: [f32; D],
    shift: [f32; D],
    /// Where the table begins in the flat buffer.
    pub offset: usize,
}

/// All levels.
#[derive(Debug, Clone)]
pub(crate) struct Tables<const D: usize> {
    pub levels: Vec<Table<D>>,
    pub features: usize,
    pub interpolation: Interpolation,
}

impl<const D: usize> Tables<D> {
    pub fn new(grid: &Grid) -> Self {
        let mut offset = 0;
        let levels = grid.levels.iter().map(|level| {
            let nodes: [usize; D] = std::array::from_fn(|d| level.nodes[d]);
            let mut strides = [1usize; D];
            for d in 1..D {
                strides[d] = strides[d - 1].saturating_mul(nodes[d - 1]);
            }
            // -1..1 is this many node distances long and begins at this node.
            let (cells, first) = match (grid.alignment, grid.interpolation) {
                (Alignment::Centres, _) => (0.0, -0.5),
                (Alignment::Vertices, Interpolation::Cubic) => (-3.0, 1.0),
                (Alignment::Vertices, _) => (-1.0, 0.0),
            };
            let scale = std::array::from_fn(|d| 0.5 * (nodes[d] as f32 + cells));
            let table = Table {
                nodes,
                strides,
                rows: level.rows,
                hashed: level.node_count() != Some(level.rows),
                scale,
                shift: std::array::from_fn(|d| scale[d] + first),
                offset,
            };
            offset += level.rows * grid.features;
            table
        });
        Self {
            levels: levels.collect(),
            features: grid.features,
            interpolation: grid.interpolation,
        }
    }

    /// Features in all.
    pub fn outputs(&self) -> usize {
        self.levels.len() * self.features
    }

    /// Numbers in all tables.
    pub fn len(&self) -> usize {
        self.levels.iter().map(|t| t.rows * self.features).sum()
    }

    /// The definition: features of one point for any scalar.
    pub fn plain<T: Scalar>(&self, params: &[f32], u: [T; D], out: &mut Vec<T>) {
        let n = self.interpolation.taps();
        for table in &self.levels {
            let mut feature = vec![T::zero(); self.features];
            let axes: [(isize, [T; 4]); D] = std::array::from_fn(|d| {
                let c = |v: f32| T::from_f64(f64::from(v));
                plain_taps(self.interpolation, u[d] * c(table.scale[d]) + c(table.shift[d]))
            });
            for corner in 0..n.pow(D as u32) {
                let (mut rest, mut weight, mut node) = (corner, T::one(), [0; D]);
                for d in 0..D {
                    let (first, weights) = axes[d];
                    let i = (first + (rest % n) as isize).clamp(0, table.nodes[d] as isize - 1);
                    node[d] = i as usize;
                    weight *= weights[rest % n];
                    rest /= n;
                }
                let at = table.offset + table.row(&node) * self.features;
                for (f, p) in feature.iter_mut().zip(&params[at..]) {
                    *f += weight * T::from_f64(f64::from(*p));
                }
            }
            out.extend(feature);
        }
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
        for (k, table) in self.levels.iter().enumerate() {
            let place = Place {
                table,
                frame,
                interpolation: self.interpolation,
                x,
                stride,
                column: k * self.features,
            };
            let params = &params[table.offset..table.offset + table.rows * self.features];
            self.sized(Gather { place, params, out });
        }
    }

    /// Adds to the gradient of a part of one table, `rows`, what the cotangents of a tile's features of this
    /// level, `[block][point][feature]`, ask for.
    pub fn backward(
        &self,
        level: usize,
        rows: Range<usize>,
        gradient: &mut [f32],
        frame: &Frame<D>,
        x: &[[f32; D]],
        bar: &[f32],
    ) {
        let (table, interpolation) = (&self.levels[level], self.interpolation);
        let place = Place { table, frame, interpolation, x, stride: self.features, column: 0 };
        self.sized(Scatter { place, rows, gradient, bar });
    }

    /// Calls the kernel's copy for the sizes of this grid.
    fn sized(&self, kernel: impl SizedKernel) {
        match self.interpolation {
            Interpolation::Nearest => self.sized_features::<1>(kernel),
            Interpolation::Linear | Interpolation::Smoothstep => self.sized_features::<2>(kernel),
            Interpolation::Cubic => self.sized_features::<4>(kernel),
        }
    }

    fn sized_features<const N: usize>(&self, kernel: impl SizedKernel) {
        match self.features {
            1 => dispatch_simd(Of::<_, N, 1>(kernel)),
            2 => dispatch_simd(Of::<_, N, 2>(kernel)),
            3 => dispatch_simd(Of::<_, N, 3>(kernel)),
            4 => dispatch_simd(Of::<_, N, 4>(kernel)),
            _ => dispatch_simd(Of::<_, N, 8>(kernel)),
        }
    }
}

impl<const D: usize> Table<D> {
    pub fn is_hashed(&self) -> bool {
        self.hashed
    }

    /// The row of a node.
    fn row(&self, node: &[usize; D]) -> usize {
        self.join(self.base(node), node[0])
    }

    /// What the axes after the first contribute to a row.
    #[inline(always)]
    fn base(&self, node: &[usize; D]) -> usize {
        if self.hashed {
            (1..D).fold(0, |h, d| h ^ (node[d] as u64).wrapping_mul(PRIMES[d]) as usize)
        } else {
            (1..D).fold(0, |row, d| row + node[d] * self.strides[d])
        }
    }

    #[inline(always)]
    fn join(&self, base: usize, first: usize) -> usize {
        if self.hashed { (base ^ first) & (self.rows - 1) } else { base + first }
    }
}

/// The first node and the weights, by definition.
fn plain_taps<T: Scalar>(interpolation: Interpolation, at: T) -> (isize, [T; 4]) {
    let (zero, one) = (T::zero(), T::one());
    let cell = at.re().floor();
    let t = at - T::from_f64(cell);
    match interpolation {
        Interpolation::Nearest => ((at.re() + 0.5).floor() as isize, [one, zero, zero, zero]),
        Interpolation::Linear => (cell as isize, [one - t, t, zero, zero]),
        Interpolation::Smoothstep => {
            let s = t * t * (T::from_f64(3.0) - T::from_f64(2.0) * t);
            (cell as isize, [one - s, s, zero, zero])
        }
        Interpolation::Cubic => (cell as isize - 1, cubic_weights(t)),
    }
}
