//! A field over position and direction, the kind a renderer asks: fitted, blended and seen on a plane, against its
//! formula and against the f64 reference.

use std::f32::consts::PI;

use inr_core::{
    Architecture, Domain, Ellipsoid, Field, FitOptions, Frame, Network, Output, Samples, Spline,
    TrainOptions, Trainer, Unit, fit,
};
use npsolve_tests::measured::jet;
use npsolve_tests::oracle::{Case, coefficients_of};
use npsolve_tests::reference;
use npsolve_tests::signals::{ball, textured};
use poisson_loss::{
    Guidance, NeuralOptions, Options, Patch, Problem, neural_box, solve, train_blend,
};

/// What the patch is brighter by: nothing of it may be left in a blend.
const OFFSET: f32 = 0.2;

/// Samples per axis: three of position, two of direction.
const SHAPE: [usize; 5] = [7, 7, 7, 6, 6];

fn lattice() -> Domain<5> {
    let pitch = [0.4, 0.4, 0.4, 0.35, 0.35];
    let origin = [-1.2, -1.2, -1.2, -0.9, -0.9];
    Domain::new(SHAPE, pitch, origin, Unit::Millimetre).expect("a valid lattice")
}

/// Brightness at a position (millimetres) from a direction (radians): shading, and light that moves with the eye. Half
/// waves from the first sample to the last: a spline mirrors its samples there, and the truth has to as well.
fn radiance(x: [f32; 5]) -> f32 {
    let index = lattice().to_index(&x);
    let [x, y, z, polar, azimuth]: [f32; 5] =
        std::array::from_fn(|d| (PI * index[d] / (SHAPE[d] - 1) as f32).cos());
    0.4 + 0.1 * x * y + 0.1 * z + 0.1 * polar * x + 0.08 * azimuth * y * z
}

/// A ball in space, from every direction.
fn region() -> Ellipsoid<5> {
    Ellipsoid::new([0.0; 5], [0.75, 0.75, 0.75, 50.0, 50.0]).expect("an ellipsoid")
}

/// 24 x 24 points between the samples, on a plane that cuts the region, from one direction.
fn view() -> Vec<[f32; 5]> {
    let at = |k: usize| -0.8 + 1.6 * k as f32 / 23.0;
    (0..576).map(|k| [at(k % 24), at(k / 24), 0.13, 0.21, -0.17]).collect()
}

fn seen(field: &impl Field<5, 1>) -> Vec<[f32; 1]> {
    let x = view();
    let mut y = vec![[0.0]; x.len()];
    field.eval(&x, &mut y);
    y
}

/// Root mean square difference from the formula, raised by something, on the view.
fn rmse(seen: &[[f32; 1]], raised: f32) -> f64 {
    let squares =
        view().into_iter().zip(seen).map(|(x, [y])| f64::from(radiance(x) + raised - y).powi(2));
    (squares.sum::<f64>() / seen.len() as f64).sqrt()
}

/// A sine network trained on the samples of the formula.
fn fitted(raised: f32) -> Network<5, 1> {
    let samples = Samples::from_fn(lattice(), |x| [radiance(x) + raised]);
    let network = Network::new(
        Architecture::siren(32, 2, 3.0),
        Frame::of_cells(&lattice()),
        Output::of_range(0.0, 1.0),
        3,
    );
    let options = TrainOptions { rate: 5e-3, batch: 1024, ..TrainOptions::default() };
    let mut trainer = Trainer::new(network.expect("a valid architecture"), options);
    let limits = FitOptions { steps: 500, budget: None, target_psnr: None, peak: 1.0 };
    fit(&mut trainer, &samples, &limits, |_, _| true).expect("a fit");
    trainer.network
}

fn problem<'a>(
    background: &'a Samples<5, 1>,
    patch: Patch<'a, 5, 1>,
    region: &'a Ellipsoid<5>,
) -> Problem<'a, 5, 1> {
    Problem { background, patch, region, guidance: Guidance::Patch, options: Options::default() }
}

/// The spline through 6 to 7 samples per axis of half waves: 1.3e-5 observed.
const INTERPOLATION: f64 = 1e-4;
/// 500 steps of a small network: 2.5e-3 observed, and 3.3e-3 of the blend.
const FIT: f64 = 0.01;

#[test]
fn a_brighter_copy_leaves_the_background_as_it_is() {
    let background = Samples::from_fn(lattice(), |x| [radiance(x)]);
    let patch = Samples::from_fn(lattice(), |x| [radiance(x) + OFFSET]);
    let region = region();
    let patch = Patch::Samples { samples: &patch, offset: [0.0; 5] };
    let blend = solve(&problem(&background, patch, &region)).expect("a solvable problem");
    let error = rmse(&seen(&blend.to_field()), 0.0);
    println!(
        "exact blend of samples, seen: {error:.1e} after {} iterations",
        blend.report.iterations
    );
    assert!(error < INTERPOLATION, "got {error:e}, expected below {INTERPOLATION:e}");
    let pasted = rmse(&seen(&blend.to_field()), OFFSET);
    assert!(pasted > 0.9 * f64::from(OFFSET), "the view does not show the region: {pasted:e}");
}

/// Networks in, a network out: background and patch are fitted, the blend is trained.
#[test]
fn fitted_fields_blend_into_a_field_that_shows_the_formula() {
    let (bright, region) = (fitted(OFFSET), region());
    let fit_error = rmse(&seen(&bright), OFFSET);
    println!("fit, seen: {fit_error:.1e}");
    assert!(fit_error < FIT, "got {fit_error:e}, expected below {FIT:e}");

    let background = Samples::from_fn(lattice(), |x| [radiance(x)]);
    let problem = problem(&background, Patch::Field { field: &bright, offset: [0.0; 5] }, &region);
    let exact = solve(&problem).expect("a solvable problem");
    let exact_error = rmse(&seen(&exact.to_field()), 0.0);
    println!("exact blend of a network, seen: {exact_error:.1e}");
    assert!(exact_error < 2.0 * FIT, "got {exact_error:e}, expected below {:e}", 2.0 * FIT);

    // The fitted patch is the start: it has the structure already, but not the level.
    let on = neural_box(&problem, &exact);
    let options = TrainOptions { rate: 3e-3, batch: 512, ..TrainOptions::default() };
    let mut trainer = Trainer::new(bright.clone(), options);
    let options = NeuralOptions { steps: 320, ..NeuralOptions::default() };
    train_blend(&problem, &exact, &on, &mut trainer, &options, |_| true).expect("a training");
    let neural_error = rmse(&seen(&trainer.network), 0.0);
    println!("neural blend, seen: {neural_error:.1e}");
    assert!(neural_error < 2.0 * FIT, "got {neural_error:e}, expected below {:e}", 2.0 * FIT);
}

/// f32 evaluation of coefficients that are right to 1e-5: 2e-6 observed.
const REFERENCE: f64 = 1e-5;

#[test]
fn views_of_an_exact_blend_are_those_of_the_reference() {
    let domain = Domain::unit([3; 5]).expect("a valid lattice");
    let (background, patch) = (textured::<5, 1>(domain, 31), textured::<5, 1>(domain, 32));
    let region = ball(domain, 0.9);
    let case = Case {
        background: &background,
        patch: &patch,
        region: &region,
        guidance: Guidance::SUM,
        options: Options::default(),
    };
    let blend = solve(&case.problem()).expect("a solvable problem");
    let field: Spline<5, 1> = blend.to_field();
    let grid = case.lattice();
    let terms = case.terms(&grid, blend.report.length);
    let start = coefficients_of(&background);
    let coefficients = reference::minimise(&grid, &terms[0], &start[0], &[]);
    let x: Vec<[f32; 5]> =
        (0..100).map(|k| [0.2 * (k % 10) as f32, 0.3 * (k / 10) as f32, 0.8, 1.3, 0.6]).collect();
    let mut y = vec![[0.0]; x.len()];
    field.eval(&x, &mut y);
    let worst = x.iter().zip(&y).fold(0.0f64, |worst, (x, [y])| {
        let (want, _) = jet(&domain.shape(), &[1.0; 5], &coefficients, &x.map(f64::from));
        worst.max((f64::from(*y) - want).abs())
    });
    println!("view of the reference: {worst:.1e}");
    assert!(worst < REFERENCE, "got {worst:e}, expected below {REFERENCE:e}");
}
