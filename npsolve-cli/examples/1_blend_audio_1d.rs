//! Puts a piece of one recording into another without clicks: the same solver with D = 1.
//!
//! `cargo run --release -p npsolve-cli --example 1_blend_audio_1d`

use std::f32::consts::TAU;

use inr_core::{BoxRegion, Domain, Region, Samples, Unit};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, solve};

const SAMPLE_RATE_HZ: f32 = 48_000.0;
/// The piece that is replaced, in seconds.
const PIECE: [f32; 2] = [0.3, 0.5];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let domain = Domain::new([38_400], [1.0 / SAMPLE_RATE_HZ], [0.0], Unit::Second)?;
    // A low tone, and a higher one that lies off centre: cut in as it is, it clicks.
    let background = Samples::<1, 1>::from_fn(domain, |[t]| [0.3 * (TAU * 110.0 * t).sin()]);
    let patch = Samples::from_fn(domain, |[t]| [0.25 + 0.1 * (TAU * 440.0 * t + 1.0).sin()]);
    let region = BoxRegion::new([PIECE[0]], [PIECE[1]])?;

    let mut cut = background.clone();
    for (k, value) in cut.as_planar_mut().iter_mut().enumerate() {
        if region.weight(&domain.position([k])) > 0.5 {
            *value = patch.plane(0)[k];
        }
    }
    let problem = Problem {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: [0.0] },
        region: &region,
        guidance: Guidance::Patch,
        // The background gives way over two milliseconds.
        options: Options::with_objective(Objective::Screened { length: Some(0.002), keep: None }),
    };
    let blend = solve(&problem)?;

    println!("Largest step between neighbouring samples near the two splices:");
    for (name, signal) in [("background", &background), ("patch", &patch)] {
        println!("  {name:<12}{:.4}", largest_step(signal));
    }
    println!("  {:<12}{:.4}   a click", "hard cut", largest_step(&cut));
    println!(
        "  {:<12}{:.4}   as smooth as what it is made of",
        "blend",
        largest_step(&blend.samples)
    );
    let mean = |s: &Samples<1, 1>| s.plane(0)[15_000..24_000].iter().sum::<f32>() / 9_000.0;
    println!("Mean inside: patch {:.3}, blend {:.3}.", mean(&patch), mean(&blend.samples));
    println!(
        "{} iterations; samples {} to {} were solved for, the others are the background bit for bit.",
        blend.report.iterations,
        blend.report.box_start[0],
        blend.report.box_start[0] + blend.report.box_shape[0]
    );
    Ok(())
}

/// Within ten samples of either end of the piece.
fn largest_step(signal: &Samples<1, 1>) -> f32 {
    let near = |t: f32| {
        let k = (t * SAMPLE_RATE_HZ) as usize;
        let steps = signal.plane(0)[k - 10..k + 10].windows(2).map(|w| (w[1] - w[0]).abs());
        steps.fold(0.0, f32::max)
    };
    near(PIECE[0]).max(near(PIECE[1]))
}
