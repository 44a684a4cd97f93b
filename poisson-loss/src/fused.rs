//! The spline system in three passes per iteration over cache-sized tiles, each reading and
//! writing every vector once. Does what [`PlainSystem`](crate::plain::PlainSystem) does for
//! problems of two and more dimensions whose gradient weight is 1 and whose coefficients are all
//! free.
//!
//! The finest multigrid level never exists in memory: its right-hand side `f = F r` and its
//! smoothed values are local functions of the residual, so a tile recomputes them where needed.
//! With `g = f / diagonal` the first red-black sweep from zero is `u = g` on red nodes and
//! `u = g + sum w g_neighbours / diagonal` on black ones, and the residual it leaves is
//! `sum w u_neighbours` on red nodes and zero on black ones.
//!
//! Inside a tile the stages run as a pipeline over the planes of the outermost axis (rows, in two
//! dimensions): a stage that looks `k` planes ahead follows `k` planes behind, while its input is
//! still in the first-level cache.

mod blocks;
mod precondition;
mod product;
mod smoother;

use inr_core::cpu::dispatch;
use rayon::prelude::*;

use crate::axis::Transfer;
use crate::cg::System;
use crate::multigrid::{self, Multigrid, Restriction};
use crate::operator::{REACH, SplineOperator};
use crate::plain::{line_dot, row_weight};
use crate::tile::{Frame, Tile};
use blocks::{Class, classify};
use precondition::{Down, HALO_DOWN, HALO_UP, Up};
use smoother::{Rings, Smoother, inverse_diagonal};

/// The widest halo of any pass.
pub const fn most_reach() -> usize {
    HALO_UP
}

/// What all right-hand sides share.
pub struct FusedOperator<const D: usize> {
    operator: SplineOperator<D>,
    multigrid: Multigrid<D>,
    /// The finest level's inverse diagonal, over the frame.
    inverse: Vec<f32>,
    /// Per slab and tile.
    classes: Vec<Vec<Class>>,
}

impl<const D: usize> FusedOperator<D> {
    /// `operator.gamma` must be empty; `multigrid` may lack the smoother of its finest level.
    pub fn new(operator: SplineOperator<D>, multigrid: Multigrid<D>) -> Self {
        assert!(
            D >= 2 && operator.gamma.is_empty() && multigrid.levels.len() > 1,
            "a gradient weight of 1 in two or more dimensions, and a coarser level"
        );
        let classes = classify(operator.frame, &operator.screening, HALO_UP);
        let screening = operator.screening.par_iter();
        let inverse = screening.map(|s| inverse_diagonal(operator.alpha, *s)).collect();
        Self { operator, multigrid, inverse, classes }
    }
}

/// The fused system of one right-hand side. Vectors change roles instead of being copied.
pub struct FusedSystem<'a, const D: usize> {
    shared: &'a FusedOperator<D>,
    /// Vectors of the coarser levels.
    work: Vec<multigrid::Vectors>,
    pub x: Vec<f32>,
    r: Vec<f32>,
    /// The next residual while passing down, then the preconditioned residual `z`.
    r_or_z: Vec<f32>,
    p: Vec<f32>,
    /// The next direction.
    p_next: Vec<f32>,
    q: Vec<f32>,
    pending_alpha: f32,
}

impl<'a, const D: usize> FusedSystem<'a, D> {
    /// Starts on the right-hand side `r`.
    pub fn new(shared: &'a FusedOperator<D>, r: Vec<f32>) -> Self {
        let zeros = || vec![0.0f32; shared.operator.frame.len()];
        Self {
            work: shared.multigrid.vectors(1),
            x: zeros(),
            r,
            r_or_z: zeros(),
            p: zeros(),
            p_next: zeros(),
            q: zeros(),
            shared,
            pending_alpha: 0.0,
        }
    }

    /// `x += alpha p`, `r -= alpha q`, and the coarse right-hand side after smoothing from zero.
    fn pass_down(&mut self) {
        let FusedOperator { operator, multigrid, inverse, classes } = self.shared;
        let (frame, alpha) = (operator.frame, self.pending_alpha);
        let len = frame.slab_len();
        let transfer = multigrid.levels[0].to_coarse.as_ref().expect("a coarser level exists");
        let coarse = multigrid.levels[1].shape();
        let (r, p, q) = (&self.r, &self.p, &self.q);
        let pieces = coarse_slabs(&frame, &transfer[D - 1], coarse, &mut self.work[1].f);
        let outputs = self.x.par_chunks_mut(len).zip(self.r_or_z.par_chunks_mut(len));
        outputs.zip(pieces).enumerate().for_each_init(
            Rings::default,
            |rings, (slab, ((x, r_next), (first_plane, f)))| {
                for (tile, class) in frame.tiles(slab, HALO_DOWN).into_iter().zip(&classes[slab]) {
                    let smoother = Smoother::new(tile, operator.alpha, inverse, class, rings);
                    let p = &p[slab * len..];
                    let (x, r_next, f) = (&mut *x, &mut *r_next, &mut *f);
                    let coarse = (coarse, first_plane);
                    dispatch(Down { smoother, r, q, p, alpha, x, r_next, transfer, coarse, f });
                }
            },
        );
        std::mem::swap(&mut self.r, &mut self.r_or_z);
    }

    /// `z = F u` from the residual and the coarse correction; returns `r . z`.
    fn pass_up(&mut self) -> f64 {
        let FusedOperator { operator, inverse, classes, .. } = self.shared;
        let frame = operator.frame;
        let len = frame.slab_len();
        let levels = &self.shared.multigrid.levels;
        let (r, correction) = (&self.r, levels[0].prolongation(&levels[1], &self.work[1].u));
        let up = |rings: &mut Rings, (slab, z): (usize, &mut [f32])| {
            let tiles = frame.tiles(slab, HALO_UP).into_iter().zip(&classes[slab]);
            let dot = |(tile, class): (Tile<D>, &Class)| {
                let smoother = Smoother::new(tile, operator.alpha, inverse, class, rings);
                dispatch(Up { smoother, r: &r[slab * len..], whole_r: r, correction, z: &mut *z })
            };
            tiles.map(dot).sum::<f64>()
        };
        let slabs = self.r_or_z.par_chunks_mut(len).enumerate();
        let partial: Vec<f64> = slabs.map_init(Rings::default, up).collect();
        partial.iter().sum()
    }
}

impl<const D: usize> System for FusedSystem<'_, D> {
    fn precondition(&mut self) -> f64 {
        self.pass_down();
        self.shared.multigrid.cycle(&mut self.work, 1);
        self.pass_up()
    }

    fn direction(&mut self, beta: f32) -> f64 {
        let FusedOperator { operator, classes, .. } = self.shared;
        let frame = operator.frame;
        let len = frame.slab_len();
        let (z, p) = (&self.r_or_z, &self.p);
        let along = |work: &mut product::Work,
                     (slab, (p_next, q)): (usize, (&mut [f32], &mut [f32]))| {
            let tiles = frame.tiles(slab, REACH).into_iter().zip(&classes[slab]);
            let dot = |(tile, class): (Tile<D>, &Class)| {
                let (p_next, q) = (&mut *p_next, &mut *q);
                let vectors = product::Vectors { z, p, beta, p_next, q };
                product::direction(tile, operator, class, vectors, work)
            };
            tiles.map(dot).sum::<f64>()
        };
        let outputs = self.p_next.par_chunks_mut(len).zip(self.q.par_chunks_mut(len));
        let partial: Vec<f64> =
            outputs.enumerate().map_init(product::Work::default, along).collect();
        std::mem::swap(&mut self.p, &mut self.p_next);
        partial.iter().sum()
    }

    fn advance(&mut self, alpha: f32) {
        // The update itself is part of the next pass down.
        self.pending_alpha = alpha;
    }
}

/// The parts of a coarse level's values that the slabs of the finest one own, each with its first
/// plane.
fn coarse_slabs<'a, const D: usize>(
    frame: &Frame<D>,
    transfer: &Transfer,
    coarse: [usize; D],
    mut values: &'a mut [f32],
) -> Vec<(usize, &'a mut [f32])> {
    let plane: usize = coarse[..D - 1].iter().product();
    let (slabs, planes) = (frame.len().div_ceil(frame.slab_len()), frame.shape[D - 1]);
    let thickness = frame.slab_len() / (frame.len() / planes);
    let piece = |slab: usize| {
        let fine = slab * thickness..((slab + 1) * thickness).min(planes);
        let owned = Restriction::<D>::owned(transfer, fine);
        let (head, tail) = std::mem::take(&mut values).split_at_mut(owned.len() * plane);
        values = tail;
        (owned.start, head)
    };
    (0..slabs).map(piece).collect()
}

/// The weighted inner product of two pieces of a core row, given by plane and row in the plane.
#[inline(always)]
fn weigh_row<const D: usize>(
    tile: &Tile<D>,
    plane: usize,
    row: usize,
    a: &[f32],
    b: &[f32],
) -> f64 {
    let (mut rest, mut global, mut stride) = (row, 0, 1);
    for d in 1..D - 1 {
        global += (tile.start[d] + rest % tile.extent(d) - tile.halo) * stride;
        rest /= tile.extent(d);
        stride *= tile.frame.shape[d];
    }
    global += (tile.start[D - 1] + plane - tile.halo) * stride;
    row_weight(&tile.frame, global) * line_dot(&tile.frame, tile.start[0], a, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::{Axis, End};
    use crate::plain::PlainSystem;

    /// Same sums in another order: a few f32 roundings of values of order one.
    const TOLERANCE: f32 = 2e-5;

    fn noise(n: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        (0..n)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 23) as f32 - 1.0
            })
            .collect()
    }

    /// How the screening varies: not at all, from sample to sample, or across a few edges.
    #[derive(Clone, Copy)]
    enum Mix {
        Uniform,
        Noise,
        Edges,
    }

    fn operator<const D: usize>(frame: Frame<D>, mix: Mix) -> SplineOperator<D> {
        let random = noise(frame.len(), 7);
        let screening = (0..frame.len())
            .map(|k| {
                let column = k % frame.shape[0];
                let in_box = (column > 9 && column < 19) || (100..260).contains(&column);
                match mix {
                    Mix::Noise if random[k] > 0.0 => 0.3,
                    Mix::Edges if in_box && (5..150).contains(&(k / frame.shape[0])) => 0.0,
                    _ => 0.06,
                }
            })
            .collect();
        let alpha = std::array::from_fn(|d| 1.0 + 0.5 * d as f32);
        SplineOperator { frame, alpha, screening, gamma: Vec::new() }
    }

    fn close(name: &str, got: &[f32], want: &[f32]) {
        let scale = want.iter().fold(1e-3f32, |a, b| a.max(b.abs()));
        for (k, (g, w)) in got.iter().zip(want).enumerate() {
            assert!((g - w).abs() <= TOLERANCE * scale, "{name} at {k}: got {g}, expected {w}");
        }
    }

    /// Every operation of the fused system against the plain one, on the same vectors.
    fn fused_matches_plain<const D: usize>(shape: [usize; D], ends: [[End; 2]; D], mix: Mix) {
        let frame = Frame { shape, ends };
        let axes: [Axis; D] = std::array::from_fn(|d| {
            Axis::uniform(shape[d], ends[d], operator(frame, mix).alpha[d])
        });
        let make = || operator(frame, mix);
        let (plain_operator, residual) = (make(), noise(frame.len(), 3));
        let multigrid = Multigrid::new(axes.clone(), make().screening, Vec::new());
        let mut plain = PlainSystem::new(&plain_operator, &multigrid, &[], residual.clone());
        let shared = FusedOperator::new(make(), Multigrid::without_finest(axes, make().screening));
        let mut fused = FusedSystem::new(&shared, residual.clone());
        let mut beta = 0.0;
        for _ in 0..3 {
            let (a, b) = (plain.precondition(), fused.precondition());
            assert!((a - b).abs() < 1e-4 * a, "{shape:?}: r.z {b}, expected {a}");
            close("z", &fused.r_or_z, plain.z());
            let (a, b) = (plain.direction(beta), fused.direction(beta));
            assert!((a - b).abs() < 1e-4 * a, "{shape:?}: p.q {b}, expected {a}");
            close("q", &fused.q, plain.q());
            plain.advance(0.4);
            fused.advance(0.4);
            beta = 0.3;
        }
        fused.precondition();
        close("r", &fused.r, &plain.r);
        close("x", &fused.x, &plain.x);
    }

    #[test]
    fn fused_matches_plain_images() {
        use End::{Mirror, Zero};
        for mix in [Mix::Uniform, Mix::Noise, Mix::Edges] {
            fused_matches_plain([33, 27], [[Zero, Zero], [Zero, Zero]], mix);
            fused_matches_plain([28, 23], [[Mirror, Mirror], [Mirror, Mirror]], mix);
            fused_matches_plain([300, 211], [[Mirror, Zero], [Zero, Mirror]], mix);
        }
    }

    #[test]
    fn fused_matches_plain_volumes() {
        use End::{Mirror, Zero};
        for mix in [Mix::Uniform, Mix::Noise, Mix::Edges] {
            fused_matches_plain(
                [21, 18, 35],
                [[Mirror, Zero], [Zero, Zero], [Mirror, Mirror]],
                mix,
            );
        }
    }
}
