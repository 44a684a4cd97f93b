//! Pictures of a lenslet array: below every lens a small picture of all directions. Pixel
//! `(x * U + u, y * V + v)` is pixel `(x, y)` of view `(u, v)`.

use super::LightField;
use crate::{Image, Result};

/// The views behind a grid of `[U, V]` pixels per lens; `Err` says what does not fit.
pub(super) fn decode(image: &Image, grid: [usize; 2]) -> std::result::Result<Image, String> {
    let [columns, rows] = grid;
    let (w, h) = (image.width(), image.height());
    let divides = |count: usize, size: usize| count > 0 && size.is_multiple_of(count);
    if !divides(columns, w) || !divides(rows, h) {
        return Err(format!("{w} x {h} pixels are not those of {columns} x {rows} views"));
    }
    let (width, height) = (w / columns, h / rows);
    Ok(image.rearranged(width, height * columns * rows, |x, row| {
        let (view, y) = (row / height, row % height);
        (x * columns + view % columns, y * rows + view / columns)
    }))
}

/// The picture of all lenslets.
pub(super) fn encode(field: &LightField) -> Result<Image> {
    let [width, height, columns, rows] = field.shape();
    Ok(field.as_strip().rearranged(width * columns, height * rows, |x, y| {
        let view = (y % rows) * columns + x % columns;
        (x / columns, view * height + y / rows)
    }))
}
