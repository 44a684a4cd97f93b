//! Interpolation on one level for a tile of points, and its way back: sizes are constants of the compiled code.

use std::ops::Range;

use super::{Frame, Interpolation, Table};
use crate::cpu::{Simd, SimdKernel};
use crate::{cubic_weights, cubic_weights_d1};

/// A kernel with the number of taps per axis and of features per level as constants.
pub(super) trait SizedKernel {
    fn run<S: Simd, const N: usize, const F: usize>(self);
}

pub(super) struct Of<K, const N: usize, const F: usize>(pub K);

impl<K: SizedKernel, const N: usize, const F: usize> SimdKernel for Of<K, N, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        self.0.run::<S, N, F>();
    }
}

/// One level's columns of a tile.
pub(super) struct Place<'a, const D: usize> {
    pub table: &'a Table<D>,
    pub frame: &'a Frame<D>,
    pub interpolation: Interpolation,
    pub x: &'a [[f32; D]],
    pub stride: usize,
    pub column: usize,
}

/// Points of a tile at most: what [`Layers::tile`](crate::network::layers::Layers::tile) gives.
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

pub(super) struct Gather<'a, const D: usize> {
    pub place: Place<'a, D>,
    pub params: &'a [f32],
    pub out: &'a mut [f32],
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

pub(super) struct Scatter<'a, const D: usize> {
    pub place: Place<'a, D>,
    pub rows: Range<usize>,
    pub gradient: &'a mut [f32],
    pub bar: &'a [f32],
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
