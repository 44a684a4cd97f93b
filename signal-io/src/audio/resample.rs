use rubato::audioadapter_buffers::direct::SequentialSlice;
use rubato::{Fft, FixedSync, Resampler, WindowFunction};

use super::check_rate;
use crate::budget::with_capacity;
use crate::error::Fault;
use crate::{Audio, Error, Result};

/// The shorter side of a transform has at least this many samples: the filter falls from 1 to 0
/// within the uppermost half percent of the band.
const BLOCK: usize = 2048;
/// The most by which a rate may change at once: 1 kHz becomes 256 kHz.
const MAX_RATIO: u32 = 256;

impl Audio {
    /// The same sound at another sampling rate: `round(frames * rate_hz / old rate)` frames, at least
    /// one. Frame 0 stays at time 0; before the first and after the last frame there is silence.
    ///
    /// Band-limited by a windowed sinc of at least 2048 samples (Blackman-Harris squared), applied
    /// in f64 by Fourier transforms: frequencies below 98 % of half the lower rate keep their
    /// amplitude and phase, those above half of it go. Number type and channels stay; floats may
    /// overshoot a peak of 1. NaN and infinite values spread over their surroundings, a block of the
    /// transform.
    ///
    /// # Errors
    /// [`Error::Audio`] when `rate_hz` is 0 or beyond [`MAX_RATE_HZ`](Self::MAX_RATE_HZ), when the
    /// rates differ by a factor of more than 256, and when there is no memory for the result.
    pub fn resampled(&self, rate_hz: u32) -> Result<Self> {
        check_rate(rate_hz)?;
        let (old, new) = (self.rate_hz, rate_hz);
        if old == new {
            return Ok(self.clone());
        }
        if old.max(new) / old.min(new) > MAX_RATIO {
            let what = format!("{old} Hz cannot become {new} Hz; go through a rate in between");
            return Err(Error::Audio { what });
        }
        let fail = |error: &dyn std::fmt::Display| Error::Audio {
            what: format!("{old} Hz cannot become {new} Hz: {error}"),
        };
        let (frames, old_wide, new_wide) =
            (self.frames() as u128, u128::from(old), u128::from(new));
        let frames = ((frames * new_wide * 2 + old_wide) / (2 * old_wide)).max(1) as usize;
        let mut data = with_capacity(frames.saturating_mul(self.channels))
            .map_err(|_: Fault| fail(&format!("no memory for {frames} frames")))?;

        // Transforms hold whole periods in which both rates meet; an even number of periods puts
        // the middle of the filter, the delay, on a sample of both rates.
        let common = gcd(old, new);
        let period = (old.min(new) / common) as usize;
        let periods = BLOCK.div_ceil(period).next_multiple_of(2);
        let block = periods * (old / common) as usize;
        let window = WindowFunction::BlackmanHarris2;
        let (from, to) = (old as usize, new as usize);
        let mut resampler = Fft::new_custom(from, to, block, 1, 1, window, FixedSync::Both)
            .map_err(|e| fail(&e))?;
        for c in 0..self.channels {
            resampler.reset();
            convert(&mut resampler, self.plane(c), frames, &mut data).map_err(|e| fail(&e))?;
        }
        Ok(Self { rate_hz, data, ..*self })
    }
}

/// Appends `frames` samples of one channel to `out`.
fn convert(
    resampler: &mut Fft<f64>,
    plane: &[f32],
    frames: usize,
    out: &mut Vec<f32>,
) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let mut input = vec![0.0f64; resampler.input_frames_next()];
    let mut output = vec![0.0f64; resampler.output_frames_max()];
    let (mut rest, mut skip, mut missing) = (plane, resampler.output_delay(), frames);
    while missing > 0 {
        let (now, later) = rest.split_at(rest.len().min(input.len()));
        rest = later;
        input[..now.len()].iter_mut().zip(now).for_each(|(to, from)| *to = f64::from(*from));
        input[now.len()..].fill(0.0);
        let (read, space) = (input.len(), output.len());
        let from = SequentialSlice::new(&input, 1, read)?;
        let mut to = SequentialSlice::new_mut(&mut output, 1, space)?;
        let (_, written) = resampler.process_into_buffer(&from, &mut to, None)?;
        let usable = &output[skip.min(written)..written];
        skip -= skip.min(written);
        let usable = &usable[..usable.len().min(missing)];
        out.extend(usable.iter().map(|v| *v as f32));
        missing -= usable.len();
    }
    Ok(())
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(rate_hz: u32, frames: usize, hertz: f64) -> Vec<f32> {
        let step = std::f64::consts::TAU * hertz / f64::from(rate_hz);
        (0..frames).map(|n| (step * n as f64).sin() as f32).collect()
    }

    #[test]
    fn sines_stay_in_place() {
        for (old, new, frames) in [
            (44_100, 48_000, 44_100),
            (16_000, 44_100, 12_345),
            (48_000, 16_000, 48_001),
            (8_000, 8_001, 20_000),
            (8_000, 16_000, 9_000),
        ] {
            let mut stereo = sine(old, frames, 1000.0);
            stereo.extend(sine(old, frames, 2345.0));
            let out = Audio::new(old, 2, stereo).unwrap().resampled(new).unwrap();
            let expected = (frames as f64 * f64::from(new) / f64::from(old)).round() as usize;
            assert_eq!((out.frames(), out.rate_hz()), (expected, new));
            let edge = 1500 * new as usize / old.min(new) as usize;
            for (c, hertz) in [1000.0, 2345.0].into_iter().enumerate() {
                let truth = sine(new, expected, hertz);
                let worst = (edge..expected - edge)
                    .map(|n| (out.plane(c)[n] - truth[n]).abs())
                    .fold(0.0, f32::max);
                assert!(worst < 1e-4, "{old} to {new} Hz, {hertz} Hz: {worst}");
            }
        }
    }

    #[test]
    fn what_the_lower_rate_cannot_hold_goes() {
        let high = Audio::new(44_100, 1, sine(44_100, 44_100, 9000.0)).unwrap();
        let out = high.resampled(16_000).unwrap();
        let middle = &out.as_planar()[3000..13_000];
        assert!(middle.iter().all(|v| v.abs() < 1e-5));
    }

    #[test]
    fn extremes() {
        let short = Audio::new(44_100, 1, vec![1.0]).unwrap();
        assert_eq!(short.resampled(48_000).unwrap().frames(), 1);
        assert_eq!(short.resampled(8_000).unwrap().frames(), 1);
        assert_eq!(short.resampled(44_100).unwrap(), short);
        for rate in [0, 100, Audio::MAX_RATE_HZ + 1] {
            assert!(matches!(short.resampled(rate), Err(Error::Audio { .. })), "{rate}");
        }
        let slow = Audio::new(47_981, 1, vec![0.5; 10]).unwrap();
        assert_eq!(slow.resampled(47_977).unwrap().frames(), 10);
    }
}
