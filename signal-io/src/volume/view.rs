use inr_core::{Domain, Samples, Spline, Unit};

use crate::{Error, Image, Result, Volume};

/// The axes that remain in a slice: across and down.
const REMAINING: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// Pictures of a volume.
impl Volume {
    /// The voxels with index `index` along `axis` (0, 1, 2 for x, y, z) as a picture, one channel per
    /// channel, values unchanged. The first remaining axis goes to the right, the second one down: (y, z),
    /// (x, z), (x, y).
    ///
    /// # Errors
    /// [`Error::Volume`] when there is no such axis or slice.
    pub fn slice(&self, axis: usize, index: usize) -> Result<Image> {
        let shape = self.shape();
        if axis > 2 || index >= shape[axis.min(2)] {
            let what = format!("no slice {index} along axis {axis} of {shape:?} voxels");
            return Err(Error::Volume { what });
        }
        let strides = [1, shape[0], shape[0] * shape[1]];
        let [across, down] = REMAINING[axis];
        let (width, height) = (shape[across], shape[down]);
        let mut data = Vec::with_capacity(width * height * self.channels());
        for c in 0..self.channels() {
            let plane = &self.plane(c)[index * strides[axis]..];
            for y in 0..height {
                let row = (0..width).map(|x| plane[x * strides[across] + y * strides[down]]);
                data.extend(row);
            }
        }
        let names: Vec<String> = match self.channels() {
            1 => vec!["Y".to_owned()],
            3 => ["R", "G", "B"].map(str::to_owned).to_vec(),
            n => (0..n).map(|c| format!("C{c}")).collect(),
        };
        Image::new(width, height, &names, data)
    }

    /// The slices through a voxel across x, y and z, ready to be looked at.
    ///
    /// Pixels are squares as large as the shorter edge of the slice's voxels (splines interpolate between
    /// them), so that lengths are right in every direction. The volume's second and third axes point
    /// upward, as radiologists have it. Values in `window` become [0, 1], others are clamped; NaN
    /// becomes 0.
    ///
    /// # Errors
    /// [`Error::Volume`] when the voxel is not there, or the window is empty or not finite.
    pub fn views(&self, voxel: [usize; 3], window: [f32; 2]) -> Result<[Image; 3]> {
        let [low, high] = window;
        if !(low < high && (high - low).is_finite()) {
            return Err(Error::Volume { what: format!("a window from {low} to {high}") });
        }
        let view = |axis: usize| {
            let slice = self.slice(axis, voxel[axis])?;
            let size = REMAINING[axis].map(|d| self.voxel_size()[d]);
            let windowed = |v: &f32| ((v - low) / (high - low)).clamp(0.0, 1.0);
            let as_shown = |v: f32| if v.is_nan() { 0.0 } else { v };
            let data = slice.as_planar().iter().map(|v| as_shown(windowed(v))).collect();
            let image = Image::new(slice.width(), slice.height(), slice.channels(), data)?;
            square(&upside_down(&image)?, size)
        };
        Ok([view(0)?, view(1)?, view(2)?])
    }
}

fn upside_down(image: &Image) -> Result<Image> {
    let rows = |c: usize| image.plane(c).chunks_exact(image.width()).rev().flatten().copied();
    let data = (0..image.channels().len()).flat_map(rows).collect();
    Image::new(image.width(), image.height(), image.channels(), data)
}

/// The most pixels that a short side is stretched to: voxels of extreme shape are shown flatter.
const MAX_SIDE: f64 = 8192.0;

/// The picture with square pixels, for pixels of this size.
fn square(image: &Image, size: [f64; 2]) -> Result<Image> {
    let shape = [image.width(), image.height()];
    let pixel = size[0].min(size[1]);
    let wanted: [usize; 2] = std::array::from_fn(|d| {
        let n = (shape[d] as f64 * size[d] / pixel).round();
        (n as usize).clamp(shape[d], shape[d].max(MAX_SIDE as usize))
    });
    if wanted == shape {
        return Ok(image.clone());
    }
    let bad = |e: inr_core::Error| Error::Volume { what: e.to_string() };
    let domain = Domain::new(shape, [1.0; 2], [0.0; 2], Unit::Sample).map_err(bad)?;
    let lattice = domain.resized(wanted).map_err(bad)?;
    let mut data = Vec::with_capacity(lattice.len() * image.channels().len());
    for c in 0..image.channels().len() {
        let samples = Samples::<2, 1>::from_planar(domain, image.plane(c).to_vec()).map_err(bad)?;
        let fine = Spline::interpolate_owned(samples).eval_lattice(&lattice, [0; 2]);
        // Splines swing over at edges.
        data.extend(fine.as_planar().iter().map(|v| v.clamp(0.0, 1.0)));
    }
    Image::new(wanted[0], wanted[1], image.channels(), data)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Volume {
        let data = (0..24).map(|v| v as f32).collect();
        Volume::new([2, 3, 4], 1, data).unwrap().with_voxel_size([1.0, 1.0, 2.5]).unwrap()
    }

    #[test]
    fn slices_are_the_voxels() {
        let volume = ramp();
        // Voxel (x, y, z) has the value x + 2 y + 6 z.
        let across_x = volume.slice(0, 1).unwrap();
        assert_eq!((across_x.width(), across_x.height()), (3, 4));
        assert_eq!(across_x.plane(0)[2 + 3 * 3], 1.0 + 4.0 + 18.0);
        let across_y = volume.slice(1, 2).unwrap();
        assert_eq!((across_y.width(), across_y.height()), (2, 4));
        assert_eq!(across_y.plane(0)[1 + 2 * 3], 1.0 + 4.0 + 18.0);
        let across_z = volume.slice(2, 3).unwrap();
        assert_eq!(across_z.plane(0), &volume.plane(0)[18..]);
        for (axis, index) in [(0, 2), (1, 3), (2, 4), (3, 0), (usize::MAX, 0)] {
            assert!(matches!(volume.slice(axis, index), Err(Error::Volume { .. })));
        }
    }

    #[test]
    fn views_have_the_right_proportions_and_point_upward() {
        let [x, y, z] = ramp().views([1, 2, 3], [0.0, 23.0]).unwrap();
        assert_eq!((x.width(), x.height()), (3, 10)); // 3 mm wide, 10 mm high.
        assert_eq!((y.width(), y.height()), (2, 10));
        assert_eq!((z.width(), z.height()), (2, 3));
        // Up is more of z, and of y.
        assert!(x.plane(0)[0] > x.plane(0)[27] && z.plane(0)[0] > z.plane(0)[4]);
        assert_eq!(z.plane(0)[1], 1.0); // The largest value: the window's end.
        let nan = Volume::new([1, 1, 1], 1, vec![f32::NAN]).unwrap();
        assert_eq!(nan.views([0; 3], [0.0, 1.0]).unwrap()[0].as_planar(), [0.0]);
        for window in [[1.0, 1.0], [2.0, 1.0], [f32::NAN, 1.0], [0.0, f32::INFINITY]] {
            assert!(matches!(ramp().views([0; 3], window), Err(Error::Volume { .. })));
        }
        assert!(matches!(ramp().views([2, 0, 0], [0.0, 1.0]), Err(Error::Volume { .. })));
    }
}
