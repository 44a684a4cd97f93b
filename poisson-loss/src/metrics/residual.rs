//! The Euler-Lagrange equation, checked at knots and at the corners between them.

use inr_core::Samples;
use rayon::prelude::*;

use super::mean;
use super::points::{Lattice, flatten, unflatten};
use super::scene::Scene;

/// Root mean squares of the residual.
pub struct Residuals {
    pub inside: f64,
    pub outside: f64,
}

/// Squares and their number.
#[derive(Clone, Copy, Default)]
struct Sums {
    inside: [f64; 2],
    outside: [f64; 2],
}

pub fn residuals<const D: usize, const C: usize>(scene: &Scene<'_, D, C>) -> Residuals {
    let slabs: Vec<[Sums; 2]> = scene
        .slabs()
        .into_par_iter()
        .map(|(start, shape)| [0.0, 0.5].map(|base| on_slab(scene, start, shape, base)))
        .collect();
    let mut sums = Sums::default();
    for part in slabs.iter().flatten() {
        for k in 0..2 {
            sums.inside[k] += part.inside[k];
            sums.outside[k] += part.outside[k];
        }
    }
    // Beyond the box nothing changes, so its points count with residual zero.
    let beyond = 2
        * C
        * (scene.inner_samples([0; D], scene.whole())
            - scene.inner_samples(scene.start, scene.shape));
    Residuals {
        inside: mean(sums.inside[0], sums.inside[1]).sqrt(),
        outside: mean(sums.outside[0], sums.outside[1] + beyond as f64).sqrt(),
    }
}

/// The residual at a slab's samples shifted by `base` along every axis.
fn on_slab<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    start: [usize; D],
    shape: [usize; D],
    base: f64,
) -> Sums {
    let first = flatten(start, scene.shape);
    let n: usize = shape.iter().product();
    let deep = |k: &usize| {
        let place = scene.place[first + k];
        (place.deep_inside || place.deep_outside) && scene.is_inner(start, unflatten(*k, shape))
    };
    let points: Vec<usize> = (0..n).filter(deep).collect();
    let mut sums = Sums::default();
    if points.is_empty() {
        return sums;
    }
    let here = Lattice { start: start.map(|v| v as f64 + base), shape };
    let mut divergence = vec![[0.0f32; C]; n];
    for d in (0..D).filter(|d| scene.whole()[*d] > 1) {
        add_axis(scene, &here, first, d, &points, &mut divergence);
    }
    let values = scene.evaluate(&scene.change, &here, None);
    let keep = scene.plan.keep;
    let inside = |k: usize| f32::from(scene.place[first + k].deep_inside);
    let pull = scene.pull(&here, |k| if keep > 0.0 { inside(k) } else { 0.0 });
    for k in points {
        let cell = first + k;
        let place = scene.place[cell];
        let gamma = if scene.plan.gamma.is_empty() || place.deep_inside { 1.0 } else { 0.0 };
        let mut squares = 0.0;
        for c in 0..C {
            let e = values.plane(c)[k];
            let mut r = gamma * divergence[k][c] - scene.colour[cell] * e;
            if place.deep_inside && keep > 0.0 {
                r -= keep * (e - pull.apart[k][c]);
            }
            squares += f64::from(r).powi(2);
        }
        let sum = if place.deep_inside { &mut sums.inside } else { &mut sums.outside };
        sum[0] += squares;
        sum[1] += C as f64;
    }
    sums
}

/// Adds the difference of `grad c - v` along axis `d` over one pitch around every point.
fn add_axis<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    here: &Lattice<D>,
    first_cell: usize,
    d: usize,
    points: &[usize],
    divergence: &mut [[f32; C]],
) {
    let mut faces = *here;
    faces.start[d] -= 0.5;
    faces.shape[d] += 1;
    let inside =
        |index: [usize; D]| scene.place[first_cell + flatten(index, here.shape)].deep_inside;
    // A face is wanted by the cells on its two sides.
    let wanted = |k: usize| {
        let mut index = unflatten(k, faces.shape);
        let ahead = index[d] < here.shape[d] && inside(index);
        let behind = index[d] > 0 && {
            index[d] -= 1;
            inside(index)
        };
        f32::from(ahead || behind)
    };
    let pull = scene.pull(&faces, wanted);
    let slope: Samples<D, C> = scene.evaluate(&scene.change, &faces, Some(d));
    let stride: usize = here.shape[..d].iter().product();
    for &k in points {
        let behind = flatten(unflatten(k, here.shape), faces.shape);
        for c in 0..C {
            let mismatch =
                |at: usize| slope.plane(c)[at] - pull.gradient.get(at).map_or(0.0, |v| v[c][d]);
            divergence[k][c] += scene.scale[d] * (mismatch(behind + stride) - mismatch(behind));
        }
    }
}

impl<const D: usize, const C: usize> Scene<'_, D, C> {
    /// Whether a sample has neighbours on both sides: the stencil stays within the signal.
    fn is_inner(&self, start: [usize; D], index: [usize; D]) -> bool {
        (0..D).all(|d| {
            let (i, n) = (self.start[d] + start[d] + index[d], self.whole()[d]);
            n == 1 || i > 0 && i + 1 < n
        })
    }

    /// Number of such samples in a box of the background.
    fn inner_samples(&self, start: [usize; D], shape: [usize; D]) -> usize {
        (0..D)
            .map(|d| match self.whole()[d] {
                1 => 1,
                n => (start[d] + shape[d]).min(n - 1).saturating_sub(start[d].max(1)),
            })
            .product()
    }
}
