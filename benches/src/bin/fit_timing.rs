//! Fits a picture with a field kind and prints PSNR over time, one JSON line per report and one at the end.
//!
//! `fit_timing PICTURE KIND [SECONDS [TARGET_DB [ROWS [RATE TABLE_RATE BATCH]]]]`, KIND: hash, grid, siren, fourier,
//! diner, diner-cubic. Without a target (0) the schedule is laid over the seconds.

use std::time::Duration;

use inr_core::{
    Architecture, FitOptions, Frame, Interpolation, Network, Output, Samples, TrainOptions,
    Trainer, fit,
};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let [_, picture, kind, ..] = &args[..] else {
        eprintln!("usage: fit_timing PICTURE KIND [SECONDS [TARGET_DB [ROWS]]]");
        std::process::exit(2)
    };
    let number =
        |k: usize, default: f64| args.get(k).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (seconds, target, rows) = (number(3, 2.0), number(4, 0.0), number(5, 32768.0) as usize);
    let image =
        signal_io::read_image(picture, &signal_io::ReadOptions::default()).expect("a picture");
    let samples: Samples<2, 3> = image.to_samples().expect("three channels");
    let shape = samples.domain().shape();
    let (mut rate, mut table_rate) = (9e-3, 3e-2);
    let architecture = match kind.as_str() {
        "hash" => Architecture::hash(&shape, rows),
        "grid" => Architecture::grid(&shape, rows),
        "siren" => {
            rate = 1e-3;
            Architecture::siren(64, 3, 30.0)
        }
        "fourier" => {
            rate = 3e-3;
            Architecture::fourier(128, 10.0, 64, 3)
        }
        "diner" | "diner-cubic" => {
            (rate, table_rate) = (1e-3, 1e-2);
            let nearest = kind == "diner";
            let interpolation = if nearest { Interpolation::Nearest } else { Interpolation::Cubic };
            Architecture::diner(&shape, interpolation, 3, 64, 3, 6.0)
        }
        _ => panic!("unknown kind {kind}"),
    };
    rate = number(6, rate as f64) as f32;
    table_rate = number(7, table_rate as f64) as f32;
    let batch = number(8, 8192.0) as usize;
    let frame = Frame::of_cells(samples.domain());
    let network = Network::new(architecture, frame, Output::of_range(0.0, 1.0), 1)
        .expect("a good architecture");
    let parameters = network.parameter_count();
    let mut trainer =
        Trainer::new(network, TrainOptions { rate, table_rate, batch, ..TrainOptions::default() });
    let options = FitOptions {
        steps: u64::MAX,
        budget: Some(Duration::from_secs_f64(seconds)),
        target_psnr: (target > 0.0).then_some(target),
        peak: 1.0,
    };
    let mut next = 0.25;
    let report = fit(&mut trainer, &samples, &options, |_, now| {
        if now.seconds >= next && target == 0.0 {
            next *= 2.0;
            println!(
                "{{\"seconds\": {:.2}, \"steps\": {}, \"batch_psnr\": {:.2}}}",
                now.seconds, now.step, now.psnr
            );
        }
        true
    })
    .expect("converges");
    println!(
        "{{\"kind\": \"{kind}\", \"parameters\": {parameters}, \"steps\": {}, \"seconds\": {:.3}, \"psnr\": {:.2}}}",
        report.steps, report.seconds, report.psnr
    );
}
