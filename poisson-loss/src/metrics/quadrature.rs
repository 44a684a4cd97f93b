//! Integrals over the signal: every quadrature point once, in slabs.

use inr_core::{Samples, Spline};
use rayon::prelude::*;

use super::points::{Lattice, Pull, flatten, unflatten};
use super::scene::Scene;

/// Sums over quadrature points; a cell's points share the weight 1.
#[derive(Debug, Clone, Copy, Default)]
pub struct Integrals {
    /// Of the region's weight.
    pub inside: f64,
    /// Of `m |grad c - v|^2`.
    pub gradient: f64,
    /// Of `(1 - m) |c - c_S|^2`.
    pub colour: f64,
    /// Of the objective's terms.
    pub objective: f64,
    /// The same for the exact result.
    pub objective_of_exact: f64,
    /// Of the terms' differences between the two.
    pub gain: f64,
    /// Measure of the seam.
    pub near: f64,
    /// Of `|grad c - v|^2` on the seam.
    pub seam: f64,
    /// Largest `|grad c - v|` of a channel on the seam.
    pub seam_max: f64,
}

impl Integrals {
    fn add(mut self, other: &Self) -> Self {
        self.inside += other.inside;
        self.gradient += other.gradient;
        self.colour += other.colour;
        self.objective += other.objective;
        self.objective_of_exact += other.objective_of_exact;
        self.gain += other.gain;
        self.near += other.near;
        self.seam += other.seam;
        self.seam_max = self.seam_max.max(other.seam_max);
        self
    }
}

/// All integrals, summed in an order that the box alone decides.
pub fn integrate<const D: usize, const C: usize>(scene: &Scene<'_, D, C>) -> Integrals {
    let slabs: Vec<Integrals> = scene
        .slabs()
        .into_par_iter()
        .map(|(start, shape)| {
            (0..1usize << D)
                .map(|half| {
                    let quarter = |d: usize| if half >> d & 1 == 0 { -0.25 } else { 0.25 };
                    integrate_points(scene, start, shape, std::array::from_fn(quarter))
                })
                .fold(Integrals::default(), |sum, part| sum.add(&part))
        })
        .collect();
    slabs.iter().fold(Integrals::default(), Integrals::add)
}

/// The sums over one point of every cell of a slab, at an offset from its sample.
fn integrate_points<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    start: [usize; D],
    shape: [usize; D],
    offset: [f64; D],
) -> Integrals {
    let lattice = Lattice { start: std::array::from_fn(|d| start[d] as f64 + offset[d]), shape };
    // Slabs are whole in all axes but the last: cells of the slab follow one another in the box.
    let first_cell = flatten(start, scene.shape);
    let pull = scene.pull(&lattice, |k| scene.guide[first_cell + k]);
    let ours = Sampled::new(scene, &scene.change, &lattice);
    let exact = scene.exact.as_ref().map(|spline| Sampled::new(scene, spline, &lattice));
    let (ours, exact) = (ours.planes(), exact.as_ref().map(Sampled::planes));
    let weight = 0.5f64.powi(D as i32);
    let mut sums = Integrals::default();
    for first in (0..lattice.len()).step_by(shape[0]) {
        let Some(row) = scene.row_within_signal(start, unflatten(first, shape), shape[0], offset)
        else {
            continue;
        };
        for k in first + row.start..first + row.end {
            let wanted = Wanted::new(scene, &pull, k, first_cell + k);
            let a = wanted.miss(&ours, k);
            sums.add_point(scene, first_cell + k, weight, &wanted, &a);
            if let Some(exact) = &exact {
                let b = wanted.miss(exact, k);
                sums.objective_of_exact += weight * wanted.terms(&b).objective;
                sums.gain += weight * wanted.gain(&a, &b);
            }
        }
    }
    sums
}

impl Integrals {
    #[inline(always)]
    fn add_point<const D: usize, const C: usize>(
        &mut self,
        scene: &Scene<'_, D, C>,
        cell: usize,
        weight: f64,
        wanted: &Wanted<D, C>,
        miss: &Miss<D, C>,
    ) {
        let (terms, m) = (wanted.terms(miss), f64::from(scene.region[cell]));
        self.inside += weight * m;
        self.gradient += weight * m * terms.gradient;
        self.colour += weight * (1.0 - m) * terms.colour;
        self.objective += weight * terms.objective;
        if scene.place[cell].near {
            self.near += weight;
            self.seam += weight * terms.gradient;
            self.seam_max = self.seam_max.max(terms.steepest.sqrt());
        }
    }
}

/// Values and slopes of one spline on a lattice.
struct Sampled<const D: usize, const C: usize> {
    value: Samples<D, C>,
    slope: [Samples<D, C>; D],
}

/// The same as plain slices, one per channel.
struct Planes<'a, const D: usize, const C: usize> {
    value: [&'a [f32]; C],
    slope: [[&'a [f32]; C]; D],
}

impl<const D: usize, const C: usize> Sampled<D, C> {
    fn new(scene: &Scene<'_, D, C>, spline: &Spline<D, C>, lattice: &Lattice<D>) -> Self {
        Self {
            value: scene.evaluate(spline, lattice, None),
            slope: std::array::from_fn(|d| scene.evaluate(spline, lattice, Some(d))),
        }
    }

    fn planes(&self) -> Planes<'_, D, C> {
        Planes {
            value: std::array::from_fn(|c| self.value.plane(c)),
            slope: std::array::from_fn(|d| std::array::from_fn(|c| self.slope[d].plane(c))),
        }
    }
}

/// What the objective asks at one point, and with which weights.
struct Wanted<const D: usize, const C: usize> {
    /// `v - grad c_S`.
    gradient: [[f32; D]; C],
    /// `c_T - c_S`, where the patch's colours are kept.
    apart: [f32; C],
    /// Weights of the squared gradient, of the change, and of the difference to the patch.
    gamma: f64,
    colour: f64,
    keep: f64,
}

/// How far a change is from that.
struct Miss<const D: usize, const C: usize> {
    /// `grad c - v`.
    gradient: [[f64; D]; C],
    /// `c - c_S`.
    change: [f64; C],
}

/// The integrands at one point.
struct Terms {
    /// `|grad c - v|^2`, all channels.
    gradient: f64,
    /// The largest of a channel.
    steepest: f64,
    /// `|c - c_S|^2`.
    colour: f64,
    objective: f64,
}

impl<const D: usize, const C: usize> Wanted<D, C> {
    #[inline(always)]
    fn new(scene: &Scene<'_, D, C>, pull: &Pull<D, C>, k: usize, cell: usize) -> Self {
        let m = scene.region[cell];
        Self {
            gradient: pull.gradient.get(k).copied().unwrap_or([[0.0; D]; C]),
            apart: pull.apart.get(k).copied().unwrap_or([0.0; C]),
            gamma: if scene.plan.gamma.is_empty() { 1.0 } else { f64::from(m) },
            colour: f64::from(scene.colour[cell]),
            keep: f64::from(scene.plan.keep * m),
        }
    }

    #[inline(always)]
    fn miss(&self, planes: &Planes<'_, D, C>, k: usize) -> Miss<D, C> {
        let gradient = std::array::from_fn(|c| {
            let slope = |d: usize| f64::from(planes.slope[d][c][k]);
            std::array::from_fn(|d| slope(d) - f64::from(self.gradient[c][d]))
        });
        Miss { gradient, change: std::array::from_fn(|c| f64::from(planes.value[c][k])) }
    }

    #[inline(always)]
    fn terms(&self, miss: &Miss<D, C>) -> Terms {
        let mut terms = Terms { gradient: 0.0, steepest: 0.0, colour: 0.0, objective: 0.0 };
        let mut kept = 0.0;
        for c in 0..C {
            let squared: f64 = miss.gradient[c].iter().map(|v| v * v).sum();
            terms.gradient += squared;
            terms.steepest = terms.steepest.max(squared);
            terms.colour += miss.change[c] * miss.change[c];
            kept += (miss.change[c] - f64::from(self.apart[c])).powi(2);
        }
        terms.objective =
            self.gamma * terms.gradient + self.colour * terms.colour + self.keep * kept;
        terms
    }

    /// The objective's integrand for one change less that for another, as `(a - b)(a + b)`.
    #[inline(always)]
    fn gain(&self, a: &Miss<D, C>, b: &Miss<D, C>) -> f64 {
        let mut sum = 0.0;
        for c in 0..C {
            for d in 0..D {
                let (a, b) = (a.gradient[c][d], b.gradient[c][d]);
                sum += self.gamma * (a - b) * (a + b);
            }
            let (a, b) = (a.change[c], b.change[c]);
            let to_patch = a + b - 2.0 * f64::from(self.apart[c]);
            sum += (a - b) * (self.colour * (a + b) + self.keep * to_patch);
        }
        sum
    }
}
