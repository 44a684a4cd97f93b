use inr_core::{Scalar, gradient, seed};

/// Largest residual of a converged [`Distortion::undo`], relative to `1 + |p|`: 1e-13 is 1e-9 pixels
/// at a focal length of 10^4 pixels, and a hundred times the rounding of the polynomial.
const RESIDUAL_TOLERANCE: f64 = 1e-13;

/// Newton steps before giving up; 2 to 5 in 1e5 random lenses, 20 next to the fold of a strong barrel.
const MAX_STEPS: usize = 60;

/// Halvings of one Newton step before giving up: 2^-30 of a step makes no progress.
const MAX_HALVINGS: usize = 30;

/// Radial and tangential lens distortion, OpenCV's five-coefficient model.
///
/// Acts on normalised image coordinates: the ray's `x / z` and `y / z`, x right and y down. All
/// zero (the default) is an ideal pinhole.
///
/// Source: Brown, "Decentering Distortion of Lenses", 1966; coefficients named and ordered as in
/// OpenCV's `(k1, k2, p1, p2, k3)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, times `r^2`.
    pub k1: f64,
    /// Radial, times `r^4`.
    pub k2: f64,
    /// Tangential, vertical.
    pub p1: f64,
    /// Tangential, horizontal.
    pub p2: f64,
    /// Radial, times `r^6`.
    pub k3: f64,
}

impl Distortion {
    /// Where a lens puts the ideal image point `[x, y]`, in normalised coordinates.
    ///
    /// `x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)`, and for `y` with `p1` and
    /// `p2` exchanged. Far outside the image the polynomial may fold back.
    pub fn apply<T: Scalar>(&self, [x, y]: [T; 2]) -> [T; 2] {
        let [k1, k2, p1, p2, k3] = [self.k1, self.k2, self.p1, self.p2, self.k3].map(T::from_f64);
        let r2 = x * x + y * y;
        let radial = T::one() + r2 * (k1 + r2 * (k2 + r2 * k3));
        let two = T::from_f64(2.0);
        [
            x * radial + two * p1 * x * y + p2 * (r2 + two * x * x),
            y * radial + p1 * (r2 + two * y * y) + two * p2 * x * y,
        ]
    }

    /// The ideal image point that the lens puts at `p`, in normalised coordinates; `None` where
    /// there is none, or only one beyond the radius at which the polynomial folds back.
    ///
    /// Newton's method with step halving, to a residual of 1e-13 relative to `1 + |p|`. A dual `p`
    /// gives derivatives up to the third, exact to rounding.
    pub fn undo<T: Scalar>(&self, p: [T; 2]) -> Option<[T; 2]> {
        if *self == Self::default() {
            return Some(p);
        }
        let root = self.undo_real(p.map(Scalar::re))?;
        // From an exact value, a Newton step in dual numbers makes the first derivatives right, and
        // a second one those up to the third: the error's order doubles and goes up by one.
        let mut x = root.map(T::from_f64);
        for _ in 0..2 {
            let step = self.newton_step(x, p);
            x = [x[0] - step[0], x[1] - step[1]];
        }
        Some(x)
    }

    fn undo_real(&self, p: [f64; 2]) -> Option<[f64; 2]> {
        let residual = |x: [f64; 2]| {
            let y = self.apply(x);
            (y[0] - p[0]).hypot(y[1] - p[1])
        };
        let tolerance = RESIDUAL_TOLERANCE * (1.0 + p[0].hypot(p[1]));
        let (mut x, mut error) = (p, residual(p));
        for _ in 0..MAX_STEPS {
            if error <= tolerance {
                return self.is_before_fold(x).then_some(x);
            }
            let step = self.newton_step(x, p);
            let shortened = |k: usize| {
                let scale = 0.5_f64.powi(k as i32);
                let next = [x[0] - scale * step[0], x[1] - scale * step[1]];
                (next, residual(next))
            };
            (x, error) = (0..MAX_HALVINGS).map(shortened).find(|(_, next)| *next < error)?;
        }
        None
    }

    /// `J^-1 (apply(x) - p)` with the Jacobian `J` of `apply` at `x`.
    fn newton_step<T: Scalar>(&self, x: [T; 2], p: [T; 2]) -> [T; 2] {
        let [a, b] = self.apply(seed(x));
        let (e, f) = (a.re - p[0], b.re - p[1]);
        let determinant = a.eps[0] * b.eps[1] - a.eps[1] * b.eps[0];
        [(e * b.eps[1] - f * a.eps[1]) / determinant, (f * a.eps[0] - e * b.eps[0]) / determinant]
    }

    /// Whether the image grows all the way from the centre to `x`, and keeps its orientation there.
    ///
    /// The distorted radius has the slope `1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3` with `s = r^2`: its
    /// minimum on `[0, |x|^2]` is at an end or where its own derivative is zero.
    fn is_before_fold(&self, x: [f64; 2]) -> bool {
        let s = x[0] * x[0] + x[1] * x[1];
        let slope = |s: f64| 1.0 + s * (3.0 * self.k1 + s * (5.0 * self.k2 + s * 7.0 * self.k3));
        let (a, half_b, c) = (21.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1);
        // The roots as q / a and c / q: neither loses digits, and a = 0 leaves one at infinity.
        let q = -(half_b + (half_b * half_b - a * c).max(0.0).sqrt().copysign(half_b));
        let grows =
            [s, q / a, c / q].into_iter().filter(|t| (0.0..=s).contains(t)).all(|t| slope(t) > 0.0);
        let (_, [xx, xy]) = gradient(|x| self.apply(x)[0], x);
        let (_, [yx, yy]) = gradient(|x| self.apply(x)[1], x);
        grows && xx * yy - xy * yx > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The numbers of the other implementation have 16 digits.
    const ROUNDING: f64 = 1e-14;

    /// Made with OpenCV 5.0.0 in Python:
    /// `cv2.projectPoints(np.array([[.5, -.25, 1.]]), np.zeros(3), np.zeros(3), np.eye(3),
    /// np.array([-.3, .12, .01, -.02, .05]))`, and so on for the second set.
    #[test]
    fn apply_matches_opencv() {
        let strong = Distortion { k1: -0.3, k2: 0.12, p1: 0.01, p2: -0.02, k3: 0.05 };
        let mild = Distortion { k1: 0.1, k2: -0.05, p1: -0.002, p2: 0.003, k3: 0.0 };
        for (lens, p, want) in [
            (strong, [0.5, -0.25], [0.440997314453125, -0.2204986572265625]),
            (mild, [-0.4, 0.7], [-0.41351999999999994, 0.7257724999999998]),
        ] {
            let got = lens.apply(p);
            for d in 0..2 {
                assert!((got[d] - want[d]).abs() < ROUNDING, "{got:?} {want:?}");
            }
        }
    }

    fn lens() -> impl Strategy<Value = Distortion> {
        (-0.3..0.3_f64, -0.05..0.05_f64, -0.01..0.01_f64, -0.01..0.01_f64, -0.01..0.01_f64)
            .prop_map(|(k1, k2, p1, p2, k3)| Distortion { k1, k2, p1, p2, k3 })
    }

    proptest! {
        /// A field of view of 90 degrees on the diagonal: r = 1, before the fold of every lens above
        /// (with k1 = -0.3 it is at r = 1.05).
        #[test]
        fn undo_inverts_apply(lens in lens(), x in prop::array::uniform2(-0.6..0.6_f64)) {
            let got = lens.undo(lens.apply(x));
            let got = got.expect("a point before the fold");
            for d in 0..2 {
                prop_assert!((got[d] - x[d]).abs() < 1e-11, "{:?} {:?}", got, x);
            }
        }

        /// The inverse function theorem: the Jacobians are inverse matrices; and the second
        /// derivatives of the identity `undo(apply(x)) = x` vanish.
        #[test]
        fn undo_has_exact_derivatives(lens in lens(), x in prop::array::uniform2(-0.6..0.6_f64)) {
            let round_trip = lens.undo(lens.apply(inr_core::seed2(x))).unwrap();
            for c in 0..2 {
                for d in 0..2 {
                    let identity = if c == d { 1.0 } else { 0.0 };
                    prop_assert!((round_trip[c].gradient()[d] - identity).abs() < 1e-10);
                    for e in 0..2 {
                        prop_assert!(round_trip[c].hessian(d, e).abs() < 1e-8);
                    }
                }
            }
        }
    }

    /// r - r^3 / 2 is largest at r = sqrt(2 / 3), where it is 0.5443.
    #[test]
    fn barrel_lens_ends_at_its_fold() {
        let lens = Distortion { k1: -0.5, ..Distortion::default() };
        for (angle, edge) in [(0.0_f64, 0.5443), (0.7, 0.5443), (2.0, 0.5443)] {
            let at = |r: f64| lens.undo([r * angle.cos(), r * angle.sin()]);
            let x = at(edge - 0.0001).unwrap();
            assert!(x[0].hypot(x[1]) < (2.0_f64 / 3.0).sqrt());
            assert_eq!(at(edge + 0.0001), None);
            assert_eq!(at(3.0), None);
        }
        assert_eq!(lens.undo([f64::NAN, 0.0]), None);
    }
}
