//! The exact solver against the independent f64 reference: every objective, guidance, border,
//! mask topology and placement.

use inr_core::{Domain, RasterMask, Translated, Unit};
use npsolve_tests::oracle::{Case, expected};
use npsolve_tests::signals::{ball, mask, textured};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, Strongest, solve};

/// 1e-5 is what the multigrid solution must reach; 2e-6 observed, mostly f32 rounding of the data.
const TOLERANCE: f64 = 1e-5;
/// The paper's objective has nothing but values outside, whose condition in splines grows ninefold per axis: in five
/// dimensions the residual of 1e-6 leaves more. 1.2e-4 observed.
const PAPER_RADIANCE: f64 = 5e-4;

fn check<const D: usize, const C: usize>(name: &str, case: &Case<D, C>) {
    let blend = solve(&case.problem()).unwrap_or_else(|e| panic!("{name}: {e}"));
    let want = expected(case, blend.report.length);
    let mut worst = 0.0f64;
    for c in 0..C {
        for (got, want) in blend.samples.plane(c).iter().zip(&want[c]) {
            worst = worst.max((f64::from(*got) - want).abs());
        }
    }
    println!("{name}: {worst:.2e} after {} iterations", blend.report.iterations);
    let paper = matches!(case.options.objective, Objective::Paper { .. });
    let tolerance = if D == 5 && paper { PAPER_RADIANCE } else { TOLERANCE };
    assert!(worst < tolerance, "{name}: largest difference {worst:e} against {tolerance:e}");
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

/// The reference sums over all pairs of 256 basis functions at every point: no more samples than keep that short.
#[test]
fn light_field_with_natural_borders() {
    let domain = Domain::unit([5, 4, 4, 4]).unwrap();
    all_on::<4, 1>("light field", domain, &ball(domain, 0.9));
}

/// As many pairs as three samples per axis leave; positions and directions have scales of their own.
#[test]
fn radiance_with_natural_borders() {
    let pitch = [1.0, 0.8, 1.1, 2.0, 2.5];
    let domain = Domain::new([3, 3, 3, 4, 3], pitch, [0.0; 5], Unit::Sample).unwrap();
    all_on::<5, 1>("radiance", domain, &ball(domain, 0.9));
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
fn dirichlet_slabs_across_every_axis() {
    fn slab<const D: usize>(shape: [usize; D], axis: usize, above: bool) {
        let domain = Domain::unit(shape).unwrap();
        let region = mask(domain, |u| f64::from((u[axis] > 0.1) == above));
        let (background, patch) = (textured::<D, 1>(domain, 1), textured::<D, 1>(domain, 2));
        let case = Case {
            background: &background,
            patch: &patch,
            region: &region,
            guidance: Guidance::Patch,
            options: Options::with_objective(Objective::Dirichlet),
        };
        check(&format!("slab of {shape:?} across axis {axis}, above: {above}"), &case);
    }
    for above in [false, true] {
        (0..2).for_each(|axis| slab([28, 23], axis, above));
        (0..3).for_each(|axis| slab([9, 10, 11], axis, above));
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
                let case = Case {
                    background: &background,
                    patch: &patch,
                    region: &region,
                    guidance,
                    options,
                };
                check(&format!("audio {n}"), &case);
            }
            for objective in [Objective::Paper { lambda: 2.0 }, Objective::Dirichlet] {
                let options = Options::with_objective(objective);
                let guidance = Guidance::Patch;
                let case = Case {
                    background: &background,
                    patch: &patch,
                    region: &region,
                    guidance,
                    options,
                };
                check(&format!("audio {n} {objective:?}"), &case);
            }
        }
    }
}
