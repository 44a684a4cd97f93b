//! Volumes as pictures.

use super::Volume;
use crate::{Error, Image, Result, SampleType, Transfer};

/// Pixels between the views of a sheet.
const GAP: usize = 4;

impl Volume {
    /// The slice `index` across `axis` (0 for x): 8-bit grey, or RGB of the first three channels, `window` to 0..1.
    /// Pixels are square: the coarser axis is repeated to the nearest whole pixel. Of a placed volume the vertical
    /// axis points up, as on films.
    ///
    /// # Errors
    /// [`Error::Shape`] when there is no such slice, or the window is empty.
    pub fn slice(&self, axis: usize, index: usize, window: [f32; 2]) -> Result<Image> {
        let [low, high] = window;
        if axis > 2 || index >= self.shape[axis] || !(high > low && (high - low).is_finite()) {
            let what =
                format!("slice {index} across axis {axis} of {:?}, window {window:?}", self.shape);
            return Err(Error::Shape { what });
        }
        let [a, b] = [[1, 2], [0, 2], [0, 1]][axis];
        let size = self.voxel_size();
        let finest = size[a].min(size[b]);
        let pixels = |d: usize| {
            // A lattice of extreme voxels is not worth a picture of gigabytes.
            ((self.shape[d] as f64 * size[d] / finest).round() as usize)
                .clamp(1, 16 * self.shape[d])
        };
        let (width, height) = (pixels(a), pixels(b));
        let colors = if self.channels >= 3 { 3 } else { 1 };
        let mut data = Vec::with_capacity(width * height * colors);
        for c in 0..colors {
            let plane = self.plane(c);
            for y in 0..height {
                let y = if self.placed { height - 1 - y } else { y };
                for x in 0..width {
                    let mut at = [0; 3];
                    at[axis] = index;
                    at[a] = x * self.shape[a] / width;
                    at[b] = y * self.shape[b] / height;
                    let value = plane[(at[2] * self.shape[1] + at[1]) * self.shape[0] + at[0]];
                    data.push(((value - low) / (high - low)).clamp(0.0, 1.0));
                }
            }
        }
        let names: &[&str] = if colors == 3 { &["R", "G", "B"] } else { &["Y"] };
        let mut image = Image::new(width, height, names, data)?;
        (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
        Ok(image)
    }

    /// The three slices through a voxel, across z, y and x, side by side on black.
    ///
    /// # Errors
    /// Those of [`slice`](Self::slice).
    pub fn views(&self, at: [usize; 3], window: [f32; 2]) -> Result<Image> {
        let parts: Vec<Image> =
            [2, 1, 0].into_iter().map(|d| self.slice(d, at[d], window)).collect::<Result<_>>()?;
        let width = parts.iter().map(Image::width).sum::<usize>() + 2 * GAP;
        let height = parts.iter().map(Image::height).max().unwrap_or(1);
        let names = parts[0].channels().to_vec();
        let mut data = vec![0.0; width * height * names.len()];
        let mut left = 0;
        for part in &parts {
            for c in 0..names.len() {
                for (y, row) in part.plane(c).chunks(part.width()).enumerate() {
                    let at = (c * height + y) * width + left;
                    data[at..at + row.len()].copy_from_slice(row);
                }
            }
            left += part.width() + GAP;
        }
        let mut image = Image::new(width, height, &names, data)?;
        (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_windowed_and_square() {
        let data: Vec<f32> = (0..24).map(|v| v as f32).collect();
        let mut volume = Volume::new([4, 3, 2], 1, data).unwrap();
        let axial = volume.slice(2, 1, [12.0, 23.0]).unwrap();
        assert_eq!((axial.width(), axial.height()), (4, 3));
        assert_eq!((axial.plane(0)[0], axial.plane(0)[11]), (0.0, 1.0));
        volume
            .set_affine([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
            .unwrap();
        let side = volume.slice(0, 0, [0.0, 23.0]).unwrap();
        assert_eq!((side.width(), side.height()), (3, 6));
        // Up is up.
        assert_eq!(side.plane(0)[0], 12.0 / 23.0);
        let sheet = volume.views([1, 1, 1], [0.0, 23.0]).unwrap();
        assert_eq!((sheet.width(), sheet.height()), (4 + 4 + 3 + 8, 6));
        for (axis, index, window) in [(3, 0, [0.0, 1.0]), (2, 2, [0.0, 1.0]), (2, 0, [1.0, 1.0])] {
            assert!(volume.slice(axis, index, window).is_err());
        }
    }
}
