//! What does a spline cost: per sample to interpolate, per point to evaluate, per point of a
//! lattice?

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use inr_core::{Domain, Field, Jet, Samples, Spline};

/// Points per evaluation: many batches, yet a few milliseconds.
const POINTS: usize = 1 << 16;

/// A signal of about a quarter of a million samples.
fn signal<const D: usize, const C: usize>(shape: [usize; D]) -> Samples<D, C> {
    let domain = Domain::unit(shape).expect("a positive shape");
    Samples::from_fn(domain, |x| {
        std::array::from_fn(|c| (0..D).map(|d| (0.1 * x[d] + (c + d) as f32).sin()).sum())
    })
}

/// Points spread over the domain by multiples of irrational steps.
fn points<const D: usize>(shape: [usize; D]) -> Vec<[f32; D]> {
    const STEPS: [f64; 3] = [0.618_033_988_7, 0.754_877_666_2, 0.569_840_290_9];
    (0..POINTS)
        .map(|k| {
            std::array::from_fn(|d| ((k as f64 * STEPS[d]).fract() * (shape[d] - 1) as f64) as f32)
        })
        .collect()
}

fn all<const D: usize, const C: usize>(criterion: &mut Criterion, shape: [usize; D]) {
    let samples = signal::<D, C>(shape);
    let spline = Spline::interpolate(&samples);
    let name = format!("D{D}C{C}");
    let mut group = criterion.benchmark_group("spline");
    group.sample_size(10).throughput(Throughput::Elements(samples.domain().len() as u64));
    group.bench_function(BenchmarkId::new("interpolate", &name), |b| {
        b.iter(|| Spline::interpolate(black_box(&samples)));
    });
    group.bench_function(BenchmarkId::new("eval_lattice", &name), |b| {
        b.iter(|| black_box(&spline).eval_lattice(samples.domain(), [0; D]));
    });
    group.throughput(Throughput::Elements(POINTS as u64));
    let x = points(shape);
    let (mut values, mut jets) = (vec![[0.0; C]; POINTS], vec![Jet::ZERO; POINTS]);
    group.bench_function(BenchmarkId::new("eval", &name), |b| {
        b.iter(|| spline.eval(black_box(&x), &mut values));
    });
    group.bench_function(BenchmarkId::new("eval_jet", &name), |b| {
        b.iter(|| spline.eval_jet(black_box(&x), &mut jets));
    });
    group.finish();
}

fn spline(criterion: &mut Criterion) {
    all::<1, 1>(criterion, [1 << 18]);
    all::<2, 3>(criterion, [512, 512]);
    all::<3, 1>(criterion, [64, 64, 64]);
}

criterion_group!(benches, spline);
criterion_main!(benches);
