//! The exact solver against the independent f64 reference: every objective, guidance, border,
//! mask topology and placement.

use inr_core::{Domain, RasterMask, Region, Samples, Translated, Unit};
use npsolve_tests::reference::{self, Lattice, Terms};
use npsolve_tests::signals::{ball, mask, textured};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, Strongest, solve};

/// 1e-5 is what the multigrid solution must reach; 2e-6 observed, mostly f32 rounding of the data.
const TOLERANCE: f64 = 1e-5;

struct Case<'a, const D: usize, const C: usize> {
    background: &'a Samples<D, C>,
    patch: &'a Samples<D, C>,
    region: &'a RasterMask<D>,
    guidance: Guidance<D, C>,
    options: Options,
}

/// The reference's answer, on the same lattice for background, patch and mask.
fn expected<const D: usize, const C: usize>(
    case: &Case<D, C>,
    length: Option<f32>,
) -> Vec<Vec<f64>> {
    let domain = case.background.domain();
    let shape = domain.shape().to_vec();
    let h = f64::from(domain.reference_pitch());
    let pitch: Vec<f64> = domain.pitch().iter().map(|p| f64::from(*p) / h).collect();
    let lattice = Lattice::new(&shape, &pitch);
    let c64 = |s: &Samples<D, C>| -> Vec<Vec<f64>> {
        (0..C)
            .map(|c| {
                reference::coefficients(
                    &shape,
                    &s.plane(c).iter().map(|v| f64::from(*v)).collect::<Vec<_>>(),
                )
            })
            .collect()
    };
    let (s, t) = (c64(case.background), c64(case.patch));
    let m: Vec<f64> = (0..domain.len())
        .map(|k| f64::from(case.region.weight(&domain.position(domain.unflatten(k)))))
        .collect();
    let total: f64 = m.iter().sum();
    let sampled: Vec<Vec<(f64, Vec<f64>, f64, Vec<f64>)>> = lattice
        .points
        .iter()
        .map(|p| {
            (0..C)
                .map(|c| {
                    let ((a, b), (d, e)) = (lattice.jet(p, &s[c]), lattice.jet(p, &t[c]));
                    (a, b, d, e)
                })
                .collect()
        })
        .collect();
    (0..C)
        .map(|c| {
            let terms: Vec<Terms> = lattice
                .points
                .iter()
                .zip(&sampled)
                .map(|(p, jets)| {
                    let w = m[p.cell];
                    let v = follow(&case.guidance, jets, c);
                    let target = (0..D).map(|d| jets[c].1[d] + w * (v[d] - jets[c].1[d])).collect();
                    let (gradient, colour, keep) = match case.options.objective {
                        Objective::Screened { keep, .. } => (
                            1.0,
                            (1.0 - w) * (h / f64::from(length.unwrap())).powi(2),
                            keep.map_or(0.0, |l| w * (h / f64::from(l)).powi(2)),
                        ),
                        Objective::Paper { lambda } => (
                            w,
                            (1.0 - w) * f64::from(lambda) * total / (domain.len() as f64 - total),
                            0.0,
                        ),
                        Objective::Dirichlet => (1.0, 0.0, 0.0),
                    };
                    Terms {
                        gradient: (gradient, target),
                        values: vec![(colour, jets[c].0), (keep, jets[c].2)],
                    }
                })
                .collect();
            let fixed = match case.options.objective {
                Objective::Dirichlet => touching_outside(&lattice, &m),
                _ => Vec::new(),
            };
            reference::nodal(&shape, &reference::minimise(&lattice, &terms, &s[c], &fixed))
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
    jets: &[(f64, Vec<f64>, f64, Vec<f64>)],
    c: usize,
) -> Vec<f64> {
    let norm = |g: &[f64]| g.iter().map(|v| v * v).sum::<f64>();
    let (s, t) = (&jets[c].1, &jets[c].3);
    match guidance {
        Guidance::Patch => t.clone(),
        Guidance::Strongest(Strongest::Joint) => {
            let (a, b): (f64, f64) = jets
                .iter()
                .map(|j| (norm(&j.1), norm(&j.3)))
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
            (0..D).map(|d| (0..C).map(|k| w[k] * jets[k].3[d]).sum()).collect()
        }
        other => panic!("no reference for {other:?}"),
    }
}

fn check<const D: usize, const C: usize>(name: &str, case: &Case<D, C>) {
    let problem = Problem {
        background: case.background,
        patch: Patch::Samples { samples: case.patch, offset: [0.0; D] },
        region: case.region,
        guidance: case.guidance.clone(),
        options: case.options,
    };
    let blend = solve(&problem).unwrap_or_else(|e| panic!("{name}: {e}"));
    let want = expected(case, blend.report.length);
    let mut worst = 0.0f64;
    for c in 0..C {
        for (got, want) in blend.samples.plane(c).iter().zip(&want[c]) {
            worst = worst.max((f64::from(*got) - want).abs());
        }
    }
    println!("{name}: {worst:.2e} after {} iterations", blend.report.iterations);
    assert!(worst < TOLERANCE, "{name}: largest difference {worst:e} against {TOLERANCE:e}");
}

fn screened(length: f32) -> Options {
    Options::with_objective(Objective::Screened { length: Some(length), keep: None })
}

fn every_guidance<const D: usize, const C: usize>() -> Vec<Guidance<D, C>> {
    vec![
        Guidance::Patch,
        Guidance::Strongest(Strongest::Joint),
        Guidance::Strongest(Strongest::PerChannel),
        Guidance::Strongest(Strongest::PerComponent),
        Guidance::SUM,
        Guidance::Mix { mu: 0.3, phi: 0.8 },
        Guidance::Monochrome,
    ]
}

/// All guidance rules and objectives on one lattice.
fn all_on<const D: usize, const C: usize>(name: &str, domain: Domain<D>, region: &RasterMask<D>) {
    let (background, patch) = (textured::<D, C>(domain, 1), textured::<D, C>(domain, 2));
    let case = |guidance, options| Case {
        background: &background,
        patch: &patch,
        region,
        guidance,
        options,
    };
    for guidance in every_guidance::<D, C>() {
        let label = format!("{name}, {guidance:?}");
        check(&label, &case(guidance, screened(2.5)));
    }
    let h = domain.reference_pitch();
    for objective in [
        Objective::Screened { length: None, keep: None },
        Objective::Screened { length: Some(2.0 * h), keep: Some(3.0 * h) },
        Objective::Paper { lambda: 2.0 },
        Objective::Dirichlet,
    ] {
        check(
            &format!("{name}, {objective:?}"),
            &case(Guidance::Patch, Options::with_objective(objective)),
        );
    }
}

#[test]
fn volume_with_natural_borders() {
    let domain = Domain::unit([9, 8, 10]).unwrap();
    all_on::<3, 2>("volume", domain, &ball(domain, 0.75));
}

#[test]
fn image_with_natural_borders() {
    let domain = Domain::unit([28, 23]).unwrap();
    all_on::<2, 3>("image", domain, &ball(domain, 0.6));
}

#[test]
fn image_with_cut_box_of_odd_and_even_sizes() {
    for shape in [[90, 81], [91, 84]] {
        let domain = Domain::unit(shape).unwrap();
        let (background, patch) = (textured::<2, 2>(domain, 3), textured::<2, 2>(domain, 4));
        let region = ball(domain, 0.15);
        for guidance in [Guidance::Patch, Guidance::Strongest(Strongest::Joint)] {
            let case = Case {
                background: &background,
                patch: &patch,
                region: &region,
                guidance,
                options: screened(2.0),
            };
            check(&format!("cut box {shape:?}"), &case);
        }
    }
}

#[test]
fn anisotropic_pitch_in_physical_units() {
    let domain = Domain::new([30, 24], [0.5, 1.7], [3.0, -8.0], Unit::Millimetre).unwrap();
    all_on::<2, 1>("anisotropic", domain, &ball(domain, 0.6));
}

#[test]
fn masks_of_every_topology() {
    let domain = Domain::unit([29, 30]).unwrap();
    let ring = mask(domain, |u| f64::from((0.2..0.6).contains(&(u[0] * u[0] + u[1] * u[1]))));
    let parts =
        mask(domain, |u| f64::from(u[0].abs() > 0.4 && u[0].abs() < 0.9 && u[1].abs() < 0.5));
    let corner = mask(domain, |u| f64::from(u[0] < -0.2 && u[1] > 0.1));
    let soft = mask(domain, |u| (1.2 - 2.0 * (u[0] * u[0] + u[1] * u[1])).clamp(0.0, 1.0));
    let (background, patch) = (textured::<2, 2>(domain, 5), textured::<2, 2>(domain, 6));
    for (name, region) in [("ring", ring), ("two parts", parts), ("corner", corner), ("soft", soft)]
    {
        for guidance in [Guidance::Patch, Guidance::Strongest(Strongest::Joint), Guidance::SUM] {
            let case = Case {
                background: &background,
                patch: &patch,
                region: &region,
                guidance,
                options: screened(2.0),
            };
            check(name, &case);
        }
    }
}

#[test]
fn sub_pixel_and_field_patches_use_the_continuous_patch() {
    // A patch that is a spline itself, placed by half samples: the same field sampled finely and
    // whole must give the same blend as the field handed over directly.
    let domain = Domain::unit([40, 36]).unwrap();
    let background = textured::<2, 1>(domain, 7);
    let patch = textured::<2, 1>(Domain::unit([20, 18]).unwrap(), 8);
    let region = Translated { region: ball(*patch.domain(), 0.7), offset: [9.5, 8.25] };
    let field = inr_core::Spline::interpolate(&patch);
    let problem = |patch| Problem {
        background: &background,
        patch,
        region: &region,
        guidance: Guidance::Patch,
        options: screened(2.0),
    };
    let offset = [9.5, 8.25];
    let a = solve(&problem(Patch::Samples { samples: &patch, offset })).unwrap();
    let b = solve(&problem(Patch::Field { field: &field, offset })).unwrap();
    assert_eq!(a.samples, b.samples);
    assert!(a.samples != background);
}

#[test]
fn audio_is_solved_directly() {
    for n in [5, 60, 400] {
        let domain = Domain::new([n], [1.0 / 16.0], [0.25], Unit::Second).unwrap();
        let cut = mask(domain, |u| f64::from((-0.1..0.12).contains(&u[0])));
        let touching = mask(domain, |u| f64::from(u[0] < 0.2));
        for region in [cut, touching] {
            let (background, patch) = (textured::<1, 2>(domain, 9), textured::<1, 2>(domain, 10));
            for guidance in every_guidance::<1, 2>() {
                let options = screened(0.25);
                let case = Case { background: &background, patch: &patch, region: &region, guidance, options };
                check(&format!("audio {n}"), &case);
            }
            for objective in [Objective::Paper { lambda: 2.0 }, Objective::Dirichlet] {
                let options = Options::with_objective(objective);
                let guidance = Guidance::Patch;
                let case = Case { background: &background, patch: &patch, region: &region, guidance, options };
                check(&format!("audio {n} {objective:?}"), &case);
            }
        }
    }
}
