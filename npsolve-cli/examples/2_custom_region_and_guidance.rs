//! A region made of shapes, and a guidance rule of one's own.
//!
//! `cargo run --release -p npsolve-cli --example 2_custom_region_and_guidance`

use std::sync::Arc;

use inr_core::{BoxRegion, Complement, Ellipsoid, Intersection, Jet};
use poisson_loss::{Guidance, Options, Patch, Problem, Strongest, measure, solve};
use signal_io::{Image, ReadOptions, WriteOptions, read_image, write_image};

/// Where the patch's top-left corner goes.
const OFFSET: [f32; 2] = [420.0, 6.0];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
    let read = |name| read_image(format!("{assets}/{name}"), &ReadOptions::default());
    let (coffee, cat) = (read("coffee.jpg")?, read("cat.jpg")?);
    let (background, patch) = (coffee.to_samples::<3>()?, cat.to_samples::<3>()?);

    // An ellipse without a slot: no mask file, exact at any resolution.
    let ellipse = Ellipsoid::new([505.0, 80.0], [78.0, 66.0])?;
    let slot = BoxRegion::new([500.0, 0.0], [510.0, 40.0])?;
    let region = Intersection::new(vec![Box::new(ellipse), Box::new(Complement(slot))]);

    // Follow the patch where it is bright, else whichever gradient is stronger.
    let own = |x: &[f32; 2], background: &Jet<2, 3>, patch: &Jet<2, 3>| {
        let brightness = patch.value.iter().sum::<f32>() / 3.0;
        let rule = match brightness > 0.5 {
            true => Guidance::Patch,
            false => Guidance::Strongest(Strongest::Joint),
        };
        rule.evaluate(x, background, patch)
    };

    println!("{:<12}{:>8}{:>12}{:>14}", "guidance", "steps", "m1", "seam (levels)");
    for (name, guidance) in [
        ("patch", Guidance::Patch),
        ("strongest", Guidance::Strongest(Strongest::Joint)),
        ("own", Guidance::Custom(Arc::new(own))),
    ] {
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: OFFSET },
            region: &region,
            guidance,
            options: Options::default(),
        };
        let blend = solve(&problem)?;
        let metrics = measure(&problem, &blend.samples, None)?;
        let (steps, seam) = (blend.report.iterations, 255.0 * metrics.seam_rms);
        println!("{name:<12}{steps:>8}{:>12.2e}{seam:>14.2}", metrics.m1);
        let target = std::env::temp_dir().join(format!("npsolve-example-2-{name}.png"));
        let force = WriteOptions { force: true, ..WriteOptions::default() };
        write_image(&target, &Image::from_samples(&blend.samples, &coffee)?, &force)?;
        println!("            {}", target.display());
    }
    Ok(())
}
