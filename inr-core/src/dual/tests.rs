use proptest::prelude::*;

use super::*;

/// Values of order 1 after a few f64 operations; 1e-15 observed.
const ROUNDING: f64 = 1e-12;

/// Central differences with step 1e-5: truncation 1e-10 times the third derivative (below 50 on
/// the tested ranges), cancellation 1e-11.
const DIFFERENCE_TOLERANCE: f64 = 1e-8;

const STEP: f64 = 1e-5;

/// A function written once, as a user of the crate would.
trait Function {
    fn at<T: Scalar>(x: T) -> T;
}

/// Checks the slope against central differences, and the curvature against the differences of
/// the slope.
fn check_against_differences<F: Function>(x: f64) {
    let slope = |x: f64| F::at(Dual::<f64, 1>::variable(x, 0)).eps[0];
    let jet = F::at(seed2([x])[0]);
    let want_slope = (F::at(x + STEP) - F::at(x - STEP)) / (2.0 * STEP);
    let want_curvature = (slope(x + STEP) - slope(x - STEP)) / (2.0 * STEP);
    assert_eq!(jet.re.re, F::at(x));
    for (got, want) in [(jet.gradient()[0], want_slope), (jet.laplacian(), want_curvature)] {
        let error = (got - want).abs();
        assert!(error < DIFFERENCE_TOLERANCE * (1.0 + want.abs()), "{x}: {got} {want} {error}");
    }
}

macro_rules! function_test {
    ($test:ident, $range:expr, $x:ident => $f:expr) => {
        #[test]
        fn $test() {
            struct Tested;
            impl Function for Tested {
                fn at<T: Scalar>($x: T) -> T {
                    $f
                }
            }
            proptest!(|(x in $range)| check_against_differences::<Tested>(x));
        }
    };
}

function_test!(sin_matches_differences, -4.0..4.0_f64, x => x.sin());
function_test!(cos_matches_differences, -4.0..4.0_f64, x => x.cos());
function_test!(tan_matches_differences, -0.8..0.8_f64, x => x.tan());
function_test!(exp_matches_differences, -2.0..2.0_f64, x => x.exp());
function_test!(ln_matches_differences, 0.7..9.0_f64, x => x.ln());
function_test!(sqrt_matches_differences, 0.7..9.0_f64, x => x.sqrt());
function_test!(abs_matches_differences, 0.1..2.0_f64, x => (-x).abs() + x.abs());
function_test!(powi_matches_differences, 0.8..1.5_f64, x => x.powi(3) + x.powi(-2) + x.powi(1));
function_test!(quotient_matches_differences, 0.8..2.0_f64, x => (x + T::one()) / (x * x));
function_test!(product_matches_differences, -1.0..1.0_f64, x => x.sin() * x.exp() * x);
function_test!(composition_matches_differences, -1.0..1.0_f64, x => (x.sin() * x.exp()).cos() / (T::one() + x * x).sqrt());

fn dual() -> impl Strategy<Value = Dual<f64, 3>> {
    (0.5..2.0_f64, prop::array::uniform3(-1.0..1.0_f64)).prop_map(|(re, eps)| Dual { re, eps })
}

fn assert_close(a: Dual<f64, 3>, b: Dual<f64, 3>) {
    let parts = |x: Dual<f64, 3>| [x.re, x.eps[0], x.eps[1], x.eps[2]];
    for (p, q) in parts(a).into_iter().zip(parts(b)) {
        assert!((p - q).abs() < ROUNDING * (1.0 + q.abs()), "{a:?} {b:?}");
    }
}

proptest! {
    #[test]
    fn arithmetic_obeys_the_field_laws(a in dual(), b in dual(), c in dual()) {
        assert_close(a * (b + c), a * b + a * c);
        assert_close((a * b) * c, a * (b * c));
        assert_close(a / b * b, a);
        assert_close(a - b, a + -b);
        assert_close([a, b, c].into_iter().sum(), a + b + c);
        let mut d = a;
        d += b;
        d -= c;
        d *= b;
        assert_close(d, (a + b - c) * b);
    }

    #[test]
    fn functions_obey_their_identities(a in dual(), b in dual()) {
        assert_close(a.ln().exp(), a);
        assert_close(a.sqrt() * a.sqrt(), a);
        assert_close(a.sin() * a.sin() + a.cos() * a.cos(), Dual::one());
        assert_close(a.sin() / a.cos(), a.tan());
        assert_close((a * b).ln(), a.ln() + b.ln());
        assert_close(a.powi(4), a * a * a * a);
        assert_close(a.powi(-1), Dual::one() / a);
        assert_close((-a).abs(), a);
    }

    /// Both orders of nesting hold the same numbers: the Hessian is symmetric.
    #[test]
    fn hessian_is_symmetric(x in prop::array::uniform3(0.5..1.5_f64)) {
        let [x, y, z] = seed2(x);
        let f = (x * y.sin()).exp() / z + (x * z).ln() * y;
        for d in 0..3 {
            for e in 0..d {
                prop_assert!((f.hessian(d, e) - f.hessian(e, d)).abs() < 1e-11);
            }
        }
    }

    /// The first-order parts of a nested number are what the plain dual number gives.
    #[test]
    fn nesting_keeps_the_first_order(x in prop::array::uniform2(0.5..1.5_f64)) {
        fn f<T: Scalar>([x, y]: [T; 2]) -> T {
            (x * y).sin() + x.powi(3) / y
        }
        let (value, slopes) = gradient(f, x);
        let nested = f(seed2(x));
        prop_assert_eq!(nested.re.re, value);
        prop_assert_eq!(nested.re.eps, slopes);
        prop_assert_eq!(nested.gradient(), slopes);
    }

    #[test]
    fn laplacian_of_a_polynomial(x in prop::array::uniform2(-2.0..2.0_f64)) {
        let [u, v] = seed2(x);
        let f = u * u * u * v + v * v;
        let want = 6.0 * x[0] * x[1] + 2.0;
        prop_assert!((f.laplacian() - want).abs() < ROUNDING * (1.0 + want.abs()));
        prop_assert!((f.hessian(0, 1) - 3.0 * x[0] * x[0]).abs() < ROUNDING * 20.0);
    }

    /// sin(k . x) is an eigenfunction of the Laplacian: the eigenvalue is -|k|^2.
    #[test]
    fn laplacian_of_a_plane_wave(x in prop::array::uniform3(-2.0..2.0_f64)) {
        let k = [1.0, -2.0, 0.5];
        let phase: Dual2<3> = seed2(x).into_iter().zip(k).map(|(x, k)| x * Dual::from_f64(k)).sum();
        let f = phase.sin();
        prop_assert!((f.laplacian() + 5.25 * f.re.re).abs() < ROUNDING);
    }
}

#[test]
fn constants_have_no_derivatives() {
    let c = Dual::<f64, 2>::from_f64(3.0);
    assert_eq!((c.re, c.eps), (3.0, [0.0; 2]));
    let one = Dual::<f64, 2>::variable(0.0, 1).powi(0);
    assert_eq!((one.re, one.eps), (1.0, [0.0; 2]));
    let cube = Dual::<f64, 1>::variable(0.0, 0).powi(3);
    assert_eq!((cube.re, cube.eps), (0.0, [0.0]));
}

#[test]
fn comparisons_see_the_real_part_only() {
    let (a, b) = (Dual::<f64, 1>::variable(1.0, 0), Dual::constant(1.0));
    assert!(a == b && a < Dual::constant(2.0));
    assert!(!Dual::<f64, 1>::variable(0.0, 0).is_zero() && Dual::<f64, 1>::zero().is_zero());
    assert!(Dual::<f64, 1>::constant(f64::NAN).partial_cmp(&a).is_none());
}

#[test]
fn abs_takes_the_right_hand_slope_at_zero() {
    assert_eq!(Dual::<f64, 1>::variable(0.0, 0).abs().eps, [1.0]);
    assert_eq!(Dual::<f64, 1>::variable(-2.0, 0).abs().eps, [-1.0]);
}

#[test]
fn f32_nests_as_well() {
    let x = seed(seed([0.5_f32, 2.0]));
    let f = x[0] * x[1] * x[1];
    assert_eq!(f.laplacian(), 1.0_f32);
    assert_eq!(f.gradient(), [4.0, 2.0]);
}
