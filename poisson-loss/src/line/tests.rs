//! Pieces of a line against the whole matrix at once.

use inr_core::{BoxRegion, Domain, RasterMask, Samples};

use super::*;
use crate::{Guidance, Objective, Options, Strongest, banded};

/// Rounding of first guess, piece and sum to f32, for values of order one.
const TOLERANCE: f32 = 1e-6;

fn wave(domain: Domain<1>, frequency: f32) -> Samples<1, 2> {
    let at = |x: f32| (frequency * x).sin() * (0.3 * frequency * x).cos();
    Samples::from_fn(domain, |[x]| [0.5 + 0.3 * at(x), 0.4 - 0.2 * at(1.7 * x)])
}

fn every_guidance() -> [Guidance<1, 2>; 4] {
    let strongest = Guidance::Strongest(Strongest::Joint);
    [Guidance::Patch, Guidance::SUM, strongest, Guidance::Monochrome]
}

fn every_option() -> Vec<Options> {
    let screened = |keep| Options::with_objective(Objective::Screened { length: Some(6.0), keep });
    let mut faded = screened(None);
    (faded.feather, faded.ramp, faded.band) = (9.0, true, true);
    vec![
        screened(None),
        screened(Some(30.0)),
        faded,
        Options::with_objective(Objective::Paper { lambda: 3.0 }),
        Options::with_objective(Objective::Dirichlet),
    ]
}

/// `n` samples of a patch whose region begins at `first` and has `len` samples, soft at its edges.
fn check(n: usize, first: usize, len: usize) {
    let domain = Domain::<1>::unit([n]).unwrap();
    let (background, patch) = (wave(domain, 0.031), wave(domain, 0.047));
    let soft = |k: usize| if k == first || k + 1 == first + len { 0.5 } else { 1.0 };
    let weights =
        (0..n).map(|k| if (first..first + len).contains(&k) { soft(k) } else { 0.0 }).collect();
    let region = RasterMask::new(domain, weights).unwrap();
    for options in every_option() {
        for guidance in every_guidance() {
            let patch = Patch::Samples { samples: &patch, offset: [0.0] };
            let background = &background;
            let problem = Problem { background, patch, region: &region, guidance, options };
            let plan = Plan::new(&problem).unwrap();
            let (want, _) = banded::solve(&problem, &plan).unwrap();
            let (got, residual) = solve(&problem, &plan).unwrap();
            assert!(residual < 1e-9, "{options:?}: residual {residual}");
            for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
                let error = (got - want).abs();
                let what = (n, first, len, &problem.guidance, options);
                assert!(error < TOLERANCE, "{what:?}: got {got}, expected {want}");
            }
        }
    }
}

#[test]
fn pieces_match_the_whole_matrix() {
    check(40, 12, 14);
    check(1500, 0, 700);
    // Ends in a separator and next to one.
    check(2049, 1000, 1040);
    check(2051, 900, 1150);
    check(5000, 1024, 2048);
}

#[test]
fn long_lines_match_the_whole_matrix() {
    let n = 200_000;
    let domain = Domain::<1>::unit([n]).unwrap();
    let (background, patch) = (wave(domain, 0.031), wave(domain, 0.047));
    let problem = Problem {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: [0.0] },
        region: &BoxRegion::new([3000.5], [150_000.5]).unwrap(),
        guidance: Guidance::Strongest(Strongest::PerChannel),
        options: Options::default(),
    };
    let plan = Plan::new(&problem).unwrap();
    let (want, _) = banded::solve(&problem, &plan).unwrap();
    let (got, _) = solve(&problem, &plan).unwrap();
    for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
        // Slopes of either sign add up to about 30.
        assert!((got - want).abs() < 30.0 * TOLERANCE, "got {got}, expected {want}");
    }
}

/// The region's samples are counted, not measured: far beyond 2^24, where f32 positions are two
/// samples apart, the blend is the same as near the origin.
#[test]
fn blends_far_from_the_origin_have_the_same_bits() {
    const BEFORE: usize = 900;
    const SAMPLES: usize = 3000;
    let blend = |first: usize| -> Vec<f32> {
        let domain = Domain::<1>::unit([first + SAMPLES]).unwrap();
        let mut background = Samples::<1, 1>::zeros(domain);
        for (k, v) in background.plane_mut(0)[first - BEFORE..].iter_mut().enumerate() {
            *v = 0.5 + 0.3 * (0.017 * k as f32).sin();
        }
        let patch =
            Samples::<1, 1>::from_fn(Domain::unit([1201]).unwrap(), |[x]| [(0.1 * x).cos()]);
        let lattice = Domain::new([1201], [1.0], [first as f32], inr_core::Unit::Sample).unwrap();
        let weights = (0..1201).map(|k| f32::from(k > 10 && k < 1191)).collect();
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [first as f32] },
            region: &RasterMask::new(lattice, weights).unwrap(),
            guidance: Guidance::Strongest(Strongest::Joint),
            options: Options::default(),
        };
        let blend = crate::solve(&problem).unwrap();
        let unchanged = &blend.samples.plane(0)[..first - BEFORE];
        assert!(unchanged.iter().all(|v| *v == 0.0));
        blend.samples.plane(0)[first - BEFORE..].to_vec()
    };
    let (near, far) = (blend(1024), blend((1 << 24) + 1024));
    assert!(near == far);
}
