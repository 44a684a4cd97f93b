mod lenslet;
mod read;
mod slices;
mod views;
mod write;

use std::path::{Path, PathBuf};

use inr_core::Samples;

pub use self::read::{LightFieldReadOptions, decode_light_field, read_light_field};
pub use self::write::{
    LightFieldFormat, LightFieldReport, LightFieldWriteOptions, check_light_field_target,
    write_light_field,
};
use crate::{Error, Image, Result, SampleType, Transfer, strip};

/// Columns and rows of the grid that the names of these files tell of.
pub(crate) fn grid_of(path: &Path, files: Vec<PathBuf>) -> Option<[usize; 2]> {
    views::grid(path, files).ok().map(|(_, grid)| grid)
}

/// A light field in floating point: a grid of pictures taken side by side.
///
/// The shape is `[X, Y, U, V]`: columns and rows of a picture, views across and views down. Planes
/// are stored one after the other; inside a plane x is contiguous, then y, u, v: value
/// `(x, y, u, v)` of channel `c` is `as_planar()[(((c * V + v) * U + u) * Y + y) * X + x]`. Numbers,
/// channel names and alpha are those of [`Image`]; so a light field is also one tall picture with the
/// views one below the other ([`LightField::as_strip`]), on which all conversions of pictures work.
///
/// ```
/// use signal_io::LightField;
///
/// // A point that moves by -1 pixel from view to view, as something in front does.
/// let data = (0..3 * 7).map(|k| if k % 7 + k / 7 == 4 { 1.0 } else { 0.0 }).collect();
/// let field = LightField::new([7, 1, 3, 1], &["Y"], data)?;
/// assert_eq!(field.view(0, 0).plane(0)[4], 1.0);
///
/// // The mean over the views, moved so that the point stays where it is in the middle one.
/// let sharp = field.refocused(-1.0);
/// assert!((sharp.plane(0)[3] - 1.0).abs() < 1e-5);
///
/// // Over x and u, the point is a line.
/// let lines = field.epipolar(0, 0);
/// assert_eq!((lines.width(), lines.height()), (7, 3));
/// # Ok::<(), signal_io::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    strip: Image,
    /// Views across, views down.
    grid: [usize; 2],
}

impl LightField {
    /// Takes planar values with their channel names; float, [`Transfer::Unspecified`].
    ///
    /// # Errors
    /// [`Error::Shape`] when an axis or the list of channels is empty, when the number of values is
    /// not `X * Y * U * V * channels`, or when names are empty or repeated.
    pub fn new<S: AsRef<str>>(shape: [usize; 4], channels: &[S], data: Vec<f32>) -> Result<Self> {
        let [width, height, u, v] = shape;
        let rows = height.saturating_mul(u).saturating_mul(v);
        Self::from_strip(Image::new(width, rows, channels, data)?, [u, v])
    }

    /// The views of a tall picture, from top to bottom, row after row of the `grid` (`[U, V]`);
    /// sample type, transfer and profile stay.
    ///
    /// # Errors
    /// [`Error::Shape`] when the rows cannot be divided into so many views.
    pub fn from_strip(strip: Image, grid: [usize; 2]) -> Result<Self> {
        strip::check_count(&strip, grid[0].saturating_mul(grid[1]))?;
        Ok(Self { strip, grid })
    }

    /// Views of one size with the same channels and transfer, row after row of the `grid`
    /// (`[U, V]`); sample type and profile are those of the first.
    ///
    /// # Errors
    /// [`Error::Shape`] when there are not `U * V` views or none, and with the number of the first one
    /// that differs.
    pub fn from_views(views: &[Image], grid: [usize; 2]) -> Result<Self> {
        if grid[0].checked_mul(grid[1]) != Some(views.len()) {
            let what = format!("{} views for a grid of {} x {}", views.len(), grid[0], grid[1]);
            return Err(Error::Shape { what });
        }
        Self::from_strip(strip::stack(views)?, grid)
    }

    /// Columns, rows, views across, views down.
    pub fn shape(&self) -> [usize; 4] {
        let [u, v] = self.grid;
        [self.strip.width(), self.strip.height() / (u * v), u, v]
    }

    /// Channel names in the order of the planes, alpha included.
    pub fn channels(&self) -> &[String] {
        self.strip.channels()
    }

    /// The number type of the file the light field came from.
    pub fn sample(&self) -> SampleType {
        self.strip.sample
    }

    /// How the colour channels relate to light.
    pub fn transfer(&self) -> Transfer {
        self.strip.transfer
    }

    /// All views, one below the other: `X` columns and `Y * U * V` rows.
    pub fn as_strip(&self) -> &Image {
        &self.strip
    }

    /// The same without the light field around it.
    pub fn into_strip(self) -> Image {
        self.strip
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        self.strip.as_planar()
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        self.strip.as_planar_mut()
    }

    /// The values of one channel in all views.
    ///
    /// # Panics
    /// If `channel >= channels().len()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        self.strip.plane(channel)
    }

    /// The picture in column `u` and row `v` of the grid, with sample type, transfer and profile.
    ///
    /// # Panics
    /// If `u >= shape()[2]` or `v >= shape()[3]`.
    pub fn view(&self, u: usize, v: usize) -> Image {
        let [columns, rows] = self.grid;
        assert!(u < columns && v < rows, "view ({u}, {v}) of {columns} x {rows}");
        strip::picture(&self.strip, columns * rows, v * columns + u)
    }

    /// The colour channels as typed samples on the lattice with pitch
    /// `[1, 1, angular_pitch, angular_pitch]`.
    ///
    /// The unit is the pixel: one step in the grid counts as `angular_pitch` (> 0) pixels, which says
    /// how much a change between views weighs against one inside a view. A pitch near the number of
    /// pixels that the picture moves from view to view makes both alike.
    ///
    /// # Errors
    /// [`Error::ChannelCount`] when there are not exactly `C` colour channels, [`Error::Shape`] when
    /// the pitch is not positive and finite.
    pub fn to_samples<const C: usize>(&self, angular_pitch: f32) -> Result<Samples<4, C>> {
        strip::to_samples(&self.strip, self.shape(), [1.0, 1.0, angular_pitch, angular_pitch])
    }

    /// A light field of these samples, without alpha; sample type, transfer and profile are those of
    /// `like`.
    ///
    /// Channels are named as in [`Image::from_samples`].
    ///
    /// # Errors
    /// [`Error::Shape`] when `C` is 0.
    pub fn from_samples<const C: usize>(samples: &Samples<4, C>, like: &Self) -> Result<Self> {
        let [_, _, u, v] = samples.domain().shape();
        Self::from_strip(strip::from_samples(samples, &like.strip)?, [u, v])
    }
}
