//! Blends the sample scenes with a network and prints, per scene, what it reaches: one JSON line each.
//!
//! `neural_timing KIND SECONDS [SCENE [RATE TABLE_RATE BATCH DISTILL]]`, KIND: grid or siren.

use std::time::{Duration, Instant};

use inr_core::{
    Activation, Architecture, Encoding, Frame, Interpolation, Level, Network, Output, TrainOptions,
    Trainer, Translated,
};
use npsolve_tests::scenes::scenes;
use poisson_loss::{
    Guidance, NeuralOptions, Options, Patch, Problem, insert, measure, neural_box, solve,
    train_blend,
};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let number =
        |k: usize, default: f64| args.get(k).and_then(|v| v.parse().ok()).unwrap_or(default);
    let kind = args.get(1).map_or("grid", String::as_str);
    let only = args.get(3).cloned().unwrap_or_default();
    for scene in scenes().unwrap_or_default() {
        if !scene.name.contains(&only) {
            continue;
        }
        let region = Translated { region: scene.mask.clone(), offset: scene.offset };
        let problem = Problem {
            background: &scene.background,
            patch: Patch::Samples { samples: &scene.patch, offset: scene.offset },
            region: &region,
            guidance: Guidance::Patch,
            options: Options { tolerance: 1e-4, ..Options::default() },
        };
        let begin = Instant::now();
        let exact = solve(&problem).expect("a solvable scene");
        let on = neural_box(&problem, &exact);
        let shape = on.shape();
        let mut train = TrainOptions {
            rate: number(4, 9e-3) as f32,
            table_rate: number(5, 3e-2) as f32,
            batch: number(6, 8192.0) as usize,
            ..TrainOptions::default()
        };
        let architecture = match kind {
            "grid" => Architecture::grid(&shape, 1 << 15),
            "full" => {
                let mut a = Architecture::grid(&shape, 1 << 20);
                let Encoding::Grid(g) = &mut a.encoding else { unreachable!() };
                let f = number(8, 1.0);
                g.features = number(9, 4.0) as usize;
                let growth = number(10, 2.0);
                let count = number(11, 4.0) as usize;
                g.levels = (0..count)
                    .map(|k| {
                        let s = growth.powi(k as i32 + 1 - count as i32) / f;
                        let nodes: Vec<usize> = shape
                            .iter()
                            .map(|n| ((*n as f64 * s).round() as usize).max(1) + 3)
                            .collect();
                        Level { rows: nodes.iter().product(), nodes }
                    })
                    .collect();
                a.mlp.width = number(12, 64.0) as usize;
                a.mlp.depth = number(13, 2.0) as usize;
                a
            }
            "spline-grid" => Architecture::spline_grid(&shape, 3),
            "siren" => {
                train.rate = number(4, 1e-3) as f32;
                Architecture::siren(128, 3, 30.0)
            }
            "diner" => Architecture::diner(&shape, Interpolation::Cubic, 3, 64, 3, 6.0),
            _ => panic!("unknown kind {kind}"),
        };
        let _ = Activation::Relu;
        let network =
            Network::new(architecture, Frame::of_samples(&on), Output::of_range(0.0, 1.0), 1)
                .expect("good numbers");
        let mut network = network;
        if kind == "spline-grid" {
            let spline = Spline::interpolate(&exact.samples);
            network.load_spline(&spline).expect("a spline grid");
        }
        let parameters = network.parameter_count();
        let mut trainer = Trainer::new(network, train);
        let options = NeuralOptions {
            steps: u64::MAX,
            budget: Some(Duration::from_secs_f64(number(2, 5.0)).saturating_sub(begin.elapsed())),
            distill: number(7, 0.9),
            tolerance: (number(14, 0.0) > 0.0).then(|| number(14, 0.0)),
            ..NeuralOptions::default()
        };
        let report = train_blend(&problem, &exact, &on, &mut trainer, &options, |_| true)
            .expect("converges");
        let samples = insert(&scene.background, &trainer.network, &on, 8);
        let seconds = begin.elapsed().as_secs_f64();
        let m = measure(&problem, &samples, Some(&exact.samples)).expect("measurable");
        println!(
            "{{\"scene\": \"{}\", \"region\": {:.0}, \"box\": {:?}, \"parameters\": {parameters}, \"steps\": {}, \
             \"staging\": {:.2}, \"seconds\": {seconds:.2}, \"excess_percent\": {:.2}, \"rmse_inside\": {:.2}, \"rmse\": {:.2}, \"psnr_outside\": {:.1}}}",
            scene.name,
            exact.report.region_samples,
            shape,
            report.last.step,
            report.staging,
            100.0 * m.excess_energy.unwrap_or(f64::NAN),
            255.0 * m.rmse_inside.unwrap_or(f64::NAN),
            255.0 * m.rmse_to_exact.unwrap_or(f64::NAN),
            m.psnr_outside,
        );
    }
}
