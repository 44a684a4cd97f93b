use inr_core::{Domain, Field, Samples, Spline};
use rayon::prelude::*;

use super::affine::{self, Affine};
use crate::{Error, Result, Volume};

/// How far an entry of the map's matrix may be from the identity's for the axes to count as equal:
/// a hundredth of a voxel over a hundred voxels.
const SAME_AXES: f64 = 1e-4;

/// Where the voxels of a patch lie among those of a background, by the places of both in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    map: Affine,
}

impl Placement {
    /// The map from the patch's voxel indices to the background's: into the world by the patch's
    /// affine, out of it by the background's.
    pub fn new(patch: &Volume, background: &Volume) -> Self {
        let inverse = affine::inverse(background.affine());
        Self { map: affine::compose(&inverse, patch.affine()) }
    }

    /// The rows of the map.
    pub fn map(&self) -> &Affine {
        &self.map
    }

    /// The background's voxel index of a voxel index of the patch.
    pub fn to_background(&self, index: [f64; 3]) -> [f64; 3] {
        affine::apply(&self.map, index)
    }

    /// The patch's voxel index of a voxel index of the background.
    pub fn to_patch(&self, index: [f64; 3]) -> [f64; 3] {
        affine::apply(&affine::inverse(&self.map), index)
    }

    /// The background's index of the patch's first voxel, where both have the same axes and voxel sizes
    /// (entries of the matrix within 1e-4): then the patch needs no resampling, only a shift, be it by
    /// whole voxels or not.
    pub fn translation(&self) -> Option<[f64; 3]> {
        let same = |r: usize, c: usize| {
            let identity = if r == c { 1.0 } else { 0.0 };
            (self.map[r][c] - identity).abs() <= SAME_AXES
        };
        let all = (0..3).all(|r| (0..3).all(|c| same(r, c)));
        all.then(|| [self.map[0][3], self.map[1][3], self.map[2][3]])
    }
}

/// Rounding of indices near the border of a patch's cells.
const BORDER: f64 = 1e-9;

impl Volume {
    /// The volume on the lattice of another one: cubic B-spline interpolation at the places of the other
    /// one's voxels in the world. Shape, affine and texts become those of `like`, number type and scaling
    /// stay.
    ///
    /// Voxels of `like` whose centres lie outside of this volume's cells (half a voxel around the outermost
    /// centres) become NaN in every channel: that is the mark for "nothing known here".
    ///
    /// Nothing is averaged: a patch that is much finer than `like` should be smoothed first. Needs another
    /// plane of memory at a time for this volume, and as many values as `like` has voxels for each channel.
    ///
    /// # Errors
    /// [`Error::Volume`] when a value is not finite: it would spread over its surroundings.
    pub fn resampled_like(&self, like: &Self) -> Result<Self> {
        if let Some(k) = self.as_planar().iter().position(|v| !v.is_finite()) {
            let n = self.voxel_count();
            let [x, y, _] = self.shape();
            let at = [k % n % x, k % n / x % y, k % n / x / y];
            let what = format!("{} at {at:?}, which cannot be interpolated", self.as_planar()[k]);
            return Err(Error::Volume { what });
        }
        let placement = Placement::new(like, self);
        let (shape, slice) = (like.shape(), like.shape()[0] * like.shape()[1]);
        let lattice = Domain::unit(self.shape()).expect("checked when the volume was made");
        let mut data = vec![f32::NAN; like.voxel_count() * self.channels()];
        for (c, plane) in data.chunks_exact_mut(like.voxel_count()).enumerate() {
            let samples = Samples::<3, 1>::from_planar(lattice, self.plane(c).to_vec());
            let spline = Spline::interpolate_owned(samples.expect("a plane has a value per voxel"));
            plane.par_chunks_mut(slice).enumerate().for_each(|(z, values)| {
                let (at, points) = self.points_inside(&placement, shape, z);
                let mut found = vec![[0.0]; points.len()];
                spline.eval(&points, &mut found);
                for (k, [value]) in at.into_iter().zip(found) {
                    values[k] = value;
                }
            });
        }
        let mut out = like.with_planes(self.channels(), data)?;
        (out.voxel_type, out.scaling) = (self.voxel_type, self.scaling);
        Ok(out)
    }

    /// Those voxels of a slice that lie inside of this volume's cells, and where.
    fn points_inside(
        &self,
        placement: &Placement,
        [width, height, _]: [usize; 3],
        z: usize,
    ) -> (Vec<usize>, Vec<[f32; 3]>) {
        let last = self.shape().map(|n| n as f64 - 0.5 + BORDER);
        let point = |k: usize| {
            let at = [(k % width) as f64, (k / width) as f64, z as f64];
            let index = placement.to_background(at);
            let inside = (0..3).all(|d| (-0.5 - BORDER..=last[d]).contains(&index[d]));
            inside.then_some((k, index.map(|v| v as f32)))
        };
        (0..width * height).filter_map(point).unzip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f32 coefficients and weights of values up to 100.
    const TOLERANCE: f32 = 2e-4;

    /// A linear function of the world, which splines reproduce away from the borders.
    fn scan(shape: [usize; 3], affine: Affine) -> Volume {
        let empty = Volume::new(shape, 1, vec![0.0; shape.iter().product()]).unwrap();
        let mut volume = empty.with_affine(affine).unwrap();
        let [x, y, _] = shape;
        let values: Vec<f32> = (0..volume.voxel_count())
            .map(|k| function(volume.to_world([k % x, k / x % y, k / x / y].map(|i| i as f64))))
            .collect();
        volume.as_planar_mut().copy_from_slice(&values);
        volume
    }

    fn function([x, y, z]: [f64; 3]) -> f32 {
        (2.0 * x - y + 0.5 * z + 3.0) as f32
    }

    #[test]
    fn shifts_are_told_from_other_maps() {
        let shape = [4, 4, 4];
        let oblique = [[0.0, -2.0, 0.0, 5.0], [1.5, 0.0, 0.0, 1.0], [0.0, 0.1, 3.0, -4.0]];
        let background = scan(shape, oblique);
        let mut moved = oblique;
        // Two voxels along x, half of one along z.
        (moved[1][3], moved[2][3]) = (1.0 + 3.0, -4.0 + 1.5);
        let placement = Placement::new(&scan(shape, moved), &background);
        let shift = placement.translation().unwrap();
        let error = (0..3).map(|d| (shift[d] - [2.0, 0.0, 0.5][d]).abs()).fold(0.0, f64::max);
        assert!(error < 1e-12, "{shift:?}");
        let back = placement.to_patch(placement.to_background([1.0, 2.0, 3.0]));
        assert!((0..3).all(|d| (back[d] - [1.0, 2.0, 3.0][d]).abs() < 1e-12));
        for (r, c) in [(0, 0), (1, 0), (2, 2)] {
            let mut other = oblique;
            other[r][c] += 1e-3;
            assert_eq!(Placement::new(&scan(shape, other), &background).translation(), None);
        }
    }

    #[test]
    fn resampling_reproduces_a_function_of_the_world() {
        let patch = scan(
            [15, 14, 13],
            [[0.9, 0.1, 0.0, -1.0], [-0.1, 0.8, 0.2, 0.5], [0.0, -0.2, 1.1, 0.0]],
        );
        let like =
            scan([9, 12, 7], [[0.0, 0.0, 1.5, 0.0], [1.2, 0.0, 0.0, -1.0], [0.0, 1.0, 0.0, 1.0]]);
        let got = patch.resampled_like(&like).unwrap();
        assert_eq!((got.shape(), got.affine()), (like.shape(), like.affine()));
        let (mut inside, mut outside) = (0, 0);
        let [x, y, _] = like.shape();
        for k in 0..got.voxel_count() {
            let at = [k % x, k / x % y, k / x / y].map(|i| i as f64);
            let index = patch.to_index(like.to_world(at));
            let n = patch.shape().map(|n| n as f64);
            if (0..3).any(|d| index[d] < -0.5 || index[d] > n[d] - 0.5) {
                assert!(got.plane(0)[k].is_nan(), "{at:?} {index:?}");
                outside += 1;
            } else if (0..3).all(|d| index[d] >= 4.0 && index[d] <= n[d] - 5.0) {
                // The mirrored border bends slopes of up to 3 a voxel; 0.27^4 of that arrives here.
                let (got, want) = (got.plane(0)[k], like.plane(0)[k]);
                assert!((got - want).abs() < 0.05, "{at:?}: {got} {want}");
                inside += 1;
            }
        }
        assert!(inside > 30 && outside > 50, "{inside} {outside}");
    }

    #[test]
    fn the_same_lattice_keeps_the_values() {
        let affine = [[0.0, -2.0, 0.0, 5.0], [1.5, 0.0, 0.0, 1.0], [0.0, 0.1, 3.0, -4.0]];
        let patch = scan([5, 1, 6], affine);
        let same = patch.resampled_like(&patch).unwrap();
        for (got, want) in same.as_planar().iter().zip(patch.as_planar()) {
            assert!((got - want).abs() < TOLERANCE, "{got} {want}");
        }
        let mut holed = patch.clone();
        holed.as_planar_mut()[7] = f32::NAN;
        assert!(matches!(holed.resampled_like(&patch), Err(Error::Volume { .. })));
    }
}
