//! What does an exact blend cost per sample of its region, set-up and solve together?

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use inr_core::Translated;
use npsolve_benches::{offset, square};
use poisson_loss::{Options, Patch, Problem, solve};

/// Sizes that take seconds; larger ones when `NPSOLVE_LONG_BENCHES` is set.
fn sizes() -> Vec<usize> {
    let long = std::env::var_os("NPSOLVE_LONG_BENCHES").is_some();
    [64, 128, 256, 512].into_iter().chain(if long { vec![1024, 2048] } else { vec![] }).collect()
}

fn exact_blend(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("exact_blend");
    group.sample_size(10);
    for n in sizes() {
        let (square, offset) = (square(n), offset());
        let region = Translated { region: square.mask.clone(), offset };
        group.throughput(Throughput::Elements((n * n) as u64));
        for tolerance in [1e-4, 1e-6] {
            let problem = Problem {
                background: &square.background,
                patch: Patch::Samples { samples: &square.patch, offset },
                region: &region,
                guidance: Default::default(),
                options: Options { tolerance, ..Options::default() },
            };
            group.bench_function(BenchmarkId::new(format!("{tolerance:e}"), n), |b| {
                b.iter(|| solve(black_box(&problem)).expect("a solvable problem"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, exact_blend);
criterion_main!(benches);
