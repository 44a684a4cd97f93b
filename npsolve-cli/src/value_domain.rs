//! In which values a blend works: a change of values before it, and back after it.

use anyhow::{Result, bail};

/// Below this share of the mean, the logarithm turns into a straight line: noise in the dark is not structure.
const LOG_FLOOR: f64 = 1e-3;

/// A monotonous change of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mapping {
    /// Values as they are.
    Identity,
    /// `ln(value + floor)`
    Log {
        /// Added before the logarithm.
        floor: f64,
    },
    /// `(value - low) / extent`
    Range {
        /// Becomes 0.
        low: f64,
        /// This much above becomes 1.
        extent: f64,
    },
}

impl Mapping {
    /// Ratios instead of differences, for values of light from 0 on; `name` stands for the file.
    pub fn log(background: &[f32], patch: &[f32], names: &[String; 2]) -> Result<Self> {
        let mean = mean(background);
        let lowest = |values: &[f32]| f64::from(values.iter().copied().fold(0.0, f32::min));
        let lows = [lowest(background), lowest(patch)];
        // Rounding and denoising leave values a little below 0; the floor takes them in.
        let floor = (LOG_FLOOR * mean).max(-2.0 * lows[0].min(lows[1]));
        if !(floor > 0.0 && floor.is_finite()) {
            bail!(
                "{} has no light in it, and --domain log needs some; take --domain stored",
                names[0]
            );
        }
        if floor > 0.1 * mean {
            let which = usize::from(lows[1] < lows[0]);
            bail!(
                "{} holds {}, and logarithms are of values from 0 on; take --domain linear or stored",
                names[which],
                lows[which]
            );
        }
        Ok(Self::Log { floor })
    }

    /// The range of these values to 0..1.
    pub fn range(values: &[f32]) -> Self {
        let [low, high] = extremes(values);
        // One value only: nothing to stretch.
        let extent = if high > low { high - low } else { 1.0 };
        Self::Range { low, extent }
    }

    /// For reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Identity => "stored",
            Self::Log { .. } => "log",
            Self::Range { .. } => "normalize",
        }
    }

    /// The values to blend.
    pub fn forward(self, values: &[f32]) -> Vec<f32> {
        let map = |f: &dyn Fn(f64) -> f64| values.iter().map(|v| f(f64::from(*v)) as f32).collect();
        match self {
            Self::Identity => values.to_vec(),
            Self::Log { floor } => map(&|v| (v + floor).ln()),
            Self::Range { low, extent } => map(&|v| (v - low) / extent),
        }
    }

    /// Blended values as the file has them; where nothing changed, the very values of `stored`, of which `before` are
    /// the mapped ones.
    pub fn back(self, stored: &[f32], before: &[f32], after: &mut [f32]) {
        let inverse = |v: f64| match self {
            Self::Identity => v,
            Self::Log { floor } => v.exp() - floor,
            Self::Range { low, extent } => v * extent + low,
        };
        for ((value, was), stored) in after.iter_mut().zip(before).zip(stored) {
            *value = if value == was { *stored } else { inverse(f64::from(*value)) as f32 };
        }
    }
}

/// Stretches values to the range of others.
pub fn match_range(values: &mut [f32], like: &[f32]) {
    let ([a, b], [low, high]) = (extremes(values), extremes(like));
    let factor = if b > a { (high - low) / (b - a) } else { 0.0 };
    values.iter_mut().for_each(|v| *v = ((f64::from(*v) - a) * factor + low) as f32);
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64
}

fn extremes(values: &[f32]) -> [f64; 2] {
    let low = values.iter().copied().fold(f32::INFINITY, f32::min);
    let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    [low, high].map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mappings_return_and_keep_what_did_not_change() {
        let stored = [0.0, 1e-3, 0.3, 443.0];
        let names = ["a".to_owned(), "b".to_owned()];
        for mapping in [
            Mapping::Identity,
            Mapping::log(&stored, &stored, &names).unwrap(),
            Mapping::range(&stored),
        ] {
            let before = mapping.forward(&stored);
            assert!(before.windows(2).all(|w| w[0] < w[1]), "{mapping:?}");
            let mut same = before.clone();
            mapping.back(&stored, &before, &mut same);
            assert_eq!(same, stored);
            let mut moved: Vec<f32> = before.iter().map(|v| v + 0.125).collect();
            let expected: Vec<f32> = moved.clone();
            mapping.back(&stored, &before, &mut moved);
            for (value, mapped) in moved.iter().zip(mapping.forward(&moved)) {
                let nearest = expected.iter().map(|e| (e - mapped).abs()).fold(f32::MAX, f32::min);
                assert!(nearest < 1e-4 * mapped.abs().max(1.0), "{mapping:?}: {value}");
            }
        }
        assert!(Mapping::log(&[-1.0, 5.0], &[1.0], &names).is_err());
        assert!(Mapping::log(&[0.0], &[1.0], &names).is_err());
        let mut values = [1.0, 2.0, 3.0];
        match_range(&mut values, &[10.0, 30.0]);
        assert_eq!(values, [10.0, 20.0, 30.0]);
    }
}
