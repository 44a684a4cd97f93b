//! Loudness.
//!
//! Source: ITU-R BS.1770-4, "Algorithms to measure audio programme loudness and true-peak audio
//! level", annex 1. Its filters are given for 48 kHz; the analogue filters behind them, from which
//! those for other rates are made by the bilinear transform, are those of B. De Man, "Evaluation of
//! implementations of the EBU R128 loudness measurement" (AES 145, 2018).

use std::f64::consts::PI;

use crate::Audio;

/// Blocks quieter than this count as silence, in LUFS.
const ABSOLUTE_GATE: f64 = -70.0;
/// Blocks that are this much below the mean do not count, in LU.
const RELATIVE_GATE: f64 = -10.0;
/// Blocks of 400 ms start every 100 ms: they consist of four steps.
const STEPS: usize = 4;
/// The corners of the two filters, in Hz.
const SHELF_HZ: f64 = 1_681.974_450_955_533;
const HIGH_PASS_HZ: f64 = 38.135_470_876_024_44;

impl Audio {
    /// The integrated loudness in LUFS after ITU-R BS.1770-4: the power behind a filter that imitates
    /// the head (K-weighting), in blocks of 400 ms, without those below -70 LUFS and those more than
    /// 10 LU below the mean of the rest.
    ///
    /// `None` for silence, for less than one block of 400 ms, for rates up to 100 Hz and for sounds
    /// with NaN or infinite values. Below 3.4 kHz, where the first filter would be above half the
    /// rate, only the second is applied. Channels count once, surround channels at the sides 1.41
    /// times and the bass channel not, in the order of WAV: 4 are quadraphony, 5 are 5.0, 6 are 5.1,
    /// 7 are 6.1, 8 are 7.1.
    pub fn loudness(&self) -> Option<f64> {
        let rate = f64::from(self.rate_hz());
        let edge = |step: usize| (step as f64 * rate / 10.0).round() as usize;
        let steps = (0..).take_while(|step| edge(step + 1) <= self.frames()).count();
        if rate <= 100.0 || steps < STEPS {
            return None;
        }
        let mut energies = vec![0.0; steps];
        for (c, weight) in weights(self.channels()).iter().enumerate() {
            let mut filters = [shelf(rate), high_pass(rate)];
            let mut filtered = self.plane(c).iter().map(|v| {
                filters.iter_mut().fold(f64::from(*v), |value, filter| filter.next(value))
            });
            for (step, energy) in energies.iter_mut().enumerate() {
                let samples = filtered.by_ref().take(edge(step + 1) - edge(step));
                *energy += weight * samples.map(|v| v * v).sum::<f64>();
            }
        }
        if energies.iter().any(|e| !e.is_finite()) {
            return None;
        }
        let power = |k: usize| {
            energies[k..k + STEPS].iter().sum::<f64>() / (edge(k + STEPS) - edge(k)) as f64
        };
        let powers: Vec<f64> = (0..=steps - STEPS).map(power).collect();
        let audible = mean_above(&powers, from_lufs(ABSOLUTE_GATE))?;
        let gate = from_lufs(ABSOLUTE_GATE).max(audible * 10f64.powf(RELATIVE_GATE / 10.0));
        mean_above(&powers, gate).map(|power| -0.691 + 10.0 * power.log10())
    }
}

fn from_lufs(loudness: f64) -> f64 {
    10f64.powf((loudness + 0.691) / 10.0)
}

fn mean_above(powers: &[f64], gate: f64) -> Option<f64> {
    let above = powers.iter().filter(|p| **p > gate);
    let (count, sum) = above.fold((0, 0.0), |(count, sum), p| (count + 1, sum + p));
    (count > 0).then(|| sum / f64::from(count))
}

/// Weights of the channels. Source: BS.1770-4, tables 3 and 4: 1.41 from 60 to 120 degrees.
fn weights(channels: usize) -> &'static [f64] {
    const SIDE: f64 = 1.41;
    match channels {
        4 => &[1.0, 1.0, SIDE, SIDE],
        5 => &[1.0, 1.0, 1.0, SIDE, SIDE],
        6 => &[1.0, 1.0, 1.0, 0.0, SIDE, SIDE],
        7 => &[1.0, 1.0, 1.0, 0.0, 1.0, SIDE, SIDE],
        8 => &[1.0, 1.0, 1.0, 0.0, 1.0, 1.0, SIDE, SIDE],
        _ => &[1.0; 3][..channels.min(3)],
    }
}

/// A filter of second order, transposed direct form II.
struct Filter {
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
}

impl Filter {
    fn next(&mut self, x: f64) -> f64 {
        let y = self.b[0] * x + self.state[0];
        self.state[0] = self.b[1] * x - self.a[0] * y + self.state[1];
        self.state[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

/// Raises what is above 1.7 kHz by 4 dB: the head as a sphere.
fn shelf(rate: f64) -> Filter {
    if rate <= 2.0 * SHELF_HZ {
        return Filter { b: [1.0, 0.0, 0.0], a: [0.0; 2], state: [0.0; 2] };
    }
    let k = (PI * SHELF_HZ / rate).tan();
    let (high, q) = (10f64.powf(3.999_843_853_973_347 / 20.0), 0.707_175_236_955_419_6);
    let (band, kk) = (high.powf(0.499_666_774_154_541_6), k * k);
    let a0 = 1.0 + k / q + kk;
    Filter {
        b: [high + band * k / q + kk, 2.0 * (kk - high), high - band * k / q + kk].map(|v| v / a0),
        a: [2.0 * (kk - 1.0), 1.0 - k / q + kk].map(|v| v / a0),
        state: [0.0; 2],
    }
}

/// Takes away what is below 38 Hz.
fn high_pass(rate: f64) -> Filter {
    let k = (PI * HIGH_PASS_HZ / rate).tan();
    let (q, kk) = (0.500_327_037_323_877_3, k * k);
    let a0 = 1.0 + k / q + kk;
    // The numerator is not normalised in the recommendation either.
    let a = [2.0 * (kk - 1.0), 1.0 - k / q + kk].map(|v| v / a0);
    Filter { b: [1.0, -2.0, 1.0], a, state: [0.0; 2] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(rate_hz: u32, seconds: f64, amplitude: f64) -> Vec<f32> {
        let step = 2.0 * PI * 997.0 / f64::from(rate_hz);
        let frames = (seconds * f64::from(rate_hz)) as usize;
        (0..frames).map(|n| (amplitude * (step * n as f64).sin()) as f32).collect()
    }

    fn near(loudness: Option<f64>, expected: f64, tolerance: f64) {
        let loudness = loudness.unwrap();
        assert!((loudness - expected).abs() <= tolerance, "{loudness}, expected {expected}");
    }

    #[test]
    fn coefficients_of_the_recommendation() {
        let (shelf, high_pass) = (shelf(48_000.0), high_pass(48_000.0));
        let b = [1.535_124_859_586_97, -2.691_696_189_406_38, 1.198_392_810_852_85];
        let a = [-1.690_659_293_182_41, 0.732_480_774_215_85];
        let high = [-1.990_047_454_833_98, 0.990_072_250_366_21];
        let same = |x: &[f64], y: &[f64]| x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-7);
        assert!(same(&shelf.b, &b) && same(&shelf.a, &a) && same(&high_pass.a, &high));
    }

    #[test]
    fn sine_at_every_rate() {
        for rate in [48_000, 44_100, 16_000, 96_000, 8_000, 11_025] {
            let mono = Audio::new(rate, 1, sine(rate, 3.0, 0.1)).unwrap();
            let tolerance = if rate < 16_000 { 0.2 } else { 0.1 };
            near(mono.loudness(), -23.0, tolerance);
        }
        // Both channels: twice the power. Bass does not count, sides count 1.41 times.
        let one = sine(48_000, 2.0, 0.1);
        near(Audio::new(48_000, 2, one.repeat(2)).unwrap().loudness(), -20.0, 0.1);
        let expected = -23.0 + 10.0 * (3.0f64 + 2.0 * 1.41).log10();
        near(Audio::new(48_000, 6, one.repeat(6)).unwrap().loudness(), expected, 0.1);
    }

    #[test]
    fn silence_is_gated() {
        let mut data = sine(48_000, 5.0, 0.1);
        data.extend(vec![0.0; 48_000 * 20]);
        data.extend(sine(48_000, 5.0, 0.01));
        near(Audio::new(48_000, 1, data).unwrap().loudness(), -23.0, 0.2);
    }

    #[test]
    fn nothing_to_measure() {
        let none = |rate, data: Vec<f32>| Audio::new(rate, 1, data).unwrap().loudness();
        assert_eq!(none(48_000, vec![0.0; 48_000]), None);
        assert_eq!(none(48_000, vec![1e-5; 48_000]), None);
        assert_eq!(none(48_000, sine(48_000, 0.3999, 0.5)), None);
        assert!(none(48_000, sine(48_000, 0.4, 0.5)).is_some());
        assert_eq!(none(100, vec![0.5; 1000]), None);
        assert!(none(1000, sine(1000, 1.0, 0.5)).is_some());
        assert_eq!(none(48_000, vec![f32::NAN; 48_000]), None);
    }
}
