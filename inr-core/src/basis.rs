//! The uniform cubic B-spline: the four basis functions that are not zero between two knots.

use crate::Scalar;

/// Values at `t` in `[0, 1]` past knot `i` of the basis functions centred at `i-1, i, i+1, i+2`.
#[inline(always)]
pub fn cubic_weights<T: Scalar>(t: T) -> [T; 4] {
    let c = T::from_f64;
    let (u, sixth) = (c(1.0) - t, c(1.0 / 6.0));
    [
        u * u * u * sixth,
        (c(4.0) + t * t * (c(3.0) * t - c(6.0))) * sixth,
        (c(4.0) + u * u * (c(3.0) * u - c(6.0))) * sixth,
        t * t * t * sixth,
    ]
}

/// First derivatives of [`cubic_weights`] with respect to `t`.
#[inline(always)]
pub fn cubic_weights_d1<T: Scalar>(t: T) -> [T; 4] {
    let c = T::from_f64;
    let (u, half) = (c(1.0) - t, c(0.5));
    [
        -(u * u) * half,
        t * (c(3.0) * t - c(4.0)) * half,
        -(u * (c(3.0) * u - c(4.0))) * half,
        t * t * half,
    ]
}

/// Second derivatives of [`cubic_weights`] with respect to `t`.
#[inline(always)]
pub fn cubic_weights_d2<T: Scalar>(t: T) -> [T; 4] {
    let c = T::from_f64;
    let u = c(1.0) - t;
    [u, c(3.0) * t - c(2.0), c(3.0) * u - c(2.0), t]
}

/// The derivative of order 0, 1 or 2 of the basis functions at `t`.
///
/// # Panics
/// If `order > 2`.
pub fn cubic_weights_of_order<T: Scalar>(t: T, order: usize) -> [T; 4] {
    match order {
        0 => cubic_weights(t),
        1 => cubic_weights_d1(t),
        2 => cubic_weights_d2(t),
        _ => panic!("derivative of order {order}; a cubic spline is smooth up to order 2"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Dual;

    #[test]
    fn partition_of_unity_and_linear_precision() {
        for k in 0..=20 {
            let t = f64::from(k) / 20.0;
            let w = cubic_weights(t);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            let mean: f64 = w.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * x).sum();
            assert!((mean - t).abs() < 1e-15);
        }
    }

    #[test]
    fn derivatives_match_dual_numbers() {
        for k in 0..=20 {
            let t = f64::from(k) / 20.0;
            let x = Dual::<Dual<f64, 1>, 1>::variable(Dual::variable(t, 0), 0);
            let (w, d1, d2) = (cubic_weights(x), cubic_weights_d1(t), cubic_weights_d2(t));
            for i in 0..4 {
                assert!((w[i].eps[0].re - d1[i]).abs() < 1e-15);
                assert!((w[i].eps[0].eps[0] - d2[i]).abs() < 1e-15);
            }
        }
    }
}
