//! Blends what is seen at a position from a direction: D = 5, and the patch is a formula instead of samples.
//!
//! `cargo run --release -p npsolve-cli --example 7_blend_radiance_5d`

use std::f32::consts::PI;

use inr_core::{Domain, Ellipsoid, Field, Jet, Samples, Scalar, Unit, gradient};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};

/// What the patch is brighter by.
const BRIGHTER: f64 = 0.25;

/// Light from a surface: x, y, z in millimetres, and two angles in radians, 0 to pi. It is level at both ends of the
/// angles, as the background's spline is at the border of its samples; a patch that is not would tilt the blend there.
fn surface<T: Scalar>([x, y, z, polar, azimuth]: [T; 5]) -> T {
    let c = T::from_f64;
    let shade = (x * c(0.9)).sin() * (y * c(0.7)).cos() + (z * c(0.8)).sin() * c(0.5);
    let moved = polar.cos() * (x * c(0.6)).cos() + azimuth.cos() * (y * c(0.5)).sin();
    c(0.4) + shade * c(0.15) + moved * c(0.1)
}

/// A field of one's own: dual numbers turn the formula into values and exact gradients.
struct Brighter;

impl Field<5, 1> for Brighter {
    fn eval(&self, x: &[[f32; 5]], y: &mut [[f32; 1]]) {
        assert_eq!(x.len(), y.len(), "points and values");
        for (x, y) in x.iter().zip(y) {
            *y = [(surface(x.map(f64::from)) + BRIGHTER) as f32];
        }
    }

    fn eval_jet(&self, x: &[[f32; 5]], y: &mut [Jet<5, 1>]) {
        assert_eq!(x.len(), y.len(), "points and jets");
        for (x, y) in x.iter().zip(y) {
            let (value, slope) = gradient(surface, x.map(f64::from));
            *y = Jet { value: [(value + BRIGHTER) as f32], grad: [slope.map(|s| s as f32)] };
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (pitch, origin) = ([0.4, 0.4, 0.4, PI / 5.0, PI / 5.0], [-1.6, -1.6, -1.6, 0.0, 0.0]);
    let domain = Domain::new([9, 9, 9, 6, 6], pitch, origin, Unit::Millimetre)?;
    let background = Samples::<5, 1>::from_fn(domain, |x| [surface(x.map(f64::from)) as f32]);
    // A ball in space, from every direction.
    let region = Ellipsoid::new([0.0; 5], [1.0, 1.0, 1.0, 50.0, 50.0])?;
    let blend = solve(&Problem {
        background: &background,
        patch: Patch::Field { field: &Brighter, offset: [0.0; 5] },
        region: &region,
        guidance: Guidance::Patch,
        options: Options::default(),
    })?;

    // A picture: a plane through the ball, from one direction, between the samples.
    let at = |k: usize| -1.1 + 2.2 * k as f32 / 31.0;
    let plane: Vec<[f32; 5]> = (0..1024).map(|k| [at(k % 32), at(k / 32), 0.1, 1.2, 0.7]).collect();
    let mut picture = vec![[0.0]; plane.len()];
    blend.to_field().eval(&plane, &mut picture);
    let errors = plane
        .iter()
        .zip(&picture)
        .map(|(x, [y])| (f64::from(*y) - surface(x.map(f64::from))).abs());
    let worst = errors.fold(0.0, f64::max);
    println!("{} samples, {} iterations", domain.len(), blend.report.iterations);
    println!(
        "Largest error of a picture through the blend: {worst:.4}; the patch is {BRIGHTER} too bright"
    );
    assert!(worst < 0.02);
    Ok(())
}
