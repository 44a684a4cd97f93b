use super::*;
use crate::random::Random;
use crate::{Domain, seed};

/// f32 networks against the same numbers in f64, relative to the largest component of the batch.
const JET_TOLERANCE: f64 = 1e-5;

/// One small network of every kind, with everything that can be off by one: odd widths, several levels,
/// hashing, a skip connection, a wide layer.
fn architectures<const D: usize>() -> Vec<(&'static str, Architecture)> {
    let shape: Vec<usize> = (0..D).map(|d| 9 + 3 * d).collect();
    let diner = |i| Architecture::diner(&shape, i, 3, 24, 2, 6.0);
    let mut nerf = Architecture::nerf();
    (nerf.mlp.width, nerf.mlp.depth, nerf.mlp.skip) = (40, 4, Some(2));
    if let Encoding::Fourier(f) = &mut nerf.encoding {
        f.frequencies = Frequencies::Axis { octaves: 4, base: 1.0 };
    }
    let mut smooth = Architecture::hash(&shape, 64);
    if let Encoding::Grid(g) = &mut smooth.encoding {
        g.interpolation = Interpolation::Smoothstep;
    }
    vec![
        ("siren", Architecture::siren(37, 3, 5.0)),
        ("siren wide", Architecture::siren(160, 1, 5.0)),
        ("fourier", Architecture::fourier(20, 1.0, 32, 2)),
        ("nerf", nerf),
        ("hash", Architecture::hash(&shape, 64)),
        ("smoothstep", smooth),
        ("grid", Architecture::grid(&shape, 1 << 9)),
        ("spline grid", Architecture::spline_grid(&shape, 3)),
        ("diner linear", diner(Interpolation::Linear)),
        ("diner cubic", diner(Interpolation::Cubic)),
        ("diner", diner(Interpolation::Nearest)),
    ]
}

fn network<const D: usize, const C: usize>(architecture: Architecture) -> Network<D, C> {
    let shape = std::array::from_fn(|d| 9 + 3 * d);
    let domain = Domain::new(shape, [0.5; D], [-1.0; D], crate::Unit::Sample).unwrap();
    let output = Output::of_range(0.0, 2.0);
    let mut network = Network::new(architecture, Frame::of_cells(&domain), output, 3).unwrap();
    // Tables large enough to be seen.
    let tables = network.tables();
    network.params_mut()[tables].iter_mut().for_each(|p| *p *= 1e4);
    network
}

fn points<const D: usize>(n: usize) -> Vec<[f32; D]> {
    let random = Random::new(11, 0);
    let at = |p: usize, d: usize| {
        let half = 0.25 * (9 + 3 * d) as f32;
        // Some points lie a little outside.
        -1.25 + half + random.symmetric((p * D + d) as u64, 1.1 * half)
    };
    (0..n).map(|p| std::array::from_fn(|d| at(p, d))).collect()
}

fn jets_match_dual_numbers<const D: usize, const C: usize>() {
    for (name, architecture) in architectures::<D>() {
        let network = network::<D, C>(architecture);
        let x = points::<D>(75);
        let mut jets = vec![Jet::<D, C>::ZERO; x.len()];
        network.eval_jet(&x, &mut jets);
        let mut values = vec![[0.0; C]; x.len()];
        network.eval(&x, &mut values);
        let (mut largest, mut worst) = ([0.0f64; 2], [0.0f64; 2]);
        for (p, x) in x.iter().enumerate() {
            let want = network.eval_scalar(seed(x.map(f64::from)));
            for c in 0..C {
                let errors =
                    [jets[p].value[c], values[p][c]].map(|v| (f64::from(v) - want[c].re).abs());
                worst[0] = worst[0].max(errors[0]).max(errors[1]);
                largest[0] = largest[0].max(want[c].re.abs());
                for d in 0..D {
                    worst[1] = worst[1].max((f64::from(jets[p].grad[c][d]) - want[c].eps[d]).abs());
                    largest[1] = largest[1].max(want[c].eps[d].abs());
                }
            }
        }
        for k in 0..2 {
            let relative = worst[k] / largest[k].max(1e-30);
            assert!(relative < JET_TOLERANCE, "{name}, D = {D}, order {k}: {relative:e}");
        }
    }
}

#[test]
fn jets_match_dual_numbers_audio() {
    jets_match_dual_numbers::<1, 1>();
}
#[test]
fn jets_match_dual_numbers_image() {
    jets_match_dual_numbers::<2, 3>();
}
#[test]
fn jets_match_dual_numbers_volume() {
    jets_match_dual_numbers::<3, 4>();
}
#[test]
fn jets_match_dual_numbers_light_field() {
    jets_match_dual_numbers::<4, 3>();
}
#[test]
fn jets_match_dual_numbers_radiance() {
    jets_match_dual_numbers::<5, 4>();
}

/// A loss with every component in it, not symmetric in any.
fn loss<const D: usize, const C: usize>(
    first: usize,
    y: &[Jet<D, C>],
    bar: &mut [Jet<D, C>],
) -> f64 {
    let mut sum = 0.0;
    for (p, (y, bar)) in y.iter().zip(bar).enumerate() {
        for c in 0..C {
            let target = ((first + p) * 7 + c) as f32 % 5.0 * 0.3;
            let e = y.value[c] - target;
            sum += f64::from(e * e);
            bar.value[c] = 2.0 * e;
            for d in 0..D {
                let e = y.grad[c][d] - 0.2 * (1 + c + d) as f32;
                sum += f64::from(0.3 * e * e);
                bar.grad[c][d] = 0.6 * e;
            }
        }
    }
    sum
}

/// The same loss in f64 by the definition.
fn plain_loss<const D: usize, const C: usize>(
    network: &Network<D, C>,
    x: &[[f32; D]],
    order: Order,
) -> f64 {
    let mut sum = 0.0;
    for (p, x) in x.iter().enumerate() {
        let y = network.eval_scalar(seed(x.map(f64::from)));
        for c in 0..C {
            sum += (y[c].re - f64::from((p * 7 + c) as f32 % 5.0 * 0.3)).powi(2);
            for d in 0..D {
                let grad = if order == Order::Jet { y[c].eps[d] } else { 0.0 };
                sum += 0.3 * (grad - f64::from(0.2 * (1 + c + d) as f32)).powi(2);
            }
        }
    }
    sum
}

fn gradients_match_central_differences<const D: usize, const C: usize>() {
    for (name, architecture) in architectures::<D>() {
        for order in [Order::Value, Order::Jet] {
            let mut network = network::<D, C>(architecture.clone());
            let x = points::<D>(29);
            let mut gradient = vec![0.0; network.params().len()];
            let got =
                network.loss_gradient(&x, order, &loss, &mut Workspace::default(), &mut gradient);
            let want = plain_loss(&network, &x, order);
            assert!((got - want).abs() < 1e-4 * want, "{name}: loss {got} instead of {want}");
            let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
            let scale = norm / (gradient.len() as f64).sqrt();
            let random = Random::new(5, 1);
            // Parameters that matter, and some of all.
            let mut sorted: Vec<usize> = (0..gradient.len()).collect();
            sorted.sort_by(|a, b| gradient[*b].abs().total_cmp(&gradient[*a].abs()));
            let picks = (0..6).map(|k| sorted[k * 3]);
            let others = (0..6).map(|k| random.below(k, gradient.len()));
            for k in picks.chain(others) {
                // Padding stays zero whatever the step is; its derivative says nothing.
                let before = network.params()[k];
                if before == 0.0 && gradient[k] == 0.0 {
                    continue;
                }
                // Short, so that rectifiers do not cross their kink; the sums are f64.
                let step = 2e-5f32;
                let mut at = |v: f32| {
                    network.params_mut()[k] = v;
                    plain_loss(&network, &x, order)
                };
                let (hi, lo) = (before + step, before - step);
                let slope = (at(hi) - at(lo)) / (f64::from(hi) - f64::from(lo));
                network.params_mut()[k] = before;
                let error = (slope - f64::from(gradient[k])).abs();
                // f32 sums against f64: observed 2e-4.
                assert!(
                    error < 2e-3 * slope.abs().max(scale),
                    "{name}, D = {D}, {order:?}, parameter {k}: {} instead of {slope}",
                    gradient[k]
                );
            }
        }
    }
}

#[test]
fn gradients_match_central_differences_audio() {
    gradients_match_central_differences::<1, 1>();
}
#[test]
fn gradients_match_central_differences_image() {
    gradients_match_central_differences::<2, 3>();
}
#[test]
fn gradients_match_central_differences_volume() {
    gradients_match_central_differences::<3, 2>();
}

#[test]
fn padding_never_gets_a_gradient() {
    for (name, architecture) in architectures::<2>() {
        let network = network::<2, 3>(architecture);
        let mut gradient = vec![0.0; network.params().len()];
        network.loss_gradient(
            &points(500),
            Order::Jet,
            &loss,
            &mut Workspace::default(),
            &mut gradient,
        );
        let nonzero = gradient.iter().filter(|g| **g != 0.0).count();
        assert!(nonzero <= network.parameter_count(), "{name}");
    }
}

/// `<J dp, y_bar> = <dp, J^T y_bar>` with `J dp` by a central difference in f64: the reverse sweep is the
/// transpose of what goes forward.
#[test]
fn the_reverse_sweep_is_the_adjoint() {
    for (name, architecture) in architectures::<2>() {
        let mut network = network::<2, 2>(architecture);
        let (x, random) = (points::<2>(60), Random::new(2, 2));
        let weight = |p: usize, k: usize| random.symmetric((p * 6 + k) as u64, 1.0);
        let linear = |first: usize, y: &[Jet<2, 2>], bar: &mut [Jet<2, 2>]| {
            let mut sum = 0.0;
            for (p, (y, bar)) in y.iter().zip(bar).enumerate() {
                for c in 0..2 {
                    let w: [f32; 3] = std::array::from_fn(|k| weight(first + p, 3 * c + k));
                    sum += f64::from(w[0] * y.value[c] + w[1] * y.grad[c][0] + w[2] * y.grad[c][1]);
                    (bar.value[c], bar.grad[c]) = (w[0], [w[1], w[2]]);
                }
            }
            sum
        };
        let mut gradient = vec![0.0; network.params().len()];
        network.loss_gradient(&x, Order::Jet, &linear, &mut Workspace::default(), &mut gradient);
        // Short, so that rectifiers do not cross their kink; as it is after rounding.
        let step =
            |k: usize, p: f32| if p == 0.0 { 0.0 } else { random.symmetric(k as u64 + 1000, 1e-5) };
        let before: Vec<(f32, f32)> = network
            .params()
            .iter()
            .enumerate()
            .map(|(k, p)| (p - step(k, *p), p + step(k, *p)))
            .collect();
        let direction = before.iter().map(|(lo, hi)| 0.5 * (f64::from(*hi) - f64::from(*lo)));
        let direction: Vec<f64> = direction.collect();
        let mut at = |upper: bool| -> f64 {
            for (p, (lo, hi)) in network.params_mut().iter_mut().zip(&before) {
                *p = if upper { *hi } else { *lo };
            }
            let mut sum = 0.0;
            for (p, x) in x.iter().enumerate() {
                let y = network.eval_scalar(seed(x.map(f64::from)));
                for c in 0..2 {
                    let w: [f64; 3] = std::array::from_fn(|k| f64::from(weight(p, 3 * c + k)));
                    sum += w[0] * y[c].re + w[1] * y[c].eps[0] + w[2] * y[c].eps[1];
                }
            }
            sum
        };
        let forward = 0.5 * (at(true) - at(false));
        let backward: f64 = gradient.iter().zip(&direction).map(|(g, d)| f64::from(*g) * d).sum();
        let size: f64 = gradient
            .iter()
            .zip(&direction)
            .map(|(g, d)| (f64::from(*g) * d).powi(2))
            .sum::<f64>()
            .sqrt();
        // f32 sums against f64: observed 1e-4.
        assert!(
            (forward - backward).abs() < 2e-3 * size,
            "{name}: {forward} and {backward}, of {size}"
        );
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for (name, architecture) in architectures::<2>() {
        let network = network::<2, 3>(architecture);
        let x = points::<2>(4000);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut gradient = vec![0.0; network.params().len()];
                let mut work = Workspace::default();
                let loss = network.loss_gradient(&x, Order::Jet, &loss, &mut work, &mut gradient);
                let mut jets = vec![Jet::<2, 3>::ZERO; x.len()];
                network.eval_jet(&x, &mut jets);
                (loss.to_bits(), gradient, jets)
            })
        };
        let one = run(1);
        for threads in [2, 8] {
            let other = run(threads);
            assert!(
                one.0 == other.0 && one.1 == other.1 && one.2 == other.2,
                "{name}, {threads} threads"
            );
        }
    }
}

#[test]
fn a_point_has_one_value_whatever_its_neighbours_are() {
    for (name, architecture) in architectures::<3>() {
        let network = network::<3, 1>(architecture);
        let x = points::<3>(200);
        let mut all = vec![Jet::<3, 1>::ZERO; x.len()];
        network.eval_jet(&x, &mut all);
        for p in [0, 13, 199] {
            let mut one = [Jet::<3, 1>::ZERO];
            network.eval_jet(&x[p..=p], &mut one);
            assert_eq!(one[0], all[p], "{name}");
        }
    }
}

#[test]
fn out_of_range_numbers_are_typed_errors() {
    let domain = Domain::unit([8, 8]).unwrap();
    let build = |a: Architecture| {
        Network::<2, 1>::new(a, Frame::of_cells(&domain), Output::of_range(0.0, 1.0), 0).map(|_| ())
    };
    let bad = |a: Architecture| assert!(matches!(build(a), Err(crate::Error::Parameter { .. })));
    bad(Architecture::siren(0, 3, 30.0));
    bad(Architecture::siren(64, 0, 30.0));
    bad(Architecture::siren(64, 3, -1.0));
    bad(Architecture::siren(64, 3, f32::NAN));
    bad(Architecture::fourier(0, 1.0, 64, 2));
    bad(Architecture::diner(&[8, 8], Interpolation::Cubic, 5, 64, 2, 30.0));
    bad(Architecture::hash(&[512, 512], 1000));
    let three = build(Architecture::grid(&[8, 8, 8], 1 << 10));
    assert_eq!(three, Err(crate::Error::Length { expected: 2, found: 3 }));
}

/// Loops that the compiler no longer turns into vectors cost a factor of five or more and nothing else shows it. A
/// ratio within this process, best of several runs: observed 0.6 to 0.75 with vectors, 0.05 without.
#[test]
#[cfg_attr(debug_assertions, ignore = "kernels of optimised builds")]
fn training_kernels_run_at_a_share_of_the_multiply_add_peak() {
    const POINTS: usize = 4096;
    const LEAST: f64 = 0.25;
    let x: Vec<[f32; 2]> = (0..POINTS).map(|k| [(k % 64) as f32, (k / 64) as f32]).collect();
    let domain = Domain::unit([64, 64]).unwrap();
    let (frame, output) = (Frame::of_cells(&domain), Output::of_range(0.0, 1.0));
    let network = Network::<2, 3>::new(Architecture::siren(64, 3, 30.0), frame, output, 1).unwrap();
    let loss = |_: usize, y: &[Jet<2, 3>], bar: &mut [Jet<2, 3>]| {
        bar.copy_from_slice(y);
        0.0
    };
    // Three products per hidden layer (forward, down, weights), a row per value and tangent; thin layers not counted.
    let flop = (POINTS * 3 * 3 * 2 * 64 * 64 * 2) as f64;
    let (mut work, mut gradient) = (Workspace::default(), vec![0.0; network.params().len()]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let share = pool.install(|| {
        let runs = (0..20).map(|_| {
            let begin = std::time::Instant::now();
            network.loss_gradient(&x, Order::Jet, &loss, &mut work, &mut gradient);
            flop / begin.elapsed().as_secs_f64() / crate::cpu::fused_multiply_add_peak(2)
        });
        runs.fold(0.0, f64::max)
    });
    assert!(share > LEAST, "{share:.2} of the peak");
}
