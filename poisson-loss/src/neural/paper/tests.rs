use inr_core::{Domain, RasterMask, Samples, Translated};

use super::differences::{Differences, cropped};
use super::*;
use crate::{Guidance, Options, Strongest};

struct Scene {
    background: Samples<2, 3>,
    patch: Samples<2, 3>,
    region: Translated<RasterMask<2>, 2>,
    offset: [f32; 2],
}

/// A dark wave and brighter ripples on a disc with a soft rim that touches the border.
fn scene(shape: [usize; 2]) -> Scene {
    let [w, h] = shape;
    let domain = Domain::unit(shape).unwrap();
    let background = Samples::from_fn(domain, |[x, y]| {
        [0, 1, 2].map(|c| 0.3 + 0.15 * (0.21 * x + 0.3 * c as f32).sin() * (0.17 * y).cos())
    });
    let small = Domain::unit([w / 2, h / 2]).unwrap();
    let patch = Samples::from_fn(small, |[x, y]| {
        [0, 1, 2].map(|c| 0.6 + 0.1 * (0.7 * x).cos() * (0.5 * y + c as f32).sin())
    });
    let (cx, cy, r) = ((w / 4) as f32, (h / 4) as f32, (h / 4) as f32 - 1.5);
    let weights = (0..small.len())
        .map(|k| {
            let [x, y] = small.unflatten(k);
            (r + 0.5 - (x as f32 - cx).hypot(y as f32 - cy)).clamp(0.0, 1.0)
        })
        .collect();
    let offset = [(w / 4) as f32, 0.0];
    let region = Translated { region: RasterMask::new(small, weights).unwrap(), offset };
    Scene { background, patch, region, offset }
}

fn problem(scene: &Scene) -> Problem<'_, 2, 3> {
    Problem {
        background: &scene.background,
        patch: Patch::Samples { samples: &scene.patch, offset: scene.offset },
        region: &scene.region,
        guidance: Guidance::Strongest(Strongest::PerComponent),
        options: Options::default(),
    }
}

fn variants() -> Vec<PaperOptions> {
    let of = |stencil, color, weights, erode| PaperOptions {
        stencil,
        color,
        weights,
        erode,
        ..PaperOptions::default()
    };
    use ColorTerm::{Boundary, Outside};
    vec![
        PaperOptions::default(),
        of(Stencil::Forward, Outside, PaperWeights::Lambda(3.0), 0),
        of(Stencil::Backward, Outside, PaperWeights::Released, 2),
        of(Stencil::Centred, Outside, PaperWeights::Lambda(0.5), 1),
        of(Stencil::All, Boundary, PaperWeights::Released, 1),
    ]
}

/// Pseudo-random in -1..1.
fn noise(k: usize) -> f64 {
    (k as f64 * 12.9898).sin() * 43758.547 % 1.0
}

/// The loss as its definition reads, for whole pictures: another way through the same formula.
fn plain_loss(scene: &Scene, options: &PaperOptions, y: &[[f64; 3]]) -> PaperLoss {
    let [w, h] = scene.background.domain().shape();
    let (ox, oy) = (scene.offset[0] as i64, scene.offset[1] as i64);
    let [pw, ph] = scene.patch.domain().shape().map(|n| n as i64);
    let mask = |x: i64, y: i64| -> f64 {
        let (x, y) = (x - ox, y - oy);
        let inside = (0..pw).contains(&x) && (0..ph).contains(&y);
        if inside { f64::from(scene.region.region.weights()[(x + y * pw) as usize]) } else { 0.0 }
    };
    let on = |x: i64, y: i64| (0..w as i64).contains(&x) && (0..h as i64).contains(&y);
    let around = |x: i64, y: i64, reach: i64, start: f64, pick: fn(f64, f64) -> f64| {
        let mut best = start;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if on(x + dx, y + dy) {
                    best = pick(best, mask(x + dx, y + dy));
                }
            }
        }
        best
    };
    let s = |c: usize, x: i64, y: i64| {
        f64::from(scene.background.plane(c)[(x + y * w as i64) as usize])
    };
    // The patch is mirrored beyond its border; with whole pixels between that is a fold of the index.
    let fold = |i: i64, n: i64| {
        if i < 0 {
            -i
        } else if i >= n {
            2 * n - 2 - i
        } else {
            i
        }
    };
    let t = |c: usize, x: i64, y: i64| {
        f64::from(scene.patch.plane(c)[(fold(x - ox, pw) + fold(y - oy, ph) * pw) as usize])
    };
    let g = |c: usize, x: i64, yy: i64| y[(x + yy * w as i64) as usize][c];
    let used: Vec<usize> = match options.stencil {
        Stencil::Forward => vec![0],
        Stencil::Backward => vec![1],
        Stencil::Centred => vec![2],
        Stencil::All => vec![0, 1, 2],
    };
    let n = (w * h * 3) as f64;
    let (mut gradient, mut color, mut inside, mut outside) = (0.0, 0.0, 0.0, 0.0);
    for yy in 0..h as i64 {
        for x in 0..w as i64 {
            let m = mask(x, yy);
            let near = around(x, yy, 1, 0.0, f64::max) > 0.0;
            let counts = options.color == ColorTerm::Outside || near;
            let out = if counts { 1.0 - m } else { 0.0 };
            (inside, outside) = (inside + m, outside + out);
            let share = around(x, yy, options.erode as i64, m, f64::min);
            for c in 0..3 {
                color += out * (g(c, x, yy) - s(c, x, yy)).powi(2);
                if m == 0.0 {
                    continue;
                }
                for (dx, dy) in [(1, 0), (0, 1)] {
                    for stencil in &used {
                        let (lo, hi) = match stencil {
                            0 => (0, 1),
                            1 => (-1, 0),
                            _ => (-1, 1),
                        };
                        let (mut lo, mut hi) = (lo, hi);
                        if !on(x + lo * dx, yy + lo * dy) || !on(x + hi * dx, yy + hi * dy) {
                            if *stencil != 2 {
                                continue;
                            }
                            lo = if on(x - dx, yy - dy) { -1 } else { 0 };
                            hi = if on(x + dx, yy + dy) { 1 } else { 0 };
                        }
                        let diff = |f: &dyn Fn(usize, i64, i64) -> f64| {
                            (f(c, x + hi * dx, yy + hi * dy) - f(c, x + lo * dx, yy + lo * dy))
                                / (hi - lo) as f64
                        };
                        let (ds, dt) = (diff(&s), diff(&t));
                        let v = if ds.abs() > dt.abs() { ds } else { dt };
                        let v = ds + share * (v - ds);
                        gradient += m * (diff(&g) - v).powi(2) / used.len() as f64;
                    }
                }
            }
        }
    }
    let weight = match options.weights {
        PaperWeights::Released => 0.2,
        PaperWeights::Lambda(lambda) => 0.5 * f64::from(lambda) * inside / outside,
    };
    let (gradient, color) = (500.0 / n * gradient, 1000.0 / n * color);
    PaperLoss { gradient, color, total: gradient + weight * color }
}

#[test]
fn the_loss_is_its_definition_and_its_derivatives_are_central_differences() {
    let scene = scene([20, 16]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    for options in variants() {
        let differences = Differences::new(&problem, on, &options).unwrap();
        let mut y: Vec<[f64; 3]> =
            (0..on.len()).map(|k| [0, 1, 2].map(|c| 0.4 + 0.2 * noise(3 * k + c))).collect();
        let mut bar = vec![[0.0; 3]; y.len()];
        let got = differences.evaluate(&y, &mut bar);
        let want = plain_loss(&scene, &options, &y);
        for (got, want) in
            [(got.gradient, want.gradient), (got.color, want.color), (got.total, want.total)]
        {
            // The guidance is kept in f32.
            assert!((got - want).abs() < 1e-6 * want, "{got} against {want}: {options:?}");
        }
        for k in (0..on.len()).step_by(7) {
            let c = k % 3;
            let h = 1e-4;
            let mut at = |value: f64| {
                let before = std::mem::replace(&mut y[k][c], value);
                let loss = differences.evaluate(&y, &mut vec![[0.0; 3]; y.len()]).total;
                y[k][c] = before;
                loss
            };
            let v = differences_value(&mut at, h, k, c);
            // Exact for a quadratic, up to rounding of a loss of order 10 over h.
            assert!((v - bar[k][c]).abs() < 1e-9, "{k} {c}: {v} against {}", bar[k][c]);
        }
    }
}

/// Central difference of the loss around the value that [`noise`] gave.
fn differences_value(at: &mut impl FnMut(f64) -> f64, h: f64, k: usize, c: usize) -> f64 {
    let value = 0.4 + 0.2 * noise(3 * k + c);
    (at(value + h) - at(value - h)) / (2.0 * h)
}

#[test]
fn the_discrete_minimum_is_one() {
    let scene = scene([48, 40]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    for options in variants() {
        let minimum = discrete_minimum(&problem, on, &options).unwrap();
        assert!(minimum.residual <= 1e-8);
        let least = minimum.loss.total;
        assert!(least > 0.0);
        let of = |samples: &Samples<2, 3>| paper_loss(&problem, on, &options, samples).unwrap();
        // What rounding the minimum to f32 costs is far below this.
        assert!((of(&minimum.samples).total / least - 1.0).abs() < 1e-9, "{options:?}");
        assert!(of(&scene.background).total > least);
        for step in [1e-3f32, -1e-3, 0.03] {
            let mut other = minimum.samples.clone();
            let bump = |(k, v): (usize, &mut f32)| *v += step * noise(k) as f32;
            other.as_planar_mut().iter_mut().enumerate().for_each(bump);
            assert!(of(&other).total > least, "{options:?} {step}");
        }
    }
}

#[test]
fn the_minimum_has_the_weights_of_the_whole_picture_and_differences_of_a_crop() {
    let scene = scene([48, 40]);
    let problem = problem(&scene);
    let (whole, options) = (scene.background.domain(), PaperOptions::default());
    let part = whole.cropped([8, 0], [32, 26]).unwrap();
    let all = discrete_minimum(&problem, whole, &options).unwrap();
    let crop = discrete_minimum(&problem, &part, &options).unwrap();
    let worst = all
        .samples
        .as_planar()
        .iter()
        .zip(crop.samples.as_planar())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    // The released weights are per sample in both terms: the crop changes their common factor alone.
    assert!(worst < 1e-6, "{worst}");
    let ratio = crop.loss.total / all.loss.total * part.len() as f64 / whole.len() as f64;
    assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
}

#[test]
fn a_network_comes_near_the_discrete_minimum() {
    let scene = scene([48, 40]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    let options = PaperOptions { steps: 600, rate: 2e-3, ..PaperOptions::default() };
    let minimum = discrete_minimum(&problem, on, &options).unwrap();
    let mut losses = Vec::new();
    let blend = train_paper(&problem, on, &options, |p| {
        losses.push(p.loss.total);
        true
    })
    .unwrap();
    assert_eq!((blend.steps, losses.len()), (600, 600));
    let means: Vec<f64> =
        losses.chunks(100).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    assert!(means.windows(2).all(|w| w[1] < w[0]), "{means:?}");
    let least = minimum.loss.total;
    assert!(blend.loss.total >= least);
    assert!(blend.loss.total < 1.5 * least, "{} against {least}", blend.loss.total);
    let measured = paper_loss(&problem, on, &options, &blend.samples).unwrap();
    assert_eq!(measured, blend.loss);
}

#[test]
fn signals_can_be_networks_and_the_start_can_be_the_background() {
    let scene = scene([32, 24]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    let mut first = Vec::new();
    for start in [PaperStart::Random, PaperStart::Background { steps: 300 }] {
        let signals = PaperSignals::Fitted { steps: 300 };
        let options =
            PaperOptions { steps: 3, rate: 2e-3, start, signals, ..PaperOptions::default() };
        let mut loss = None;
        train_paper(&problem, on, &options, |p| {
            loss.get_or_insert(p.loss);
            p.step < 2
        })
        .unwrap();
        first.push(loss.unwrap().color);
    }
    assert!(first[1] < 0.01 * first[0], "{first:?}");
}

#[test]
fn colours_at_the_boundary_alone_leave_the_background_to_itself() {
    let scene = scene([48, 40]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    let far = |color| {
        let options = PaperOptions { steps: 300, rate: 2e-3, color, ..PaperOptions::default() };
        let blend = train_paper(&problem, on, &options, |_| true).unwrap();
        // Everywhere, also where the loss does not look.
        let all = PaperOptions { color: ColorTerm::Outside, ..options };
        paper_loss(&problem, on, &all, &blend.samples).unwrap().color
    };
    let (outside, boundary) = (far(ColorTerm::Outside), far(ColorTerm::Boundary));
    assert!(boundary > 20.0 * outside, "{boundary} against {outside}");
}

#[test]
fn threads_do_not_change_a_bit() {
    let scene = scene([48, 40]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let options = PaperOptions { steps: 5, ..PaperOptions::default() };
            let blend = train_paper(&problem, on, &options, |_| true).unwrap();
            let minimum = discrete_minimum(&problem, on, &options).unwrap();
            let bits = |s: &Samples<2, 3>| -> Vec<u32> {
                s.as_planar().iter().map(|v| v.to_bits()).collect()
            };
            (bits(&blend.samples), bits(&minimum.samples), blend.loss.total.to_bits())
        })
    };
    assert!(run(1) == run(2));
}

#[test]
fn bad_options_are_typed_errors() {
    let scene = scene([20, 16]);
    let problem = problem(&scene);
    let on = scene.background.domain();
    let refuse = |options: PaperOptions, wanted: &str| {
        let error = discrete_minimum(&problem, on, &options).unwrap_err();
        assert!(
            matches!(error, Error::Parameter { name, .. } if name == wanted),
            "{error}: {options:?}"
        );
        assert!(train_paper(&problem, on, &options, |_| true).is_err());
    };
    let default = PaperOptions::default;
    refuse(PaperOptions { rate: 0.0, ..default() }, "rate");
    refuse(PaperOptions { omega: f32::NAN, ..default() }, "omega");
    refuse(PaperOptions { decay: -1.0, ..default() }, "decay");
    refuse(PaperOptions { weights: PaperWeights::Lambda(0.0), ..default() }, "lambda");
    assert_eq!(cropped(&scene.background, on).len(), on.len());
}
