//! What is measured, on a box: splines of the change and of both signals, and all weights.

use std::ops::Range;

use inr_core::{Domain, Samples, Spline, distance_to, distance_to_cells, prefilter};
use rayon::prelude::*;

use super::points::unflatten;
use crate::inputs::{Moved, check, sample_patch};
use crate::plan::{Plan, ramp};
use crate::problem::copy_box;
use crate::{Problem, Result};

/// Samples around everything that differs: a spline through a lone difference has decayed to
/// `0.268^20 = 4e-12` there.
const MARGIN: usize = 20;
/// Samples around the region that the prefilter needs: `0.268^16 = 7e-10`.
const PREFILTER_REACH: usize = 16;
/// Half width of the seam, and distance kept from it, in reference pitches (method, section 6).
const SEAM: f32 = 3.0;
/// Points evaluated at a time, about.
const SLAB: usize = 1 << 15;

/// Where a sample cell is.
#[derive(Clone, Copy, Default)]
pub struct Place {
    /// Within the seam's width of the boundary.
    pub near: bool,
    /// Inside and farther from it than that.
    pub deep_inside: bool,
    /// Outside and farther from it than that.
    pub deep_outside: bool,
}

/// A box of background samples, with everything that a measurement needs on it.
pub struct Scene<'a, const D: usize, const C: usize> {
    pub problem: &'a Problem<'a, D, C>,
    pub plan: Plan<D>,
    /// First background sample of the box and its samples per axis.
    pub start: [usize; D],
    pub shape: [usize; D],
    /// `c - c_S` of the result and of the exact result, in samples of the box.
    pub change: Spline<D, C>,
    pub exact: Option<Spline<D, C>>,
    pub region: Vec<f32>,
    pub guide: Vec<f32>,
    pub colour: Vec<f32>,
    pub place: Vec<Place>,
    /// `h_ref / h_d` per axis.
    pub scale: [f32; D],
    pub signals: Signals<'a, D, C>,
}

/// Both signals near the region.
pub struct Signals<'a, const D: usize, const C: usize> {
    /// First background sample of the splines' lattice.
    pub start: [usize; D],
    pub background: Spline<D, C>,
    pub patch: Spline<D, C>,
    /// Set where the background's lattice does not carry the patch.
    pub field: Option<Moved<'a, D, C>>,
}

/// The spline through planes of samples, with the first one at the origin and unit pitch.
fn spline_in_samples<const D: usize, const C: usize>(
    shape: [usize; D],
    mut planes: Vec<Vec<f32>>,
) -> Spline<D, C> {
    planes.iter_mut().for_each(|plane| prefilter(&shape, plane));
    let domain = Domain::unit(shape).expect("a box inside a valid domain");
    let samples = Samples::from_planar(domain, planes.concat()).expect("C planes of the box");
    Spline::from_coefficients(samples)
}

impl<'a, const D: usize, const C: usize> Scene<'a, D, C> {
    pub fn new(
        problem: &'a Problem<'a, D, C>,
        result: &Samples<D, C>,
        exact: Option<&Samples<D, C>>,
    ) -> Result<Self> {
        let plan = Plan::new(problem)?;
        let (start, shape) = interesting_box(problem, &plan, result, exact);
        Self::on_box(problem, plan, start, shape, result, exact)
    }

    /// The scene on a box of one's own choice, which must hold the region.
    pub fn on_box(
        problem: &'a Problem<'a, D, C>,
        plan: Plan<D>,
        start: [usize; D],
        shape: [usize; D],
        result: &Samples<D, C>,
        exact: Option<&Samples<D, C>>,
    ) -> Result<Self> {
        let signals = Signals::new(problem, &plan)?;
        let domain = problem.background.domain();
        let crop = |samples: &Samples<D, C>, c: usize| {
            let lo = start.map(|v| v as isize);
            copy_box(samples.plane(c), domain.shape(), lo, shape, |_, _| None)
        };
        let background: Vec<Vec<f32>> = (0..C).map(|c| crop(problem.background, c)).collect();
        check("background", &background, shape, start)?;
        let change = |samples: &Samples<D, C>| -> Result<Spline<D, C>> {
            let mut planes: Vec<Vec<f32>> = (0..C).map(|c| crop(samples, c)).collect();
            check("result", &planes, shape, start)?;
            for (plane, s) in planes.iter_mut().zip(&background) {
                plane.iter_mut().zip(s).for_each(|(v, s)| *v -= s);
            }
            Ok(spline_in_samples(shape, planes))
        };
        let (change, exact) = (change(result)?, exact.map(change).transpose()?);
        let (h_ref, pitch) = (plan.h_ref, domain.pitch());
        let mut scene = Self {
            problem,
            start,
            shape,
            change,
            exact,
            region: plan.support.weights_on(start, shape),
            guide: Vec::new(),
            colour: Vec::new(),
            place: Vec::new(),
            scale: pitch.map(|h| h_ref / h),
            signals,
            plan,
        };
        scene.set_weights();
        scene.set_places();
        Ok(scene)
    }

    /// The plan's weights, continued beyond its box.
    fn set_weights(&mut self) {
        let (plan, options) = (&self.plan, &self.problem.options);
        let lo = std::array::from_fn(|d| self.start[d] as isize - plan.start[d] as isize);
        let beyond = |values: &[f32], value: f32| {
            let shifted: Vec<f32> = values.iter().map(|v| v - value).collect();
            let mut out = copy_box(&shifted, plan.frame.shape, lo, self.shape, |_, _| None);
            out.iter_mut().for_each(|v| *v += value);
            out
        };
        self.guide = beyond(plan.guide(), 0.0);
        self.colour = beyond(&plan.colour, plan.colour_outside);
        if options.ramp {
            let distance = distance_to(&self.boxed(), |k| self.region[k] >= 0.5);
            let scale = plan.length.unwrap_or(plan.h_ref);
            for (k, d) in distance.into_iter().enumerate() {
                let index = unflatten(k, self.shape);
                let planned = (0..D).all(|d| {
                    let i = index[d] as isize + lo[d];
                    i >= 0 && i < plan.frame.shape[d] as isize
                });
                if !planned && d.is_finite() {
                    self.colour[k] *= ramp(d, scale);
                }
            }
        }
    }

    fn set_places(&mut self) {
        let boxed = self.boxed();
        let (seam, region) = (SEAM * self.plan.h_ref, &self.region);
        let deep = seam + self.problem.options.feather;
        let hard = region.iter().all(|m| *m == 0.0 || *m == 1.0);
        let to_outside = distance_to_cells(&boxed, |k| region[k] < 0.5);
        let to_inside = distance_to_cells(&boxed, |k| region[k] >= 0.5);
        // Soft masks fade over cells that are neither in nor out.
        let faded = (!hard).then(|| {
            let from_in = distance_to_cells(&boxed, |k| region[k] < 1.0);
            (from_in, distance_to_cells(&boxed, |k| region[k] > 0.0))
        });
        let (in_depth, out_depth) = match &faded {
            Some((a, b)) => (a, b),
            None => (&to_outside, &to_inside),
        };
        self.place = (0..region.len())
            .map(|k| Place {
                near: to_outside[k].max(to_inside[k]) <= seam,
                deep_inside: in_depth[k] > deep,
                deep_outside: out_depth[k] > seam,
            })
            .collect();
    }

    /// Samples per axis of the whole background.
    pub fn whole(&self) -> [usize; D] {
        self.problem.background.domain().shape()
    }

    /// The points of a row that lie between the signal's outermost samples; `index` is the row's
    /// first sample in a slab, `offset` (less than a sample) that of the points from their
    /// samples. An axis with one sample has no border.
    pub fn row_within_signal(
        &self,
        start: [usize; D],
        index: [usize; D],
        len: usize,
        offset: [f64; D],
    ) -> Option<Range<usize>> {
        let at = |d: usize| self.start[d] + start[d] + index[d];
        let within = |d: usize| {
            let last = self.whole()[d] - 1;
            last == 0 || if offset[d] < 0.0 { at(d) > 0 } else { at(d) < last }
        };
        let last = self.whole()[0] - 1;
        let cut_first = last > 0 && offset[0] < 0.0 && at(0) == 0;
        let cut_last = last > 0 && offset[0] > 0.0 && at(0) + len == last + 1;
        (1..D).all(within).then(|| usize::from(cut_first)..len - usize::from(cut_last))
    }

    fn boxed(&self) -> Domain<D> {
        let domain = self.problem.background.domain();
        domain.cropped(self.start, self.shape).expect("a box inside a valid domain")
    }

    /// The box in pieces along its last axis, fixed by its shape: first sample and shape of each.
    pub fn slabs(&self) -> Vec<([usize; D], [usize; D])> {
        let inner: usize = self.shape[..D - 1].iter().product();
        let thickness = (SLAB / inner).max(1);
        (0..self.shape[D - 1])
            .step_by(thickness)
            .map(|first| {
                let (mut start, mut shape) = ([0; D], self.shape);
                start[D - 1] = first;
                shape[D - 1] = thickness.min(self.shape[D - 1] - first);
                (start, shape)
            })
            .collect()
    }
}

impl<'a, const D: usize, const C: usize> Signals<'a, D, C> {
    fn new(problem: &'a Problem<'a, D, C>, plan: &Plan<D>) -> Result<Self> {
        let domain = problem.background.domain();
        let support = &plan.support;
        let start = std::array::from_fn(|d| support.start[d].saturating_sub(PREFILTER_REACH));
        let shape: [usize; D] = std::array::from_fn(|d| {
            let end = support.start[d] + support.shape[d] + PREFILTER_REACH;
            end.min(domain.shape()[d]) - start[d]
        });
        let lo = start.map(|v| v as isize);
        let background = (0..C)
            .map(|c| {
                let plane = problem.background.plane(c);
                copy_box(plane, domain.shape(), lo, shape, |_, _| None)
            })
            .collect();
        let (patch, field) = sample_patch(problem, start, shape)?;
        Ok(Self {
            start,
            background: spline_in_samples(shape, background),
            patch: spline_in_samples(shape, patch),
            field,
        })
    }
}

/// The box around the region and everything that differs from the background, with a margin for
/// the splines and the seam.
fn interesting_box<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
    result: &Samples<D, C>,
    exact: Option<&Samples<D, C>>,
) -> ([usize; D], [usize; D]) {
    let domain = problem.background.domain();
    let (shape, pitch) = (domain.shape(), domain.pitch());
    let mut lo = plan.support.start;
    let mut hi: [usize; D] = std::array::from_fn(|d| lo[d] + plan.support.shape[d]);
    for samples in [Some(result), exact].into_iter().flatten() {
        for c in 0..C {
            let (first, end) = differing(samples.plane(c), problem.background.plane(c), shape);
            for d in 0..D {
                (lo[d], hi[d]) = (lo[d].min(first[d]), hi[d].max(end[d]));
            }
        }
    }
    for d in 0..D {
        let seam = ((SEAM + 1.0) * plan.h_ref / pitch[d]).ceil() as usize;
        let margin = MARGIN.max(seam);
        lo[d] = lo[d].saturating_sub(margin);
        hi[d] = (hi[d] + margin).min(shape[d]);
    }
    (lo, std::array::from_fn(|d| hi[d] - lo[d]))
}

/// The smallest box that holds all samples in which two planes differ: first and end.
fn differing<const D: usize>(a: &[f32], b: &[f32], shape: [usize; D]) -> ([usize; D], [usize; D]) {
    let none = || (shape, [0; D]);
    let n0 = shape[0];
    a.par_chunks(n0)
        .zip(b.par_chunks(n0))
        .enumerate()
        .map(|(row, (a, b))| {
            let differs = |i: &usize| a[*i] != b[*i];
            let Some(first) = (0..n0).find(differs) else { return none() };
            let last = (0..n0).rev().find(differs).unwrap_or(first);
            let mut lo = unflatten(row * n0, shape);
            let mut hi = lo.map(|i| i + 1);
            (lo[0], hi[0]) = (first, last + 1);
            (lo, hi)
        })
        .reduce(none, |(a, b), (c, d)| {
            (std::array::from_fn(|k| a[k].min(c[k])), std::array::from_fn(|k| b[k].max(d[k])))
        })
}
