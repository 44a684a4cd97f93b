use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{AddAssign, Div, MulAssign, Neg, Sub, SubAssign};

use num_traits::{Float, One, Zero};

/// A number that a formula can be evaluated with: `f32`, `f64`, or a [`Dual`](crate::Dual) that
/// carries derivatives along.
///
/// A function generic over `Scalar` is written once and read as plain arithmetic. Called with
/// `f64` it gives the value, called with a dual number it gives the exact derivatives as well, and
/// that makes it the oracle of the hand-differentiated fast paths.
///
/// Comparisons look at the real part only, so that a branch is taken as the plain function would
/// take it.
pub trait Scalar:
    Copy
    + Debug
    + PartialOrd
    + Zero
    + One
    + Sub<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Sum
    + Send
    + Sync
    + 'static
{
    /// A constant: all its derivatives are zero. Rounded when the scalar is narrower than `f64`.
    fn from_f64(value: f64) -> Self;

    /// The real part without derivatives: what picks a knot interval or a branch.
    fn re(self) -> f64;

    /// Sine of an angle in radians.
    fn sin(self) -> Self;

    /// Cosine of an angle in radians.
    fn cos(self) -> Self;

    /// Tangent of an angle in radians.
    fn tan(self) -> Self;

    /// `e^self`.
    fn exp(self) -> Self;

    /// Natural logarithm; NaN below zero.
    fn ln(self) -> Self;

    /// Square root; NaN below zero. Its derivative at zero is not finite.
    fn sqrt(self) -> Self;

    /// `self^n`; 1 for `n = 0`, whatever `self` is.
    fn powi(self, n: i32) -> Self;

    /// Absolute value. A dual number takes the right-hand derivative, 1, at zero.
    fn abs(self) -> Self;
}

impl<F> Scalar for F
where
    F: Float + Debug + AddAssign + SubAssign + MulAssign + Sum + Send + Sync + 'static,
{
    fn from_f64(value: f64) -> Self {
        F::from(value).expect("a float type represents every f64, rounded")
    }

    fn re(self) -> f64 {
        self.to_f64().expect("a float converts to f64")
    }

    fn sin(self) -> Self {
        Float::sin(self)
    }

    fn cos(self) -> Self {
        Float::cos(self)
    }

    fn tan(self) -> Self {
        Float::tan(self)
    }

    fn exp(self) -> Self {
        Float::exp(self)
    }

    fn ln(self) -> Self {
        Float::ln(self)
    }

    fn sqrt(self) -> Self {
        Float::sqrt(self)
    }

    fn powi(self, n: i32) -> Self {
        Float::powi(self, n)
    }

    fn abs(self) -> Self {
        Float::abs(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn horner<T: Scalar>(x: T) -> T {
        let mut y = T::from_f64(0.5);
        for c in [-1.0, 2.0] {
            y *= x;
            y += T::from_f64(c);
        }
        y
    }

    #[test]
    fn one_formula_serves_both_widths() {
        let want = 0.5 * 0.25 * 0.25 - 0.25 + 2.0;
        assert_eq!(horner(0.25_f64), want);
        assert_eq!(horner(0.25_f32).re(), want);
    }

    #[test]
    fn constants_are_rounded_to_the_width() {
        assert_eq!(<f32 as Scalar>::from_f64(0.1), 0.1_f32);
        assert_eq!(<f64 as Scalar>::from_f64(0.1).re(), 0.1);
        assert_eq!(<f32 as Scalar>::from_f64(1e300), f32::INFINITY);
        assert!(<f32 as Scalar>::from_f64(f64::NAN).is_nan());
    }
}
