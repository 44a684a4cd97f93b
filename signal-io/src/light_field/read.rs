use std::path::Path;

use super::{LightField, lenslet, views};
use crate::budget::Budget;
use crate::codec::npy;
use crate::read::{HEAD, read_bytes};
use crate::strip::{listing, pictures};
use crate::{Error, Format, Image, ReadOptions, Result, decode_image};

/// What [`read_light_field`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LightFieldReadOptions {
    /// The limit for the whole light field, and what its numbers mean.
    pub read: ReadOptions,
    /// `[U, V]`: pixels across and down below each lens of a lenslet picture, where pixel
    /// `(x * U + u, y * V + v)` is pixel `(x, y)` of view `(u, v)`. Only for files that are pictures;
    /// arrays of four or five axes and folders tell their grid themselves.
    pub lenslet: Option<[usize; 2]>,
}

/// Reads a light field: an array, a folder of views, or the picture of a lenslet array.
///
/// * `.npy` with axes (V, U, Y, X, C) or (V, U, Y, X); numbers as in pictures, channels `Y`, `R G B`,
///   `R G B A` or `C0 C1 ...`.
/// * A folder: all files in it that have the extension of a picture, named by row and column of the
///   grid as `view_03_04.png` or `r3c4.exr`: the last two numbers before the extension. A pattern:
///   the files that fit; where it has two numbers, as `out_%02d_%02d_*.png`, these are row and column.
///   Rows (v) and columns (u) are sorted by their numbers, of which some may be left out for the whole
///   grid (0, 4, 8). All views must have one size, the same channels and transfer.
/// * Any picture, with [`LightFieldReadOptions::lenslet`]. Lenses are expected at whole pixels without
///   rotation: raw pictures of plenoptic cameras must be rectified first.
///
/// # Errors
/// Those of [`read_image`](crate::read_image), where `limit_bytes` bounds the whole light field;
/// [`Error::Mismatch`] with the first view that is not like the first one, [`Error::MissingView`],
/// [`Error::NoPlace`] for names without row and column, and [`Error::NotLenslets`] for pictures
/// without a grid or with one that does not divide their size.
pub fn read_light_field(
    path: impl AsRef<Path>,
    options: &LightFieldReadOptions,
) -> Result<LightField> {
    let path = path.as_ref();
    if let Some(files) = listing::candidates(path) {
        let (files, grid) = views::grid(path, files?)?;
        return LightField::from_strip(pictures::read(path, &files, &options.read)?, grid);
    }
    let (_, bytes) = read_bytes(path, &options.read, |head| check_head(path, head))?;
    decode_light_field(path, &bytes, options)
}

/// The same for an array or a lenslet picture that is in memory already; `name` stands for the path
/// in messages.
///
/// # Errors
/// Those of [`read_light_field`], without the ones of the file system.
pub fn decode_light_field(
    name: impl AsRef<Path>,
    bytes: &[u8],
    options: &LightFieldReadOptions,
) -> Result<LightField> {
    let name = name.as_ref();
    check_head(name, &bytes[..bytes.len().min(HEAD)])?;
    if let Some(field) = decode_array(name, bytes, &options.read)? {
        return Ok(field);
    }
    let image = decode_image(name, bytes, &options.read)?;
    let not_lenslets = |what| Error::NotLenslets { path: name.to_path_buf(), what };
    let grid = options.lenslet.ok_or_else(|| not_lenslets(size_alone(&image)))?;
    let strip = lenslet::decode(&image, grid).map_err(not_lenslets)?;
    LightField::from_strip(strip, grid)
}

fn size_alone(image: &Image) -> String {
    format!("{} x {} pixels without the grid of their lenslets", image.width(), image.height())
}

/// An array of four or five axes; `None` for other files.
fn decode_array(name: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Option<LightField>> {
    let is_array = match Format::from_content(bytes) {
        Some(format) => format == Format::Npy,
        None => Format::from_extension(name) == Some(Format::Npy),
    };
    if !is_array {
        return Ok(None);
    }
    let budget = Budget::new(options.limit_bytes);
    let decoded = npy::decode_grid(bytes, &budget)
        .map_err(|fault| fault.at(name, Format::Npy.name(), "read"))?;
    let Some((mut strip, grid)) = decoded else { return Ok(None) };
    strip.transfer = options.transfer.unwrap_or(strip.transfer);
    LightField::from_strip(strip, grid).map(Some)
}

/// Whether the first bytes, or the name, are those of a picture or an array.
fn check_head(path: &Path, head: &[u8]) -> Result<()> {
    crate::read::find_format(path, head).map(|_| ())
}
