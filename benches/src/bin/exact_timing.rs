//! Seconds of one exact blend, set-up and solve, as one JSON line per repetition.
//!
//! `exact_timing N LENGTH TOLERANCE THREADS REPEATS`; LENGTH 0 takes the default.

use std::time::Instant;

use inr_core::Translated;
use npsolve_benches::{offset, square};
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, solve};

fn main() {
    let argument = |k: usize| -> f64 {
        std::env::args().nth(k).and_then(|v| v.parse().ok()).unwrap_or_else(|| {
            eprintln!("usage: exact_timing N LENGTH TOLERANCE THREADS REPEATS");
            std::process::exit(2)
        })
    };
    let (n, length, tolerance) = (argument(1) as usize, argument(2) as f32, argument(3) as f32);
    rayon::ThreadPoolBuilder::new()
        .num_threads(argument(4) as usize)
        .build_global()
        .expect("first use");
    let square = square(n);
    let offset = offset();
    let region = Translated { region: square.mask.clone(), offset };
    for _ in 0..argument(5) as usize {
        let start = Instant::now();
        let problem = Problem {
            background: &square.background,
            patch: Patch::Samples { samples: &square.patch, offset },
            region: &region,
            guidance: Guidance::Patch,
            options: Options {
                objective: Objective::Screened {
                    length: (length > 0.0).then_some(length),
                    keep: None,
                },
                tolerance,
                ..Options::default()
            },
        };
        let blend = solve(&problem).expect("a solvable problem");
        println!(
            "{{\"n\": {n}, \"length\": {}, \"tolerance\": {tolerance:e}, \"seconds\": {:.5}, \"iterations\": {}, \"residual\": {:.2e}, \"box\": {:?}}}",
            blend.report.length.unwrap_or(0.0),
            start.elapsed().as_secs_f64(),
            blend.report.iterations,
            blend.report.residual,
            blend.report.box_shape,
        );
    }
}
