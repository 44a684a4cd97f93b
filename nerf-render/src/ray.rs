use crate::{Error, Result};

/// A piece of a straight line: the points `origin + t direction` with `t` in `[near, far]`.
///
/// The direction has unit length, so `t` is a distance in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    origin: [f32; 3],
    direction: [f32; 3],
    near: f32,
    far: f32,
}

impl Ray {
    /// A ray from a direction of any length but zero, and `0 <= near < far`; `far` may be infinite.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn new(origin: [f32; 3], direction: [f32; 3], near: f32, far: f32) -> Result<Self> {
        let wrong =
            |what, rule, value: f32| Err(Error::Parameter { what, rule, value: value.into() });
        if let Some(value) = origin.into_iter().find(|v| !v.is_finite()) {
            return wrong("the ray's origin", "finite", value);
        }
        // In f64 the squares neither overflow nor vanish.
        let d = direction.map(f64::from);
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if !(length.is_finite() && length > 0.0) {
            return wrong(
                "the length of the ray's direction",
                "positive and finite",
                length as f32,
            );
        }
        if !(near >= 0.0 && near.is_finite()) {
            return wrong("near", "at least 0 and finite", near);
        }
        if far.is_nan() || far <= near {
            return wrong("far", "above near", far);
        }
        Ok(Self { origin, direction: d.map(|v| (v / length) as f32), near, far })
    }

    /// Where `t = 0`.
    pub fn origin(&self) -> [f32; 3] {
        self.origin
    }

    /// Unit vector.
    pub fn direction(&self) -> [f32; 3] {
        self.direction
    }

    /// Distance at which the ray begins.
    pub fn near(&self) -> f32 {
        self.near
    }

    /// Distance at which the ray ends; may be infinite.
    pub fn far(&self) -> f32 {
        self.far
    }

    /// The point at distance `t` from the origin.
    pub fn at(&self, t: f32) -> [f32; 3] {
        std::array::from_fn(|d| self.origin[d] + t * self.direction[d])
    }

    /// The part of the ray inside an axis-aligned box, or `None` when that is empty or one point.
    ///
    /// A ray that runs within a face is inside. A box with `min > max` or NaN on an axis is empty.
    /// Distances are rounded to f32: `at(near)` may lie a few roundings outside the box.
    ///
    /// Source: the slab method, Kay and Kajiya, "Ray Tracing Complex Scenes", 1986.
    pub fn clip_box(&self, min: [f32; 3], max: [f32; 3]) -> Option<Self> {
        let (mut near, mut far) = (self.near, self.far);
        for d in 0..3 {
            let (o, v) = (self.origin[d], self.direction[d]);
            let has_points = min[d] <= max[d];
            // Parallel to the slab: 0 / 0 would be NaN below.
            if !has_points || (v == 0.0 && !(min[d]..=max[d]).contains(&o)) {
                return None;
            }
            if v != 0.0 {
                let (a, b) = ((min[d] - o) / v, (max[d] - o) / v);
                near = near.max(a.min(b));
                far = far.min(a.max(b));
            }
        }
        (near < far).then_some(Self { near, far, ..*self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// f32 rounding of positions up to 30 through a division by a direction component; boundaries
    /// closer than this to a tested point are not decided.
    const MARGIN: f64 = 1e-4;

    /// Depth of a point inside the box (negative outside), in f64.
    fn depth(x: [f64; 3], min: [f32; 3], max: [f32; 3]) -> f64 {
        (0..3)
            .map(|d| (x[d] - f64::from(min[d])).min(f64::from(max[d]) - x[d]))
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        /// A point of the ray is in the clipped ray exactly when it is in the box.
        #[test]
        fn clipped_ray_is_the_points_in_the_box(
            origin in prop::array::uniform3(-4.0..4.0_f32),
            direction in prop::array::uniform3(-1.0..1.0_f32),
            flat in 0..4_usize,
            min in prop::array::uniform3(-2.0..0.0_f32),
            size in prop::array::uniform3(0.1..4.0_f32),
            near in 0.0..3.0_f32,
        ) {
            let mut direction = direction;
            if flat < 3 { direction[flat] = 0.0; }
            prop_assume!(direction.iter().any(|v| v.abs() > 0.01));
            let max = std::array::from_fn(|d| min[d] + size[d]);
            let ray = Ray::new(origin, direction, near, 20.0).unwrap();
            let clipped = ray.clip_box(min, max);
            for k in 0..=400 {
                let t = f64::from(near) + (20.0 - f64::from(near)) * f64::from(k) / 400.0;
                let x = std::array::from_fn(|d| {
                    f64::from(origin[d]) + t * f64::from(ray.direction()[d])
                });
                let depth = depth(x, min, max);
                let inside = |margin: f64| clipped.is_some_and(|c| {
                    f64::from(c.near()) - margin <= t && t <= f64::from(c.far()) + margin
                });
                prop_assert!(depth < MARGIN || inside(MARGIN), "missed t = {}", t);
                prop_assert!(depth > -MARGIN || !inside(0.0), "kept t = {}", t);
            }
        }
    }

    #[test]
    fn axis_parallel_rays() {
        let ray = Ray::new([0.5, 0.5, -2.0], [0.0, 0.0, 3.0], 0.0, f32::INFINITY).unwrap();
        let clipped = ray.clip_box([0.0; 3], [1.0; 3]).unwrap();
        assert_eq!((clipped.near(), clipped.far()), (2.0, 3.0));
        assert_eq!(clipped.at(clipped.far()), [0.5, 0.5, 1.0]);
        assert_eq!(ray.clip_box([0.0, 2.0, 0.0], [1.0, 3.0, 1.0]), None);
        let in_a_face = Ray::new([1.0, 0.5, -2.0], [0.0, 0.0, 1.0], 0.0, 9.0).unwrap();
        assert!(in_a_face.clip_box([0.0; 3], [1.0; 3]).is_some());
        let behind = Ray::new([0.5, 0.5, 2.0], [0.0, 0.0, 1.0], 0.0, 9.0).unwrap();
        assert_eq!(behind.clip_box([0.0; 3], [1.0; 3]), None);
        assert_eq!(ray.clip_box([0.0, f32::NAN, 0.0], [1.0; 3]), None);
        assert_eq!(ray.clip_box([0.0, 0.6, 0.0], [1.0, 0.4, 1.0]), None);
    }

    #[test]
    fn bad_parameters_are_typed_errors() {
        let with = |direction, near, far| Ray::new([0.0; 3], direction, near, far);
        for ray in [
            with([0.0; 3], 0.0, 1.0),
            with([f32::NAN, 0.0, 1.0], 0.0, 1.0),
            with([1.0; 3], -1.0, 1.0),
            with([1.0; 3], 2.0, 2.0),
            with([1.0; 3], 0.0, f32::NAN),
            Ray::new([f32::INFINITY, 0.0, 0.0], [1.0; 3], 0.0, 1.0),
        ] {
            assert!(matches!(ray, Err(Error::Parameter { .. })), "{ray:?}");
        }
    }
}
