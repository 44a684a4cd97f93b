use crate::Audio;

/// Frames in a window of [`Audio::click_energy`].
const CLICK: usize = 32;
/// Windows on either side that make up the usual level: 2048 frames.
const AROUND: usize = 2048 / CLICK;
/// How far back a third difference reaches.
const ORDER: usize = 3;

impl Audio {
    /// The largest magnitude of all samples; full scale is 1. NaN does not count.
    pub fn peak(&self) -> f32 {
        self.as_planar().iter().fold(0.0, |peak, v| peak.max(v.abs()))
    }

    /// The mean over all samples of all channels: the constant component, full scale is 1.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.as_planar().iter().map(|v| f64::from(*v)).sum();
        sum / self.as_planar().len() as f64
    }

    /// How much a click at `frame` stands out: about 1 where the sound goes on as before, large where
    /// it jumps. No unit.
    ///
    /// With the third difference `d[n] = x[n] - 3 x[n-1] + 3 x[n-2] - x[n-3]` of every channel, the
    /// energy of the 32 frames from `s` on is
    /// `E(s) = sum over channels, sum of d[n]^2 for n in s..s + 32`, and the result is
    /// `E(frame - 16) / median of E(frame - 16 + 32 j)` for `j` in -64..=64 without 0, as far as these
    /// windows lie within the sound: 2048 frames on both sides. At the ends the first window is moved
    /// inwards until it fits.
    ///
    /// The third difference weakens what is smooth: by `(2 sin(pi f / rate))^3` at a frequency `f`.
    /// In silence the median is 0: the result is infinite when there is a click and 0 otherwise.
    /// It is 0 as well for sounds that have no second window, those below 67 frames.
    pub fn click_energy(&self, frame: usize) -> f64 {
        let n = self.frames();
        if n < ORDER + CLICK {
            return 0.0;
        }
        let start = frame.saturating_sub(CLICK / 2).clamp(ORDER, n - CLICK);
        let before = (1..=AROUND).map_while(|j| start.checked_sub(j * CLICK));
        let after = (1..=AROUND).map(|j| start + j * CLICK);
        let mut around: Vec<f64> = before
            .take_while(|s| *s >= ORDER)
            .chain(after.take_while(|s| s + CLICK <= n))
            .map(|s| self.third_difference_energy(s))
            .collect();
        let Some(median) = median(&mut around) else { return 0.0 };
        let energy = self.third_difference_energy(start);
        if energy == 0.0 { 0.0 } else { energy / median }
    }

    /// `start` is at least 3 and `start + 32` within the sound.
    fn third_difference_energy(&self, start: usize) -> f64 {
        let energy = |c: usize| -> f64 {
            let around = &self.plane(c)[start - ORDER..start + CLICK];
            let difference = |w: &[f32]| {
                let [a, b, c, d] = [w[0], w[1], w[2], w[3]].map(f64::from);
                d - 3.0 * c + 3.0 * b - a
            };
            around.windows(ORDER + 1).map(|w| difference(w).powi(2)).sum()
        };
        (0..self.channels()).map(energy).sum()
    }
}

/// The middle value, or the mean of the two in the middle.
fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    let (low, high) = (values.get(n.checked_sub(1)? / 2)?, values.get(n / 2)?);
    Some((low + high) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(frames: usize) -> Vec<f32> {
        (0..frames).map(|n| (0.5 * (n as f64 * 0.0628).sin()) as f32).collect()
    }

    #[test]
    fn peak_and_mean() {
        let sound = Audio::new(8000, 2, vec![0.5, -2.0, 1.0, f32::NAN]).unwrap();
        assert_eq!(sound.peak(), 2.0);
        assert!(sound.mean().is_nan());
        let sound = Audio::new(8000, 2, vec![0.5, -2.0, 1.0, 1.0]).unwrap();
        assert_eq!(sound.mean(), 0.125);
    }

    #[test]
    fn a_step_is_a_click_and_a_sine_is_not() {
        let smooth = sine(8000);
        let whole = Audio::new(44_100, 1, smooth.clone()).unwrap();
        for frame in [0, 16, 100, 4000, 7999, usize::MAX] {
            let value = whole.click_energy(frame);
            assert!((0.3..2.0).contains(&value), "{value} at {frame}");
        }
        let mut step = smooth;
        step[4000..].iter_mut().for_each(|v| *v += 0.1);
        let jump = Audio::new(44_100, 1, step.clone()).unwrap();
        assert!(jump.click_energy(4000) > 1000.0, "{}", jump.click_energy(4000));
        assert!(jump.click_energy(4015) > 1000.0);
        assert!(jump.click_energy(4040) < 2.0);
        // A step in one of two channels; their energies are added.
        step.extend(sine(8000));
        let stereo = Audio::new(44_100, 2, step).unwrap();
        let half = jump.click_energy(4000) / stereo.click_energy(4000);
        assert!((1.5..2.5).contains(&half), "{half}");
    }

    #[test]
    fn clicks_in_silence_and_in_short_sounds() {
        let mut data = vec![0.0; 1000];
        let silent = Audio::new(8000, 1, data.clone()).unwrap();
        assert_eq!(silent.click_energy(500), 0.0);
        data[500] = 1.0;
        assert_eq!(Audio::new(8000, 1, data).unwrap().click_energy(500), f64::INFINITY);
        for frames in [1, 34, 35, 66, 67] {
            let short = Audio::new(8000, 1, vec![0.0; frames]).unwrap();
            assert_eq!(short.click_energy(0), 0.0);
        }
    }
}
