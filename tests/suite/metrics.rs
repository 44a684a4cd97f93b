//! The metrics against an independent evaluation in f64, point by point from their definitions,
//! and the laws that tie them to the exact solution.

use inr_core::{Domain, RasterMask, Samples, Unit};
use npsolve_tests::measured::{Case, Reference, screened};
use npsolve_tests::oracle::coefficients_of;
use npsolve_tests::reference::Lattice;
use npsolve_tests::signals::{ball, mask, textured};
use poisson_loss::{
    Baseline, Guidance, Metrics, Objective, Options, Patch, Strongest, measure, solve,
    solve_baseline,
};

/// Relative; f32 values and slopes at every point give 1e-6 in the sums.
const TOLERANCE: f64 = 2e-5;

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
            let (a, b) = (coefficients_of(&result), coefficients_of(&exact));
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
