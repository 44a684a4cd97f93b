//! Tables of features on lattices: interpolation with tangents, and the way back into the tables.

use std::ops::Range;

use super::architecture::{Alignment, Grid, Interpolation};
use super::frame::Frame;
use crate::cpu::{Simd, SimdKernel, dispatch_simd};
use crate::{Scalar, cubic_weights, cubic_weights_d1};

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

/// A kernel with the number of taps per axis and of features per level as constants.
trait SizedKernel {
    fn run<S: Simd, const N: usize, const F: usize>(self);
}

struct Of<K, const N: usize, const F: usize>(K);

impl<K: SizedKernel, const N: usize, const F: usize> SimdKernel for Of<K, N, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        self.0.run::<S, N, F>();
    }
}

/// One level's columns of a tile.
struct Place<'a, const D: usize> {
    table: &'a Table<D>,
    frame: &'a Frame<D>,
    interpolation: Interpolation,
    x: &'a [[f32; D]],
    stride: usize,
    column: usize,
}

/// Points of a tile at most: what [`Layers::tile`](super::layers::Layers::tile) gives.
const MOST: usize = 96;

/// What the points of a tile need of one axis: their first nodes, the weights of the nodes from there on,
/// and the derivatives of the weights per physical unit. Arrays over points, so that filling them
/// vectorises: it took half of the time when done point by point.
struct Taps<const N: usize> {
    first: [i32; MOST],
    weight: [[f32; MOST]; N],
    slope: [[f32; MOST]; N],
}

/// One point's part of that.
#[derive(Clone, Copy)]
struct Tap<const N: usize> {
    first: i32,
    weight: [f32; N],
    slope: [f32; N],
}

impl<const N: usize> Taps<N> {
    #[inline(always)]
    fn at(&self, p: usize) -> Tap<N> {
        let mut tap = Tap { first: self.first[p], weight: [0.0; N], slope: [0.0; N] };
        for i in 0..N {
            (tap.weight[i], tap.slope[i]) = (self.weight[i][p], self.slope[i][p]);
        }
        tap
    }
}

impl<const D: usize> Place<'_, D> {
    /// The taps of all axes. No closure between here and the loops: one that is not inlined is compiled for
    /// the baseline.
    #[inline(always)]
    fn axes<const N: usize>(&self) -> [Taps<N>; D] {
        let mut axes = [const {
            Taps { first: [0; MOST], weight: [[1.0; MOST]; N], slope: [[0.0; MOST]; N] }
        }; D];
        for d in 0..D {
            self.fill(d, &mut axes[d]);
        }
        axes
    }

    #[inline(always)]
    fn fill<const N: usize>(&self, d: usize, taps: &mut Taps<N>) {
        let (table, n) = (self.table, self.x.len());
        assert!(n <= MOST, "{n} points in a tile");
        let (center, inverse) = (self.frame.center[d], self.frame.inverse(d));
        let (scale, shift) = (table.scale[d], table.shift[d]);
        // Everything further out is constant.
        let (least, most) = (-8.0, table.nodes[d] as f32 + 8.0);
        let per_unit = inverse * scale;
        let smooth = self.interpolation == Interpolation::Smoothstep;
        let Taps { first, weight, slope } = taps;
        for (p, x) in self.x.iter().enumerate() {
            let at = ((x[d] - center) * inverse * scale + shift).clamp(least, most);
            // Rounding down by an integer conversion: `at` is above -8, and NaN becomes -9 and stays in `t`.
            let down = |v: f32| (v + 9.0) as i32 - 9;
            if N == 1 {
                first[p] = down(at + 0.5);
                continue;
            }
            let cell = down(at);
            let t = at - cell as f32;
            if N == 2 {
                let (s, ds) =
                    if smooth { (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)) } else { (t, 1.0) };
                first[p] = cell;
                (weight[0][p], weight[1][p]) = (1.0 - s, s);
                (slope[0][p], slope[1][p]) = (-ds * per_unit, ds * per_unit);
            } else {
                first[p] = cell - 1;
                let (w, dw) = (cubic_weights(t), cubic_weights_d1(t));
                for i in 0..N {
                    weight[i][p] = w[i];
                    slope[i][p] = dw[i] * per_unit;
                }
            }
        }
    }

    #[inline(always)]
    fn clamped(&self, d: usize, i: i32) -> usize {
        i.clamp(0, self.table.nodes[d] as i32 - 1) as usize
    }

    /// Calls `visit` for every row of nodes along axis 0 that the point depends on, with what the other
    /// axes contribute to the row's number, the product of their weights, and that product with axis `d`'s
    /// slope instead of its weight.
    #[inline(always)]
    fn for_rows<const N: usize>(
        &self,
        taps: &[Tap<N>; D],
        mut visit: impl FnMut(usize, f32, [f32; D]),
    ) {
        for corner in 0..N.pow(D as u32 - 1) {
            let (mut rest, mut node, mut weight, mut slopes) = (corner, [0; D], 1.0, [1.0; D]);
            for d in 1..D {
                let i = rest % N;
                rest /= N;
                node[d] = self.clamped(d, taps[d].first + i as i32);
                weight *= taps[d].weight[i];
                for e in 1..D {
                    slopes[e] *= if e == d { taps[d].slope[i] } else { taps[d].weight[i] };
                }
            }
            visit(self.table.base(&node), weight, slopes);
        }
    }

    /// The row of the table where `N` nodes from `first` on lie side by side, if they do.
    #[inline(always)]
    fn together<const N: usize>(&self, base: usize, first: i32) -> Option<usize> {
        let table = self.table;
        let inside = first >= 0 && first as usize + N <= table.nodes[0];
        (inside && !table.hashed).then(|| base + first as usize)
    }
}

struct Gather<'a, const D: usize> {
    place: Place<'a, D>,
    params: &'a [f32],
    out: &'a mut [f32],
}

impl<const D: usize> SizedKernel for Gather<'_, D> {
    #[inline(always)]
    fn run<S: Simd, const N: usize, const F: usize>(self) {
        let (rows, rest) = self.params.as_chunks::<F>();
        debug_assert!(rest.is_empty());
        if self.out.len() > self.place.x.len() * self.place.stride {
            gather::<S, D, N, F, true>(&self.place, rows, self.out);
        } else {
            gather::<S, D, N, F, false>(&self.place, rows, self.out);
        }
    }
}

#[inline(always)]
fn gather<S: Simd, const D: usize, const N: usize, const F: usize, const TANGENTS: bool>(
    place: &Place<'_, D>,
    rows: &[[f32; F]],
    out: &mut [f32],
) {
    let block = place.x.len() * place.stride;
    let axes = place.axes::<N>();
    for p in 0..place.x.len() {
        let mut taps = [const { Tap { first: 0, weight: [0.0; N], slope: [0.0; N] } }; D];
        for d in 0..D {
            taps[d] = axes[d].at(p);
        }
        let mut nodes = [0; N];
        for i in 0..N {
            nodes[i] = place.clamped(0, taps[0].first + i as i32);
        }
        // Sums over the other axes, still apart for each node along axis 0.
        let mut value = [[0.0f32; F]; N];
        let mut slope = [[[0.0f32; F]; N]; D];
        place.for_rows(&taps, |base, weight, slopes| {
            let mut line = [[0.0; F]; N];
            match place.together::<N>(base, taps[0].first) {
                Some(row) => line.copy_from_slice(&rows[row..row + N]),
                None => (0..N).for_each(|i| line[i] = rows[place.table.join(base, nodes[i])]),
            }
            for i in 0..N {
                for f in 0..F {
                    value[i][f] = S::fma(weight, line[i][f], value[i][f]);
                }
            }
            if TANGENTS {
                for d in 1..D {
                    for i in 0..N {
                        for f in 0..F {
                            slope[d][i][f] = S::fma(slopes[d], line[i][f], slope[d][i][f]);
                        }
                    }
                }
            }
        });
        let across = |weights: &[f32; N], sums: &[[f32; F]; N]| {
            let mut feature = [0.0f32; F];
            for i in 0..N {
                for f in 0..F {
                    feature[f] = S::fma(weights[i], sums[i][f], feature[f]);
                }
            }
            feature
        };
        let at = p * place.stride + place.column;
        out[at..at + F].copy_from_slice(&across(&taps[0].weight, &value));
        if TANGENTS {
            for d in 0..D {
                let (weights, sums) =
                    if d == 0 { (&taps[0].slope, &value) } else { (&taps[0].weight, &slope[d]) };
                let at = at + (1 + d) * block;
                out[at..at + F].copy_from_slice(&across(weights, sums));
            }
        }
    }
}

struct Scatter<'a, const D: usize> {
    place: Place<'a, D>,
    rows: Range<usize>,
    gradient: &'a mut [f32],
    bar: &'a [f32],
}

impl<const D: usize> SizedKernel for Scatter<'_, D> {
    #[inline(always)]
    fn run<S: Simd, const N: usize, const F: usize>(self) {
        let (gradient, rest) = self.gradient.as_chunks_mut::<F>();
        debug_assert!(rest.is_empty());
        if self.bar.len() > self.place.x.len() * self.place.stride {
            scatter::<S, D, N, F, true>(&self.place, self.rows, gradient, self.bar);
        } else {
            scatter::<S, D, N, F, false>(&self.place, self.rows, gradient, self.bar);
        }
    }
}

#[inline(always)]
fn scatter<S: Simd, const D: usize, const N: usize, const F: usize, const TANGENTS: bool>(
    place: &Place<'_, D>,
    part: Range<usize>,
    gradient: &mut [[f32; F]],
    bar: &[f32],
) {
    let block = place.x.len() * place.stride;
    let whole = part.len() == place.table.rows;
    let axes = place.axes::<N>();
    for p in 0..place.x.len() {
        if !whole {
            let (plane, first) = (place.table.strides[D - 1], axes[D - 1].first[p]);
            let lowest = place.clamped(D - 1, first) * plane;
            let end = (place.clamped(D - 1, first + N as i32 - 1) + 1) * plane;
            if end <= part.start || lowest >= part.end {
                continue;
            }
        }
        let mut taps = [const { Tap { first: 0, weight: [0.0; N], slope: [0.0; N] } }; D];
        for d in 0..D {
            taps[d] = axes[d].at(p);
        }
        let mut nodes = [0; N];
        for i in 0..N {
            nodes[i] = place.clamped(0, taps[0].first + i as i32);
        }
        let at = p * place.stride + place.column;
        let read = |at: usize| -> [f32; F] { std::array::from_fn(|f| bar[at + f]) };
        // Cotangents already spread along axis 0.
        let mut value = [[0.0f32; F]; N];
        let mut slope = [[[0.0f32; F]; N]; D];
        let spread = |weights: &[f32; N], bar: [f32; F], sums: &mut [[f32; F]; N]| {
            for i in 0..N {
                for f in 0..F {
                    sums[i][f] = S::fma(weights[i], bar[f], sums[i][f]);
                }
            }
        };
        spread(&taps[0].weight, read(at), &mut value);
        if TANGENTS {
            spread(&taps[0].slope, read(at + block), &mut value);
            for d in 1..D {
                spread(&taps[0].weight, read(at + (1 + d) * block), &mut slope[d]);
            }
        }
        place.for_rows(&taps, |base, weight, slopes| {
            let mut line = [[0.0f32; F]; N];
            for i in 0..N {
                for f in 0..F {
                    line[i][f] = weight * value[i][f];
                    if TANGENTS {
                        for d in 1..D {
                            line[i][f] = S::fma(slopes[d], slope[d][i][f], line[i][f]);
                        }
                    }
                }
            }
            match place.together::<N>(base, taps[0].first) {
                Some(row) if whole || (row >= part.start && row + N <= part.end) => {
                    let rows = &mut gradient[row - part.start..row - part.start + N];
                    for i in 0..N {
                        for f in 0..F {
                            rows[i][f] += line[i][f];
                        }
                    }
                }
                _ => {
                    for i in 0..N {
                        let row = place.table.join(base, nodes[i]);
                        if whole || part.contains(&row) {
                            for f in 0..F {
                                gradient[row - part.start][f] += line[i][f];
                            }
                        }
                    }
                }
            }
        });
    }
}
