use std::time::Instant;

use super::{Simd, SimdKernel, dispatch_simd};

/// The multiply-adds per second of one thread with operands in registers, times two: the FLOP/s
/// that a kernel can be measured against. The fastest of `repeats` short runs.
pub fn fused_multiply_add_peak(repeats: usize) -> f64 {
    (0..repeats.max(1)).map(|_| dispatch_simd(Peak)).fold(0.0, f64::max)
}

struct Peak;

/// Long enough for a steady clock, short enough to be lucky on a shared machine.
const STEPS: usize = 400_000;
/// Independent sums: more than latency times units, and no spills with 16 registers.
const SUMS: usize = 12;

impl SimdKernel for Peak {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self) -> f64 {
        // SAFETY: registers only, and `S` is the unit this kernel was compiled for.
        unsafe {
            let (a, b) = (S::splat(0.999), S::splat(std::hint::black_box(1e-3)));
            let mut sums = [S::splat(1.0); SUMS];
            let begin = Instant::now();
            for _ in 0..STEPS {
                for sum in &mut sums {
                    *sum = S::mul_add(*sum, a, b);
                }
            }
            let seconds = begin.elapsed().as_secs_f64();
            let mut out = [0.0f32; 16];
            for sum in sums {
                S::store(out.as_mut_ptr(), sum);
                std::hint::black_box(out);
            }
            2.0 * (STEPS * SUMS * S::LANES) as f64 / seconds
        }
    }
}
