//! Everything that batches of a neural blend need, evaluated once on the quadrature's sub-lattices.

use std::sync::Mutex;

use inr_core::{Domain, Jet, Samples, Spline};

use crate::metrics::points::{Lattice, flatten};
use crate::metrics::scene::Scene;
use crate::plan::Plan;
use crate::{Blend, Problem, Result};

/// Weight of the squared distance to the exact solution inside the region, where the objective itself looks at
/// gradients alone: a level is settled long before the network's gradients add up to it. 1/16 pitches squared.
const ANCHOR: f32 = 1.0 / 256.0;

/// One quadrature point.
#[derive(Clone, Copy)]
struct Point<const D: usize, const C: usize> {
    /// The background's value and the gradient to follow.
    wanted: Jet<D, C>,
    /// The exact solution.
    exact: Jet<D, C>,
    /// Weights of the squared gradient (per reference pitch), of `|c - c_S|^2` and of `|c - c_T|^2`; all zero beyond the
    /// signal's outermost samples.
    weight: [f32; 3],
    /// `c_T - c_S` where the patch's colours are kept.
    apart: [f32; C],
}

/// Sums over a batch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    pub loss: f64,
    /// Squared distances to the exact solution: of gradients per reference pitch, and of values.
    pub gradient: f64,
    pub value: f64,
}

/// All points, by sub-lattice and sample.
pub(super) struct Stage<const D: usize, const C: usize> {
    on: Domain<D>,
    h_ref: f32,
    fixed: bool,
    points: Vec<Vec<Point<D, C>>>,
    /// Sums of the pieces of the batch in work, with the piece's first point: they come in any order and are
    /// added in one.
    pieces: Mutex<Vec<(usize, Sums)>>,
}

/// The offset of a sub-lattice from the samples, in samples.
fn quarter<const D: usize>(half: usize) -> [f64; D] {
    std::array::from_fn(|d| if half >> d & 1 == 0 { -0.25 } else { 0.25 })
}

impl<const D: usize, const C: usize> Stage<D, C> {
    pub fn new(problem: &Problem<'_, D, C>, exact: &Blend<D, C>, on: &Domain<D>) -> Result<Self> {
        let (background, plan) = (problem.background.domain(), Plan::new(problem)?);
        let index = background.to_index(&on.origin());
        let start: [usize; D] = std::array::from_fn(|d| index[d].round() as usize);
        let inside = (0..D).all(|d| start[d] + on.shape()[d] <= background.shape()[d]);
        assert!(inside, "a lattice of {:?} at {start:?} in {:?}", on.shape(), background.shape());
        let (h_ref, fixed) = (plan.h_ref, !plan.free.is_empty());
        let scene = Scene::on_box(problem, plan, start, on.shape(), &exact.samples, None)?;
        let signal = spline_around(problem.background, start, on.shape());
        let mut points = Vec::with_capacity(1 << D);
        for half in 0..1usize << D {
            let mut all = Vec::with_capacity(on.len());
            for (first, shape) in scene.slabs() {
                slab(&scene, &signal, quarter(half), first, shape, &mut all);
            }
            points.push(all);
        }
        Ok(Self { on: *on, h_ref, fixed, points, pieces: Mutex::new(Vec::new()) })
    }

    /// Whether values outside the region are fixed rather than weighed (Dirichlet): then the objective alone does
    /// not hold them, and only the exact solution can be followed.
    pub fn is_fixed(&self) -> bool {
        self.fixed
    }

    /// Where a sample's point of a sub-lattice is.
    pub fn position(&self, half: usize, k: usize) -> [f32; D] {
        let (index, offset) = (self.on.unflatten(k), quarter::<D>(half));
        std::array::from_fn(|d| {
            self.on.origin()[d] + (index[d] as f32 + offset[d] as f32) * self.on.pitch()[d]
        })
    }

    /// Runs a batch and returns the sums that [`Stage::loss`] left.
    pub fn with_sums(&self, batch: impl FnOnce() -> f64) -> Sums {
        let loss = batch();
        let mut pieces =
            std::mem::take(&mut *self.pieces.lock().expect("no panic while it is held"));
        pieces.sort_by_key(|p| p.0);
        let zero = Sums { loss, ..Sums::default() };
        pieces.iter().fold(zero, |mut sum, (_, piece)| {
            sum.gradient += piece.gradient;
            sum.value += piece.value;
            sum
        })
    }

    /// Loss and cotangents of a piece of a batch.
    pub fn loss(
        &self,
        half: usize,
        indices: &[usize],
        y: &[Jet<D, C>],
        y_bar: &mut [Jet<D, C>],
        distill: bool,
    ) -> f64 {
        let (h, mut sums) = (self.h_ref, Sums::default());
        for (k, (y, y_bar)) in indices.iter().zip(y.iter().zip(y_bar)) {
            let p = &self.points[half][*k];
            let [gamma, colour, keep] = p.weight;
            let on = f32::from(gamma + colour + keep > 0.0);
            for c in 0..C {
                let off = y.value[c] - p.exact.value[c];
                sums.value += f64::from(on * off * off);
                let (mut loss, mut bar);
                if distill {
                    let weight = on * (colour + keep).max(ANCHOR);
                    (loss, bar) = (weight * off * off, weight * off);
                } else {
                    let a = y.value[c] - p.wanted.value[c];
                    let b = a - p.apart[c];
                    (loss, bar) = (colour * a * a + keep * b * b, colour * a + keep * b);
                }
                y_bar.value[c] = 2.0 * bar;
                bar = 2.0 * gamma * h * h;
                for d in 0..D {
                    let off = y.grad[c][d] - p.exact.grad[c][d];
                    sums.gradient += f64::from(on * h * h * off * off);
                    let miss = if distill { off } else { y.grad[c][d] - p.wanted.grad[c][d] };
                    loss += gamma * h * h * miss * miss;
                    y_bar.grad[c][d] = bar * miss;
                }
                sums.loss += f64::from(loss);
            }
        }
        let first = indices.first().copied().unwrap_or(0);
        self.pieces.lock().expect("no panic while it is held").push((first, sums));
        sums.loss
    }
}

/// The spline through a part of the background; 16 samples around it carry what lies beyond (`0.268^16 = 7e-10`).
fn spline_around<const D: usize, const C: usize>(
    background: &Samples<D, C>,
    start: [usize; D],
    shape: [usize; D],
) -> (Spline<D, C>, [usize; D]) {
    let whole = background.domain().shape();
    let low: [usize; D] = std::array::from_fn(|d| start[d].saturating_sub(16));
    let size: [usize; D] =
        std::array::from_fn(|d| (start[d] + shape[d] + 16).min(whole[d]) - low[d]);
    let lo = low.map(|v| v as isize);
    let planes: Vec<f32> = (0..C)
        .flat_map(|c| crate::problem::copy_box(background.plane(c), whole, lo, size, |_, _| None))
        .collect();
    let domain = Domain::unit(size).expect("a box inside a valid domain");
    let samples = Samples::from_planar(domain, planes).expect("C planes of the box");
    (Spline::interpolate_owned(samples), low)
}

/// The points of a slab of the box, appended in order.
fn slab<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    (signal, low): &(Spline<D, C>, [usize; D]),
    offset: [f64; D],
    first: [usize; D],
    shape: [usize; D],
    out: &mut Vec<Point<D, C>>,
) {
    let lattice = Lattice { start: std::array::from_fn(|d| first[d] as f64 + offset[d]), shape };
    let first_cell = flatten(first, scene.shape);
    let pull = scene.pull(&lattice, |k| scene.guide[first_cell + k]);
    let mut here = lattice;
    for d in 0..D {
        here.start[d] += scene.start[d] as f64 - low[d] as f64;
    }
    // Per axis: slopes; last: values. Of the background and of the change.
    let orders = || (0..D).map(Some).chain([None]);
    let of_signal: Vec<_> = orders().map(|o| scene.evaluate(signal, &here, o)).collect();
    let of_change: Vec<_> = orders().map(|o| scene.evaluate(&scene.change, &lattice, o)).collect();
    let (h, keeps) = (scene.plan.h_ref, scene.plan.keep);
    for row in (0..lattice.len()).step_by(shape[0]) {
        let index = crate::metrics::points::unflatten(row, shape);
        let within = scene.row_within_signal(first, index, shape[0], offset).unwrap_or(0..0);
        for i in 0..shape[0] {
            let k = row + i;
            let cell = first_cell + k;
            let mut point = Point {
                wanted: Jet::ZERO,
                exact: Jet::ZERO,
                weight: [0.0; 3],
                apart: pull.apart.get(k).copied().unwrap_or([0.0; C]),
            };
            if within.contains(&i) {
                let gamma = if scene.plan.gamma.is_empty() { 1.0 } else { scene.region[cell] };
                point.weight = [gamma, scene.colour[cell], keeps * scene.region[cell]];
            }
            for c in 0..C {
                let value = of_signal[D].plane(c)[k];
                point.wanted.value[c] = value;
                point.exact.value[c] = value + of_change[D].plane(c)[k];
                for d in 0..D {
                    let slope = of_signal[d].plane(c)[k];
                    let more = pull.gradient.get(k).map_or(0.0, |g| g[c][d]);
                    point.wanted.grad[c][d] = (slope + more) / h;
                    point.exact.grad[c][d] = (slope + of_change[d].plane(c)[k]) / h;
                }
            }
            out.push(point);
        }
    }
}
