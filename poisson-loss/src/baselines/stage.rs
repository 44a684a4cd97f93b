//! Both signals on a box of background samples, and the guidance on its links.

use inr_core::{Field, Jet, Spline};
use rayon::prelude::*;

use crate::assembly::{edge_samples, mean_at};
use crate::inputs::{check, sample_patch};
use crate::plan::solved_box;
use crate::problem::{Patch, Support, copy_box};
use crate::tile::Frame;
use crate::{Guidance, Problem, Result};

/// Samples around the region: its neighbours, and one more that the choice of the box may take.
const MARGIN: usize = 2;

pub struct Stage<'a, const D: usize, const C: usize> {
    problem: &'a Problem<'a, D, C>,
    /// First background sample of the box.
    pub start: [usize; D],
    pub frame: Frame<D>,
    /// `(h_ref / h_d)^2` per axis.
    pub alpha: [f32; D],
    /// Region weight per sample.
    pub region: Vec<f32>,
    background: Vec<Vec<f32>>,
    patch: Vec<Vec<f32>>,
}

impl<'a, const D: usize, const C: usize> Stage<'a, D, C> {
    pub fn new(problem: &'a Problem<'a, D, C>, support: &Support<D>) -> Result<Self> {
        let domain = problem.background.domain();
        let (start, frame) = solved_box(domain, support, [MARGIN; D]);
        let lo = start.map(|v| v as isize);
        let crop = |plane: &[f32]| copy_box(plane, domain.shape(), lo, frame.shape, |_, _| None);
        let background: Vec<Vec<f32>> = (0..C).map(|c| crop(problem.background.plane(c))).collect();
        check("background", &background, frame.shape, start)?;
        let (patch, _) = sample_patch(problem, start, frame.shape)?;
        let h_ref = domain.reference_pitch();
        Ok(Self {
            problem,
            start,
            frame,
            alpha: domain.pitch().map(|h| (h_ref / h).powi(2)),
            region: support.weights_on(start, frame.shape),
            background,
            patch,
        })
    }

    /// The right-hand side for the change of the background:
    /// `b_i = sum over links (i, j) of alpha share (t_ji)`, `t = v - grad c_S` along the link
    /// towards `i`. `share` takes the region weights of a link's ends.
    pub fn divergence(&self, share: impl Fn(f32, f32) -> f32 + Sync) -> Vec<Vec<f32>> {
        let (n0, mut stride) = (self.frame.shape[0], 1);
        let mut b = vec![vec![0.0f32; self.frame.len()]; C];
        let midpoints = match self.problem.guidance {
            Guidance::Custom(_) => Some(Midpoints::new(self.problem)),
            _ => None,
        };
        for d in 0..D {
            let mut flux = vec![[0.0f32; C]; self.frame.len()];
            flux.par_chunks_mut(n0).enumerate().for_each(|(row, out)| {
                self.flux_row(d, stride, row * n0, &share, midpoints.as_ref(), out);
            });
            for (c, b) in b.iter_mut().enumerate() {
                b.par_iter_mut().zip(&flux).for_each(|(b, f)| *b -= f[c]);
                b[stride..].par_iter_mut().zip(&flux).for_each(|(b, f)| *b += f[c]);
            }
            stride *= self.frame.shape[d];
        }
        b
    }

    /// `alpha share (v - grad c_S)`, in change per link, on the links from a row's samples along
    /// axis `d`; zero where the signal ends.
    fn flux_row(
        &self,
        d: usize,
        stride: usize,
        first: usize,
        share: impl Fn(f32, f32) -> f32,
        midpoints: Option<&Midpoints<'_, D, C>>,
        out: &mut [[f32; C]],
    ) {
        let last = self.frame.shape[d] - 1;
        let active: Vec<(usize, f32)> = (first..first + out.len())
            .filter(|k| k / stride % (last + 1) < last)
            .map(|k| (k, share(self.region[k], self.region[k + stride])))
            .filter(|(_, w)| *w > 0.0)
            .collect();
        let from_midpoints = midpoints.map(|m| m.guidance(self, d, &active));
        for (order, &(k, w)) in active.iter().enumerate() {
            let along = |planes: &[Vec<f32>]| -> [f32; C] {
                std::array::from_fn(|c| planes[c][k + stride] - planes[c][k])
            };
            let s = along(&self.background);
            let v = match &from_midpoints {
                Some(v) => v[order],
                // All rules compare, or combine linearly, within the axis: its scale drops out.
                None => self.follow(d, s, along(&self.patch)),
            };
            let weight = self.alpha[d] * w;
            out[k - first] = std::array::from_fn(|c| weight * (v[c] - s[c]));
        }
    }

    /// The guidance from differences along axis `d` alone.
    fn follow(&self, d: usize, s: [f32; C], t: [f32; C]) -> [f32; C] {
        let jet = |v: [f32; C]| {
            let mut jet = Jet::<D, C>::ZERO;
            (0..C).for_each(|c| jet.grad[c][d] = v[c]);
            jet
        };
        self.problem.guidance.evaluate(&[0.0; D], &jet(s), &jet(t)).map(|v| v[d])
    }

    /// A change to start from: what would be pasted, less its mean along the region's edge. Where
    /// the guidance is linear it has the right gradient already.
    pub fn guess(&self) -> Vec<Vec<f32>> {
        let linear = matches!(self.problem.guidance, Guidance::Mix { .. } | Guidance::Monochrome);
        let mut change = vec![vec![0.0f32; self.frame.len()]; C];
        for k in 0..self.frame.len() {
            let of = |planes: &[Vec<f32>]| std::array::from_fn(|c| planes[c][k]);
            let (s, t): ([f32; C], [f32; C]) = (of(&self.background), of(&self.patch));
            let target = if linear { self.follow(0, s, t) } else { t };
            (0..C).for_each(|c| change[c][k] = target[c] - s[c]);
        }
        let edge = edge_samples(&self.region, &self.frame);
        for e in &mut change {
            let mean = mean_at(e, &edge);
            e.iter_mut().zip(&self.region).for_each(|(e, m)| *e = m * (*e - mean));
        }
        change
    }
}

/// Both signals as splines, for guidance that is a function of position and jets.
struct Midpoints<'a, const D: usize, const C: usize> {
    problem: &'a Problem<'a, D, C>,
    background: Spline<D, C>,
    /// The patch if it is made of samples.
    patch: Option<Spline<D, C>>,
}

impl<'a, const D: usize, const C: usize> Midpoints<'a, D, C> {
    fn new(problem: &'a Problem<'a, D, C>) -> Self {
        let patch = match problem.patch {
            Patch::Samples { samples, .. } => Some(Spline::interpolate(samples)),
            Patch::Field { .. } => None,
        };
        Self { problem, background: Spline::interpolate(problem.background), patch }
    }

    /// `v` along axis `d`, in change per link, at the midpoints of the links from some samples.
    fn guidance(&self, stage: &Stage<'_, D, C>, d: usize, links: &[(usize, f32)]) -> Vec<[f32; C]> {
        let domain = self.problem.background.domain();
        let x: Vec<[f32; D]> = links
            .iter()
            .map(|(k, _)| {
                let mut rest = *k;
                let mut x = domain.position(std::array::from_fn(|e| {
                    let i = stage.start[e] + rest % stage.frame.shape[e];
                    rest /= stage.frame.shape[e];
                    i
                }));
                x[d] += 0.5 * domain.pitch()[d];
                x
            })
            .collect();
        let (field, offset): (&dyn Field<D, C>, _) = match (&self.problem.patch, &self.patch) {
            (Patch::Field { field, offset }, _) => (*field, offset),
            (Patch::Samples { offset, .. }, Some(spline)) => (spline, offset),
            (Patch::Samples { .. }, None) => unreachable!("sampled patches have a spline"),
        };
        let moved: Vec<[f32; D]> =
            x.iter().map(|x| std::array::from_fn(|e| x[e] - offset[e])).collect();
        let h_ref = domain.reference_pitch();
        let jets = |field: &dyn Field<D, C>, x: &[[f32; D]]| {
            let mut jets = vec![Jet::ZERO; x.len()];
            field.eval_jet(x, &mut jets);
            jets.iter_mut().flat_map(|j| j.grad.iter_mut().flatten()).for_each(|g| *g *= h_ref);
            jets
        };
        let (s, t) = (jets(&self.background, &x), jets(field, &moved));
        let per_link = domain.pitch()[d] / h_ref;
        (0..x.len())
            .map(|k| {
                let v = self.problem.guidance.evaluate(&x[k], &s[k], &t[k]);
                v.map(|v| v[d] * per_link)
            })
            .collect()
    }
}
