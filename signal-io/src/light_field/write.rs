use std::path::Path;

use super::{LightField, lenslet};
use crate::codec::npy;
use crate::plan::Plan;
use crate::strip::folder::Series;
use crate::strip::pattern::is_pattern;
use crate::{
    Error, Format, Result, SampleType, Transfer, WriteOptions, WriteReport, atomic, check_target,
    write_image,
};

/// The forms of light fields this crate knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LightFieldFormat {
    /// A NumPy array with axes (V, U, Y, X, C).
    Array,
    /// A folder of pictures named by row and column.
    Views,
    /// One picture with all directions below each lens.
    Lenslets,
}

impl LightFieldFormat {
    /// What [`read_light_field`](crate::read_light_field) knows.
    pub const READABLE: &'static str = "npy, a folder of views, a pattern such as \
        view_%02d_%02d.png, a picture of lenslets with its grid";
    /// What [`write_light_field`] knows.
    pub const WRITABLE: &'static str = Self::READABLE;

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Array => "npy",
            Self::Views => "folder of views",
            Self::Lenslets => "lenslet picture",
        }
    }
}

/// What [`write_light_field`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LightFieldWriteOptions {
    /// Overwriting, number type and JPEG quality, as for pictures.
    pub write: WriteOptions,
    /// The target is a picture of lenslets. Without it pictures are no targets, as the grid is not
    /// stored in them.
    pub lenslet: bool,
}

/// What [`write_light_field`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightFieldReport {
    /// The form written.
    pub format: LightFieldFormat,
    /// The number type written.
    pub sample: SampleType,
    /// What the values in the file mean.
    pub transfer: Transfer,
    /// Views written.
    pub views: usize,
    /// Colour samples written (alpha not counted).
    pub samples: usize,
    /// How many of them were moved to the nearest value that the number type has by more than
    /// rounding.
    pub clipped: usize,
}

/// The names of views in a folder for which no pattern is given: row and column, from 0.
const VIEWS: &str = "view_%02d_%02d.png";

/// Where a path leads.
enum Target {
    Array,
    Views(Series),
    Lenslets,
}

fn target(path: &Path, lenslet: bool) -> Result<Target> {
    if lenslet {
        return Ok(Target::Lenslets);
    }
    // Patterns come first: `view_%d_%d.npy` are many arrays.
    if let Some(series) = Series::of_path(path, 2, VIEWS) {
        return Ok(Target::Views(series));
    }
    match Format::from_extension(path) {
        Some(Format::Npy) if !is_pattern(path) => Ok(Target::Array),
        _ => Err(Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: crate::format::extension(path),
            known: LightFieldFormat::WRITABLE,
        }),
    }
}

/// Writes a light field completely or not at all; the name of the target says the form.
///
/// * `.npy`: an array with axes (V, U, Y, X, C), or (V, U, Y, X) for one channel.
/// * `folder/view_%02d_%02d.png`, or a folder (an existing one, a name without extension, or with a
///   slash at its end), which gets `view_00_00.png` and so on: a picture for each view, named by row
///   (v) and column (u) from 0, see [`write_image`]. A new folder appears when it is complete; in an
///   existing one the files are renamed into place when all are written.
/// * Any picture with [`LightFieldWriteOptions::lenslet`]: pixel `(x * U + u, y * V + v)` is pixel
///   `(x, y)` of view `(u, v)`. The grid must be told again when it is read.
///
/// # Errors
/// Those of [`write_image`]. [`Error::CannotHold`] also when an existing folder has views of a larger
/// grid, which would be left over among the new ones.
pub fn write_light_field(
    path: impl AsRef<Path>,
    field: &LightField,
    options: &LightFieldWriteOptions,
) -> Result<LightFieldReport> {
    let path = path.as_ref();
    let [_, _, columns, rows] = field.shape();
    let views = columns * rows;
    let (format, report) = match target(path, options.lenslet)? {
        Target::Array => (LightFieldFormat::Array, write_array(path, field, &options.write)?),
        Target::Views(series) => {
            let numbers: Vec<_> = (0..views).map(|k| vec![k / columns, k % columns]).collect();
            let view = |k: usize| field.view(k % columns, k / columns);
            (LightFieldFormat::Views, series.write(&numbers, view, &options.write)?)
        }
        Target::Lenslets => {
            let image = lenslet::encode(field)?;
            (LightFieldFormat::Lenslets, write_image(path, &image, &options.write)?)
        }
    };
    let WriteReport { sample, transfer, samples, clipped, .. } = report;
    Ok(LightFieldReport { format, sample, transfer, views, samples, clipped })
}

fn write_array(path: &Path, field: &LightField, options: &WriteOptions) -> Result<WriteReport> {
    atomic::check_place(path, options.force)?;
    let named = |fault: crate::error::Fault| fault.at(path, Format::Npy.name(), "write");
    let strip = field.as_strip();
    let plan = Plan::new(Format::Npy, "npy", strip, options).map_err(named)?;
    let [_, height, columns, rows] = field.shape();
    let clipped = atomic::replace(path, options.force, |writer| {
        npy::encode_rows(strip, &[rows, columns, height], &plan, writer).map_err(named)
    })?;
    let samples = strip.color_count() * strip.pixel_count();
    let (sample, transfer) = (plan.sample, plan.transfer);
    Ok(WriteReport { format: Format::Npy, sample, transfer, samples, clipped })
}

/// Everything about a target that can be known before there is a light field: form, folder, existing
/// files. Call it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_light_field_target(
    path: impl AsRef<Path>,
    options: &LightFieldWriteOptions,
) -> Result<()> {
    let path = path.as_ref();
    let force = options.write.force;
    match target(path, options.lenslet)? {
        Target::Array => atomic::check_place(path, force),
        Target::Views(series) => series.check(force),
        Target::Lenslets => check_target(path, force),
    }
}
