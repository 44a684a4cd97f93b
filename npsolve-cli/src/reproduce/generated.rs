//! Scenes drawn by formulas, for where no photographs are at hand.

use anyhow::Result;
use inr_core::{Domain, RasterMask, Samples};

use super::setting::Setting;

/// An object on a slope of light, and writing on a texture.
pub fn settings() -> Result<Vec<Setting>> {
    Ok(vec![ball()?, letters()?])
}

/// A shaded ball from a bright picture into a darker slope.
fn ball() -> Result<Setting> {
    let background = Samples::from_fn(Domain::unit([240, 180])?, |[x, y]| {
        let light = 0.3 + 0.0012 * x + 0.0006 * y;
        let grain = 0.02 * (0.9 * x).sin() * (0.7 * y).cos();
        [light + grain, 0.9 * light + grain, 0.25 + 0.6 * light]
    });
    let small = Domain::unit([96, 96])?;
    let from_middle = |[x, y]: [f32; 2]| [(x - 47.5) / 36.0, (y - 47.5) / 36.0];
    let patch = Samples::from_fn(small, |x| {
        let [u, v] = from_middle(x);
        let r = u.hypot(v);
        let height = (1.0 - r * r).max(0.0).sqrt();
        let shade = 0.45 + 0.5 * (0.4 * height - 0.5 * u - 0.6 * v).max(0.0);
        let ball = [0.95 * shade, 0.7 * shade, 0.5 * shade];
        let sky = [0.6 + 0.03 * v, 0.62, 0.6 + 0.03 * u];
        if r < 1.0 { ball } else { sky }
    });
    let inside = |k: usize| {
        let [x, y] = small.unflatten(k).map(|i| i as f32);
        let [u, v] = from_middle([x, y]);
        f32::from(u8::from(u.hypot(v) < 1.14))
    };
    let mask = RasterMask::new(small, (0..small.len()).map(inside).collect())?;
    Ok(Setting { name: "ball".to_owned(), background, patch, mask, offset: [88.0, 44.0] })
}

/// Dark strokes on paper into a brick pattern.
fn letters() -> Result<Setting> {
    let background = Samples::from_fn(Domain::unit([220, 160])?, |[x, y]| {
        let (row, shift) = ((y / 16.0).floor(), 14.0 * ((y / 16.0).floor() % 2.0));
        let joint = y % 16.0 < 2.0 || (x + shift) % 28.0 < 2.0;
        let grain = 0.03 * (1.7 * x + 3.0 * row).sin() * (1.3 * y).cos();
        let brick = [0.55 + grain, 0.3 + grain, 0.22 + grain];
        if joint { [0.62; 3] } else { brick }
    });
    let small = Domain::unit([120, 60])?;
    let patch = Samples::from_fn(small, |[x, y]| {
        let (u, v) = (x % 30.0 - 15.0, y - 30.0);
        let stroke = ((u.hypot(0.6 * v) - 10.0).abs() < 2.5) || (u.abs() < 2.0 && v.abs() < 12.0);
        let ink = if stroke { 0.15 } else { 0.92 };
        [ink, ink, ink + 0.03]
    });
    let inside = |k: usize| {
        let [x, y] = small.unflatten(k);
        f32::from(u8::from((3..117).contains(&x) && (3..57).contains(&y)))
    };
    let mask = RasterMask::new(small, (0..small.len()).map(inside).collect())?;
    Ok(Setting { name: "letters".to_owned(), background, patch, mask, offset: [50.0, 50.0] })
}
