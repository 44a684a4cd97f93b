//! Run-time choice of the vector unit. The only `unsafe` of the workspace lives in this folder.
#![allow(unsafe_code)]

mod peak;
mod product;
mod simd;
mod sweep;
mod thin;

use std::sync::atomic::{AtomicU8, Ordering};

pub use peak::fused_multiply_add_peak;
pub(crate) use product::{Product, Start, product};
use simd::Baseline;
#[cfg(target_arch = "aarch64")]
use simd::Neon;
pub use simd::Simd;
#[cfg(target_arch = "x86_64")]
use simd::{Avx2, Avx512};
pub(crate) use sweep::{sweep, tangents};
pub(crate) use thin::{add_rows, thin_product};

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

/// A [`Kernel`] that knows its vector unit: for code that multiplies and adds in one step, and so
/// gives other last bits on other units.
pub trait SimdKernel {
    /// What the kernel returns.
    type Output;
    /// Does the work with the vectors of `S`.
    fn run<S: Simd>(self) -> Self::Output;
}

/// The vector instructions that kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Unit {
    /// What every machine of the target has: SSE2 on x86-64, NEON on aarch64.
    Baseline,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// AVX-512 F, VL, BW and DQ.
    Avx512,
}

/// The unit in use; 0 before the first question.
static UNIT: AtomicU8 = AtomicU8::new(0);

impl Unit {
    const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// The widest unit of this machine.
    pub fn detected() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
            {
                return Self::Avx512;
            }
            if avx2 {
                return Self::Avx2;
            }
        }
        Self::Baseline
    }

    /// The unit that kernels run on: the widest of this machine, or what [`Unit::limit`] allowed.
    #[inline]
    pub fn current() -> Self {
        match UNIT.load(Ordering::Relaxed) {
            0 => Self::limit(Self::Avx512),
            n => Self::ALL[usize::from(n) - 1],
        }
    }

    /// Lets kernels of the whole process use this unit at most, and returns what they will use: to
    /// compare units, or to get the bits of another machine.
    pub fn limit(widest: Self) -> Self {
        let unit = Self::detected().min(widest);
        UNIT.store(unit as u8 + 1, Ordering::Relaxed);
        unit
    }
}

/// Runs a kernel with the widest vector instructions of this machine (AVX-512, AVX2, or the
/// target's baseline, which is NEON on aarch64).
#[inline]
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    struct Same<K>(K);
    impl<K: Kernel> SimdKernel for Same<K> {
        type Output = K::Output;

        #[inline(always)]
        fn run<S: Simd>(self) -> K::Output {
            self.0.run()
        }
    }
    dispatch_simd(Same(kernel))
}

/// [`dispatch`] for kernels that know their unit.
#[inline]
pub fn dispatch_simd<K: SimdKernel>(kernel: K) -> K::Output {
    match Unit::current() {
        // SAFETY: `Unit::current` is never wider than what this machine was found to have.
        #[cfg(target_arch = "x86_64")]
        Unit::Avx512 => unsafe { run_avx512(kernel) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Unit::Avx2 => unsafe { run_avx2(kernel) },
        #[cfg(target_arch = "aarch64")]
        _ => kernel.run::<Neon>(),
        #[cfg(not(target_arch = "aarch64"))]
        _ => kernel.run::<Baseline>(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
fn run_avx512<K: SimdKernel>(kernel: K) -> K::Output {
    kernel.run::<Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<K: SimdKernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}
