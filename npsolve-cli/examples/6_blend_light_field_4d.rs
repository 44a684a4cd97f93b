//! Puts a sticker on a wall that five by five cameras see, in all views at once: D = 4.
//!
//! `cargo run --release -p npsolve-cli --example 6_blend_light_field_4d`

use inr_core::{BoxRegion, Domain, Field, Samples, Unit};
use poisson_loss::{Guidance, Options, Patch, Problem, solve};

/// Pixels that the wall moves by from one view to the next.
const DISPARITY: f32 = 0.6;
/// What the sticker's own photographs are brighter by.
const BRIGHTER: f32 = 0.2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // x, y, and the camera's place u, v.
    let domain = Domain::new([48, 40, 5, 5], [1.0; 4], [0.0; 4], Unit::Sample)?;
    let background = Samples::<4, 1>::from_fn(domain, |x| [wall(x)]);
    let patch = Samples::from_fn(domain, |x| [wall(x) + sticker(x) + BRIGHTER]);
    // A frame of pixels around the sticker that holds it in every view; all views.
    let region = BoxRegion::new([9.5, 7.5, -1.0, -1.0], [36.5, 30.5, 5.0, 5.0])?;
    let blend = solve(&Problem {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: [0.0; 4] },
        region: &region,
        guidance: Guidance::Patch,
        options: Options::default(),
    })?;

    let wanted = Samples::<4, 1>::from_fn(domain, |x| [wall(x) + sticker(x)]);
    let pairs = blend.samples.as_planar().iter().zip(wanted.as_planar());
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("Largest error in the 25 views: {worst:.5}, where pasting leaves {BRIGHTER:.5}");

    // The blend is a field: a camera between the cameras sees it, too.
    let field = blend.to_field();
    let pixels: Vec<[f32; 4]> =
        (0..48 * 40).map(|k| [(k % 48) as f32, (k / 48) as f32, 1.5, 2.25]).collect();
    let mut view = vec![[0.0]; pixels.len()];
    field.eval(&pixels, &mut view);
    let errors = pixels.iter().zip(&view).map(|(x, [y])| (y - wall(*x) - sticker(*x)).powi(2));
    let rmse = (errors.sum::<f32>() / view.len() as f32).sqrt();
    println!("Root mean square error of the view at 1.5, 2.25, where no camera is: {rmse:.5}");
    assert!(worst < 0.002 && rmse < 0.005);
    Ok(())
}

/// Where a point of the wall is in the view of the middle.
fn on_wall([x, y, u, v]: [f32; 4]) -> [f32; 2] {
    [x - DISPARITY * (u - 2.0), y - DISPARITY * (v - 2.0)]
}

fn wall(at: [f32; 4]) -> f32 {
    let [x, y] = on_wall(at);
    0.4 + 0.1 * (0.21 * x).sin() + 0.1 * (0.17 * y + 0.05 * x).cos()
}

/// A soft disc, zero from ten pixels on.
fn sticker(at: [f32; 4]) -> f32 {
    let [x, y] = on_wall(at);
    let squared = ((x - 23.0).powi(2) + (y - 19.0).powi(2)) / 100.0;
    0.3 * (1.0 - squared).max(0.0).powi(3)
}
