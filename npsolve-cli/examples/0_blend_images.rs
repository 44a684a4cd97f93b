//! Blends two pictures: `cargo run --release -p npsolve-cli --example 0_blend_images`.

use inr_core::{RasterMask, Translated};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};
use signal_io::{Image, ReadOptions, WriteOptions, read_image, write_image};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
    let read = |name| read_image(format!("{assets}/{name}"), &ReadOptions::default());
    let (coffee, cat, mask) = (read("coffee.jpg")?, read("cat.jpg")?, read("cat_mask.png")?);
    let (background, samples) = (&coffee.to_samples::<3>()?, &cat.to_samples()?);
    let offset = [420.0, 6.0]; // The patch's top-left corner in the background.
    let mask = RasterMask::new(mask.domain(), mask.plane(0).to_vec())?;
    let (region, patch) =
        (&Translated { region: mask, offset }, Patch::Samples { samples, offset });
    let (guidance, options) = (Guidance::Patch, Options::default());
    let blend = solve(&Problem { background, patch, region, guidance, options })?;
    let target = std::env::temp_dir().join("npsolve-example-0.png");
    let force = WriteOptions { force: true, ..WriteOptions::default() };
    write_image(&target, &Image::from_samples(&blend.samples, &coffee)?, &force)?;
    println!("{} iterations; look at {}", blend.report.iterations, target.display());
    Ok(())
}
