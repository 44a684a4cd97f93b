/// Random numbers by position: number `k` of stream `seed`, without a state to keep. What is drawn does
/// not depend on who draws first, and a run that is resumed draws what it would have drawn.
///
/// Source: the output function of SplitMix64 (Steele, Lea and Flood 2014) over a Weyl sequence.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Random {
    seed: u64,
}

impl Random {
    /// Purposes, so that streams of one seed do not repeat each other.
    pub const FREQUENCIES: u64 = 1;
    pub const PARAMETERS: u64 = 2;
    pub const BATCHES: u64 = 3;

    /// The stream of a seed and a purpose.
    pub fn new(seed: u64, purpose: u64) -> Self {
        let start = Self { seed: purpose };
        Self { seed: seed ^ start.bits(seed) }
    }

    /// 64 bits.
    pub fn bits(self, k: u64) -> u64 {
        let mut z = self.seed.wrapping_add(k.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1, a multiple of 2^-24.
    pub fn uniform(self, k: u64) -> f32 {
        (self.bits(k) >> 40) as f32 / (1 << 24) as f32
    }

    /// Uniform in -limit..limit.
    pub fn symmetric(self, k: u64, limit: f32) -> f32 {
        limit * (2.0 * self.uniform(k) - 1.0)
    }

    /// Normal with mean 0 and variance 1 (Box and Muller).
    pub fn normal(self, k: u64) -> f32 {
        let (a, b) = (self.bits(2 * k) >> 11, self.bits(2 * k + 1) >> 11);
        let unit = |n: u64| (n as f64 + 0.5) / (1u64 << 53) as f64;
        ((-2.0 * unit(a).ln()).sqrt() * (std::f64::consts::TAU * unit(b)).cos()) as f32
    }

    /// Uniform in 0..n.
    pub fn below(self, k: u64, n: usize) -> usize {
        ((u128::from(self.bits(k)) * n as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_distributions() {
        let (r, n) = (Random::new(7, 1), 100_000);
        let mean = |f: &dyn Fn(u64) -> f64| (0..n).map(f).sum::<f64>() / n as f64;
        assert!((mean(&|k| f64::from(r.uniform(k))) - 0.5).abs() < 4e-3);
        assert!(mean(&|k| f64::from(r.normal(k))).abs() < 1e-2);
        assert!((mean(&|k| f64::from(r.normal(k)).powi(2)) - 1.0).abs() < 2e-2);
        assert!((0..n).all(|k| r.below(k, 7) < 7 && r.symmetric(k, 2.0).abs() <= 2.0));
        assert_ne!(Random::new(7, 2).bits(0), r.bits(0));
    }
}
