//! Blends the sample scenes into networks and prints what each reaches, one JSON line per scene.
//!
//! `neural_timing KIND SECONDS [SCENE]`: KIND is spline-grid, which begins at the exact solution, or grid, siren or
//! diner, which are trained to be it; SCENE keeps the scenes whose name holds it.

use std::time::{Duration, Instant};

use inr_core::{
    Architecture, Frame, Interpolation, Network, Output, Spline, TrainOptions, Trainer, Translated,
};
use npsolve_tests::scenes::scenes;
use poisson_loss::{
    Guidance, NeuralOptions, Options, Patch, Problem, insert, measure, neural_box, solve,
    train_blend,
};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let (Some(kind), Some(Ok(seconds))) = (args.get(1), args.get(2).map(|s| s.parse::<f64>()))
    else {
        eprintln!("usage: neural_timing KIND SECONDS [SCENE]");
        std::process::exit(2)
    };
    let only = args.get(3).map_or("", String::as_str);
    for scene in scenes().unwrap_or_default().iter().filter(|s| s.name.contains(only)) {
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
        let usual = TrainOptions::default();
        let (architecture, train) = match kind.as_str() {
            "spline-grid" => {
                let small = TrainOptions { rate: 1e-4, table_rate: 1e-5, ..usual };
                (Architecture::spline_grid(&shape, 3), small)
            }
            "grid" => (Architecture::grid(&shape, 1 << 15), usual),
            "siren" => (Architecture::siren(128, 3, 30.0), TrainOptions { rate: 1e-3, ..usual }),
            "diner" => (
                Architecture::diner(&shape, Interpolation::Cubic, 3, 64, 2, 6.0),
                TrainOptions { rate: 1e-3, table_rate: 1e-2, ..usual },
            ),
            other => panic!("unknown kind {other}"),
        };
        let output = Output::of_range(0.0, 1.0);
        let mut network = Network::new(architecture, Frame::of_samples(&on), output, 1)
            .expect("a good architecture");
        let begins_there = kind == "spline-grid";
        if begins_there {
            let spline = Spline::interpolate(&exact.samples);
            network.load_spline(&spline).expect("a level with a node per sample");
        }
        let parameters = network.parameter_count();
        let mut trainer = Trainer::new(network, train);
        let options = NeuralOptions {
            steps: u64::MAX,
            budget: Some(Duration::from_secs_f64(seconds).saturating_sub(begin.elapsed())),
            tolerance: Some(1e-3),
            distill: if begins_there { 0.0 } else { 0.9 },
        };
        let report = train_blend(&problem, &exact, &on, &mut trainer, &options, |_| true)
            .expect("no divergence");
        let samples = insert(&scene.background, &trainer.network, &on, 8);
        let seconds = begin.elapsed().as_secs_f64();
        let m = measure(&problem, &samples, Some(&exact.samples)).expect("finite samples");
        println!(
            "{{\"scene\": \"{}\", \"region\": {:.0}, \"box\": {shape:?}, \"parameters\": {parameters}, \
             \"steps\": {}, \"seconds\": {seconds:.2}, \"excess_percent\": {:.3}, \
             \"levels_inside\": {:.3}, \"psnr_outside\": {:.1}}}",
            scene.name,
            exact.report.region_samples,
            report.last.step,
            100.0 * m.excess_energy.unwrap_or(f64::NAN),
            255.0 * m.rmse_inside.unwrap_or(f64::NAN),
            m.psnr_outside,
        );
    }
}
