//! What do the methods that we compare with cost, beside the exact blend of the same problem?

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use inr_core::Translated;
use npsolve_benches::{offset, square};
use poisson_loss::{Baseline, Options, Patch, Problem, solve, solve_baseline};

/// Side of the region in samples.
const SIZE: usize = 256;

fn baselines(criterion: &mut Criterion) {
    let (square, offset) = (square(SIZE), offset());
    let region = Translated { region: square.mask.clone(), offset };
    let problem = Problem {
        background: &square.background,
        patch: Patch::Samples { samples: &square.patch, offset },
        region: &region,
        guidance: Default::default(),
        options: Options { tolerance: 1e-4, ..Options::default() },
    };
    let mut group = criterion.benchmark_group("baselines_256");
    group.sample_size(10).throughput(Throughput::Elements((SIZE * SIZE) as u64));
    group.bench_function("exact", |b| b.iter(|| solve(black_box(&problem)).expect("a solution")));
    for (name, baseline) in [
        ("paste", Baseline::Paste),
        ("pie", Baseline::Pie),
        ("neumann", Baseline::Neumann),
        ("paper_links", Baseline::PaperLinks { lambda: 2.0 }),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| solve_baseline(black_box(&problem), baseline).expect("a solution"));
        });
    }
    group.finish();
}

criterion_group!(benches, baselines);
criterion_main!(benches);
