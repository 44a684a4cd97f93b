//! Times the training kernels on workload W1: sine network 2-64-64-64-3, 65,536 points, value and gradient,
//! full parameter gradient; as a share of the multiply-add peak measured in the same process.
//!
//! `network_timing [REPEATS [avx512|avx2|baseline]]` prints one JSON line per vector unit and number of threads.

use std::time::Instant;

use inr_core::cpu::{Unit, fused_multiply_add_peak};
use inr_core::{Architecture, Domain, Frame, Jet, Network, Order, Output, Workspace};

const POINTS: usize = 65_536;

/// Multiply-adds times two: three products per layer (forward, down, weights), each with 1 + D rows a point.
const FLOP: f64 =
    (POINTS * 3 * (2 * 64 + 64 * 64 + 64 * 64 + 64 * 3) * 3 * 2 - POINTS * 3 * 2 * 64 * 2) as f64;

fn main() {
    let repeats = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(20);
    let domain = Domain::unit([256, 256]).expect("a good shape");
    let x: Vec<[f32; 2]> = (0..POINTS).map(|k| domain.position(domain.unflatten(k))).collect();
    let network = Network::<2, 3>::new(
        Architecture::siren(64, 3, 30.0),
        Frame::of_cells(&domain),
        Output::of_range(0.0, 1.0),
        1,
    )
    .expect("a good architecture");
    for unit in [Unit::Avx512, Unit::Avx2, Unit::Baseline] {
        let asked = std::env::args().nth(2).is_none_or(|u| u == format!("{unit:?}").to_lowercase());
        if !asked || Unit::limit(unit) != unit {
            continue;
        }
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads start");
            let (mut peaks, mut seconds) = (Vec::new(), Vec::new());
            for _ in 0..repeats {
                peaks.push(pool.broadcast(|_| fused_multiply_add_peak(5)).into_iter().sum::<f64>());
                seconds.push(pool.install(|| step(&network, &x)));
            }
            let median = |v: &mut Vec<f64>| {
                v.sort_by(f64::total_cmp);
                v[v.len() / 2]
            };
            let (peak, time) = (median(&mut peaks), median(&mut seconds));
            println!(
                "{{\"unit\": \"{unit:?}\", \"threads\": {threads}, \"seconds\": {time:.5}, \
                 \"best_seconds\": {:.5}, \"gflops\": {:.1}, \"peak_gflops\": {:.1}, \"share\": {:.3}, \"best_share\": {:.3}}}",
                seconds[0],
                FLOP / time * 1e-9,
                peak * 1e-9,
                FLOP / time / peak,
                FLOP / seconds[0] / peaks[peaks.len() - 1],
            );
        }
    }
}

fn step(network: &Network<2, 3>, x: &[[f32; 2]]) -> f64 {
    thread_local! {
        static WORK: std::cell::RefCell<(Workspace, Vec<f32>)> = Default::default();
    }
    let loss = |_: usize, y: &[Jet<2, 3>], bar: &mut [Jet<2, 3>]| {
        let mut sum = 0.0;
        for (y, bar) in y.iter().zip(bar) {
            for c in 0..3 {
                let e = y.value[c] - 0.5;
                sum += e * e;
                bar.value[c] = 2.0 * e;
                for d in 0..2 {
                    sum += y.grad[c][d] * y.grad[c][d];
                    bar.grad[c][d] = 2.0 * y.grad[c][d];
                }
            }
        }
        f64::from(sum)
    };
    WORK.with_borrow_mut(|(work, gradient)| {
        gradient.resize(network.params().len(), 0.0);
        let begin = Instant::now();
        gradient.fill(0.0);
        let sum = network.loss_gradient(x, Order::Jet, &loss, work, gradient);
        std::hint::black_box((sum, &gradient));
        begin.elapsed().as_secs_f64()
    })
}
