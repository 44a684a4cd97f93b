//! Pictures larger than memory: read and written some rows at a time.

mod arrays;
mod png;
mod tiff;
mod write;

use std::path::{Path, PathBuf};

use crate::error::Fault;
use crate::read::{HEAD, find_format, head_of};
use crate::{Error, Format, Image, ReadOptions, Result, SampleType, Transfer, read_image};

pub use write::RowWriter;

/// What a picture is besides its numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PictureInfo {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the channels in the order of the planes, alpha included.
    pub channels: Vec<String>,
    /// The number type it is stored in.
    pub sample: SampleType,
    /// How its values relate to light.
    pub transfer: Transfer,
    /// Its colour profile.
    pub icc: Option<Vec<u8>>,
}

impl PictureInfo {
    /// That of a picture in memory.
    pub fn of(image: &Image) -> Self {
        Self {
            width: image.width(),
            height: image.height(),
            channels: image.channels().to_vec(),
            sample: image.sample,
            transfer: image.transfer,
            icc: image.icc.clone(),
        }
    }

    /// A picture of this kind with these numbers, one plane after the other, and as many rows as they fill.
    ///
    /// # Errors
    /// [`Error::Shape`] where they fill no whole rows, or no row at all.
    pub fn rows(&self, data: Vec<f32>) -> Result<Image> {
        let height = data.len() / (self.width * self.channels.len()).max(1);
        let mut image = Image::new(self.width, height, &self.channels, data)?;
        (image.sample, image.transfer, image.icc) = (self.sample, self.transfer, self.icc.clone());
        Ok(image)
    }
}

/// Rows of a file from the top; `out` is planar, for as many rows as it has room for.
trait Rows: Send {
    fn read(&mut self, rows: usize, out: &mut [f32]) -> std::result::Result<(), Fault>;
}

/// What opening a file by rows comes to.
enum Opened {
    /// Rows come one after the other.
    Rows(PictureInfo, Box<dyn Rows>),
    /// They do not, for this reason.
    Whole(&'static str),
}

/// Reads a picture from top to bottom, a band of rows at a time.
///
/// The bands together are the picture that [`read_image`] gives, value for value. PNG without interlacing, npy in C
/// order, PFM, and TIFF in strips or tiles of 8 and 16 bits and floats are read with memory for a band (and a row of
/// tiles); everything else, and pictures that EXIF turns, is decoded as a whole if that fits
/// [`ReadOptions::limit_bytes`], and then given out in bands.
pub struct RowReader {
    path: PathBuf,
    format: Format,
    info: PictureInfo,
    /// Rows given out.
    row: usize,
    rows: Box<dyn Rows>,
    in_memory: bool,
}

impl RowReader {
    /// Opens a file and reads what stands before its numbers.
    ///
    /// # Errors
    /// Those of [`read_image`], and [`Error::NotByRows`] for what can be decoded as a whole only and exceeds the limit.
    pub fn open(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Self> {
        let path = path.as_ref();
        let head = head_of(path, HEAD)?;
        let format = find_format(path, &head)?;
        let regular = path.metadata().map_err(|e| Error::io(path, "read", e))?.is_file();
        let opened = match format {
            _ if !regular => Ok(Opened::Whole("it is a pipe")),
            Format::Png => png::open(path),
            Format::Npy => arrays::open_npy(path),
            Format::Pfm => arrays::open_pfm(path),
            Format::Tiff => tiff::open(path, options.limit_bytes),
            _ => Ok(Opened::Whole("its format is decoded as a whole")),
        };
        let fail = |fault: Fault| fault.at(path, format.name(), "read");
        let (mut info, rows, in_memory) = match opened.map_err(fail)? {
            Opened::Rows(info, rows) => (info, rows, false),
            Opened::Whole(why) => {
                let image = read_image(path, options).map_err(|e| not_by_rows(e, why))?;
                let info = PictureInfo::of(&image);
                (info, Box::new(InMemory { image, row: 0 }) as Box<dyn Rows>, true)
            }
        };
        info.transfer = options.transfer.unwrap_or(info.transfer);
        Ok(Self { path: path.to_path_buf(), format, info, row: 0, rows, in_memory })
    }

    /// Size, channels, number type, encoding and profile.
    pub fn info(&self) -> &PictureInfo {
        &self.info
    }

    /// Whether the picture had to be decoded as a whole.
    pub fn is_in_memory(&self) -> bool {
        self.in_memory
    }

    /// The next rows, at most this many, as a picture of full width; `None` after the last one. Takes four bytes a
    /// sample.
    ///
    /// # Errors
    /// [`Error::Corrupt`], [`Error::Io`] and [`Error::OutOfMemory`].
    pub fn read(&mut self, rows: usize) -> Result<Option<Image>> {
        let rows = rows.max(1).min(self.info.height - self.row);
        if rows == 0 {
            return Ok(None);
        }
        let count = rows * self.info.width * self.info.channels.len();
        let fail = |fault: Fault| fault.at(&self.path, self.format.name(), "read");
        let mut out = crate::budget::zeros(count).map_err(fail)?;
        self.rows.read(rows, &mut out).map_err(fail)?;
        self.row += rows;
        self.info.rows(out).map(Some)
    }
}

impl std::fmt::Debug for RowReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RowReader").field("path", &self.path).field("info", &self.info).finish()
    }
}

fn not_by_rows(error: Error, why: &str) -> Error {
    match error {
        Error::TooLarge { path, needed, limit } => {
            let what = format!("{why}, which takes {needed} bytes where {limit} are allowed");
            Error::NotByRows { path, what, action: "read" }
        }
        other => other,
    }
}

/// A picture that was decoded as a whole.
struct InMemory {
    image: Image,
    row: usize,
}

impl Rows for InMemory {
    fn read(&mut self, rows: usize, out: &mut [f32]) -> std::result::Result<(), Fault> {
        let n = rows * self.image.width();
        for (c, plane) in out.chunks_exact_mut(n).enumerate() {
            plane.copy_from_slice(&self.image.plane(c)[self.row * self.image.width()..][..n]);
        }
        self.row += rows;
        Ok(())
    }
}

/// Puts a row of numbers side by side, `size` bytes each, into row `row` of planes of `rows` rows.
fn spread(
    line: &[u8],
    size: usize,
    convert: impl Fn(&[u8]) -> f32,
    [row, rows]: [usize; 2],
    out: &mut [f32],
    channels: usize,
) {
    let width = line.len() / (size * channels);
    for c in 0..channels {
        let plane = &mut out[(c * rows + row) * width..][..width];
        let numbers = line.chunks_exact(size).skip(c).step_by(channels);
        plane.iter_mut().zip(numbers).for_each(|(v, bytes)| *v = convert(bytes));
    }
}

#[cfg(test)]
mod tests;
