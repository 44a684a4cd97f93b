use crate::{Domain, Error, Region, Result};

/// An axis-aligned box: interval, rectangle, cuboid.
///
/// The signed distance is exact, up to f32 rounding of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxRegion<const D: usize> {
    min: [f32; D],
    max: [f32; D],
}

impl<const D: usize> BoxRegion<D> {
    /// The box between two corners, in physical coordinates; finite, and `min < max` on every axis.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn new(min: [f32; D], max: [f32; D]) -> Result<Self> {
        let corner = |what, value: f32| match value.is_finite() {
            true => Ok(()),
            false => Err(Error::Parameter { what, rule: "finite", value }),
        };
        for d in 0..D {
            corner("the box's lower corner", min[d])?;
            corner("the box's upper corner", max[d])?;
            if min[d] >= max[d] {
                let rule = "below the upper corner on every axis";
                return Err(Error::Parameter {
                    what: "the box's lower corner",
                    rule,
                    value: min[d],
                });
            }
        }
        Ok(Self { min, max })
    }

    /// The lower corner.
    pub fn min(&self) -> [f32; D] {
        self.min
    }

    /// The upper corner.
    pub fn max(&self) -> [f32; D] {
        self.max
    }
}

impl<const D: usize> Region<D> for BoxRegion<D> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        let (mut nearest_face, mut outside) = (f32::NEG_INFINITY, 0.0_f32);
        for d in 0..D {
            let beyond = (self.min[d] - x[d]).max(x[d] - self.max[d]);
            nearest_face = nearest_face.max(beyond);
            // hypot: the sum of squares would overflow for distances above 1e19.
            outside = outside.hypot(beyond.max(0.0));
        }
        if nearest_face < 0.0 { nearest_face } else { outside }
    }

    /// A sample within 1e-4 samples of a face lies on it, and so outside.
    fn weights_on(&self, lattice: &Domain<D>, start: [usize; D], weights: &mut [f32]) {
        const SLACK: f64 = 1e-4;
        let faces = |d: usize| {
            let (origin, pitch) = (f64::from(lattice.origin()[d]), f64::from(lattice.pitch()[d]));
            [self.min[d], self.max[d]].map(|v| (f64::from(v) - origin) / pitch)
        };
        weights.fill(0.0);
        for d in 1..D {
            let ([low, high], i) = (faces(d), start[d] as f64);
            if i <= low + SLACK || i >= high - SLACK {
                return;
            }
        }
        let [low, high] = faces(0).map(|v| v - start[0] as f64);
        // Casts saturate: a box that begins before the row begins with it.
        let first = ((low + SLACK).floor() + 1.0) as usize;
        let end = ((high - SLACK).ceil() as usize).min(weights.len());
        if first < end {
            weights[first..end].fill(1.0);
        }
    }

    fn bounds(&self) -> Option<[[f32; D]; 2]> {
        Some([self.min, self.max])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A few f32 roundings of values up to 10.
    const TOLERANCE: f64 = 5e-6;

    /// The nearest point of each of the `2 D` faces, in f64.
    fn distance_to_faces<const D: usize>(b: &BoxRegion<D>, x: &[f32; D]) -> f64 {
        let mut nearest = f64::INFINITY;
        for face in 0..D {
            for side in [b.min[face], b.max[face]] {
                let foot = |d: usize| if d == face { side } else { x[d].clamp(b.min[d], b.max[d]) };
                let squared = |d: usize| (f64::from(x[d]) - f64::from(foot(d))).powi(2);
                nearest = nearest.min((0..D).map(squared).sum::<f64>().sqrt());
            }
        }
        nearest
    }

    fn check<const D: usize>(min: [f32; D], size: [f32; D], x: [f32; D]) {
        let max = std::array::from_fn(|d| min[d] + size[d]);
        let region = BoxRegion::new(min, max).unwrap();
        let inside = (0..D).all(|d| min[d] < x[d] && x[d] < max[d]);
        let want = distance_to_faces(&region, &x) * if inside { -1.0 } else { 1.0 };
        let got = region.signed_distance(&x);
        assert!((f64::from(got) - want).abs() < TOLERANCE, "{region:?} {x:?}: {got} {want}");
        assert_eq!(region.weight(&x) == 1.0, inside);
    }

    proptest! {
        #[test]
        fn distance_is_that_of_the_nearest_face(
            min in prop::array::uniform3(-5.0..0.0_f32),
            size in prop::array::uniform3(0.5..5.0_f32),
            x in prop::array::uniform3(-6.0..6.0_f32),
        ) {
            check([min[0]], [size[0]], [x[0]]);
            check([min[0], min[1]], [size[0], size[1]], [x[0], x[1]]);
            check(min, size, x);
        }
    }

    #[test]
    fn weights_on_a_lattice_are_those_of_its_positions() {
        let lattice = Domain::new([9, 7], [0.5, 2.0], [-1.0, 3.0], crate::Unit::Sample).unwrap();
        for (min, max) in
            [([-0.9, 4.0], [1.5, 9.5]), ([-9.0, 0.0], [9.0, 5.1]), ([0.1; 2], [0.2; 2])]
        {
            let region = BoxRegion::new(min, max).unwrap();
            for (i, j) in [(0, 0), (3, 1), (0, 2), (5, 3), (8, 6)] {
                let mut got = vec![7.0; 9 - i];
                region.weights_on(&lattice, [i, j], &mut got);
                let want: Vec<f32> =
                    (i..9).map(|k| region.weight(&lattice.position([k, j]))).collect();
                assert_eq!(got, want, "{region:?} from {i}, {j}");
            }
        }
    }

    #[test]
    fn samples_beyond_the_integers_of_f32_are_told_apart() {
        let (first, lattice) = (1usize << 27, Domain::unit([1 << 28]).unwrap());
        let region = BoxRegion::new([first as f32], [(first + 16) as f32]).unwrap();
        let mut weights = [0.0; 24];
        region.weights_on(&lattice, [first - 3], &mut weights);
        let inside = |k: usize| (4..19).contains(&k);
        assert!((0..24).all(|k| (weights[k] == 1.0) == inside(k)), "{weights:?}");
    }

    #[test]
    fn bad_corners_are_typed_errors() {
        for (min, max) in [(1.0, 1.0), (f32::NAN, 1.0), (0.0, f32::INFINITY), (2.0, 1.0)] {
            assert!(matches!(BoxRegion::new([min], [max]), Err(Error::Parameter { .. })));
        }
    }
}
