use std::path::Path;

use crate::codec::encode;
use crate::format::extension;
use crate::plan::Plan;
use crate::{Error, Format, Image, Result, SampleType, Transfer, atomic};

/// What [`write_image`] shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteOptions {
    /// Replace an existing file.
    pub force: bool,
    /// The number type to store; `None` takes the image's own where the format has it, else the
    /// nearest that loses least.
    pub sample: Option<SampleType>,
    /// JPEG quality, 1 to 100. Default: 95.
    pub jpeg_quality: u8,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { force: false, sample: None, jpeg_quality: 95 }
    }
}

/// What [`write_image`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteReport {
    /// The format written.
    pub format: Format,
    /// The number type written.
    pub sample: SampleType,
    /// What the values in the file mean.
    pub transfer: Transfer,
    /// Colour samples written (alpha not counted).
    pub samples: usize,
    /// How many of them were outside the range of the number type by more than rounding, or NaN
    /// where the format has none, and were moved to the nearest value it has.
    pub clipped: usize,
}

/// Writes a picture completely or not at all; the extension says the format.
///
/// The crate's first page has the table of formats, depths and conversions.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`], [`Error::NotAFile`],
/// [`Error::CannotHold`], [`Error::Encode`] and [`Error::Io`]; in each case there is no new file and
/// an existing one is unchanged.
pub fn write_image(
    path: impl AsRef<Path>,
    image: &Image,
    options: &WriteOptions,
) -> Result<WriteReport> {
    let path = path.as_ref();
    let plan = make_plan(path, image, options)?;
    let format = plan.format;
    let prepared = plan.prepare(image).map_err(|f| f.at(path, format.name(), "write"))?;
    let clipped = atomic::replace(path, options.force, |writer| {
        encode(&prepared, &plan, writer).map_err(|f| f.at(path, format.name(), "write"))
    })?;
    let samples = prepared.color_count() * prepared.pixel_count();
    Ok(WriteReport { format, sample: plan.sample, transfer: plan.transfer, samples, clipped })
}

/// Everything about a target that can be known before there is a picture: extension, folder and
/// existing file. Call it before a long job.
///
/// # Errors
/// [`Error::UnsupportedFormat`], [`Error::Exists`], [`Error::NoFolder`] and [`Error::NotAFile`].
pub fn check_target(path: impl AsRef<Path>, force: bool) -> Result<()> {
    let path = path.as_ref();
    writable_format(path)?;
    atomic::check_place(path, force)
}

/// Whether a picture like this one (size, channels, sample type; not values) can be written so:
/// [`check_target`] and the checks of the format. Call it before a long job.
///
/// # Errors
/// Those of [`check_target`], and [`Error::CannotHold`].
pub fn check_write(path: impl AsRef<Path>, image: &Image, options: &WriteOptions) -> Result<()> {
    make_plan(path.as_ref(), image, options).map(|_| ())
}

fn make_plan(path: &Path, image: &Image, options: &WriteOptions) -> Result<Plan> {
    check_target(path, options.force)?;
    let format = writable_format(path)?;
    Plan::new(format, &extension(path), image, options)
        .map_err(|f| f.at(path, format.name(), "write"))
}

pub(crate) fn writable_format(path: &Path) -> Result<Format> {
    let known = extension(path);
    Format::from_extension(path)
        .filter(|f| *f != Format::Gif && !matches!(known.as_str(), "pbm" | "apng"))
        .ok_or_else(|| Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: known,
            known: Format::WRITABLE,
        })
}
