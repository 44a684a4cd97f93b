//! How much of a blend in blocks is done, before anybody knows how many sweeps it takes.

use poisson_loss::{BlockProgress, BlockStage};

/// Work of a correction, relative to that of all blocks.
const CORRECTION: f32 = 0.5;
/// Sweeps that are expected at first, and what each is expected to leave of the change: typical of large regions.
const SWEEPS: f32 = 4.0;
const RATE: f32 = 0.1;

/// Guesses from the changes of the sweeps so far.
pub struct Pace {
    tolerance: f32,
    /// Change of the last sweep, and how much of the change before it that is.
    last: Option<(usize, f32)>,
    rate: f32,
    /// Largest share so far: a bar does not go back.
    share: f32,
}

impl Pace {
    /// For sweeps that end at this change.
    pub fn new(tolerance: f32) -> Self {
        Self { tolerance, last: None, rate: RATE, share: 0.0 }
    }

    /// The share of the work that is done, 0 to 1.
    pub fn share(&mut self, at: &BlockProgress) -> f32 {
        if at.change.is_finite() && self.last.is_none_or(|(sweep, _)| sweep != at.sweep) {
            if let Some((_, before)) = self.last {
                self.rate = (at.change / before).clamp(0.01, 0.9);
            }
            self.last = Some((at.sweep, at.change));
        }
        let expected = match self.last {
            Some((sweep, change)) => {
                let left = (self.tolerance / change).ln() / self.rate.ln();
                sweep as f32 + left.ceil().max(1.0)
            }
            None => SWEEPS,
        };
        let part = at.block as f32 / at.blocks.max(1) as f32;
        let of_sweep = match (at.blocks, at.stage) {
            (1, _) => part,
            (_, BlockStage::Correction) => CORRECTION * part / (1.0 + CORRECTION),
            _ => (CORRECTION + part) / (1.0 + CORRECTION),
        };
        let expected = if at.blocks == 1 { 1.0 } else { expected };
        let share = (at.sweep as f32 + of_sweep) / expected.max(at.sweep as f32 + 1.0);
        self.share = self.share.max(share.min(1.0));
        self.share
    }

    /// What to say beside the bar.
    pub fn note(&self, at: &BlockProgress) -> String {
        let what = if at.stage == BlockStage::Correction { "correction" } else { "block" };
        format!("sweep {}, {what} {}/{}", at.sweep + 1, at.block, at.blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_rise_to_the_end() {
        let mut pace = Pace::new(1e-5);
        let (mut last, mut change) = (0.0, f32::INFINITY);
        for sweep in 0..4 {
            for stage in [BlockStage::Correction, BlockStage::Blocks] {
                for block in 1..=9 {
                    let at = BlockProgress { stage, sweep, block, blocks: 9, change };
                    let share = pace.share(&at);
                    assert!(share >= last && share <= 1.0, "{share} after {last}");
                    last = share;
                }
            }
            change = 0.05 * 0.03f32.powi(sweep as i32);
        }
        assert!(last > 0.95, "{last}");
        let at = BlockProgress { stage: BlockStage::Blocks, sweep: 0, block: 1, blocks: 1, change };
        assert_eq!(Pace::new(1e-5).share(&at), 1.0);
    }
}
