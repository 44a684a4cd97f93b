//! What a point costs: values, jets, and a training step, by field kind and dimension.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use inr_core::{
    Architecture, Domain, Field, Frame, Interpolation, Jet, Network, Order, Output, Workspace,
};

const POINTS: usize = 8192;

fn points<const D: usize>(side: usize) -> (Domain<D>, Vec<[f32; D]>) {
    let domain = Domain::unit([side; D]).expect("a positive shape");
    let step = domain.len() / POINTS;
    let x = (0..POINTS).map(|k| domain.position(domain.unflatten(k * step))).collect();
    (domain, x)
}

fn kinds(shape: &[usize]) -> Vec<(&'static str, Architecture)> {
    vec![
        ("siren", Architecture::siren(64, 3, 30.0)),
        ("fourier", Architecture::fourier(64, 10.0, 64, 2)),
        ("hash", Architecture::hash(shape, 1 << 15)),
        ("grid", Architecture::grid(shape, 1 << 15)),
        ("diner-cubic", Architecture::diner(shape, Interpolation::Cubic, 3, 64, 3, 6.0)),
    ]
}

/// Cost per point of a value, of a jet, and of loss and gradient on each.
fn by_kind(c: &mut Criterion) {
    let (domain, x) = points::<2>(512);
    for (name, architecture) in kinds(&domain.shape()) {
        let network = Network::<2, 3>::new(
            architecture,
            Frame::of_cells(&domain),
            Output::of_range(0.0, 1.0),
            1,
        )
        .expect("good numbers");
        let mut group = c.benchmark_group(format!("image/{name}"));
        group.throughput(Throughput::Elements(POINTS as u64));
        let (mut y, mut jets) = (vec![[0.0; 3]; POINTS], vec![Jet::<2, 3>::ZERO; POINTS]);
        group.bench_function("value", |b| b.iter(|| network.eval(&x, &mut y)));
        group.bench_function("jet", |b| b.iter(|| network.eval_jet(&x, &mut jets)));
        let loss = |_: usize, y: &[Jet<2, 3>], bar: &mut [Jet<2, 3>]| {
            bar.copy_from_slice(y);
            0.0
        };
        let (mut work, mut gradient) = (Workspace::default(), vec![0.0; network.params().len()]);
        for (order, name) in [(Order::Value, "train value"), (Order::Jet, "train jet")] {
            group.bench_function(name, |b| {
                b.iter(|| network.loss_gradient(&x, order, &loss, &mut work, &mut gradient));
            });
        }
        group.finish();
    }
}

/// Cost of a jet by dimension, for one sine network.
fn by_dimension(c: &mut Criterion) {
    let mut group = c.benchmark_group("siren jets by dimension");
    group.throughput(Throughput::Elements(POINTS as u64));
    fn one<const D: usize>(
        group: &mut criterion::BenchmarkGroup<'_, criterion::measurement::WallTime>,
        side: usize,
    ) {
        let (domain, x) = points::<D>(side);
        let network = Network::<D, 3>::new(
            Architecture::siren(64, 3, 30.0),
            Frame::of_cells(&domain),
            Output::of_range(0.0, 1.0),
            1,
        )
        .expect("good numbers");
        let mut jets = vec![Jet::<D, 3>::ZERO; POINTS];
        group.bench_function(BenchmarkId::from_parameter(D), |b| {
            b.iter(|| network.eval_jet(&x, &mut jets));
        });
    }
    one::<1>(&mut group, 1 << 14);
    one::<2>(&mut group, 256);
    one::<3>(&mut group, 32);
    one::<4>(&mut group, 16);
    one::<5>(&mut group, 8);
    group.finish();
}

criterion_group!(benches, by_kind, by_dimension);
criterion_main!(benches);
