//! Splines and guidance on the points of a lattice.

use inr_core::{Domain, Jet, Samples, Spline, Unit};

use super::scene::Scene;

/// Points at unit distance in samples of the box.
#[derive(Clone, Copy)]
pub struct Lattice<const D: usize> {
    pub start: [f64; D],
    pub shape: [usize; D],
}

/// What the guidance asks at the points of a lattice; empty where it asks nothing.
pub struct Pull<const D: usize, const C: usize> {
    /// `weight (v - grad c_S)` per reference pitch.
    pub gradient: Vec<[[f32; D]; C]>,
    /// `c_T - c_S`.
    pub apart: Vec<[f32; C]>,
}

impl<const D: usize> Lattice<D> {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    fn domain(&self) -> Domain<D> {
        Domain::new(self.shape, [1.0; D], self.start.map(|v| v as f32), Unit::Sample)
            .expect("a lattice inside a valid domain")
    }
}

/// Splits a flat index into one per axis.
pub fn unflatten<const D: usize>(mut flat: usize, shape: [usize; D]) -> [usize; D] {
    std::array::from_fn(|d| {
        let i = flat % shape[d];
        flat /= shape[d];
        i
    })
}

pub fn flatten<const D: usize>(index: [usize; D], shape: [usize; D]) -> usize {
    (0..D).rev().fold(0, |flat, d| flat * shape[d] + index[d])
}

impl<const D: usize, const C: usize> Scene<'_, D, C> {
    /// Values of a spline of the box on a lattice, or slopes along an axis per reference pitch.
    pub fn evaluate(
        &self,
        spline: &Spline<D, C>,
        lattice: &Lattice<D>,
        slope_axis: Option<usize>,
    ) -> Samples<D, C> {
        let order = std::array::from_fn(|d| usize::from(slope_axis == Some(d)));
        let mut values = spline.eval_lattice(&lattice.domain(), order);
        if let Some(scale) = slope_axis.map(|d| self.scale[d]).filter(|s| *s != 1.0) {
            values.as_planar_mut().iter_mut().for_each(|v| *v *= scale);
        }
        values
    }

    /// What the guidance asks at points of a lattice; `weight` takes a point's flat index, and
    /// only points with a positive weight are looked at.
    pub fn pull(&self, lattice: &Lattice<D>, weight: impl Fn(usize) -> f32) -> Pull<D, C> {
        let mut pull = Pull { gradient: Vec::new(), apart: Vec::new() };
        let Some((first, part)) = self.near_region(lattice) else { return pull };
        let active: Vec<(usize, usize, f32)> = (0..part.len())
            .map(|k| {
                let mut index = unflatten(k, part.shape);
                (0..D).for_each(|d| index[d] += first[d]);
                let at = flatten(index, lattice.shape);
                (k, at, weight(at))
            })
            .filter(|(_, _, w)| *w > 0.0)
            .collect();
        if active.is_empty() {
            return pull;
        }
        let guidance = &self.problem.guidance;
        let values = guidance.needs_values() || self.plan.keep > 0.0;
        let s = self.jets(&self.signals.background, &part, &active, values);
        let t = self.patch_jets(&part, &active, values);
        pull.gradient = vec![[[0.0; D]; C]; lattice.len()];
        pull.apart = vec![[0.0; C]; if self.plan.keep > 0.0 { lattice.len() } else { 0 }];
        for (order, (k, at, w)) in active.iter().enumerate() {
            let (s, t) = (&s[order], &t[order]);
            let x = if guidance.needs_values() { self.position(&part, *k) } else { [0.0; D] };
            let v = guidance.evaluate(&x, s, t);
            pull.gradient[*at] =
                std::array::from_fn(|c| std::array::from_fn(|d| w * (v[c][d] - s.grad[c][d])));
            if let Some(apart) = pull.apart.get_mut(*at) {
                *apart = std::array::from_fn(|c| t.value[c] - s.value[c]);
            }
        }
        pull
    }

    /// The part of a lattice that lies in the region's box of cells, and where it begins.
    fn near_region(&self, lattice: &Lattice<D>) -> Option<([usize; D], Lattice<D>)> {
        let (mut first, mut part) = ([0; D], *lattice);
        for d in 0..D {
            let lo = self.plan.support.start[d] as f64 - self.start[d] as f64 - 0.5;
            let hi = lo + self.plan.support.shape[d] as f64;
            let begin = (lo - lattice.start[d]).ceil().max(0.0) as usize;
            let end = ((hi - lattice.start[d]).floor() + 1.0).clamp(0.0, lattice.shape[d] as f64);
            if end as usize <= begin {
                return None;
            }
            first[d] = begin;
            part.shape[d] = end as usize - begin;
            part.start[d] = lattice.start[d] + begin as f64;
        }
        Some((first, part))
    }

    /// Physical position of a lattice point.
    fn position(&self, lattice: &Lattice<D>, k: usize) -> [f32; D] {
        let (domain, index) = (self.problem.background.domain(), unflatten(k, lattice.shape));
        std::array::from_fn(|d| {
            let i = self.start[d] as f64 + lattice.start[d] + index[d] as f64;
            (f64::from(domain.origin()[d]) + i * f64::from(domain.pitch()[d])) as f32
        })
    }

    /// Jets of one of the splines at the active points of a lattice; values only if asked for.
    fn jets(
        &self,
        spline: &Spline<D, C>,
        part: &Lattice<D>,
        active: &[(usize, usize, f32)],
        values: bool,
    ) -> Vec<Jet<D, C>> {
        let mut here = *part;
        for d in 0..D {
            here.start[d] += self.start[d] as f64 - self.signals.start[d] as f64;
        }
        let mut jets = vec![Jet::ZERO; active.len()];
        for slope in 0..=D {
            if slope == D && !values {
                continue;
            }
            let plane = self.evaluate(spline, &here, (slope < D).then_some(slope));
            for c in 0..C {
                let plane = plane.plane(c);
                for (jet, (k, _, _)) in jets.iter_mut().zip(active) {
                    match slope < D {
                        true => jet.grad[c][slope] = plane[*k],
                        false => jet.value[c] = plane[*k],
                    }
                }
            }
        }
        jets
    }

    /// Jets of the patch at active points, gradients per reference pitch.
    fn patch_jets(
        &self,
        part: &Lattice<D>,
        active: &[(usize, usize, f32)],
        values: bool,
    ) -> Vec<Jet<D, C>> {
        let Some(moved) = &self.signals.field else {
            return self.jets(&self.signals.patch, part, active, values);
        };
        let mut x: Vec<[f32; D]> = active.iter().map(|a| self.position(part, a.0)).collect();
        let mut jets = vec![Jet::ZERO; x.len()];
        moved.jets(&mut x, &mut jets);
        let h_ref = self.plan.h_ref;
        jets.iter_mut().flat_map(|j| j.grad.iter_mut().flatten()).for_each(|g| *g *= h_ref);
        jets
    }
}
