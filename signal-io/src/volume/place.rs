//! One volume in the voxels of another.

use inr_core::{Domain, Field, Samples, Spline};

use super::Volume;
use super::affine::{Affine, apply, compose, inverse};
use crate::{Error, Result};

/// Voxel sizes, axes and places that agree to this much are the same: files store them as f32.
const SAME: f64 = 1e-4;

impl Volume {
    /// The voxel index, with fractions, of a place in the world (millimetres).
    pub fn world_to_index(&self, world: [f64; 3]) -> [f64; 3] {
        apply(&inverse(&self.affine), world)
    }

    /// From voxel indices of this volume to those of another one.
    pub fn index_map_to(&self, other: &Self) -> Affine {
        compose(&inverse(&other.affine), &self.affine)
    }

    /// Where the first voxel lies in voxels of the other volume, if axes and sizes of voxels agree.
    pub fn shift_to(&self, other: &Self) -> Option<[f64; 3]> {
        let map = self.index_map_to(other);
        let longest = self.shape.iter().max().copied().unwrap_or(1) as f64;
        // No voxel may be off by more than a hundredth of one.
        let slack = SAME.min(1e-2 / longest).max(1e-7);
        let agree = (0..3)
            .all(|r| (0..3).all(|c| (map[r][c] - f64::from(u8::from(r == c))).abs() <= slack));
        // Rounding of f32 places, such as 90.00001 mm.
        let shift = [map[0][3], map[1][3], map[2][3]];
        let whole = |v: f64| if (v - v.round()).abs() < 1e-3 { v.round() } else { v };
        agree.then(|| shift.map(whole))
    }

    /// The values at the other volume's voxels, by the cubic spline through this one's, and a plane that is 1 where
    /// they lie within this volume's voxels and 0 elsewhere. Cost: 64 products per value.
    ///
    /// # Errors
    /// [`Error::Shape`] if there are values that are not finite: a spline spreads them.
    pub fn resampled_like(&self, other: &Self) -> Result<(Self, Vec<f32>)> {
        if self.data.iter().any(|v| !v.is_finite()) {
            let what = "values that are not finite cannot be resampled".to_owned();
            return Err(Error::Shape { what });
        }
        let map = other.index_map_to(self);
        let [width, height, depth] = other.shape;
        let lattice = Domain::unit(self.shape).expect("checked when made");
        let row = |y: usize, z: usize| -> Vec<[f32; 3]> {
            (0..width).map(|x| apply(&map, [x, y, z].map(|v| v as f64)).map(|v| v as f32)).collect()
        };
        let within =
            |x: &[f32; 3]| (0..3).all(|d| (-0.5..=self.shape[d] as f32 - 0.5).contains(&x[d]));
        let mut inside = Vec::with_capacity(width * height * depth);
        for (z, y) in (0..depth).flat_map(|z| (0..height).map(move |y| (z, y))) {
            inside.extend(row(y, z).iter().map(|x| f32::from(u8::from(within(x)))));
        }
        let mut data = Vec::with_capacity(inside.len() * self.channels);
        let mut values = vec![[0.0]; width];
        for c in 0..self.channels {
            let samples = Samples::<3, 1>::from_planar(lattice, self.plane(c).to_vec());
            let spline = Spline::interpolate_owned(samples.expect("one value per voxel"));
            for (z, y) in (0..depth).flat_map(|z| (0..height).map(move |y| (z, y))) {
                spline.eval(&row(y, z), &mut values);
                data.extend(values.iter().map(|[v]| *v));
            }
        }
        let mut out = Self::new(other.shape, self.channels, data)?;
        (out.affine, out.placed, out.voxel) = (other.affine, other.placed, self.voxel);
        Ok((out, inside))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(shape: [usize; 3], map: Affine) -> Volume {
        let mut volume = Volume::new(shape, 1, vec![0.0; shape.iter().product()]).unwrap();
        volume.set_affine(map).unwrap();
        volume
    }

    #[test]
    fn places_become_shifts_where_axes_agree() {
        let at = |x: f64| [[2.0, 0.0, 0.0, x], [0.0, 2.0, 0.0, -7.0], [0.0, 0.0, 2.0, 1.0]];
        let (a, b) = (volume([9, 9, 9], at(3.0)), volume([4, 4, 4], at(13.00001)));
        assert_eq!(b.shift_to(&a), Some([5.0, 0.0, 0.0]));
        assert_eq!(a.world_to_index([7.0, -5.0, 1.0]), [2.0, 1.0, 0.0]);
        let turned = [[0.0, 2.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]];
        assert_eq!(volume([4, 4, 4], turned).shift_to(&a), None);
    }

    #[test]
    fn resampling_follows_the_map() {
        // A linear ramp is what a spline keeps exactly, away from the mirrored borders.
        let mut ramp = volume(
            [24, 20, 22],
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        );
        for k in 0..ramp.data.len() {
            let (x, y, z) = (k % 24, k / 24 % 20, k / 480);
            ramp.data[k] = x as f32 + 10.0 * y as f32 - z as f32;
        }
        let other =
            volume([5, 4, 3], [[0.0, 0.7, 0.0, 9.3], [0.6, 0.0, 0.0, 8.0], [0.0, 0.0, 1.1, 10.2]]);
        let (out, inside) = ramp.resampled_like(&other).unwrap();
        assert!(inside.iter().all(|w| *w == 1.0));
        for (k, value) in out.as_planar().iter().enumerate() {
            let (x, y, z) = ((k % 5) as f32, (k / 5 % 4) as f32, (k / 20) as f32);
            let expected = (0.7 * y + 9.3) + 10.0 * (0.6 * x + 8.0) - (1.1 * z + 10.2);
            assert!((value - expected).abs() < 2e-3, "{k}: {value} {expected}");
        }
        let far =
            volume([2, 2, 2], [[1.0, 0.0, 0.0, -9.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);
        assert!(ramp.resampled_like(&far).unwrap().1.iter().all(|w| *w == 0.0));
    }
}
