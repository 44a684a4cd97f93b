//! The contact sheet: every result around the region, and below it its difference to ours.

use std::path::Path;

use anyhow::Result;
use signal_io::Image;

use crate::scene::Scene;

use super::canvas::Canvas;
use super::font;
use super::methods::{self, Case, Row};

/// Differences are shown this many times larger: one grey level in 8 bits becomes visible.
const GAIN: f32 = 8.0;
/// Width of a cell and how many go side by side: a sheet fits a common screen.
const CELL: usize = 300;
const COLUMNS: usize = 4;
const GAP: usize = 12;
/// Of letters; two pixels per font pixel are readable at arm's length.
const SCALE: usize = 2;
const LINE: usize = (font::HEIGHT + 4) * SCALE;
const PAPER: [f32; 3] = [0.93; 3];
const INK: [f32; 3] = [0.05; 3];
/// Share of the region's size that is shown around it, and its least in pixels.
const MARGIN: (f32, f32) = (0.2, 12.0);

/// The absolute difference of a result to ours as a screen shows both, eight times enlarged.
pub fn difference(result: Canvas, ours: &Canvas) -> Result<Image> {
    result.difference(ours, GAIN).to_image()
}

/// Draws the sheet; `view` shows the planes of a result.
pub fn draw<const D: usize>(
    case: &Case<'_, D>,
    rows: &[Row],
    view: &dyn Fn(&[f32]) -> Result<Canvas>,
) -> Result<Image> {
    let ours = view(methods::ours(rows)?)?;
    let cell_height = ours.scaled_to(CELL)?.size()[1];
    let block = [CELL + GAP, 2 * LINE + 2 * cell_height + 2 * GAP];
    let head = 2 * LINE + 2 * GAP;
    let columns = COLUMNS.min(rows.len());
    let lines = rows.len().div_ceil(COLUMNS);
    let (width, height) = (GAP + columns * block[0], head + lines * block[1]);
    let mut sheet = Canvas::new(width, height, PAPER)?;

    sheet.write(&title(case), [GAP, GAP], SCALE, INK);
    let legend = format!("below each result: |difference to ours| x{GAIN}");
    sheet.write(&legend, [GAP, GAP + LINE], SCALE, INK);
    for (k, row) in rows.iter().enumerate() {
        let at = [GAP + k % COLUMNS * block[0], head + k / COLUMNS * block[1]];
        sheet.write(&fitting(&row.method.label), at, SCALE, INK);
        sheet.write(&fitting(&caption(row)), [at[0], at[1] + LINE], SCALE, INK);
        let Some(planes) = &row.planes else { continue };
        let result = view(planes)?;
        let difference = result.clone().difference(&ours, GAIN);
        let y = at[1] + 2 * LINE;
        sheet.put(&result.scaled_to(CELL)?, [at[0], y]);
        sheet.put(&difference.scaled_to(CELL)?, [at[0], y + cell_height + GAP / 2]);
    }
    sheet.to_image()
}

fn title<const D: usize>(case: &Case<'_, D>) -> String {
    let file = |k: usize| {
        let name = Path::new(&case.setup.names[k]).file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let name = match case.name.is_empty() {
        true => format!("{} into {}", file(1), file(0)),
        false => case.name.clone(),
    };
    format!("{name}: guidance {}", case.guidance)
}

fn caption(row: &Row) -> String {
    match &row.metrics {
        Some(m) => format!("seam {:.2} max {:.1}", 255.0 * m.seam_rms, 255.0 * m.seam_max),
        None => "failed".to_owned(),
    }
}

/// As much of a text as fits a cell.
fn fitting(text: &str) -> String {
    text.chars().take(CELL / (font::ADVANCE * SCALE)).collect()
}

/// The part of a picture around the mask.
pub fn around(scene: &Scene, planes: &[f32]) -> Result<Canvas> {
    let (start, size) = surroundings(scene);
    Canvas::from_image(&scene.picture(planes.to_vec(), false)?)?.cropped(start, size)
}

/// First pixel and size of the part of the background around the mask.
fn surroundings(scene: &Scene) -> ([usize; 2], [usize; 2]) {
    let domain = scene.mask.domain();
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for (k, weight) in scene.mask.weights().iter().enumerate() {
        if *weight > 0.0 {
            let index = domain.unflatten(k);
            for d in 0..2 {
                let x = index[d] as f32 + scene.offset[d];
                (low[d], high[d]) = (low[d].min(x), high[d].max(x));
            }
        }
    }
    let shape = [scene.background.width(), scene.background.height()];
    let extent = (high[0] - low[0]).max(high[1] - low[1]);
    let margin = (MARGIN.0 * extent).max(MARGIN.1);
    let pixel = |x: f32, d: usize| x.clamp(0.0, (shape[d] - 1) as f32) as usize;
    let start: [usize; 2] = std::array::from_fn(|d| pixel(low[d] - margin, d));
    let end: [usize; 2] = std::array::from_fn(|d| pixel(high[d] + margin, d));
    (start, std::array::from_fn(|d| end[d] - start[d] + 1))
}
