//! The metrics against an independent evaluation in f64, point by point from their definitions,
//! and the laws that tie them to the exact solution.

use inr_core::{Domain, RasterMask, Region, Samples, Unit};
use npsolve_tests::reference::{self, Lattice};
use npsolve_tests::signals::{ball, mask, textured};
use poisson_loss::{
    Baseline, Guidance, Metrics, Objective, Options, Patch, Problem, Strongest, measure, solve,
    solve_baseline,
};

/// Relative; f32 values and slopes at every point give 1e-6 in the sums.
const TOLERANCE: f64 = 2e-5;

struct Case<const D: usize, const C: usize> {
    background: Samples<D, C>,
    patch: Samples<D, C>,
    region: RasterMask<D>,
    guidance: Guidance<D, C>,
    options: Options,
}

impl<const D: usize, const C: usize> Case<D, C> {
    fn new(domain: Domain<D>, region: RasterMask<D>) -> Self {
        Self {
            background: textured(domain, 1),
            patch: textured(domain, 2),
            region,
            guidance: Guidance::Patch,
            options: screened(2.5, None),
        }
    }

    fn problem(&self) -> Problem<'_, D, C> {
        Problem {
            background: &self.background,
            patch: Patch::Samples { samples: &self.patch, offset: [0.0; D] },
            region: &self.region,
            guidance: self.guidance.clone(),
            options: self.options,
        }
    }
}

fn screened(length: f32, keep: Option<f32>) -> Options {
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
fn jet(shape: &[usize], pitch: &[f64], c: &[f64], at: &[f64]) -> (f64, Vec<f64>) {
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
struct Reference<'a, const D: usize, const C: usize> {
    case: &'a Case<D, C>,
    shape: Vec<usize>,
    /// In units of the reference pitch.
    pitch: Vec<f64>,
    h: f64,
    m: Vec<f64>,
    guide: Vec<f64>,
    colour: Vec<f64>,
    s: Vec<Vec<f64>>,
    t: Vec<Vec<f64>>,
    length: Option<f32>,
}

fn coefficients<const D: usize, const C: usize>(samples: &Samples<D, C>) -> Vec<Vec<f64>> {
    let shape = samples.domain().shape().to_vec();
    (0..C)
        .map(|c| {
            let plane: Vec<f64> = samples.plane(c).iter().map(|v| f64::from(*v)).collect();
            reference::coefficients(&shape, &plane)
        })
        .collect()
}

impl<'a, const D: usize, const C: usize> Reference<'a, D, C> {
    fn new(case: &'a Case<D, C>, length: Option<f32>) -> Self {
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
            s: coefficients(&case.background),
            t: coefficients(&case.patch),
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

    fn jets(&self, c: &[Vec<f64>], at: &[f64]) -> Vec<(f64, Vec<f64>)> {
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

    fn measure(&self, result: &Samples<D, C>) -> Metrics {
        let case = self.case;
        let n = self.m.len() as f64;
        let total: f64 = self.m.iter().sum();
        let c = coefficients(result);
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

fn compare(name: &str, got: &Metrics, want: &Metrics) {
    let pairs = [
        ("m1", got.m1, want.m1),
        ("m2", got.m2, want.m2),
        ("m1_paper", got.m1_paper, want.m1_paper),
        ("m2_paper", got.m2_paper, want.m2_paper),
        ("objective", got.objective, want.objective),
        ("pde_inside", got.pde_inside, want.pde_inside),
        ("pde_outside", got.pde_outside, want.pde_outside),
        ("seam_rms", got.seam_rms, want.seam_rms),
        ("seam_max", got.seam_max, want.seam_max),
        ("psnr_outside", got.psnr_outside, want.psnr_outside),
        ("outside_unit_range", got.outside_unit_range, want.outside_unit_range),
    ];
    for (metric, got, want) in pairs {
        // 1e-6: what f32 leaves of a residual or a difference that should vanish.
        let close = got == want || (got - want).abs() <= TOLERANCE * want.abs() + 1e-6;
        assert!(close, "{name}: {metric} is {got:e}, expected {want:e}");
    }
}

/// Paste, somebody else's image that differs everywhere, and our own solution.
fn check<const D: usize, const C: usize>(name: &str, case: &Case<D, C>) {
    let ours = solve(&case.problem()).unwrap();
    let reference = Reference::new(case, ours.report.length);
    let pasted = solve_baseline(&case.problem(), Baseline::Paste).unwrap().samples;
    let mut foreign = ours.samples.clone();
    let noise = textured::<D, C>(*foreign.domain(), 77);
    for (v, n) in foreign.as_planar_mut().iter_mut().zip(noise.as_planar()) {
        *v += 0.3 * (n - 0.5);
    }
    for (result, label) in [(&ours.samples, "exact"), (&pasted, "paste"), (&foreign, "foreign")] {
        let got = measure(&case.problem(), result, Some(&ours.samples)).unwrap();
        compare(&format!("{name}, {label}"), &got, &reference.measure(result));
    }
}

#[test]
fn every_objective_and_option_in_two_dimensions() {
    let domain = Domain::new([31, 27], [1.0, 1.3], [4.0, -2.0], Unit::Millimetre).unwrap();
    let mut case = Case::<2, 2>::new(domain, ball(domain, 0.75));
    for guidance in [Guidance::Patch, Guidance::Strongest(Strongest::Joint), Guidance::SUM] {
        case.guidance = guidance;
        for options in [
            screened(2.5, None),
            screened(2.0, Some(4.0)),
            Options { ramp: true, band: true, feather: 2.0, ..screened(2.0, None) },
            Options::with_objective(Objective::Paper { lambda: 2.0 }),
            Options::with_objective(Objective::Dirichlet),
        ] {
            case.options = options;
            check(&format!("{:?}, {options:?}", case.guidance), &case);
        }
    }
}

#[test]
fn soft_masks_holes_and_borders() {
    let domain = Domain::unit([30, 33]).unwrap();
    let shapes: [fn([f64; 2]) -> f64; 3] = [
        |u| (1.6 - 2.0 * (u[0] * u[0] + u[1] * u[1])).clamp(0.0, 1.0),
        |u| f64::from(u[0].hypot(u[1]) < 0.9 && u[0].hypot(u[1]) > 0.2),
        |u| f64::from(u[0] < 0.1 && u[1] > -0.3),
    ];
    for (k, shape) in shapes.into_iter().enumerate() {
        let case = Case::<2, 1>::new(domain, mask(domain, shape));
        check(&format!("shape {k}"), &case);
    }
}

#[test]
fn one_and_three_dimensions() {
    let line = Domain::unit([120]).unwrap();
    check("line", &Case::<1, 2>::new(line, ball(line, 0.2)));
    let volume = Domain::unit([12, 11, 13]).unwrap();
    check("volume", &Case::<3, 1>::new(volume, ball(volume, 0.8)));
    let flat = Domain::unit([17, 1, 14]).unwrap();
    let disc = mask(flat, |u| f64::from(u[0] * u[0] + u[2] * u[2] < 0.5));
    check("flat volume", &Case::<3, 1>::new(flat, disc));
}

#[test]
fn sampled_and_continuous_patches_measure_the_same() {
    let domain = Domain::unit([40, 36]).unwrap();
    let case = Case::<2, 1>::new(domain, ball(domain, 0.6));
    let field = inr_core::Spline::interpolate(&case.patch);
    let result = solve(&case.problem()).unwrap().samples;
    let mut problem = case.problem();
    problem.patch = Patch::Field { field: &field, offset: [0.0; 2] };
    let (a, b) = (
        measure(&case.problem(), &result, None).unwrap(),
        measure(&problem, &result, None).unwrap(),
    );
    compare("field", &b, &a);
}

#[test]
fn a_single_changed_sample_far_away_is_seen() {
    let domain = Domain::unit([200, 90]).unwrap();
    let weights = (0..domain.len()).map(|k| f32::from(k % 200 < 20 && k / 200 < 20)).collect();
    let case = Case::<2, 3>::new(domain, RasterMask::new(domain, weights).unwrap());
    let exact = solve(&case.problem()).unwrap().samples;
    let mut result = exact.clone();
    result.plane_mut(2)[85 * 200 + 190] += 0.5;
    let (a, b) = (
        measure(&case.problem(), &exact, Some(&exact)).unwrap(),
        measure(&case.problem(), &result, Some(&exact)).unwrap(),
    );
    assert!(b.m2 > a.m2 && b.psnr_outside < a.psnr_outside && b.objective > a.objective);
    let want = 0.5 / (3.0 * domain.len() as f64).sqrt();
    assert!((b.rmse_to_exact.unwrap() - want).abs() < 1e-6 * want);
    assert_eq!(b.rmse_inside, Some(0.0));
    assert_eq!(b.m1, a.m1);
}

#[test]
fn the_exact_solution_has_no_excess_and_no_other_result_has_less() {
    let domain = Domain::unit([70, 64]).unwrap();
    let mut case = Case::<2, 3>::new(domain, ball(domain, 0.5));
    let of = |case: &Case<2, 3>, result: &Samples<2, 3>, exact: &Samples<2, 3>| {
        measure(&case.problem(), result, Some(exact)).unwrap()
    };
    for objective in [
        Objective::Screened { length: None, keep: None },
        Objective::Screened { length: Some(3.0), keep: Some(6.0) },
        Objective::Paper { lambda: 2.0 },
    ] {
        case.options.objective = objective;
        let exact = solve(&case.problem()).unwrap().samples;
        let best = of(&case, &exact, &exact);
        assert_eq!((best.excess_energy, best.rmse_to_exact), (Some(0.0), Some(0.0)));
        for baseline in [
            Baseline::Paste,
            Baseline::Pie,
            Baseline::Neumann,
            Baseline::PaperLinks { lambda: 2.0 },
        ] {
            let other = solve_baseline(&case.problem(), baseline).unwrap().samples;
            let other = of(&case, &other, &exact);
            println!("{objective:?}, {baseline:?}: J - J* = {:?} J*", other.excess_energy);
            let excess = other.excess_energy.unwrap();
            assert!(excess > 0.0, "{objective:?}, {baseline:?}: {excess:e}");
            // The difference of two rounded sums.
            let plain = other.objective / best.objective - 1.0;
            assert!((plain - excess).abs() < 1e-6 * (1.0 + plain), "{plain} against {excess}");
        }
    }
}

#[test]
fn the_excess_is_the_energy_of_the_difference() {
    let domain = Domain::unit([26, 29]).unwrap();
    let mut case = Case::<2, 1>::new(domain, ball(domain, 0.6));
    case.options = Options { tolerance: 1e-7, ..screened(2.0, None) };
    let exact = solve(&case.problem()).unwrap().samples;
    let bump = textured::<2, 1>(domain, 5);
    let of = |eps: f32| {
        let mut result = exact.clone();
        let planes = result.as_planar_mut().iter_mut().zip(bump.as_planar());
        planes.for_each(|(v, b)| *v += eps * (b - 0.5));
        let metrics = measure(&case.problem(), &result, Some(&exact)).unwrap();
        // J - J* from the excess and both objectives.
        let excess = metrics.excess_energy.unwrap();
        (excess, excess * metrics.objective / (1.0 + excess), result)
    };
    for eps in [0.2f32, 0.02] {
        let (excess, energy, result) = of(eps);
        let (half, ..) = of(0.5 * eps);
        // Quadratic; what is left of the first order is the solver's tolerance.
        assert!((excess / half - 4.0).abs() < 0.01, "{eps}: {}", excess / half);
        let reference = Reference::new(&case, Some(2.0));
        let difference = {
            let (a, b) = (coefficients(&result), coefficients(&exact));
            vec![a[0].iter().zip(&b[0]).map(|(a, b)| a - b).collect::<Vec<f64>>()]
        };
        let lattice = Lattice::new(&reference.shape, &reference.pitch);
        let want: f64 = lattice
            .points
            .iter()
            .map(|p| {
                let (value, slopes) = &reference.jets(&difference, &p.at)[0];
                let g: f64 = slopes.iter().map(|v| v * v).sum();
                0.25 * (g + reference.colour[p.cell] * value * value)
            })
            .sum::<f64>()
            / reference.m.iter().sum::<f64>();
        assert!((energy / want - 1.0).abs() < 1e-3, "{eps}: {energy:e} against {want:e}");
    }
}

#[test]
fn other_shapes_and_nan_are_refused() {
    let domain = Domain::unit([20, 20]).unwrap();
    let case = Case::<2, 1>::new(domain, ball(domain, 0.5));
    let other = Samples::zeros(Domain::unit([20, 19]).unwrap());
    let wrong = measure(&case.problem(), &other, None);
    assert!(matches!(wrong, Err(poisson_loss::Error::Shape { .. })));
    let mut broken = case.background.clone();
    broken.plane_mut(0)[19 * 20 + 3] = f32::NAN;
    let wrong = measure(&case.problem(), &broken, None);
    let Err(poisson_loss::Error::NotFinite { signal: "result", index, .. }) = wrong else {
        panic!("NaN was accepted");
    };
    assert_eq!(index, [3, 19]);
}
