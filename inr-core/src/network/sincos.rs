use crate::cpu::Simd;

/// Sine and cosine from one range reduction, for loops that the compiler vectorises.
///
/// For |x| up to 8192 at most 1.7e-7 from the exact values with a fused multiply-add, 4e-7 without
/// it (tested against f64); beyond, the reduction loses digits in proportion to |x|. Not finite in, NaN out.
///
/// Reduction to half a period, so that one sign serves both, by pi in several parts (Cody and Waite
/// 1980); minimax polynomials on -pi/2..pi/2, errors 5e-9 and 4e-10.
#[inline(always)]
pub(crate) fn sincos<S: Simd>(x: f32) -> (f32, f32) {
    /// 1.5 * 2^23: adding it rounds to an integer in the low bits.
    const MAGIC: f32 = 12_582_912.0;
    /// pi rounded, and the rest.
    const TWO: [f32; 2] = [std::f32::consts::PI, -8.742_278e-8];
    /// pi in parts of few bits, whose products with small integers are exact.
    const THREE: [f32; 3] = [3.140_625, 9.675_026e-4, 1.509_957_9e-7];
    let shifted = S::fma(x, std::f32::consts::FRAC_1_PI, MAGIC);
    let k = shifted - MAGIC;
    let r = if S::FUSED {
        S::fma(k, -TWO[1], S::fma(k, -TWO[0], x))
    } else {
        ((x - k * THREE[0]) - k * THREE[1]) - k * THREE[2]
    };
    let q = r * r;
    let sin = S::fma(S::fma(2.599_903_6e-6, q, -1.980_654_7e-4), q, 8.333_016e-3);
    let sin = S::fma(S::fma(sin, q, -1.666_665_7e-1), q * r, r);
    let cos = S::fma(S::fma(-2.619_248_5e-7, q, 2.476_924e-5), q, -1.388_856_8e-3);
    let cos = S::fma(S::fma(S::fma(cos, q, 4.166_665_6e-2), q, -0.5), q, 1.0);
    // Both change sign from one half period to the next.
    let sign = shifted.to_bits() << 31;
    (f32::from_bits(sin.to_bits() ^ sign), f32::from_bits(cos.to_bits() ^ sign))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::{SimdKernel, dispatch_simd};

    struct Worst(f64);

    impl SimdKernel for Worst {
        type Output = f64;

        fn run<S: Simd>(self) -> f64 {
            (0..400_000)
                .map(|i| {
                    let x = ((i as f64 / 200_000.0 - 1.0) * self.0) as f32;
                    let (sin, cos) = sincos::<S>(x);
                    let exact = f64::from(x).sin_cos();
                    (f64::from(sin) - exact.0).abs().max((f64::from(cos) - exact.1).abs())
                })
                .fold(0.0, f64::max)
        }
    }

    #[test]
    fn error_bound_against_libm() {
        let limit = if cfg!(target_arch = "x86_64")
            && crate::cpu::Unit::detected() == crate::cpu::Unit::Baseline
        {
            4e-7
        } else {
            1.7e-7
        };
        for range in [1.0, 100.0, 8192.0] {
            let worst = dispatch_simd(Worst(range));
            assert!(worst <= limit, "{worst:e} within {range}");
        }
    }

    #[test]
    fn not_finite_gives_nan() {
        struct At(f32);
        impl SimdKernel for At {
            type Output = (f32, f32);
            fn run<S: Simd>(self) -> (f32, f32) {
                sincos::<S>(self.0)
            }
        }
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (sin, cos) = dispatch_simd(At(x));
            assert!(sin.is_nan() && cos.is_nan());
        }
    }
}
