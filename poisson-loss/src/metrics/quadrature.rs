//! Integrals over the signal: every quadrature point once, in slabs.

use inr_core::{Samples, Spline};
use rayon::prelude::*;

use super::scene::{Lattice, Pull, Scene, flatten, unflatten};

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

/// Values and slopes of one spline on a lattice.
struct Sampled<const D: usize, const C: usize> {
    value: Samples<D, C>,
    slope: [Samples<D, C>; D],
}

impl<const D: usize, const C: usize> Sampled<D, C> {
    fn new(scene: &Scene<'_, D, C>, spline: &Spline<D, C>, lattice: &Lattice<D>) -> Self {
        Self {
            value: scene.evaluate(spline, lattice, None),
            slope: std::array::from_fn(|d| scene.evaluate(spline, lattice, Some(d))),
        }
    }

    fn value(&self, c: usize, k: usize) -> f64 {
        f64::from(self.value.plane(c)[k])
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
    let weight = 0.5f64.powi(D as i32);
    let mut sums = Integrals::default();
    for k in 0..lattice.len() {
        if !scene.within_signal(start, unflatten(k, shape), offset) {
            continue;
        }
        let cell = first_cell + k;
        let terms = Terms::new(scene, &pull, &ours, k, cell);
        let m = f64::from(scene.region[cell]);
        sums.inside += weight * m;
        sums.gradient += weight * m * terms.gradient;
        sums.colour += weight * (1.0 - m) * terms.colour;
        sums.objective += weight * terms.objective;
        if scene.place[cell].near {
            sums.near += weight;
            sums.seam += weight * terms.gradient;
            sums.seam_max = sums.seam_max.max(terms.steepest.sqrt());
        }
        if let Some(exact) = &exact {
            let best = Terms::new(scene, &pull, exact, k, cell);
            sums.objective_of_exact += weight * best.objective;
            sums.gain += weight * gain(scene, &pull, &ours, exact, k, cell);
        }
    }
    sums
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

impl Terms {
    #[inline(always)]
    fn new<const D: usize, const C: usize>(
        scene: &Scene<'_, D, C>,
        pull: &Pull<D, C>,
        sampled: &Sampled<D, C>,
        k: usize,
        cell: usize,
    ) -> Self {
        let mut terms = Self { gradient: 0.0, steepest: 0.0, colour: 0.0, objective: 0.0 };
        let mut kept = 0.0;
        for c in 0..C {
            let squared: f64 = (0..D).map(|d| mismatch(pull, sampled, k, c, d).powi(2)).sum();
            terms.gradient += squared;
            terms.steepest = terms.steepest.max(squared);
            terms.colour += sampled.value(c, k).powi(2);
            kept += (sampled.value(c, k) - apart(pull, k, c)).powi(2);
        }
        let [gamma, colour, keep] = scene.weights(cell);
        terms.objective = gamma * terms.gradient + colour * terms.colour + keep * kept;
        terms
    }
}

/// `grad c - v`, one component: the change's slope less what the guidance adds to the background.
#[inline(always)]
fn mismatch<const D: usize, const C: usize>(
    pull: &Pull<D, C>,
    sampled: &Sampled<D, C>,
    k: usize,
    c: usize,
    d: usize,
) -> f64 {
    let wanted = pull.gradient.get(k).map_or(0.0, |v| v[c][d]);
    f64::from(sampled.slope[d].plane(c)[k]) - f64::from(wanted)
}

/// `c_T - c_S`, where the patch's colours are kept.
fn apart<const D: usize, const C: usize>(pull: &Pull<D, C>, k: usize, c: usize) -> f64 {
    pull.apart.get(k).map_or(0.0, |v| f64::from(v[c]))
}

/// The objective's integrand for one change less that for another, as `(a - b)(a + b)`.
fn gain<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    pull: &Pull<D, C>,
    ours: &Sampled<D, C>,
    exact: &Sampled<D, C>,
    k: usize,
    cell: usize,
) -> f64 {
    let [gamma, colour, keep] = scene.weights(cell);
    let mut sum = 0.0;
    for c in 0..C {
        for d in 0..D {
            let (a, b) = (mismatch(pull, ours, k, c, d), mismatch(pull, exact, k, c, d));
            sum += gamma * (a - b) * (a + b);
        }
        let (a, b) = (ours.value(c, k), exact.value(c, k));
        let patch = apart(pull, k, c);
        sum += (a - b) * (colour * (a + b) + keep * (a + b - 2.0 * patch));
    }
    sum
}

impl<const D: usize, const C: usize> Scene<'_, D, C> {
    /// The objective's weights in a cell: of the squared gradient, of the change, and of the
    /// difference to the patch.
    #[inline(always)]
    fn weights(&self, cell: usize) -> [f64; 3] {
        let m = self.region[cell];
        let gamma = if self.plan.gamma.is_empty() { 1.0 } else { m };
        [gamma, self.colour[cell], self.plan.keep * m].map(f64::from)
    }
}
