use std::cmp::Ordering;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use num_traits::{One, Zero};

use crate::Scalar;

/// A dual number: a value and its derivatives along `D` directions.
///
/// `re + sum_d eps[d] e_d` with `e_d e_k = 0`: arithmetic on these numbers is the chain rule, so
/// any function written for [`Scalar`] gives exact derivatives, without a step size. A dual number
/// is a `Scalar` over any `Scalar`, so it nests: [`Dual2`] carries second derivatives.
///
/// `==` and `<` compare real parts only; `is_zero` asks for every part to be zero, so that a term
/// skipped because of it has no derivative either.
///
/// Source: Clifford 1873; forward mode as in Griewank and Walther, "Evaluating Derivatives", 2008,
/// chapter 3.
#[derive(Debug, Clone, Copy)]
pub struct Dual<T, const D: usize> {
    /// The value.
    pub re: T,
    /// One derivative per direction.
    pub eps: [T; D],
}

/// A value with its gradient and Hessian in `D` coordinates. See [`seed2`].
pub type Dual2<const D: usize> = Dual<Dual<f64, D>, D>;

impl<T: Scalar, const D: usize> Dual<T, D> {
    /// A number that does not depend on any coordinate.
    pub fn constant(value: T) -> Self {
        Self { re: value, eps: [T::zero(); D] }
    }

    /// The coordinate `axis` itself: its derivative along that axis is 1.
    ///
    /// # Panics
    /// If `axis >= D`.
    pub fn variable(value: T, axis: usize) -> Self {
        let mut x = Self::constant(value);
        x.eps[axis] = T::one();
        x
    }

    /// The first derivatives, also of a nested number.
    pub fn gradient(&self) -> [f64; D] {
        self.eps.map(Scalar::re)
    }

    /// `f(self)` for a function with the given value and slope at `self.re`.
    fn chain(self, value: T, slope: T) -> Self {
        Self { re: value, eps: self.eps.map(|e| e * slope) }
    }
}

impl<T: Scalar, const D: usize> Dual<Dual<T, D>, D> {
    /// The second derivative along axes `d` and `e`.
    ///
    /// # Panics
    /// If an axis is not below `D`.
    pub fn hessian(&self, d: usize, e: usize) -> T {
        self.eps[d].eps[e]
    }

    /// The sum of the pure second derivatives.
    pub fn laplacian(&self) -> T {
        (0..D).map(|d| self.hessian(d, d)).sum()
    }
}

/// The point `x` as variables: evaluate a function with it to get its gradient along.
pub fn seed<T: Scalar, const D: usize>(x: [T; D]) -> [Dual<T, D>; D] {
    std::array::from_fn(|d| Dual::variable(x[d], d))
}

/// The point `x` as variables of second order: evaluate a function with it to get its gradient,
/// [`hessian`](Dual::hessian) and [`laplacian`](Dual::laplacian) along.
///
/// Costs about `(1 + D)^2` plain evaluations.
pub fn seed2<const D: usize>(x: [f64; D]) -> [Dual2<D>; D] {
    seed(seed(x))
}

/// Value and gradient of `f` at `x`, exact to rounding.
///
/// ```
/// let (value, gradient) = inr_core::gradient(|[x, y]| x * y + x, [2.0, 5.0]);
/// assert_eq!((value, gradient), (12.0, [6.0, 2.0]));
/// ```
pub fn gradient<const D: usize>(
    f: impl FnOnce([Dual<f64, D>; D]) -> Dual<f64, D>,
    x: [f64; D],
) -> (f64, [f64; D]) {
    let y = f(seed(x));
    (y.re, y.eps)
}

impl<T: Scalar, const D: usize> PartialEq for Dual<T, D> {
    fn eq(&self, other: &Self) -> bool {
        self.re == other.re
    }
}

impl<T: Scalar, const D: usize> PartialOrd for Dual<T, D> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.re.partial_cmp(&other.re)
    }
}

impl<T: Scalar, const D: usize> Add for Dual<T, D> {
    type Output = Self;

    fn add(self, b: Self) -> Self {
        Self { re: self.re + b.re, eps: std::array::from_fn(|d| self.eps[d] + b.eps[d]) }
    }
}

impl<T: Scalar, const D: usize> Sub for Dual<T, D> {
    type Output = Self;

    fn sub(self, b: Self) -> Self {
        Self { re: self.re - b.re, eps: std::array::from_fn(|d| self.eps[d] - b.eps[d]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl)] // The product rule.
impl<T: Scalar, const D: usize> Mul for Dual<T, D> {
    type Output = Self;

    fn mul(self, b: Self) -> Self {
        let eps = std::array::from_fn(|d| self.eps[d] * b.re + self.re * b.eps[d]);
        Self { re: self.re * b.re, eps }
    }
}

#[allow(clippy::suspicious_arithmetic_impl)] // The quotient rule.
impl<T: Scalar, const D: usize> Div for Dual<T, D> {
    type Output = Self;

    // (a / b)' = (a' - (a / b) b') / b: the quotient is divided by b once more, never by b^2, which
    // would overflow first.
    fn div(self, b: Self) -> Self {
        let re = self.re / b.re;
        Self { re, eps: std::array::from_fn(|d| (self.eps[d] - re * b.eps[d]) / b.re) }
    }
}

impl<T: Scalar, const D: usize> Neg for Dual<T, D> {
    type Output = Self;

    fn neg(self) -> Self {
        Self { re: -self.re, eps: self.eps.map(|e| -e) }
    }
}

impl<T: Scalar, const D: usize> AddAssign for Dual<T, D> {
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<T: Scalar, const D: usize> SubAssign for Dual<T, D> {
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<T: Scalar, const D: usize> MulAssign for Dual<T, D> {
    fn mul_assign(&mut self, b: Self) {
        *self = *self * b;
    }
}

impl<T: Scalar, const D: usize> Sum for Dual<T, D> {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::zero(), Add::add)
    }
}

impl<T: Scalar, const D: usize> Zero for Dual<T, D> {
    fn zero() -> Self {
        Self::constant(T::zero())
    }

    fn is_zero(&self) -> bool {
        self.re.is_zero() && self.eps.iter().all(Zero::is_zero)
    }
}

impl<T: Scalar, const D: usize> One for Dual<T, D> {
    fn one() -> Self {
        Self::constant(T::one())
    }
}

impl<T: Scalar, const D: usize> Scalar for Dual<T, D> {
    fn from_f64(value: f64) -> Self {
        Self::constant(T::from_f64(value))
    }

    fn re(self) -> f64 {
        self.re.re()
    }

    fn sin(self) -> Self {
        self.chain(self.re.sin(), self.re.cos())
    }

    fn cos(self) -> Self {
        self.chain(self.re.cos(), -self.re.sin())
    }

    fn tan(self) -> Self {
        let tan = self.re.tan();
        self.chain(tan, T::one() + tan * tan)
    }

    fn exp(self) -> Self {
        let exp = self.re.exp();
        self.chain(exp, exp)
    }

    fn ln(self) -> Self {
        self.chain(self.re.ln(), T::one() / self.re)
    }

    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, T::from_f64(0.5) / root)
    }

    fn powi(self, n: i32) -> Self {
        match n {
            // 0 * x^-1 would be NaN at x = 0.
            0 => Self::one(),
            _ => self.chain(self.re.powi(n), T::from_f64(n.into()) * self.re.powi(n - 1)),
        }
    }

    fn abs(self) -> Self {
        if self.re < T::zero() { -self } else { self }
    }
}

#[cfg(test)]
mod tests;
