//! A picture of pictures: rows and columns with labels.

use anyhow::Result;
use inr_core::Samples;
use signal_io::{Image, SampleType, Transfer};

use crate::compare::{canvas::Canvas, font};

/// Width of a cell, and space between two.
const CELL: usize = 220;
const GAP: usize = 8;
/// Of letters: font pixels are this many pixels wide.
const SCALE: usize = 1;
const LINE: usize = (font::HEIGHT + 5) * SCALE;
const PAPER: [f32; 3] = [0.93; 3];
const INK: [f32; 3] = [0.05; 3];

/// One picture with its label and a line of numbers.
pub struct Tile {
    /// What it is.
    pub label: String,
    /// A few numbers, or nothing.
    pub caption: String,
    /// What is shown.
    pub canvas: Canvas,
}

impl Tile {
    /// A tile of sRGB values.
    pub fn new(label: &str, caption: String, samples: &Samples<2, 3>) -> Result<Self> {
        let [w, h] = samples.domain().shape();
        let mut image = Image::new(w, h, &["R", "G", "B"], samples.as_planar().to_vec())?;
        (image.sample, image.transfer) = (SampleType::F32, Transfer::Srgb);
        Ok(Self { label: label.to_owned(), caption, canvas: Canvas::from_image(&image)? })
    }
}

/// Draws rows of tiles, each under its own headline.
pub fn draw(title: &str, rows: &[(String, Vec<Tile>)]) -> Result<Image> {
    let cell_height = |tiles: &[Tile]| -> Result<usize> {
        let mut height = 0;
        for tile in tiles {
            height = height.max(tile.canvas.scaled_to(CELL)?.size()[1]);
        }
        Ok(height)
    };
    let columns = rows.iter().map(|(_, tiles)| tiles.len()).max().unwrap_or(0);
    let mut height = GAP + LINE + GAP;
    for (_, tiles) in rows {
        height += 3 * LINE + cell_height(tiles)? + 2 * GAP;
    }
    let mut sheet = Canvas::new(GAP + columns * (CELL + GAP), height, PAPER)?;
    sheet.write(title, [GAP, GAP], SCALE, INK);
    let mut y = GAP + LINE + GAP;
    for (head, tiles) in rows {
        sheet.write(head, [GAP, y], SCALE, INK);
        for (k, tile) in tiles.iter().enumerate() {
            let x = GAP + k * (CELL + GAP);
            sheet.write(&fitting(&tile.label), [x, y + LINE], SCALE, INK);
            sheet.write(&fitting(&tile.caption), [x, y + 2 * LINE], SCALE, INK);
            sheet.put(&tile.canvas.scaled_to(CELL)?, [x, y + 3 * LINE]);
        }
        y += 3 * LINE + cell_height(tiles)? + 2 * GAP;
    }
    sheet.to_image()
}

/// As much of a text as fits a cell.
fn fitting(text: &str) -> String {
    text.chars().take(CELL / (font::ADVANCE * SCALE)).collect()
}
