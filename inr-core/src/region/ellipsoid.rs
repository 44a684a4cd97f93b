use crate::{Error, Region, Result};

/// Newton steps before giving up on further digits: while one term near its pole dominates, a step
/// takes `s` to `1.5 s`, from a sum of at most `D` to one of 1 within rounding: `log_1.5 (1e16)^(1/2)`
/// = 46, and a few quadratic steps. 44 were the most seen in 4e5 random cases, radii 1e6 : 1.
const MAX_STEPS: usize = 60;

/// An axis-aligned ellipsoid: interval, ellipse, ellipsoid; a ball when all radii are equal.
///
/// The signed distance is exact, up to rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid<const D: usize> {
    center: [f32; D],
    radii: [f32; D],
}

impl<const D: usize> Ellipsoid<D> {
    /// The ellipsoid with the given centre and semi-axes (> 0), in physical units, finite.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn new(center: [f32; D], radii: [f32; D]) -> Result<Self> {
        if let Some(&value) = center.iter().find(|v| !v.is_finite()) {
            return Err(Error::Parameter { what: "the ellipsoid's centre", rule: "finite", value });
        }
        if let Some(&value) = radii.iter().find(|v| !(**v > 0.0 && v.is_finite())) {
            let (what, rule) = ("the ellipsoid's radius", "positive and finite");
            return Err(Error::Parameter { what, rule, value });
        }
        Ok(Self { center, radii })
    }

    /// The ball with the given centre and radius (> 0), in physical units.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn ball(center: [f32; D], radius: f32) -> Result<Self> {
        Self::new(center, [radius; D])
    }

    /// The centre.
    pub fn center(&self) -> [f32; D] {
        self.center
    }

    /// The semi-axes.
    pub fn radii(&self) -> [f32; D] {
        self.radii
    }
}

impl<const D: usize> Region<D> for Ellipsoid<D> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        let radii = self.radii.map(f64::from);
        let y: [f64; D] =
            std::array::from_fn(|d| (f64::from(x[d]) - f64::from(self.center[d])).abs());
        let inside = (0..D).map(|d| (y[d] / radii[d]).powi(2)).sum::<f64>() < 1.0;
        let distance = distance_to_surface(radii, y);
        (if inside { -distance } else { distance }) as f32
    }
}

/// Distance from a point `y` with non-negative coordinates to the ellipsoid around the origin.
///
/// The nearest point is `x_d = r_d^2 y_d / (t + r_d^2)` for the largest root `t` of
/// `F(t) = sum_d (r_d y_d / (t + r_d^2))^2 - 1`. `F` is convex and decreasing there, so that Newton's
/// method rises to the root from any start where `F >= 0`. The unknown is `s = t + min_d r_d^2`,
/// which keeps its digits when `y` is close to the ellipsoid's long axes.
///
/// Source: Eberly, "Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid", 2013,
/// with Newton's method in place of bisection.
fn distance_to_surface<const D: usize>(r: [f64; D], y: [f64; D]) -> f64 {
    let shortest = r.into_iter().fold(f64::INFINITY, f64::min);
    // r_d^2 - shortest^2 without cancellation.
    let excess = r.map(|r| (r - shortest) * (r + shortest));
    let positive = || (0..D).filter(|d| y[*d] > 0.0);

    // One term of F alone is 1 here, and every other at most 1.
    let mut s = positive().map(|d| r[d] * y[d] - excess[d]).fold(f64::NEG_INFINITY, f64::max);
    for _ in 0..MAX_STEPS {
        let (mut f, mut slope) = (-1.0, 0.0);
        for d in positive() {
            let term = r[d] * y[d] / (s + excess[d]);
            f += term * term;
            slope -= 2.0 * term * term / (s + excess[d]);
        }
        let next = s - f / slope;
        // Rounding ends the rise. At the centre there are no terms: NaN here, zero below.
        if next <= s {
            break;
        }
        s = next;
    }
    // A root left of the shortest axis' pole: y lies in the plane y_shortest = 0, near the centre,
    // and its nearest points lie off that plane, where the remainder of the equation puts them.
    s = s.max(0.0);
    let (mut squared, mut remainder) = (0.0, 1.0);
    for d in positive() {
        let x = r[d] * (r[d] * y[d] / (s + excess[d]));
        squared += (x - y[d]) * (x - y[d]);
        remainder -= (x / r[d]) * (x / r[d]);
    }
    let off_plane = if s == 0.0 { shortest * shortest * remainder.max(0.0) } else { 0.0 };
    (squared + off_plane).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// f32 rounding of coordinates and distances up to 10.
    const TOLERANCE: f64 = 4e-6;

    /// Point and outward unit normal of the surface in the direction `w` of the unit sphere.
    fn surface<const D: usize>(r: [f32; D], w: [f64; D]) -> ([f64; D], [f64; D]) {
        let length = |v: &[f64; D]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let w = w.map(|v| v / length(&w));
        let normal: [f64; D] = std::array::from_fn(|d| w[d] / f64::from(r[d]));
        (std::array::from_fn(|d| w[d] * f64::from(r[d])), normal.map(|v| v / length(&normal)))
    }

    /// A point `s` along the outward normal of the surface is at signed distance `s`, as long as it
    /// does not lie deeper than the smallest radius of curvature, `min^2 / max`.
    fn check_offset_along_normal<const D: usize>(r: [f32; D], w: [f64; D], outward: f64) {
        let region = Ellipsoid::new([1.0; D], r).unwrap();
        let (min, max) = (r.into_iter().fold(9.0, f32::min), r.into_iter().fold(0.0, f32::max));
        let s = if outward < 0.0 { outward * f64::from(min * min / max) / 5.0 } else { outward };
        let (point, normal) = surface(r, w);
        let x = std::array::from_fn(|d| (1.0 + point[d] + s * normal[d]) as f32);
        let got = region.signed_distance(&x);
        assert!((f64::from(got) - s).abs() < TOLERANCE, "{r:?} {x:?}: got {got}, expected {s}");
    }

    proptest! {
        #[test]
        fn offset_along_the_normal_is_the_distance(
            r in prop::array::uniform3(0.3..3.0_f32),
            w in prop::array::uniform3(0.01..1.0_f64),
            sign in prop::array::uniform3(prop::bool::ANY),
            s in -5.0..5.0_f64,
        ) {
            let w: [f64; 3] = std::array::from_fn(|d| if sign[d] { w[d] } else { -w[d] });
            check_offset_along_normal([r[0]], [w[0]], s);
            check_offset_along_normal([r[0], r[1]], [w[0], w[1]], s);
            check_offset_along_normal(r, w, s);
        }

        /// Every point against 20000 points of the ellipse: their spacing h leaves an error of at
        /// most h, and h^2 / 2 / distance where the distance is not small.
        #[test]
        fn nearest_of_many_surface_points(
            r in prop::array::uniform2(0.3..3.0_f32),
            x in prop::array::uniform2(-4.0..4.0_f32),
            on_axis in 0..3_usize,
        ) {
            let mut x = x;
            if on_axis < 2 { x[on_axis] = 0.0; }
            let turn = |k: usize| (k as f64 * std::f64::consts::TAU / 20000.0).sin_cos();
            let nearest = (0..20000).map(|k| {
                let (sin, cos) = turn(k);
                (f64::from(x[0]) - f64::from(r[0]) * cos).hypot(f64::from(x[1]) - f64::from(r[1]) * sin)
            }).fold(f64::INFINITY, f64::min);
            let got = f64::from(Ellipsoid::new([0.0; 2], r).unwrap().signed_distance(&x));
            prop_assert!((got.abs() - nearest).abs() < 1e-3, "{} {}", got, nearest);
        }
    }

    #[test]
    fn ball_has_its_closed_form() {
        let ball = Ellipsoid::ball([1.0, -2.0, 0.5], 2.0).unwrap();
        for x in [[1.0, -2.0, 0.5], [1.0, -2.0, 3.0], [4.0, 2.0, 0.5], [1.5, -2.0, 0.5]] {
            let offset: [f64; 3] = std::array::from_fn(|d| f64::from(x[d] - ball.center()[d]));
            let want = offset.iter().map(|v| v * v).sum::<f64>().sqrt() - 2.0;
            assert!((f64::from(ball.signed_distance(&x)) - want).abs() < TOLERANCE, "{x:?}");
        }
    }

    #[test]
    fn center_and_extreme_shapes() {
        let thin = Ellipsoid::new([0.0; 3], [1e3, 1e-3, 1.0]).unwrap();
        assert_eq!(thin.signed_distance(&[0.0; 3]), -1e-3);
        assert_eq!(thin.signed_distance(&[2e3, 0.0, 0.0]), 1e3);
        assert_eq!(thin.signed_distance(&[0.0, 5.0, 0.0]), 5.0 - 1e-3);
        let tiny_offset = thin.signed_distance(&[0.0, 1e-30, 0.0]);
        assert!((tiny_offset + 1e-3).abs() < 1e-9, "{tiny_offset}");
        let interval = Ellipsoid::new([2.0], [0.5]).unwrap();
        assert_eq!([1.5, 2.0, 4.0].map(|x| interval.signed_distance(&[x])), [0.0, -0.5, 1.5]);
    }

    #[test]
    fn bad_parameters_are_typed_errors() {
        for (center, radius) in [(f32::NAN, 1.0), (0.0, 0.0), (0.0, f32::INFINITY)] {
            assert!(matches!(Ellipsoid::ball([center], radius), Err(Error::Parameter { .. })));
        }
    }
}
