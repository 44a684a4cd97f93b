//! The baselines against dense direct solves in f64, written link by link from their definitions.

use std::sync::Arc;

use inr_core::{Domain, RasterMask, Region, Samples, Unit};
use nalgebra::{DMatrix, DVector};
use poisson_loss::{
    Baseline, Error, Guidance, Options, Patch, Problem, Strongest, measure, solve, solve_baseline,
};

/// What a visible difference is far above: f32 rounding of values of order one gives 1e-6.
const TOLERANCE: f64 = 1e-5;

/// Repeatable numbers in [0, 1): Knuth's MMIX generator, upper bits.
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678;
    move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

fn random<const D: usize, const C: usize>(domain: Domain<D>, seed: u64) -> Samples<D, C> {
    let mut next = noise(seed);
    Samples::from_fn(domain, |_| std::array::from_fn(|_| next()))
}

/// Two components, a hole in one, the other on the border; `soft` adds fractions.
fn topology<const D: usize>(domain: Domain<D>, soft: bool) -> RasterMask<D> {
    let mut next = noise(9);
    let n = domain.shape();
    let weights = (0..domain.len())
        .map(|k| {
            let i = domain.unflatten(k);
            let u: [f64; D] = std::array::from_fn(|d| (i[d] as f64 + 0.5) / n[d] as f64);
            let on_border = u[0] < 0.2 && u[D - 1] > 0.3;
            let block = (0..D).all(|d| u[d] > 0.35 && u[d] < 0.9);
            let hole = (0..D).all(|d| (u[d] - 0.62).abs() < 0.1);
            match (on_border || block && !hole, soft) {
                (false, _) => 0.0,
                (true, false) => 1.0,
                (true, true) => (0.2 + next()).min(1.0),
            }
        })
        .collect();
    RasterMask::new(domain, weights).unwrap()
}

struct Case<const D: usize, const C: usize> {
    background: Samples<D, C>,
    patch: Samples<D, C>,
    region: RasterMask<D>,
    guidance: Guidance<D, C>,
}

/// A link: its ends, its axis and what each channel should differ by (from `i` to `j`).
struct Link<const C: usize> {
    i: usize,
    j: usize,
    alpha: f64,
    v: [f64; C],
    s: [f64; C],
}

impl<const D: usize, const C: usize> Case<D, C> {
    fn new(domain: Domain<D>, soft: bool, guidance: Guidance<D, C>) -> Self {
        Self {
            background: random(domain, 1),
            patch: random(domain, 2),
            region: topology(domain, soft),
            guidance,
        }
    }

    fn domain(&self) -> Domain<D> {
        *self.background.domain()
    }

    fn problem(&self) -> Problem<'_, D, C> {
        Problem {
            background: &self.background,
            patch: Patch::Samples { samples: &self.patch, offset: [0.0; D] },
            region: &self.region,
            guidance: self.guidance.clone(),
            options: Options::default(),
        }
    }

    fn weights(&self) -> Vec<f64> {
        let domain = self.domain();
        (0..domain.len())
            .map(|k| f64::from(self.region.weight(&domain.position(domain.unflatten(k)))))
            .collect()
    }

    fn links(&self) -> Vec<Link<C>> {
        let domain = self.domain();
        let (shape, strides, pitch) = (domain.shape(), domain.strides(), domain.pitch());
        let h = f64::from(domain.reference_pitch());
        let mut links = Vec::new();
        for i in 0..domain.len() {
            for d in 0..D {
                if domain.unflatten(i)[d] + 1 == shape[d] {
                    continue;
                }
                let j = i + strides[d];
                let along = |f: &Samples<D, C>| -> [f64; C] {
                    std::array::from_fn(|c| f64::from(f.plane(c)[j]) - f64::from(f.plane(c)[i]))
                };
                let (s, t) = (along(&self.background), along(&self.patch));
                let square = |v: &[f64; C]| v.iter().map(|v| v * v).sum::<f64>();
                let v = match &self.guidance {
                    Guidance::Patch => t,
                    Guidance::Strongest(Strongest::Joint) => {
                        if square(&t) >= square(&s) {
                            t
                        } else {
                            s
                        }
                    }
                    Guidance::Strongest(_) => {
                        std::array::from_fn(|c| if t[c].abs() >= s[c].abs() { t[c] } else { s[c] })
                    }
                    Guidance::Mix { mu, phi } => {
                        std::array::from_fn(|c| f64::from(*mu) * s[c] + f64::from(*phi) * t[c])
                    }
                    Guidance::Monochrome => [t.iter().sum::<f64>() / C as f64; C],
                    // The field of `custom_field` at the midpoint.
                    Guidance::Custom(_) => std::array::from_fn(|c| {
                        let at = domain.unflatten(i);
                        let x = f64::from(domain.origin()[d])
                            + (at[d] as f64 + 0.5) * f64::from(pitch[d]);
                        (c as f64 + 1.0) * 0.1 * (3.0 * x).sin() * f64::from(pitch[d]) / h
                    }),
                };
                links.push(Link { i, j, alpha: (h / f64::from(pitch[d])).powi(2), v, s });
            }
        }
        links
    }

    /// Solves `sum alpha w (c_j - c_i - target)^2 + sum s (c - c_S)^2` for one channel, with some
    /// samples fixed to the background.
    fn dense(
        &self,
        c: usize,
        link: impl Fn(&Link<C>) -> (f64, f64),
        screening: &[f64],
        fixed: &[bool],
    ) -> Vec<f64> {
        let n = self.domain().len();
        let s: Vec<f64> = self.background.plane(c).iter().map(|v| f64::from(*v)).collect();
        let (mut a, mut b) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        for l in self.links() {
            let (w, target) = link(&l);
            let w = w * l.alpha;
            for (p, q, sign) in [(l.i, l.j, -1.0), (l.j, l.i, 1.0)] {
                a[(p, p)] += w;
                a[(p, q)] -= w;
                b[p] += sign * w * target;
            }
        }
        for k in 0..n {
            a[(k, k)] += screening[k];
            b[k] += screening[k] * s[k];
        }
        for k in (0..n).filter(|k| fixed[*k]) {
            a.row_mut(k).fill(0.0);
            a[(k, k)] = 1.0;
            b[k] = s[k];
        }
        a.lu().solve(&b).expect("a regular matrix").iter().copied().collect()
    }

    fn compare(&self, name: &str, baseline: Baseline, want: impl Fn(usize) -> Vec<f64>) {
        let blend = solve_baseline(&self.problem(), baseline).unwrap();
        for c in 0..C {
            for (k, (got, want)) in blend.samples.plane(c).iter().zip(want(c)).enumerate() {
                let error = (f64::from(*got) - want).abs();
                assert!(
                    error < TOLERANCE,
                    "{name}, {baseline:?}, channel {c}, sample {:?}: {got} against {want}",
                    self.domain().unflatten(k)
                );
            }
        }
        println!("{name}, {baseline:?}: {} iterations", blend.report.iterations);
    }

    fn check(&self, name: &str) {
        let (m, n) = (self.weights(), self.domain().len());
        let total: f64 = m.iter().sum();
        let outside: Vec<bool> = m.iter().map(|m| *m < 0.5).collect();
        self.compare(name, Baseline::Pie, |c| {
            self.dense(c, |l| (1.0, l.v[c]), &vec![0.0; n], &outside)
        });
        let lambda = 3.0f32;
        self.compare(name, Baseline::PaperLinks { lambda }, |c| {
            let screening: Vec<f64> = m
                .iter()
                .map(|m| f64::from(lambda) * total / (n as f64 - total) * (1.0 - m))
                .collect();
            self.dense(c, |l| (0.5 * (m[l.i] + m[l.j]), l.v[c]), &screening, &vec![false; n])
        });
        self.compare(name, Baseline::Neumann, |c| {
            // One sample fixed removes the constant, which is then chosen by the mean outside.
            let fixed: Vec<bool> = (0..n).map(|k| k == n / 2).collect();
            let target = |l: &Link<C>| {
                let w = 0.5 * (m[l.i] + m[l.j]);
                (1.0, l.s[c] + w * (l.v[c] - l.s[c]))
            };
            let free = self.dense(c, target, &vec![0.0; n], &fixed);
            let s = self.background.plane(c);
            let shift = (0..n).map(|k| (1.0 - m[k]) * (free[k] - f64::from(s[k]))).sum::<f64>()
                / (n as f64 - total);
            free.iter().map(|v| v - shift).collect()
        });
    }
}

/// `v[c][d] = (c + 1) / 10 sin(3 x_d)`, a function of position alone.
fn custom_field<const D: usize, const C: usize>() -> Guidance<D, C> {
    Guidance::Custom(Arc::new(|x, _, _| {
        std::array::from_fn(|c| {
            std::array::from_fn(|d| (c as f32 + 1.0) * 0.1 * (3.0 * x[d]).sin())
        })
    }))
}

fn dense_solves<const D: usize>(shape: [usize; D]) {
    let mut pitch = [1.0; D];
    pitch[D - 1] = 1.7;
    for domain in [
        Domain::unit(shape).unwrap(),
        Domain::new(shape, pitch, [2.5; D], Unit::Millimetre).unwrap(),
    ] {
        for soft in [false, true] {
            for guidance in [
                Guidance::<D, 2>::Patch,
                Guidance::Strongest(Strongest::Joint),
                Guidance::Strongest(Strongest::PerChannel),
                Guidance::Strongest(Strongest::PerComponent),
                Guidance::SUM,
                Guidance::Mix { mu: 0.3, phi: 0.8 },
                Guidance::Monochrome,
                custom_field(),
            ] {
                let name = format!("{shape:?}, soft {soft}, {guidance:?}");
                Case::new(domain, soft, guidance).check(&name);
            }
        }
    }
}

#[test]
fn links_match_dense_solves_in_one_dimension() {
    dense_solves([57]);
}

#[test]
fn links_match_dense_solves_in_two_dimensions() {
    dense_solves([19, 14]);
}

#[test]
fn links_match_dense_solves_in_three_dimensions() {
    dense_solves([7, 8, 6]);
}

#[test]
fn a_box_cut_out_of_a_larger_signal_matches_too() {
    let domain = Domain::unit([61, 8]).unwrap();
    let weights =
        (0..domain.len()).map(|k| f32::from((25..34).contains(&(k % 61)) && k / 61 > 2)).collect();
    let mut case = Case::<2, 1>::new(domain, false, Guidance::Patch);
    case.region = RasterMask::new(domain, weights).unwrap();
    case.check("cut box");
}

#[test]
fn outside_is_the_background_bit_for_bit_and_constants_change_nothing() {
    let domain = Domain::unit([40, 33]).unwrap();
    let mut case = Case::<2, 3>::new(domain, false, Guidance::Patch);
    case.background.plane_mut(1)[5] = -0.0;
    let weights = case.weights();
    for baseline in [Baseline::Pie, Baseline::Neumann, Baseline::PaperLinks { lambda: 2.0 }] {
        let before = solve_baseline(&case.problem(), baseline).unwrap().samples;
        if baseline == Baseline::Pie {
            for c in 0..3 {
                for (k, m) in weights.iter().enumerate().filter(|(_, m)| **m < 0.5) {
                    let (got, want) = (before.plane(c)[k], case.background.plane(c)[k]);
                    assert_eq!(got.to_bits(), want.to_bits(), "weight {m}");
                }
            }
        }
        let mut shifted = case.problem();
        let mut patch = case.patch.clone();
        patch.as_planar_mut().iter_mut().for_each(|v| *v += 0.75);
        shifted.patch = Patch::Samples { samples: &patch, offset: [0.0; 2] };
        let after = solve_baseline(&shifted, baseline).unwrap().samples;
        for (a, b) in before.as_planar().iter().zip(after.as_planar()) {
            assert!(f64::from((a - b).abs()) < TOLERANCE, "{baseline:?}: {a} against {b}");
        }
    }
}

#[test]
fn neumann_residual_is_rounding_and_the_mean_outside_stays() {
    let case = Case::<3, 2>::new(Domain::unit([21, 16, 9]).unwrap(), true, Guidance::SUM);
    let blend = solve_baseline(&case.problem(), Baseline::Neumann).unwrap();
    // f64 throughout: 1e-13 observed, a right-hand side in f32 whose sum is 1e-9 off.
    assert!(blend.report.residual < 1e-7, "{:e}", blend.report.residual);
    let m = case.weights();
    for c in 0..2 {
        let mean = |f: &Samples<3, 2>| {
            let weighted = f.plane(c).iter().zip(&m).map(|(v, m)| (1.0 - m) * f64::from(*v));
            weighted.sum::<f64>() / m.iter().map(|m| 1.0 - m).sum::<f64>()
        };
        let (got, want) = (mean(&blend.samples), mean(&case.background));
        assert!((got - want).abs() < 1e-6, "{got} against {want}");
    }
}

#[test]
fn results_and_their_metrics_do_not_depend_on_the_threads() {
    let domain = Domain::unit([211, 390]).unwrap();
    let case = Case::<2, 2>::new(domain, true, Guidance::Strongest(Strongest::Joint));
    for baseline in [Baseline::Pie, Baseline::Neumann, Baseline::PaperLinks { lambda: 1.0 }] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let blend = solve_baseline(&case.problem(), baseline).unwrap();
                let exact = solve(&case.problem()).unwrap().samples;
                let metrics = measure(&case.problem(), &blend.samples, Some(&exact)).unwrap();
                (blend, metrics)
            })
        };
        assert_eq!(with(1), with(3), "{baseline:?}");
    }
}

#[test]
fn regions_without_an_outside_are_refused() {
    let domain = Domain::unit([9, 9]).unwrap();
    let mut case = Case::<2, 1>::new(domain, false, Guidance::Patch);
    case.region = RasterMask::new(domain, vec![1.0; 81]).unwrap();
    for baseline in [Baseline::Pie, Baseline::Neumann, Baseline::PaperLinks { lambda: 1.0 }] {
        assert_eq!(solve_baseline(&case.problem(), baseline), Err(Error::NoAnchor), "{baseline:?}");
    }
    assert!(solve_baseline(&case.problem(), Baseline::Paste).is_ok());
    case.region = RasterMask::new(domain, vec![0.25; 81]).unwrap();
    assert_eq!(solve_baseline(&case.problem(), Baseline::Pie), Err(Error::EmptyRegion));
    let wrong = solve_baseline(&case.problem(), Baseline::PaperLinks { lambda: f32::NAN });
    assert!(matches!(wrong, Err(Error::Parameter { name: "lambda", .. })));
}
