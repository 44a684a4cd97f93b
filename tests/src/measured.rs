//! The metrics in f64, point by point from their definitions: the truth of the library's.

use inr_core::{Domain, RasterMask, Region, Samples};
use poisson_loss::{Guidance, Metrics, Objective, Options, Patch, Problem, Strongest};

use crate::oracle::coefficients_of;
use crate::reference::Lattice;
use crate::signals::textured;

/// A problem that owns its signals.
pub struct Case<const D: usize, const C: usize> {
    /// What stays outside.
    pub background: Samples<D, C>,
    /// What gives its gradients, on the same lattice.
    pub patch: Samples<D, C>,
    /// Where.
    pub region: RasterMask<D>,
    /// Which gradients.
    pub guidance: Guidance<D, C>,
    /// Functional and tolerance.
    pub options: Options,
}

impl<const D: usize, const C: usize> Case<D, C> {
    /// Textures on a lattice, screened with a length of 2.5.
    pub fn new(domain: Domain<D>, region: RasterMask<D>) -> Self {
        Self {
            background: textured(domain, 1),
            patch: textured(domain, 2),
            region,
            guidance: Guidance::Patch,
            options: screened(2.5, None),
        }
    }

    /// The case as the library takes it.
    pub fn problem(&self) -> Problem<'_, D, C> {
        Problem {
            background: &self.background,
            patch: Patch::Samples { samples: &self.patch, offset: [0.0; D] },
            region: &self.region,
            guidance: self.guidance.clone(),
            options: self.options,
        }
    }
}

/// The screened objective with these lengths.
pub fn screened(length: f32, keep: Option<f32>) -> Options {
    Options::with_objective(Objective::Screened { length: Some(length), keep })
}

/// The cubic B-spline from truncated powers, and its derivative.
fn bspline(x: f64) -> (f64, f64) {
    let terms = [(1.0, 2.0), (-4.0, 1.0), (6.0, 0.0), (-4.0, -1.0), (1.0, -2.0)];
    terms.iter().fold((0.0, 0.0), |(v, s), (factor, knot)| {
        let t: f64 = (x + knot).max(0.0);
        (v + factor * t.powi(3) / 6.0, s + factor * t * t / 2.0)
    })
}

/// Value and slopes (per unit of `pitch`) of a spline at a position in samples.
pub fn jet(shape: &[usize], pitch: &[f64], c: &[f64], at: &[f64]) -> (f64, Vec<f64>) {
    let dims = shape.len();
    let (mut value, mut slopes) = (0.0, vec![0.0; dims]);
    for tap in 0..4usize.pow(dims as u32) {
        let (mut flat, mut stride, mut rest) = (0, 1, tap);
        let mut factors = Vec::new();
        for d in 0..dims {
            let knot = at[d].floor() as i64 - 1 + (rest % 4) as i64;
            rest /= 4;
            let period = 2 * (shape[d] as i64 - 1).max(1);
            let inside = knot.rem_euclid(period).min(period - knot.rem_euclid(period));
            flat += if shape[d] == 1 { 0 } else { inside as usize } * stride;
            stride *= shape[d];
            factors.push(bspline(at[d] - knot as f64));
        }
        value += c[flat] * factors.iter().map(|f| f.0).product::<f64>();
        for (e, slope) in slopes.iter_mut().enumerate() {
            let product: f64 = (0..dims)
                .map(|d| if d == e { factors[d].1 / pitch[d] } else { factors[d].0 })
                .product();
            *slope += c[flat] * product;
        }
    }
    (value, slopes)
}

/// Everything in f64, by brute force.
pub struct Reference<'a, const D: usize, const C: usize> {
    case: &'a Case<D, C>,
    /// Samples per axis.
    pub shape: Vec<usize>,
    /// In units of the reference pitch.
    pub pitch: Vec<f64>,
    h: f64,
    /// Weight of the region per sample.
    pub m: Vec<f64>,
    guide: Vec<f64>,
    /// Weight of the squared distance to the background per sample.
    pub colour: Vec<f64>,
    s: Vec<Vec<f64>>,
    t: Vec<Vec<f64>>,
    length: Option<f32>,
}

impl<'a, const D: usize, const C: usize> Reference<'a, D, C> {
    /// Weights and coefficients of a case; `length` is the coupling length in use.
    pub fn new(case: &'a Case<D, C>, length: Option<f32>) -> Self {
        let domain = case.background.domain();
        let h = f64::from(domain.reference_pitch());
        let m: Vec<f64> = (0..domain.len())
            .map(|k| f64::from(case.region.weight(&domain.position(domain.unflatten(k)))))
            .collect();
        let mut this = Self {
            case,
            shape: domain.shape().to_vec(),
            pitch: domain.pitch().iter().map(|p| f64::from(*p) / h).collect(),
            h,
            guide: m.clone(),
            colour: Vec::new(),
            m,
            s: coefficients_of(&case.background),
            t: coefficients_of(&case.patch),
            length,
        };
        this.set_weights();
        this
    }

    fn set_weights(&mut self) {
        let (options, n) = (self.case.options, self.m.len() as f64);
        let total: f64 = self.m.iter().sum();
        let base = match options.objective {
            Objective::Screened { .. } => (self.h / f64::from(self.length.unwrap())).powi(2),
            Objective::Paper { lambda } => f64::from(lambda) * total / (n - total),
            Objective::Dirichlet => 0.0,
        };
        self.colour = (0..self.m.len())
            .map(|k| {
                let d = self.distance(k, 0.0, |j| self.m[j] >= 0.5) * self.h;
                let mut weight = base * (1.0 - self.m[k]);
                if options.ramp {
                    weight *= (1.0 + d / f64::from(self.length.unwrap())).powi(2);
                }
                if options.band && d <= 2.0 * self.h {
                    weight *= 10.0;
                }
                weight
            })
            .collect();
        if options.feather > 0.0 {
            self.guide = (0..self.m.len())
                .map(|k| {
                    let d = self.distance(k, 0.0, |j| self.m[j] < 0.5) * self.h;
                    self.m[k] * (d / f64::from(options.feather)).min(1.0)
                })
                .collect();
        }
    }

    fn index(&self, k: usize) -> Vec<usize> {
        let mut rest = k;
        self.shape
            .iter()
            .map(|n| {
                let i = rest % n;
                rest /= n;
                i
            })
            .collect()
    }

    /// Distance in reference pitches to the nearest cell with a property, its cell being `half`
    /// of a pitch wide on every side.
    fn distance(&self, k: usize, half: f64, target: impl Fn(usize) -> bool) -> f64 {
        let here = self.index(k);
        (0..self.m.len())
            .filter(|j| target(*j))
            .map(|j| {
                let there = self.index(j);
                (0..D)
                    .map(|d| {
                        let steps = (here[d] as f64 - there[d] as f64).abs();
                        ((steps - half).max(0.0) * self.pitch[d]).powi(2)
                    })
                    .sum::<f64>()
                    .sqrt()
            })
            .fold(f64::INFINITY, f64::min)
    }

    /// Value and slopes of every channel at a position in samples.
    pub fn jets(&self, c: &[Vec<f64>], at: &[f64]) -> Vec<(f64, Vec<f64>)> {
        c.iter().map(|c| jet(&self.shape, &self.pitch, c, at)).collect()
    }

    /// The gradient to follow at a point, with the given share of the guidance.
    fn target(&self, at: &[f64], guide: f64) -> Vec<Vec<f64>> {
        let (s, t) = (self.jets(&self.s, at), self.jets(&self.t, at));
        let norm =
            |jets: &[(f64, Vec<f64>)]| jets.iter().flat_map(|j| &j.1).map(|v| v * v).sum::<f64>();
        (0..C)
            .map(|c| {
                (0..D)
                    .map(|d| {
                        let (s_d, t_d) = (s[c].1[d], t[c].1[d]);
                        let v = match &self.case.guidance {
                            Guidance::Patch => t_d,
                            Guidance::Strongest(Strongest::Joint) => {
                                if norm(&t) >= norm(&s) {
                                    t_d
                                } else {
                                    s_d
                                }
                            }
                            Guidance::Mix { mu, phi } => {
                                f64::from(*mu) * s_d + f64::from(*phi) * t_d
                            }
                            other => panic!("no reference for {other:?}"),
                        };
                        s_d + guide * (v - s_d)
                    })
                    .collect()
            })
            .collect()
    }

    /// Every metric of a result.
    pub fn measure(&self, result: &Samples<D, C>) -> Metrics {
        let case = self.case;
        let n = self.m.len() as f64;
        let total: f64 = self.m.iter().sum();
        let c = coefficients_of(result);
        let keep = match case.options.objective {
            Objective::Screened { keep: Some(l), .. } => (self.h / f64::from(l)).powi(2),
            _ => 0.0,
        };
        let paper = matches!(case.options.objective, Objective::Paper { .. });
        let near: Vec<bool> = (0..self.m.len())
            .map(|k| {
                let inside = self.m[k] >= 0.5;
                self.distance(k, 0.5, |j| (self.m[j] >= 0.5) != inside) <= 3.0
            })
            .collect();
        let (mut m1, mut m2, mut objective, mut seam) = ([0.0; 2], [0.0; 2], 0.0, [0.0; 2]);
        let mut seam_max = 0.0f64;
        let w = 0.5f64.powi(D as i32);
        for p in &Lattice::new(&self.shape, &self.pitch).points {
            let (jets, s, t) =
                (self.jets(&c, &p.at), self.jets(&self.s, &p.at), self.jets(&self.t, &p.at));
            let v = self.target(&p.at, self.guide[p.cell]);
            let m = self.m[p.cell];
            let per_channel: Vec<f64> =
                (0..C).map(|c| (0..D).map(|d| (jets[c].1[d] - v[c][d]).powi(2)).sum()).collect();
            let g: f64 = per_channel.iter().sum();
            let e: f64 = (0..C).map(|c| (jets[c].0 - s[c].0).powi(2)).sum();
            let kept: f64 = (0..C).map(|c| (jets[c].0 - t[c].0).powi(2)).sum();
            m1 = [m1[0] + w * m * g, m1[1] + w * m];
            m2 = [m2[0] + w * (1.0 - m) * e, m2[1] + w * (1.0 - m)];
            let gamma = if paper { m } else { 1.0 };
            objective += w * (gamma * g + self.colour[p.cell] * e + keep * m * kept);
            if near[p.cell] {
                seam = [seam[0] + w * g, seam[1] + w];
                seam_max = per_channel.iter().fold(seam_max, |a, b| a.max(b.sqrt()));
            }
        }
        let (pde_inside, pde_outside) = self.residuals(&c, keep, paper);
        let outside: f64 = (0..self.m.len())
            .map(|k| {
                let change = |c: usize| {
                    f64::from(result.plane(c)[k]) - f64::from(case.background.plane(c)[k])
                };
                (1.0 - self.m[k]) * (0..C).map(|c| change(c).powi(2)).sum::<f64>()
            })
            .sum();
        let clipped: f64 = (0..self.m.len())
            .filter(|k| (0..C).any(|c| !(0.0..=1.0).contains(&result.plane(c)[*k])))
            .map(|k| self.m[k])
            .sum();
        let (m1, m2) = (m1[0] / m1[1], m2[0] / m2[1]);
        Metrics {
            m1,
            m2,
            m1_paper: 500.0 * total / n / C as f64 * m1,
            m2_paper: 1000.0 * (1.0 - total / n) / C as f64 * m2,
            objective: objective / total,
            excess_energy: None,
            rmse_to_exact: None,
            rmse_inside: None,
            pde_inside,
            pde_outside,
            seam_rms: (seam[0] / seam[1] / C as f64).sqrt(),
            seam_max,
            psnr_outside: 10.0 * (C as f64 * (n - total) / outside).log10(),
            outside_unit_range: clipped / total,
        }
    }

    fn residuals(&self, c: &[Vec<f64>], keep: f64, paper: bool) -> (f64, f64) {
        let deep = 3.0 + f64::from(self.case.options.feather) / self.h;
        let (mut inside, mut outside) = ([0.0; 2], [0.0; 2]);
        for k in 0..self.m.len() {
            let i = self.index(k);
            if (0..D).any(|d| self.shape[d] > 1 && (i[d] == 0 || i[d] + 1 == self.shape[d])) {
                continue;
            }
            let in_deep = self.distance(k, 0.5, |j| self.m[j] < 1.0) > deep;
            let out_deep = self.distance(k, 0.5, |j| self.m[j] > 0.0) > 3.0;
            if !in_deep && !out_deep {
                continue;
            }
            for base in [0.0, 0.5] {
                let x: Vec<f64> = i.iter().map(|i| *i as f64 + base).collect();
                let mut r = vec![0.0; C];
                for d in (0..D).filter(|d| self.shape[*d] > 1) {
                    for sign in [-1.0, 1.0] {
                        let mut y = x.clone();
                        y[d] += 0.5 * sign;
                        let v = self.target(&y, f64::from(in_deep));
                        let g = self.jets(c, &y);
                        (0..C).for_each(|c| r[c] += sign * (g[c].1[d] - v[c][d]) / self.pitch[d]);
                    }
                }
                let (g, s, t) = (self.jets(c, &x), self.jets(&self.s, &x), self.jets(&self.t, &x));
                for c in 0..C {
                    let gamma = if paper && out_deep { 0.0 } else { 1.0 };
                    let kept = if in_deep { keep * (g[c].0 - t[c].0) } else { 0.0 };
                    let r = gamma * r[c] - self.colour[k] * (g[c].0 - s[c].0) - kept;
                    let sum = if in_deep { &mut inside } else { &mut outside };
                    *sum = [sum[0] + r * r, sum[1] + 1.0];
                }
            }
        }
        let rms = |s: [f64; 2]| if s[1] > 0.0 { (s[0] / s[1]).sqrt() } else { 0.0 };
        (rms(inside), rms(outside))
    }
}
