//! Run-time choice of the vector unit. The only `unsafe` of the workspace lives here.
#![allow(unsafe_code)]

/// A numeric loop nest that [`dispatch`] compiles once per vector unit.
///
/// Write `run`, and every function it calls in its hot loops, with `#[inline(always)]`: only
/// inlined code takes the wider instructions. Do not use `mul_add`: without it all variants give
/// the same bits.
pub trait Kernel {
    /// What the kernel returns.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the widest vector instructions of this machine (AVX-512, AVX2, or the
/// target's baseline, which is NEON on aarch64).
#[inline]
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
        {
            // SAFETY: the features that `run_avx512` is compiled for were detected just above.
            return unsafe { run_avx512(kernel) };
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the feature that `run_avx2` is compiled for was detected just above.
            return unsafe { run_avx2(kernel) };
        }
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
