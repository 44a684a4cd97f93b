//! Blending problems for the f64 reference: from signals, mask and guidance to what is asked at
//! every quadrature point.

use inr_core::{RasterMask, Region, Samples};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, Strongest};

use crate::reference::{self, Lattice, Terms};

/// A problem whose background, patch and mask share one lattice.
pub struct Case<'a, const D: usize, const C: usize> {
    /// What stays outside.
    pub background: &'a Samples<D, C>,
    /// What gives its gradients, on the same lattice.
    pub patch: &'a Samples<D, C>,
    /// Where.
    pub region: &'a RasterMask<D>,
    /// Which gradients.
    pub guidance: Guidance<D, C>,
    /// Functional and tolerance.
    pub options: Options,
}

impl<const D: usize, const C: usize> Case<'_, D, C> {
    /// The case as the solver takes it.
    pub fn problem(&self) -> Problem<'_, D, C> {
        Problem {
            background: self.background,
            patch: Patch::Samples { samples: self.patch, offset: [0.0; D] },
            region: self.region,
            guidance: self.guidance.clone(),
            options: self.options,
        }
    }

    /// The quadrature points, in units of the reference pitch.
    pub fn lattice(&self) -> Lattice {
        let domain = self.background.domain();
        let h = f64::from(domain.reference_pitch());
        let pitch: Vec<f64> = domain.pitch().iter().map(|p| f64::from(*p) / h).collect();
        Lattice::new(&domain.shape(), &pitch)
    }

    /// What every channel asks at every point; `length` is the one in use.
    pub fn terms(&self, lattice: &Lattice, length: Option<f32>) -> Vec<Vec<Terms>> {
        let domain = self.background.domain();
        let h = f64::from(domain.reference_pitch());
        let (s, t) = (coefficients_of(self.background), coefficients_of(self.patch));
        let m = self.weights();
        let total: f64 = m.iter().sum();
        let jets: Vec<Vec<Jets>> = lattice
            .points
            .iter()
            .map(|p| (0..C).map(|c| (lattice.jet(p, &s[c]), lattice.jet(p, &t[c]))).collect())
            .collect();
        let term = |c: usize, cell: usize, jets: &[Jets]| {
            let (w, (background, patch)) = (m[cell], &jets[c]);
            let v = follow(&self.guidance, jets, c);
            let target = (0..D).map(|d| background.1[d] + w * (v[d] - background.1[d])).collect();
            let (gradient, colour, keep) = match self.options.objective {
                Objective::Screened { keep, .. } => (
                    1.0,
                    (1.0 - w) * (h / f64::from(length.expect("a length in use"))).powi(2),
                    keep.map_or(0.0, |l| w * (h / f64::from(l)).powi(2)),
                ),
                Objective::Paper { lambda } => {
                    let outside = domain.len() as f64 - total;
                    (w, (1.0 - w) * f64::from(lambda) * total / outside, 0.0)
                }
                Objective::Dirichlet => (1.0, 0.0, 0.0),
            };
            Terms {
                gradient: (gradient, target),
                values: vec![(colour, background.0), (keep, patch.0)],
            }
        };
        (0..C)
            .map(|c| lattice.points.iter().zip(&jets).map(|(p, j)| term(c, p.cell, j)).collect())
            .collect()
    }

    /// Region weights of all samples.
    pub fn weights(&self) -> Vec<f64> {
        let domain = self.background.domain();
        let weight = |k| f64::from(self.region.weight(&domain.position(domain.unflatten(k))));
        (0..domain.len()).map(weight).collect()
    }
}

/// Value and slopes of background and patch.
type Jets = ((f64, Vec<f64>), (f64, Vec<f64>));

/// Spline coefficients of every channel in f64.
pub fn coefficients_of<const D: usize, const C: usize>(samples: &Samples<D, C>) -> Vec<Vec<f64>> {
    let shape = samples.domain().shape();
    let wide = |c| samples.plane(c).iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
    (0..C).map(|c| reference::coefficients(&shape, &wide(c))).collect()
}

/// The reference's answer: samples of every channel.
pub fn expected<const D: usize, const C: usize>(
    case: &Case<D, C>,
    length: Option<f32>,
) -> Vec<Vec<f64>> {
    let shape = case.background.domain().shape();
    let lattice = case.lattice();
    let start = coefficients_of(case.background);
    let fixed = match case.options.objective {
        Objective::Dirichlet => touching_outside(&lattice, &case.weights()),
        _ => Vec::new(),
    };
    case.terms(&lattice, length)
        .iter()
        .zip(&start)
        .map(|(terms, start)| {
            reference::nodal(&shape, &reference::minimise(&lattice, terms, start, &fixed))
        })
        .collect()
}

/// Coefficients that some point outside the region sees.
fn touching_outside(lattice: &Lattice, m: &[f64]) -> Vec<bool> {
    let mut fixed = vec![false; m.len()];
    for p in lattice.points.iter().filter(|p| m[p.cell] < 1.0) {
        p.basis.iter().for_each(|(k, _, _)| fixed[*k] = true);
    }
    fixed
}

fn follow<const D: usize, const C: usize>(
    guidance: &Guidance<D, C>,
    jets: &[Jets],
    c: usize,
) -> Vec<f64> {
    let norm = |g: &[f64]| g.iter().map(|v| v * v).sum::<f64>();
    let (s, t) = (&jets[c].0.1, &jets[c].1.1);
    match guidance {
        Guidance::Patch => t.clone(),
        Guidance::Strongest(Strongest::Joint) => {
            let (a, b): (f64, f64) = jets
                .iter()
                .map(|j| (norm(&j.0.1), norm(&j.1.1)))
                .fold((0.0, 0.0), |x, y| (x.0 + y.0, x.1 + y.1));
            if b >= a { t.clone() } else { s.clone() }
        }
        Guidance::Strongest(Strongest::PerChannel) => {
            if norm(t) >= norm(s) {
                t.clone()
            } else {
                s.clone()
            }
        }
        Guidance::Strongest(Strongest::PerComponent) => {
            (0..D).map(|d| if t[d].abs() >= s[d].abs() { t[d] } else { s[d] }).collect()
        }
        Guidance::Mix { mu, phi } => {
            (0..D).map(|d| f64::from(*mu) * s[d] + f64::from(*phi) * t[d]).collect()
        }
        Guidance::Monochrome => {
            let w = if C == 3 { vec![0.2126, 0.7152, 0.0722] } else { vec![1.0 / C as f64; C] };
            (0..D).map(|d| (0..C).map(|k| w[k] * jets[k].1.1[d]).sum()).collect()
        }
        other => panic!("no reference for {other:?}"),
    }
}
