//! Laws of the minimum: its energy, its limits, its closed form, and what it costs to find.

use inr_core::{BoxRegion, Domain, RasterMask, Samples, Unit};
use npsolve_tests::oracle::coefficients_of;
use npsolve_tests::random::{Pair, rules, screened};
use npsolve_tests::reference;
use npsolve_tests::signals::{Random, ball, mask, textured};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, solve};

/// The gradient of the energy at the solver's result, seen along a random direction and relative
/// to that direction's own energy; 4e-6 observed, from f32 samples and the stopping rule.
const ENERGY_IDENTITY: f64 = 5e-5;

/// `E(f) - E(f*) = |f - f*|_A^2`, with energies and norm by the f64 reference.
fn energy_is_a_square_around_the_minimum<const D: usize, const C: usize>() {
    // The reference keeps every basis function at every point: 1024 at each in five dimensions.
    let sizes = [[45, 90], [20, 40], [8, 16], [4, 5], [3, 3]][D - 1];
    for seed in 0..4 {
        let pair = Pair::<D, C>::random_of(seed, sizes);
        for guidance in rules() {
            let case = pair.case(guidance, screened(2.0));
            let blend = solve(&case.problem()).expect("a solvable problem");
            let lattice = case.lattice();
            let best = coefficients_of(&blend.samples);
            let mut random = Random::new(seed + 77);
            let terms = case.terms(&lattice, blend.report.length);
            for c in 0..C {
                let change: Vec<f64> =
                    best[c].iter().map(|_| 0.05 * (random.unit() - 0.5)).collect();
                let moved: Vec<f64> = best[c].iter().zip(&change).map(|(a, b)| a + b).collect();
                let mut homogeneous = terms[c].clone();
                for t in &mut homogeneous {
                    t.gradient.1.fill(0.0);
                    t.values.iter_mut().for_each(|v| v.1 = 0.0);
                }
                let gain = reference::energy(&lattice, &moved, &terms[c])
                    - reference::energy(&lattice, &best[c], &terms[c]);
                let square = reference::energy(&lattice, &change, &homogeneous);
                let error = (gain / square - 1.0).abs();
                println!("energy identity, D = {D}: {error:.1e}");
                assert!(
                    error < ENERGY_IDENTITY,
                    "D = {D}, seed {seed}: got {gain:e}, expected {square:e}, error {error:e}"
                );
            }
        }
    }
}

/// At the shortest length in one dimension, where the solver is direct in f64.
const NEAR_DIRICHLET: f64 = 4e-3;

/// As `l` goes to 0 the background's values become fixed, in the same spline space. The last
/// coefficient that a point outside sees has weight `(1/4)^3 / 6` there: it stays free until
/// `l` is below a thousandth of a pitch, so the limit itself is only reached in f64.
fn short_lengths_tend_to_fixed_values<const D: usize, const C: usize>() {
    let sizes = [[45, 90], [20, 40], [8, 16], [6, 7], [4, 5]][D - 1];
    for seed in 10..if D < 4 { 14 } else { 12 } {
        let pair = Pair::<D, C>::random_of(seed, sizes);
        let h = pair.background.domain().reference_pitch();
        let fixed = pair.blend(Guidance::Patch, Options::with_objective(Objective::Dirichlet));
        let shortest = if D == 1 { 1e-6 } else { 0.03 };
        let distance = [1.0, 0.3, 0.1, 0.03, shortest].map(|l| {
            let blend = pair.blend(Guidance::Patch, screened(l * h));
            let difference = blend.as_planar().iter().zip(fixed.as_planar());
            difference.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
        });
        println!("l -> 0, D = {D}, seed {seed}: {distance:?}");
        assert!(
            distance.is_sorted_by(|a, b| a >= b) && (D > 1 || distance[4] < NEAR_DIRICHLET),
            "D = {D}, seed {seed}: got distances {distance:?}, expected a fall"
        );
    }
}

/// Share of the background's range by which the inside may leave it. The Laplace equation has no
/// interior extremum; the cubic spline rings by a few percent of the slope's jump at the edge.
const OVERSHOOT: f64 = 0.02;

/// Waves at least 20 samples long: what a spline interpolates without ringing.
fn smooth<const D: usize, const C: usize>(domain: Domain<D>) -> Samples<D, C> {
    Samples::from_fn(domain, |x| {
        std::array::from_fn(|c| {
            let wave = |d: usize| (0.3 * x[d] + c as f32 + 2.0 * d as f32).sin();
            0.5 + (0..D).map(|d| 0.4 / D as f32 * wave(d)).sum::<f32>()
        })
    })
}

/// With `v = 0` the inside is a membrane: its values stay in the range of what surrounds it.
fn membranes_have_no_new_extremum<const D: usize, const C: usize>() {
    for seed in 20..26 {
        let mut pair = Pair::<D, C>::random(seed);
        pair.background = smooth(*pair.background.domain());
        for options in [screened(2.0), Options::with_objective(Objective::Dirichlet)] {
            let blend = pair.blend(Guidance::Mix { mu: 0.0, phi: 0.0 }, options);
            for c in 0..C {
                // With fixed values the coefficients that a point outside sees keep the background
                // two samples deep.
                let depth = -2.5 * pair.background.domain().pitch().into_iter().fold(0.0, f32::max);
                let distances = pair.region.signed_distances();
                let range = |samples: &Samples<D, C>, at: &dyn Fn(f32) -> bool| {
                    let values = samples.plane(c).iter().zip(distances);
                    values
                        .filter(|(_, d)| at(**d))
                        .map(|(v, _)| f64::from(*v))
                        .fold((f64::INFINITY, f64::NEG_INFINITY), |r, v| (r.0.min(v), r.1.max(v)))
                };
                let (lo, hi) = range(&pair.background, &|d| d > depth);
                let (low, high) = range(&blend, &|d| d < 0.0);
                let over = (lo - low).max(high - hi) / (hi - lo);
                println!("membrane, D = {D}: {over:.3}");
                assert!(
                    over < OVERSHOOT,
                    "D = {D}, seed {seed}, {:?}: got {low}..{high}, expected {lo}..{hi}",
                    options.objective
                );
            }
        }
    }
}

/// Least observed order of convergence to the closed form; the solution has a kink at the
/// region's edge, which lies between two knots: order 1.5 in the root mean square is what
/// continuous-slope splines can have there.
const CLOSED_FORM_ORDER: f64 = 1.4;

/// A slope `k` pasted on `[a, b]` into silence. Inside `c'' = 0`, outside `c = c(b) exp(-d/l)`,
/// and `c' - v` is continuous: `c' = k / (1 + (b - a) / (2 l))` inside, odd about the middle.
#[test]
fn ramp_into_silence_has_closed_form() {
    let (extent, a, b, length, slope) = (32.0f64, 14.0, 17.0, 0.8, 1.5);
    let inside = slope / (1.0 + (b - a) / (2.0 * length));
    let exact = |x: f64| {
        let from_middle = x - 0.5 * (a + b);
        let edge = 0.5 * (b - a);
        let beyond = (from_middle.abs() - edge).max(0.0);
        from_middle.clamp(-edge, edge) * inside * (-beyond / length).exp()
    };
    let error = [128, 256, 512, 1024].map(|n| {
        let pitch = extent / n as f64;
        let domain = Domain::new([n], [pitch as f32], [0.5 * pitch as f32], Unit::Second)
            .expect("a valid lattice");
        let background = Samples::<1, 1>::zeros(domain);
        let patch = Samples::from_fn(domain, |[x]| [(slope * f64::from(x)) as f32]);
        let region = BoxRegion::new([a as f32], [b as f32]).expect("a box");
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [0.0] },
            region: &region,
            guidance: Guidance::Patch,
            options: screened(length as f32),
        };
        let blend = solve(&problem).expect("a solvable problem");
        let square: f64 = (0..n)
            .map(|i| {
                let x = (i as f64 + 0.5) * pitch;
                (f64::from(blend.samples.plane(0)[i]) - exact(x)).powi(2) * pitch
            })
            .sum();
        square.sqrt()
    });
    let order: Vec<f64> = error.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    println!("closed form: errors {error:?}, orders {order:.2?}");
    assert!(
        order.iter().all(|o| *o > CLOSED_FORM_ORDER),
        "got errors {error:?} of orders {order:?}, expected above {CLOSED_FORM_ORDER}"
    );
}

/// Iterations to 1e-6: measured bounds of the multigrid, which do not grow with the size.
const ITERATIONS_IMAGE: usize = 12;
const ITERATIONS_VOLUME: usize = 22;
const ITERATIONS_LIGHT_FIELD: usize = 22;
const ITERATIONS_RADIANCE: usize = 26;

fn iterations<const D: usize>(domain: Domain<D>, region: RasterMask<D>, length: f32) -> usize {
    let pair = Pair::<D, 1> { background: textured(domain, 1), patch: textured(domain, 2), region };
    let blend = solve(&pair.case(Guidance::Patch, screened(length)).problem());
    blend.expect("a solvable problem").report.iterations
}

fn regions<const D: usize>(domain: Domain<D>) -> [(&'static str, RasterMask<D>); 4] {
    let most = |u: [f64; D]| u.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    [
        ("disc", ball(domain, 0.6)),
        ("box", mask(domain, |u| f64::from(most(u) < 0.55))),
        ("corner", mask(domain, |u| f64::from(u.iter().all(|v| *v < 0.2)))),
        (
            "cut disc",
            mask(domain, |mut u| {
                u[0] += 0.7;
                f64::from(u.iter().map(|v| v * v).sum::<f64>() < 0.5)
            }),
        ),
    ]
}

fn iterations_stay_below<const D: usize>(most: usize, shapes: &[[usize; D]]) {
    let mut worst = 0;
    for shape in shapes {
        let domain = Domain::unit(*shape).expect("a valid lattice");
        for (name, region) in regions(domain) {
            let counts = [2.0, 4.0, 8.0, 16.0].map(|l| iterations(domain, region.clone(), l));
            println!("{name} {shape:?}: {counts:?} iterations at l = 2, 4, 8, 16");
            worst = worst.max(*counts.iter().max().expect("four counts"));
            assert!(
                counts.iter().all(|n| *n <= most),
                "{name} {shape:?}: got {counts:?} iterations, expected at most {most}"
            );
        }
    }
    println!("D = {D}: at most {worst} iterations");
}

#[test]
fn iterations_image() {
    let shapes = [33, 48, 64, 65, 97, 128, 129, 200, 256, 257].map(|n| [n, n]);
    iterations_stay_below(ITERATIONS_IMAGE, &shapes);
    iterations_stay_below(ITERATIONS_IMAGE, &[[64, 200], [257, 65]]);
}

#[test]
fn iterations_volume() {
    iterations_stay_below(ITERATIONS_VOLUME, &[[24; 3], [33; 3], [40; 3], [48, 31, 36]]);
}

#[test]
fn iterations_light_field() {
    iterations_stay_below(ITERATIONS_LIGHT_FIELD, &[[8; 4], [10, 8, 9, 9]]);
}

#[test]
fn iterations_radiance() {
    iterations_stay_below(ITERATIONS_RADIANCE, &[[5; 5], [6, 4, 5, 5, 5]]);
}

in_every_dimension! {
    energy_is_a_square_around_the_minimum;
    short_lengths_tend_to_fixed_values;
    membranes_have_no_new_extremum;
}
