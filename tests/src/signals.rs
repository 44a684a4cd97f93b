//! Signals and regions to blend, made from formulas and a seed.

use inr_core::{Domain, RasterMask, Samples};

/// A repeatable generator of numbers in [0, 1): a 64-bit linear congruential generator
/// (Knuth's MMIX constants), upper bits.
pub struct Random(u64);

impl Random {
    /// A stream of numbers.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678)
    }

    /// The next number.
    pub fn unit(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Smooth waves plus a little noise, in about [0, 1], different for every seed and channel.
pub fn textured<const D: usize, const C: usize>(domain: Domain<D>, seed: u64) -> Samples<D, C> {
    let mut random = Random::new(seed);
    let waves: Vec<[[f64; D]; 3]> = (0..C)
        .map(|_| std::array::from_fn(|_| std::array::from_fn(|_| random.unit() - 0.5)))
        .collect();
    let phase: Vec<f64> = (0..3 * C).map(|_| std::f64::consts::TAU * random.unit()).collect();
    let level: Vec<f64> = (0..C).map(|_| 0.35 + 0.3 * random.unit()).collect();
    Samples::from_fn(domain, |x| {
        std::array::from_fn(|c| {
            let wave = |k: usize| {
                let dot: f64 = (0..D).map(|d| waves[c][k][d] * f64::from(x[d])).sum();
                ((0.3 + k as f64) * dot + phase[3 * c + k]).sin()
            };
            let smooth: f64 = (0..3).map(|k| 0.12 * wave(k)).sum();
            (level[c] + smooth + 0.05 * (random.unit() - 0.5)) as f32
        })
    })
}

/// A raster mask from a formula of the sample index, shifted to 0 at the centre and scaled to
/// [-1, 1] per axis.
pub fn mask<const D: usize>(domain: Domain<D>, weight: impl Fn([f64; D]) -> f64) -> RasterMask<D> {
    let weights = (0..domain.len())
        .map(|k| {
            let i = domain.unflatten(k);
            let u =
                std::array::from_fn(|d| 2.0 * (i[d] as f64 + 0.5) / domain.shape()[d] as f64 - 1.0);
            weight(u) as f32
        })
        .collect();
    RasterMask::new(domain, weights).expect("weights in [0, 1], one per sample")
}

/// A ball of the given radius in the units of [`mask`].
pub fn ball<const D: usize>(domain: Domain<D>, radius: f64) -> RasterMask<D> {
    mask(domain, |u| f64::from(u.iter().map(|v| v * v).sum::<f64>() < radius * radius))
}
