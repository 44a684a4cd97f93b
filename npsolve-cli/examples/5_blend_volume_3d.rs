//! Puts a finding from one scan into another that was taken with other settings: D = 3, lengths in millimetres.
//!
//! `cargo run --release -p npsolve-cli --example 5_blend_volume_3d`

use inr_core::{Domain, Ellipsoid, Region, Samples, Unit};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};

/// The middle of the finding, in millimetres.
const CENTER: [f32; 3] = [26.0, 24.0, 33.0];
/// How far it reaches, in millimetres.
const RADIUS: f32 = 8.0;
/// What the other scanner adds to every voxel.
const BRIGHTER: f32 = 0.15;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Slices are further apart than voxels within them, as in most scans.
    let domain = Domain::new([64, 60, 28], [0.8, 0.8, 2.4], [0.0; 3], Unit::Millimetre)?;
    let background = Samples::<3, 1>::from_fn(domain, |x| [tissue(x)]);
    let patch = Samples::from_fn(domain, |x| [tissue(x) + finding(x) + BRIGHTER]);
    let wanted = Samples::from_fn(domain, |x| [tissue(x) + finding(x)]);
    let region = Ellipsoid::ball(CENTER, RADIUS + 3.0)?;

    let mut pasted = background.clone();
    for (k, value) in pasted.as_planar_mut().iter_mut().enumerate() {
        if region.weight(&domain.position(domain.unflatten(k))) > 0.5 {
            *value = patch.plane(0)[k];
        }
    }
    let blend = solve(&Problem {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: [0.0; 3] },
        region: &region,
        guidance: Guidance::Patch,
        options: Options::default(),
    })?;

    let worst = |volume: &Samples<3, 1>| {
        let pairs = volume.as_planar().iter().zip(wanted.as_planar());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    println!("Largest error against the finding in this scanner's own light:");
    println!("  {:<8}{:.5}", "pasted", worst(&pasted));
    println!("  {:<8}{:.5}   it had to be below 0.002", "blended", worst(&blend.samples));
    assert!(worst(&blend.samples) < 0.002);
    let [x, y, z] = [0, 1, 2].map(|d| blend.report.box_shape[d]);
    println!("{} iterations on {x} x {y} x {z} voxels.", blend.report.iterations);
    Ok(())
}

/// Slow waves.
fn tissue([x, y, z]: [f32; 3]) -> f32 {
    0.4 + 0.1 * (0.11 * x + 0.07 * z).sin() + 0.08 * (0.13 * y - 0.05 * z).cos()
}

/// A soft ball, zero from its radius on.
fn finding(x: [f32; 3]) -> f32 {
    let squared: f32 = (0..3).map(|d| ((x[d] - CENTER[d]) / RADIUS).powi(2)).sum();
    0.3 * (1.0 - squared).max(0.0).powi(3)
}
