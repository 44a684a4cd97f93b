/// Vectors of `f32` on one kind of machine, for loops that the compiler does not vectorise well by
/// itself.
///
/// # Safety
/// Every method may use instructions that only its machine has: call them from a
/// [`SimdKernel`](super::SimdKernel) alone, which runs where they exist.
pub trait Simd: Copy + Send + Sync + 'static {
    /// One vector.
    type Vector: Copy;
    /// Numbers in a vector.
    const LANES: usize;
    /// Vectors of columns that a matrix product works on at a time, at most 4.
    const VECTORS: usize;
    /// Rows of accumulators that a matrix product keeps in registers beside 1, 2, 3 or 4 vectors of
    /// columns: enough of them to hide the latency of a multiply-add, few enough not to spill.
    const ROWS: [usize; 4];
    /// Whether a multiply-add is one instruction with one rounding.
    const FUSED: bool;

    /// `a * b + c` for scalar loops that the compiler vectorises; rounded once where
    /// [`Simd::FUSED`] says so.
    #[inline(always)]
    fn fma(a: f32, b: f32, c: f32) -> f32 {
        if Self::FUSED { a.mul_add(b, c) } else { a * b + c }
    }

    /// The same number in every lane.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn splat(x: f32) -> Self::Vector;

    /// `LANES` numbers from memory, at any alignment.
    ///
    /// # Safety
    /// See the trait; `from` must be readable for `LANES` numbers.
    unsafe fn load(from: *const f32) -> Self::Vector;

    /// `LANES` numbers to memory, at any alignment.
    ///
    /// # Safety
    /// See the trait; `to` must be writable for `LANES` numbers.
    unsafe fn store(to: *mut f32, v: Self::Vector);

    /// `a * b + c` lane by lane.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;

    /// `a * b` lane by lane.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector;

    /// The sum of all lanes, added as a tree.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn sum(v: Self::Vector) -> f32;
}

/// Plain arrays of four, which every compiler turns into 128-bit vectors.
#[derive(Debug, Clone, Copy)]
pub struct Baseline;

impl Simd for Baseline {
    type Vector = [f32; 4];
    const LANES: usize = 4;
    const VECTORS: usize = 2;
    const ROWS: [usize; 4] = [8, 4, 0, 0];
    const FUSED: bool = false;

    #[inline(always)]
    unsafe fn splat(x: f32) -> [f32; 4] {
        [x; 4]
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> [f32; 4] {
        // SAFETY: the caller vouches for four numbers.
        unsafe { from.cast::<[f32; 4]>().read_unaligned() }
    }

    #[inline(always)]
    unsafe fn store(to: *mut f32, v: [f32; 4]) {
        // SAFETY: the caller vouches for four numbers.
        unsafe { to.cast::<[f32; 4]>().write_unaligned(v) }
    }

    #[inline(always)]
    unsafe fn mul_add(a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> [f32; 4] {
        [a[0] * b[0] + c[0], a[1] * b[1] + c[1], a[2] * b[2] + c[2], a[3] * b[3] + c[3]]
    }

    #[inline(always)]
    unsafe fn mul(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
    }

    #[inline(always)]
    unsafe fn sum(v: [f32; 4]) -> f32 {
        (v[0] + v[2]) + (v[1] + v[3])
    }
}

/// Implements [`Simd`] with intrinsics that have the same meaning on every machine.
macro_rules! simd {
    ($(#[$doc:meta])* $name:ident, $arch:ident, $vector:ident, $lanes:literal, $vectors:literal, $rows:expr,
     $splat:ident, $load:ident, $store:ident, $mul:ident, |$a:ident, $b:ident, $c:ident| $fma:expr, |$v:ident| $sum:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy)]
        pub struct $name;

        // Where the instructions are part of the target, as NEON is, they are safe to call.
        #[allow(unused_unsafe)]
        impl Simd for $name {
            type Vector = std::arch::$arch::$vector;
            const LANES: usize = $lanes;
            const VECTORS: usize = $vectors;
            const ROWS: [usize; 4] = $rows;
            const FUSED: bool = true;

            #[inline(always)]
            unsafe fn splat(x: f32) -> Self::Vector {
                // SAFETY: the caller runs on a machine with this instruction.
                unsafe { std::arch::$arch::$splat(x) }
            }

            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self::Vector {
                // SAFETY: as above, and the caller vouches for the memory.
                unsafe { std::arch::$arch::$load(from) }
            }

            #[inline(always)]
            unsafe fn store(to: *mut f32, v: Self::Vector) {
                // SAFETY: as above, and the caller vouches for the memory.
                unsafe { std::arch::$arch::$store(to, v) }
            }

            #[inline(always)]
            unsafe fn mul_add($a: Self::Vector, $b: Self::Vector, $c: Self::Vector) -> Self::Vector {
                // SAFETY: the caller runs on a machine with this instruction.
                unsafe { $fma }
            }

            #[inline(always)]
            unsafe fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                // SAFETY: the caller runs on a machine with this instruction.
                unsafe { std::arch::$arch::$mul(a, b) }
            }

            #[inline(always)]
            unsafe fn sum($v: Self::Vector) -> f32 {
                // SAFETY: the caller runs on a machine with this instruction.
                unsafe { $sum }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
simd!(
    /// 8 lanes, 16 registers.
    Avx2, x86_64, __m256, 8, 2, [12, 6, 0, 0],
    _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_mul_ps,
    |a, b, c| std::arch::x86_64::_mm256_fmadd_ps(a, b, c),
    |v| {
        use std::arch::x86_64::*;
        let four = _mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
        let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps(two, two, 1)))
    }
);
#[cfg(target_arch = "x86_64")]
simd!(
    /// 16 lanes, 32 registers.
    Avx512, x86_64, __m512, 16, 4, [14, 12, 8, 6],
    _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_mul_ps,
    |a, b, c| std::arch::x86_64::_mm512_fmadd_ps(a, b, c),
    |v| std::arch::x86_64::_mm512_reduce_add_ps(v)
);
#[cfg(target_arch = "aarch64")]
simd!(
    /// 4 lanes, 32 registers.
    Neon, aarch64, float32x4_t, 4, 4, [14, 12, 8, 6],
    vdupq_n_f32, vld1q_f32, vst1q_f32, vmulq_f32,
    |a, b, c| std::arch::aarch64::vfmaq_f32(c, a, b),
    |v| std::arch::aarch64::vaddvq_f32(v)
);
