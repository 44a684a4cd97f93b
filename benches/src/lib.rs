//! Problems of any size for the benchmarks: a disc of waves goes into other waves.

use inr_core::{Domain, RasterMask, Samples};

/// A blending problem of `n` by `n` region samples in a background with a margin of 128.
pub struct Square {
    /// The background, with 128 samples around it.
    pub background: Samples<2, 3>,
    /// The patch, `n` by `n`.
    pub patch: Samples<2, 3>,
    /// The patch's whole rectangle, less its outermost samples as OpenCV needs it.
    pub mask: RasterMask<2>,
}

/// Where the patch goes in [`Square`].
pub fn offset() -> [f32; 2] {
    [128.0; 2]
}

/// Waves of several lengths with a gradient of brightness, in [0, 1].
pub fn waves<const C: usize>(shape: [usize; 2], phase: f32) -> Samples<2, C> {
    let domain = Domain::unit(shape).expect("a positive shape");
    let scale = 6.0 / shape[0] as f32;
    Samples::from_fn(domain, |[x, y]| {
        std::array::from_fn(|c| {
            let c = c as f32 + phase;
            let slow = (scale * x + c).sin() + (scale * y * 1.3 - c).cos();
            let fast = (0.37 * x + 0.21 * y + c).sin() * (0.11 * x - 0.29 * y).cos();
            0.5 + 0.15 * slow + 0.1 * fast
        })
    })
}

/// The problem that all timings use.
pub fn square(n: usize) -> Square {
    let patch = waves([n, n], 0.0);
    let domain = *patch.domain();
    let weights = (0..n * n)
        .map(|k| {
            let (x, y) = (k % n, k / n);
            f32::from(x > 0 && y > 0 && x + 1 < n && y + 1 < n)
        })
        .collect();
    let mask = RasterMask::new(domain, weights).expect("weights of 0 and 1");
    Square { background: waves([n + 256, n + 256], 1.7), patch, mask }
}

/// The most memory that this process has had, in bytes; 0 where the system does not tell.
pub fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|l| l.trim().trim_end_matches(" kB").trim().parse::<u64>().ok());
    1024 * kilobytes.unwrap_or(0)
}
