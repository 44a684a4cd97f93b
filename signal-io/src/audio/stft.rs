use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

pub use realfft::num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use crate::{Error, Result};

/// The short-time Fourier transform and its inverse: what sounds when.
///
/// A spectrogram of `frames(n)` frames with `bins()` bins each lies in memory frame after frame: bin
/// `b` of frame `k` is `spectrum[k * bins() + b]`. Frame `k` is centred at sample `k * hop()`, bin `b`
/// at the frequency `b * rate / window` Hz. The window is a periodic Hann window,
/// `w[n] = (1 - cos(2 pi n / window)) / 2`; frames start every quarter of it. The transform is not
/// normalised: a sine of amplitude 1 in the middle of a bin has the magnitude `window / 4`. Phases
/// count from the start of the frame, `window / 2` samples before its centre.
///
/// ```
/// use signal_io::Stft;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let stft = Stft::new(256)?;
/// let sound: Vec<f32> = (0..1000).map(|n| (n as f32 * 0.3).sin()).collect();
/// let spectrum = stft.forward(&sound);
/// assert_eq!(spectrum.len(), stft.frames(sound.len()) * stft.bins());
/// let back = stft.inverse(&spectrum, sound.len());
/// assert!(sound.iter().zip(&back).all(|(a, b)| (a - b).abs() < 1e-5));
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct Stft {
    window: Vec<f32>,
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
}

impl Stft {
    /// The longest window in samples: six minutes at 44.1 kHz.
    pub const MAX_WINDOW: usize = 1 << 24;

    /// Prepares transforms of `window` samples.
    ///
    /// # Errors
    /// [`Error::Audio`] when `window` is odd, below 4 or beyond [`MAX_WINDOW`](Self::MAX_WINDOW).
    pub fn new(window: usize) -> Result<Self> {
        if !window.is_multiple_of(2) || !(4..=Self::MAX_WINDOW).contains(&window) {
            let max = Self::MAX_WINDOW;
            let what = format!("a window of {window} samples; even numbers from 4 to {max} work");
            return Err(Error::Audio { what });
        }
        let hann = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / window as f64).cos();
        let mut planner = RealFftPlanner::new();
        Ok(Self {
            window: (0..window).map(|n| hann(n) as f32).collect(),
            forward: planner.plan_fft_forward(window),
            inverse: planner.plan_fft_inverse(window),
        })
    }

    /// Samples per frame.
    pub fn window(&self) -> usize {
        self.window.len()
    }

    /// Samples from one frame to the next: a quarter of the window, rounded down.
    pub fn hop(&self) -> usize {
        self.window.len() / 4
    }

    /// Frequencies per frame, from 0 to half the sampling rate: `window / 2 + 1`.
    pub fn bins(&self) -> usize {
        self.window.len() / 2 + 1
    }

    /// Frames of `n` samples: the last one is centred at the last sample or at most a hop beyond it;
    /// none for `n = 0`.
    pub fn frames(&self, n: usize) -> usize {
        if n == 0 { 0 } else { (n - 1).div_ceil(self.hop()) + 1 }
    }

    /// The spectrogram of the samples, `frames(x.len()) * bins()` values; beyond both ends there are
    /// zeros.
    pub fn forward(&self, x: &[f32]) -> Vec<Complex32> {
        let mut out = vec![Complex32::default(); self.frames(x.len()) * self.bins()];
        let mut time = self.forward.make_input_vec();
        let mut scratch = self.forward.make_scratch_vec();
        for (k, spectrum) in out.chunks_exact_mut(self.bins()).enumerate() {
            for (n, value) in time.iter_mut().enumerate() {
                let sample = self.sample(k, n).and_then(|at| x.get(at));
                *value = sample.map_or(0.0, |v| v * self.window[n]);
            }
            self.forward
                .process_with_scratch(&mut time, spectrum, &mut scratch)
                .expect("the lengths are those of the plan");
        }
        out
    }

    /// The `n` samples whose spectrogram is nearest to the given one in the sense of least squares:
    /// the frames are windowed again, added where they overlap, and divided by the sum of the
    /// squared windows. After [`forward`](Self::forward) these are the samples it was given, to the
    /// precision of f32.
    ///
    /// `spectrum` should have `frames(n) * bins()` values. Missing ones count as 0, further ones are
    /// ignored, as are the imaginary parts of the first and the last bin of a frame.
    pub fn inverse(&self, spectrum: &[Complex32], n: usize) -> Vec<f32> {
        let (mut sum, mut weight) = (vec![0.0f32; n], vec![0.0f32; n]);
        let mut frequency = self.inverse.make_input_vec();
        let mut time = self.inverse.make_output_vec();
        let mut scratch = self.inverse.make_scratch_vec();
        let (bins, scale) = (self.bins(), 1.0 / self.window.len() as f32);
        for k in 0..self.frames(n) {
            let given = spectrum.get(k * bins..).unwrap_or_default();
            let given = &given[..given.len().min(bins)];
            frequency[..given.len()].copy_from_slice(given);
            frequency[given.len()..].fill(Complex32::default());
            frequency[0].im = 0.0;
            frequency[bins - 1].im = 0.0;
            self.inverse
                .process_with_scratch(&mut frequency, &mut time, &mut scratch)
                .expect("the lengths are those of the plan, the ends are real");
            for (j, value) in time.iter().enumerate() {
                if let Some(at) = self.sample(k, j).filter(|at| *at < n) {
                    sum[at] += value * scale * self.window[j];
                    weight[at] += self.window[j] * self.window[j];
                }
            }
        }
        // A sample is at most a hop from the centre of a frame, where the window is at least a half.
        sum.iter().zip(&weight).map(|(sum, weight)| sum / weight).collect()
    }

    /// The sample that value `n` of frame `k` comes from, unless it is before the first.
    fn sample(&self, k: usize, n: usize) -> Option<usize> {
        (k * self.hop() + n).checked_sub(self.window.len() / 2)
    }
}

impl fmt::Debug for Stft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stft").field("window", &self.window.len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f32> {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        (0..n).map(|_| next()).collect()
    }

    #[test]
    fn reconstruction_is_perfect() {
        for window in [4, 6, 8, 10, 64, 100, 1024] {
            let stft = Stft::new(window).unwrap();
            for n in [1, 2, 3, 5, 63, 64, 65, 257, 1000, 4096, 5001] {
                let x = noise(n);
                let spectrum = stft.forward(&x);
                assert_eq!(spectrum.len(), stft.frames(n) * stft.bins());
                let back = stft.inverse(&spectrum, n);
                let worst = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(back.len() == n && worst < 1e-5, "window {window}, {n} samples: {worst}");
            }
        }
    }

    #[test]
    fn a_sine_is_in_its_bin() {
        let (stft, bin) = (Stft::new(256).unwrap(), 20);
        let step = TAU * bin as f64 / 256.0;
        let x: Vec<f32> = (0..2560).map(|n| (step * n as f64).cos() as f32).collect();
        let spectrum = stft.forward(&x);
        for k in 2..stft.frames(x.len()) - 3 {
            let frame = &spectrum[k * stft.bins()..][..stft.bins()];
            assert!((frame[bin].norm() - 64.0).abs() < 1e-2, "{}", frame[bin]);
            assert!((frame[bin - 1].norm() - 32.0).abs() < 1e-2);
            assert!(frame[bin + 2].norm() < 1e-2);
        }
    }

    #[test]
    fn an_impulse_is_where_it_is() {
        let stft = Stft::new(64).unwrap();
        let mut x = vec![0.0; 640];
        x[5 * stft.hop()] = 1.0;
        let spectrum = stft.forward(&x);
        let energy = |k: usize| -> f32 {
            spectrum[k * stft.bins()..][..stft.bins()].iter().map(|v| v.norm_sqr()).sum()
        };
        let loudest = (0..stft.frames(640)).max_by(|a, b| energy(*a).total_cmp(&energy(*b)));
        assert_eq!(loudest, Some(5));
        assert!(energy(8) == 0.0 && energy(2) == 0.0);
    }

    #[test]
    fn odd_requests() {
        for window in [0, 2, 5, usize::MAX - 1, Stft::MAX_WINDOW + 2] {
            assert!(matches!(Stft::new(window), Err(Error::Audio { .. })), "{window}");
        }
        let stft = Stft::new(8).unwrap();
        assert_eq!((stft.hop(), stft.bins(), stft.frames(0), stft.frames(1)), (2, 5, 0, 1));
        assert!(stft.forward(&[]).is_empty() && stft.inverse(&[], 0).is_empty());
        assert_eq!(stft.inverse(&[], 3), [0.0; 3]);
        assert_eq!(stft.inverse(&[Complex32::new(0.0, 9.0)], 3), [0.0; 3]);
        assert_eq!(format!("{stft:?}"), "Stft { window: 8, .. }");
    }
}
