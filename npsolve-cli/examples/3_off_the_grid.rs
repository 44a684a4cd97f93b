//! A blend is a continuous field: values and gradients anywhere, at any resolution.
//!
//! `cargo run --release -p npsolve-cli --example 3_off_the_grid`

use inr_core::{Ellipsoid, Field, Jet};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};
use signal_io::{Image, ReadOptions, WriteOptions, read_image, write_image};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
    let read = |name| read_image(format!("{assets}/{name}"), &ReadOptions::default());
    let (coffee, cat) = (read("coffee.jpg")?, read("cat.jpg")?);
    let (background, patch) = (coffee.to_samples::<3>()?, cat.to_samples::<3>()?);
    let problem = Problem {
        background: &background,
        // A third of a pixel off the lattice: placement is continuous, too.
        patch: Patch::Samples { samples: &patch, offset: [420.33, 6.0] },
        region: &Ellipsoid::new([505.0, 80.0], [78.0, 66.0])?,
        guidance: Guidance::Patch,
        options: Options::default(),
    };
    let field = solve(&problem)?.to_field();

    // Points on a curve across the edge of the region, none of them a pixel.
    let points: Vec<[f32; 2]> =
        (0..6).map(|k| [417.3 + 6.1 * k as f32, 70.7 + 2.9 * k as f32]).collect();
    let mut jets = vec![Jet::<2, 3>::ZERO; points.len()];
    field.eval_jet(&points, &mut jets);
    println!("{:>8}{:>8}{:>9}{:>12}{:>16}", "x", "y", "red", "d red/dx", "by differences");
    for ([x, y], jet) in points.iter().zip(&jets) {
        let step = 0.01;
        let mut ends = [[0.0; 3]; 2];
        field.eval(&[[x - step, *y], [x + step, *y]], &mut ends);
        let difference = (ends[1][0] - ends[0][0]) / (2.0 * step);
        let (red, slope) = (jet.value[0], jet.grad[0][0]);
        println!("{x:>8.2}{y:>8.2}{red:>9.4}{slope:>12.5}{difference:>16.5}");
    }

    // The cat's eye, 40 x 30 pixels of the blend, drawn with 640 x 480.
    let window = background.domain().cropped([440, 45], [40, 30])?.resized([640, 480])?;
    let zoomed = field.eval_lattice(&window, [0, 0]);
    let target = std::env::temp_dir().join("npsolve-example-3.png");
    let force = WriteOptions { force: true, ..WriteOptions::default() };
    write_image(&target, &Image::from_samples(&zoomed, &coffee)?, &force)?;
    println!("The cat's eye sixteen times enlarged: {}", target.display());
    Ok(())
}
