//! A picture as a network, and a blend as one: fit, save, load, evaluate.
//!
//! `cargo run --release -p npsolve-cli --example 4_networks`

use std::collections::BTreeMap;
use std::time::Duration;

use inr_core::{
    Architecture, Checkpoint, Ellipsoid, Field, FitOptions, Frame, Jet, Network, Output, Spline,
    TrainOptions, Trainer, fit,
};
use poisson_loss::{Guidance, Options, Patch, Problem, neural_box, solve};
use signal_io::{ReadOptions, read_image};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
    let read = |name| read_image(format!("{assets}/{name}"), &ReadOptions::default());
    let (coffee, cat) = (read("coffee.jpg")?, read("cat.jpg")?);
    let (background, patch) = (coffee.to_samples::<3>()?, cat.to_samples::<3>()?);
    let domain = *background.domain();

    // A hash grid with 2^13 rows per level, trained for two seconds.
    let architecture = Architecture::hash(&domain.shape(), 1 << 13);
    let output = Output::of_range(0.0, 1.0);
    let network = Network::<2, 3>::new(architecture, Frame::of_cells(&domain), output, 1)?;
    let options = TrainOptions { rate: 9e-3, table_rate: 3e-2, ..TrainOptions::default() };
    let mut trainer = Trainer::new(network, options);
    let limits = FitOptions {
        steps: u64::MAX,
        budget: Some(Duration::from_secs(2)),
        target_psnr: None,
        peak: 1.0,
    };
    let report = fit(&mut trainer, &background, &limits, |_, _| true)?;
    let parameters = trainer.network.parameter_count();
    println!(
        "coffee.jpg in {parameters} numbers: {:.1} dB after {} steps",
        report.psnr, report.steps
    );

    // The exact blend, held by a network whose finest table has a node per sample.
    let problem = Problem {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: [420.0, 6.0] },
        region: &Ellipsoid::new([505.0, 80.0], [78.0, 66.0])?,
        guidance: Guidance::Patch,
        options: Options::default(),
    };
    let blend = solve(&problem)?;
    let on = neural_box(&problem, &blend);
    let architecture = Architecture::spline_grid(&on.shape(), 3);
    let mut network = Network::<2, 3>::new(architecture, Frame::of_samples(&on), output, 1)?;
    network.load_spline(&Spline::interpolate(&blend.samples))?;

    // To bytes with all conventions, and back.
    let checkpoint = Checkpoint {
        network,
        domain: on,
        notes: BTreeMap::new(),
        range: [0.0, 1.0],
        training: None,
    };
    let bytes = checkpoint.to_bytes()?;
    let network = Checkpoint::<2, 3>::from_bytes(&bytes)?.network;
    let (field, at) = (blend.to_field(), [[505.3, 80.7]]);
    let mut jets = [[Jet::<2, 3>::ZERO]; 2];
    field.eval_jet(&at, &mut jets[0]);
    network.eval_jet(&at, &mut jets[1]);
    println!("red and its gradient in the region, {} bytes:", bytes.len());
    for (name, [jet]) in ["the blend", "the network"].iter().zip(jets) {
        println!("{name:>12} {:.5} {:.5?}", jet.value[0], jet.grad[0]);
    }
    Ok(())
}
