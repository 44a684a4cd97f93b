//! Seconds, iterations and peak memory of exact blends in one to five dimensions, one JSON line per repetition.
//!
//! `dimension_timing [--dirichlet] CHANNELS REPEATS N0 [N1 [N2 [N3 [N4]]]]`: the samples per axis of the region, a box
//! with eight samples of background on either side of every axis of more than eight; CHANNELS is 1 or 3. With
//! `--dirichlet` values outside are fixed. To see the memory of one case, run it by itself.

use std::time::Instant;

use inr_core::{BoxRegion, Domain, Samples};
use npsolve_benches::peak_memory_bytes;
use poisson_loss::{Guidance, Objective, Options, Patch, Problem, solve};

/// Samples of background around the region.
const MARGIN: usize = 8;

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let all = arguments.len();
    arguments.retain(|a| a != "--dirichlet");
    let objective = if arguments.len() < all { Objective::Dirichlet } else { Objective::default() };
    let numbers: Option<Vec<usize>> = arguments.iter().map(|a| a.parse().ok()).collect();
    let case = Case { channels: 1, repeats: 1, objective };
    match numbers.as_deref() {
        Some([channels, repeats, size @ ..]) => {
            let case = Case { channels: *channels, repeats: *repeats, ..case };
            match *size {
                [a] => case.run([a]),
                [a, b] => case.run([a, b]),
                [a, b, c] => case.run([a, b, c]),
                [a, b, c, d] => case.run([a, b, c, d]),
                [a, b, c, d, e] => case.run([a, b, c, d, e]),
                _ => usage(),
            }
        }
        _ => usage(),
    }
}

fn usage() {
    eprintln!(
        "usage: dimension_timing [--dirichlet] CHANNELS REPEATS N0 [N1 [N2 [N3 [N4]]]], with 1 or 3 channels"
    );
    std::process::exit(2)
}

struct Case {
    channels: usize,
    repeats: usize,
    objective: Objective,
}

impl Case {
    fn run<const D: usize>(&self, size: [usize; D]) {
        match self.channels {
            1 => time::<D, 1>(size, self),
            3 => time::<D, 3>(size, self),
            _ => usage(),
        }
    }
}

fn time<const D: usize, const C: usize>(size: [usize; D], case: &Case) {
    let margin = size.map(|n| if n > MARGIN { MARGIN } else { 0 });
    let shape = std::array::from_fn(|d| size[d] + 2 * margin[d]);
    let domain = Domain::<D>::unit(shape).expect("a good shape");
    let (background, patch) = (waves::<D, C>(domain, 0.11), waves::<D, C>(domain, 0.17));
    let low = margin.map(|m| m as f32 - 0.5);
    let high = std::array::from_fn(|d| low[d] + size[d] as f32);
    let region = BoxRegion::new(low, high).expect("a good box");
    for _ in 0..case.repeats {
        let begin = Instant::now();
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [0.0; D] },
            region: &region,
            guidance: Guidance::Patch,
            options: Options { tolerance: 1e-6, ..Options::with_objective(case.objective) },
        };
        let blend = solve(&problem).expect("a solvable problem");
        let seconds = begin.elapsed().as_secs_f64();
        let samples: usize = size.iter().product();
        println!(
            "{{\"size\": {size:?}, \"channels\": {C}, \"seconds\": {seconds:.6}, \"ns_per_sample_and_channel\": {:.1}, \
             \"iterations\": {}, \"residual\": {:.1e}, \"length\": {:.1}, \"peak_bytes\": {}, \"bytes_per_sample\": {:.0}}}",
            1e9 * seconds / (samples * C) as f64,
            blend.report.iterations,
            blend.report.residual,
            blend.report.length.unwrap_or(0.0),
            peak_memory_bytes(),
            peak_memory_bytes() as f64 / domain.len() as f64,
        );
    }
}

/// Waves along all axes with a little texture, different for every channel.
fn waves<const D: usize, const C: usize>(domain: Domain<D>, frequency: f32) -> Samples<D, C> {
    let mut samples = Samples::zeros(domain);
    for c in 0..C {
        let phase = frequency * 10.0 + c as f32;
        for (k, v) in samples.plane_mut(c).iter_mut().enumerate() {
            let i = domain.unflatten(k);
            let wave: f32 = i.iter().map(|i| (frequency * *i as f32 + phase).sin()).sum();
            let noise = (k as u32).wrapping_mul(2_654_435_761) >> 16;
            *v = 0.5 + 0.2 * wave / D as f32 + 0.05 * noise as f32 / 65_536.0;
        }
    }
    samples
}
