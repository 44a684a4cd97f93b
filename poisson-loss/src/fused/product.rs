//! The operator's pass: the next direction, its product with the matrix, and their inner product.

use inr_core::cpu::{Kernel, dispatch};

use super::blocks::{BLOCK, Class};
use crate::operator::{
    REACH, Scratch, SplineOperator, cell_points, factor_taps, pair, symmetric7, symmetric7_both,
};
use crate::ring::Ring;
use crate::tile::{Beyond, Tile};

/// Buffers of one thread: planes in two dimensions and where the screening is uniform, whole
/// tiles elsewhere.
#[derive(Default)]
pub struct Work {
    scratch: Scratch,
    rings: Rings,
}

/// The last planes of the operator's two products; see [`SplineOperator`].
#[derive(Default)]
struct Rings {
    load: Ring,
    mass: [Ring; 2],
    stiff: [Ring; 2],
    /// Two dimensions, mixed screening: the weights of a row of cells, and what the points below
    /// and above its samples give back.
    weight: Ring,
    points: [Ring; 2],
}

/// The vectors of one slab's task.
pub struct Vectors<'a> {
    pub z: &'a [f32],
    pub p: &'a [f32],
    pub beta: f32,
    /// From the slab on.
    pub p_next: &'a mut [f32],
    /// From the slab on.
    pub q: &'a mut [f32],
}

/// `p_next = z + beta p`, `q = A p_next`, on a tile; returns `p_next . q`.
pub fn direction<const D: usize>(
    tile: Tile<D>,
    operator: &SplineOperator<D>,
    class: &Class,
    vectors: Vectors<'_>,
    work: &mut Work,
) -> f64 {
    if D == 2 || class.uniform.is_some() {
        return dispatch(Along { tile, operator, class, vectors, rings: &mut work.rings });
    }
    let Vectors { z, p, beta, p_next, q } = vectors;
    let mut buffer = std::mem::take(&mut work.scratch.input);
    dispatch(Combine { tile: &tile, z, p, beta, buffer: &mut buffer, p_next });
    operator.apply_classified(&tile, None, &buffer, &mut work.scratch);
    let dot = dispatch(StoreDot { tile: &tile, p: &buffer, q: &work.scratch.output, out: q });
    work.scratch.input = buffer;
    dot
}

/// [`direction`] plane by plane; a tile of mixed screening only in two dimensions.
struct Along<'a, const D: usize> {
    tile: Tile<D>,
    operator: &'a SplineOperator<D>,
    class: &'a Class,
    vectors: Vectors<'a>,
    rings: &'a mut Rings,
}

impl<const D: usize> Along<'_, D> {
    /// Loads a plane and applies all axes but the last: `m' = M m`, `k' = M k + alpha K m`.
    #[inline(always)]
    fn load_plane(&mut self, plane: usize) {
        let (e0, n0, halo) = (self.tile.extent(0), self.tile.core[0], self.tile.halo);
        let strides = self.tile.strides();
        let rows = strides[D - 1] / e0;
        let Rings { load, mass: [m, m_other], stiff: [k, k_other], .. } = &mut *self.rings;
        let Vectors { z, p, beta, p_next, .. } = &mut self.vectors;
        for row in 0..rows {
            let line = &mut load.at_mut(plane)[row * e0..(row + 1) * e0];
            if *beta == 0.0 {
                self.tile.load_row(plane * rows + row, z, Beyond::Zero, line);
            } else {
                self.tile.load_row_sum(plane * rows + row, z, *beta, p, line);
            }
        }
        if (halo..self.tile.extent(D - 1) - halo).contains(&plane) {
            for (row, at) in self.tile.core_rows_of(plane) {
                let line = &load.at(plane)[row * e0 + halo..][..n0];
                p_next[at..][..n0].copy_from_slice(line);
            }
        }
        let (m_taps, k_taps) = factor_taps();
        let (mut m, mut k, mut m_other, mut k_other) = (m, k, m_other, k_other);
        if D % 2 == 1 {
            // The last of these axes must write the rings that are kept.
            std::mem::swap(&mut m, &mut m_other);
            std::mem::swap(&mut k, &mut k_other);
        }
        for d in 0..D - 1 {
            let k_taps = k_taps.map(|v| v * self.operator.alpha[d]);
            let stride = strides[d];
            if d == 0 {
                let src = shifts(load, plane, stride);
                symmetric7_both(m.at_mut(plane), k.at_mut(plane), src, m_taps, k_taps);
            } else {
                let (x, y) = (shifts(m_other, plane, stride), shifts(k_other, plane, stride));
                symmetric7(m.at_mut(plane), x, m_taps);
                pair(k.at_mut(plane), x, k_taps, y, m_taps);
            }
            std::mem::swap(&mut m, &mut m_other);
            std::mem::swap(&mut k, &mut k_other);
        }
    }

    /// The weights of one row of cells, each shared by the cell's four points.
    #[inline(always)]
    fn load_weights(&mut self, row: usize) {
        let line = self.rings.weight.at_mut(row);
        self.tile.load_row(row, &self.operator.screening, Beyond::Edge, line);
        line.iter_mut().for_each(|w| *w *= 0.25);
    }

    /// `sum over the cell's points at this height of B^T s B c`, still at that height: what a row
    /// of cells gives to the coefficient rows around it, on the blocks that need it. `half` 0 is
    /// below the samples, 1 above.
    #[inline(always)]
    fn cell_row(&mut self, row: usize, half: usize) {
        let needed = self.class.needed[row];
        let Rings { load, weight, points, .. } = &mut *self.rings;
        for block in (0..u32::BITS).filter(|b| needed >> b & 1 == 1) {
            let first = self.tile.halo + block as usize * BLOCK;
            let end = (first + BLOCK).min(self.tile.extent(0));
            let sum = cell_block(load, weight, row, half, first);
            points[half].at_mut(row)[first..end].copy_from_slice(&sum[..end - first]);
        }
    }

    /// The last axis on one plane, and its share of the inner product.
    #[inline(always)]
    fn finish(&mut self, plane: usize) -> f64 {
        let (tile, n0) = (self.tile, self.tile.core[0]);
        let mut dot = 0.0;
        for (row, at) in tile.core_rows_of(plane) {
            let local = row * tile.extent(0) + tile.halo;
            if let Some(s) = self.class.uniform {
                self.finish_run(plane, local, at, n0, s);
            } else {
                let blocks = n0.div_ceil(BLOCK);
                let classes = &self.class.blocks[(plane - tile.halo) * blocks..][..blocks];
                let mut from = 0;
                while from < blocks {
                    let class = classes[from];
                    let same = |b: &&f32| b.to_bits() == class.to_bits();
                    let to = from + classes[from..].iter().take_while(same).count();
                    let start = from * BLOCK;
                    let n = (to * BLOCK).min(n0) - start;
                    if class.is_nan() {
                        self.finish_run(plane, local + start, at + start, n, 0.0);
                        let q = &mut self.vectors.q[at + start..][..n];
                        self.rings.add_points(plane, local + start, q);
                    } else {
                        self.finish_run(plane, local + start, at + start, n, class);
                    }
                    from = to;
                }
            }
            let (p, q) = (&self.vectors.p_next[at..][..n0], &self.vectors.q[at..][..n0]);
            dot += super::weigh_row(&tile, plane, row, p, q);
        }
        dot
    }

    /// The last axis on a run of coefficients of screening `s`.
    #[inline(always)]
    fn finish_run(&mut self, plane: usize, local: usize, at: usize, n: usize, s: f32) {
        let (mass, stiff) = factor_taps();
        let alpha = self.operator.alpha[D - 1];
        let taps: [f32; 4] = std::array::from_fn(|j| alpha * stiff[j] + s * mass[j]);
        let Rings { mass: [m, _], stiff: [k, _], .. } = &*self.rings;
        let (m, k) = (planes(m, plane, local, n), planes(k, plane, local, n));
        pair(&mut self.vectors.q[at..][..n], m, taps, k, mass);
    }
}

/// One block of [`Along::cell_row`]: [`BLOCK`] coefficients from column `first` on.
#[inline(always)]
fn cell_block(load: &Ring, weight: &Ring, row: usize, half: usize, first: usize) -> [f32; BLOCK] {
    /// Cells seen by a block, and a few more.
    const CELLS: usize = BLOCK + 8;
    /// Coefficients seen by those.
    const SEEN: usize = CELLS + 8;
    let points = cell_points();
    let (t, below) = (points[half].value, points[half].first);
    let [a, b, c, d]: [&[f32; SEEN]; 4] = std::array::from_fn(|k| {
        let row = (row + k).wrapping_add_signed(below);
        load.shifted(row, first as isize - 4, SEEN).try_into().expect("as long")
    });
    let values: [f32; SEEN] =
        std::array::from_fn(|i| t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i]);
    let mut sum = [0.0; BLOCK];
    for (column, point) in points.iter().enumerate() {
        let t = point.value;
        // The first cell that the block sees, from this side of its sample.
        let cell = first as isize - 1 - column as isize;
        let weight: &[f32; CELLS] = weight.shifted(row, cell, CELLS).try_into().expect("as long");
        let across: [f32; CELLS] = std::array::from_fn(|i| {
            let v = &values[i + 1..i + 5];
            weight[i] * (t[0] * v[0] + t[1] * v[1] + t[2] * v[2] + t[3] * v[3])
        });
        for (i, sum) in sum.iter_mut().enumerate() {
            let v = &across[i..i + 4];
            *sum += t[0] * v[3] + t[1] * v[2] + t[2] * v[1] + t[3] * v[0];
        }
    }
    sum
}

impl Rings {
    /// Adds what the cell rows around a coefficient row give to it.
    #[inline(always)]
    fn add_points(&self, row: usize, local: usize, q: &mut [f32]) {
        let n = q.len();
        for (point, ring) in cell_points().iter().zip(&self.points) {
            let from = |k: usize| {
                ring.shifted((row - k).wrapping_add_signed(-point.first), local as isize, n)
            };
            let ([a, b, c, d], t) = ([from(0), from(1), from(2), from(3)], point.value);
            for i in 0..n {
                q[i] += t[0] * a[i] + t[1] * b[i] + t[2] * c[i] + t[3] * d[i];
            }
        }
    }
}

impl<const D: usize> Kernel for Along<'_, D> {
    type Output = f64;
    #[inline(always)]
    fn run(mut self) -> f64 {
        let strides = self.tile.strides();
        let plane = strides[D - 1];
        let reach = if D > 2 { REACH * strides[D - 2] } else { REACH };
        let mixed = self.class.uniform.is_none();
        let Rings { load, mass, stiff, weight, points: [below, above] } = &mut *self.rings;
        load.reset(8, plane, reach);
        if mixed {
            for ring in [weight, below, above] {
                ring.reset(8, plane, reach);
            }
        }
        for [kept, spare] in [mass, stiff] {
            kept.reset(8, plane, reach);
            spare.reset(1, plane, reach);
        }
        let mut dot = 0.0;
        for step in 0..self.tile.extent(D - 1) {
            self.load_plane(step);
            if mixed && step >= REACH {
                // Points above a row of samples see one coefficient row more than points below it.
                if step == REACH {
                    self.load_weights(step - 2);
                }
                self.load_weights(step - 1);
                self.cell_row(step - 1, 0);
                self.cell_row(step - 2, 1);
            }
            if step >= 2 * REACH {
                dot += self.finish(step - REACH);
            }
        }
        dot
    }
}

/// The seven shifts of a plane that a symmetric stencil along one axis reads.
#[inline(always)]
fn shifts(ring: &Ring, plane: usize, stride: usize) -> [&[f32]; 7] {
    let n = ring.at(plane).len();
    std::array::from_fn(|k| ring.shifted(plane, (k as isize - REACH as isize) * stride as isize, n))
}

/// The seven planes that a symmetric stencil along the last axis reads.
#[inline(always)]
fn planes(ring: &Ring, plane: usize, local: usize, n: usize) -> [&[f32]; 7] {
    let at = |k: usize| ring.shifted(plane + k - REACH, local as isize, n);
    [at(0), at(1), at(2), at(3), at(4), at(5), at(6)]
}

/// Loads `z + beta p` and stores its core as the next direction.
struct Combine<'a, const D: usize> {
    tile: &'a Tile<D>,
    z: &'a [f32],
    p: &'a [f32],
    beta: f32,
    buffer: &'a mut Vec<f32>,
    p_next: &'a mut [f32],
}

impl<const D: usize> Kernel for Combine<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.buffer.resize(self.tile.len(), 0.0);
        for (row, line) in self.buffer.chunks_exact_mut(self.tile.extent(0)).enumerate() {
            self.tile.load_row_sum(row, self.z, self.beta, self.p, line);
        }
        self.tile.store(self.buffer, self.p_next);
    }
}

/// Stores `q` and returns `p . q` over the core.
struct StoreDot<'a, const D: usize> {
    tile: &'a Tile<D>,
    p: &'a [f32],
    q: &'a [f32],
    out: &'a mut [f32],
}

impl<const D: usize> Kernel for StoreDot<'_, D> {
    type Output = f64;
    #[inline(always)]
    fn run(self) -> f64 {
        let (tile, n0) = (self.tile, self.tile.core[0]);
        tile.store(self.q, self.out);
        let stride = tile.strides()[D - 1];
        let mut dot = 0.0;
        for plane in tile.halo..tile.halo + tile.core[D - 1] {
            for (row, _) in tile.core_rows_of(plane) {
                let at = plane * stride + row * tile.extent(0) + tile.halo;
                let (p, q) = (&self.p[at..][..n0], &self.q[at..][..n0]);
                dot += super::weigh_row(tile, plane, row, p, q);
            }
        }
        dot
    }
}
