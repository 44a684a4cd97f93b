mod format;
mod loudness;
mod measure;
mod read;
mod resample;
mod sample;
mod stft;
mod wav;
mod write;

#[cfg(feature = "compressed-audio")]
mod compressed;
#[cfg(feature = "compressed-audio")]
mod ogg;
#[cfg(feature = "compressed-audio")]
mod vorbis;

use inr_core::{Domain, Samples, Unit};

pub use format::AudioFormat;
pub use read::{decode_audio, read_audio};
pub use sample::AudioSample;
pub use stft::{Complex32, Stft};
pub use write::{AudioReport, AudioWriteOptions, check_audio_target, write_audio};

use crate::{Error, Result};

/// Sound in floating point: one plane of samples per channel, all at the same sampling rate.
///
/// Planes are stored one after the other: frame `n` of channel `c` is `as_planar()[c * frames + n]`
/// and belongs to the time `n / rate_hz` seconds. Full scale is 1: integer files are scaled to
/// [-1, 1), float files keep their numbers, whatever they are. Channels are in the order of the
/// file; with more than two that is front left, front right, centre, bass, ... as in WAV.
#[derive(Debug, Clone, PartialEq)]
pub struct Audio {
    rate_hz: u32,
    channels: usize,
    data: Vec<f32>,
    /// The number type of the file the sound came from: what it is written back as.
    pub sample: AudioSample,
}

/// How far the pitch of samples in seconds may be from the sampling rate: f32 rounds by 6e-8, and
/// rates that differ by less than this lose a tenth of a second in a day.
const PITCH_TOLERANCE: f64 = 1e-6;

impl Audio {
    /// The most channels: WAV has names for this many loudspeakers in common layouts (7.1).
    pub const MAX_CHANNELS: usize = 8;
    /// The highest sampling rate in Hz. Recorders of ultrasound end at half of it.
    pub const MAX_RATE_HZ: u32 = 1_000_000;

    /// Takes planar values: `channels` planes of equal length, one after the other; float.
    ///
    /// # Errors
    /// [`Error::Audio`] when there are no samples, when their number is not a multiple of `channels`,
    /// and when `channels` or `rate_hz` is 0 or beyond [`MAX_CHANNELS`](Self::MAX_CHANNELS) or
    /// [`MAX_RATE_HZ`](Self::MAX_RATE_HZ).
    pub fn new(rate_hz: u32, channels: usize, data: Vec<f32>) -> Result<Self> {
        let fail = |what| Err(Error::Audio { what });
        if !(1..=Self::MAX_CHANNELS).contains(&channels) {
            return fail(format!("{channels} channels; 1 to {} are possible", Self::MAX_CHANNELS));
        }
        check_rate(rate_hz)?;
        let n = data.len();
        if !n.is_multiple_of(channels) || Domain::<1>::unit([n / channels]).is_err() {
            return fail(format!("{n} values in {channels} channels"));
        }
        Ok(Self { rate_hz, channels, data, sample: AudioSample::F32 })
    }

    /// Takes interleaved values: the channels of a frame side by side, as in most files; float.
    ///
    /// # Errors
    /// Those of [`Audio::new`].
    pub fn from_interleaved(rate_hz: u32, channels: usize, data: &[f32]) -> Result<Self> {
        let planes = (0..channels.min(Self::MAX_CHANNELS + 1))
            .flat_map(|c| data.iter().skip(c).step_by(channels).copied());
        Self::new(rate_hz, channels, planes.collect())
    }

    /// Samples per second and channel.
    pub fn rate_hz(&self) -> u32 {
        self.rate_hz
    }

    /// Number of channels, 1 to 8.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Samples per channel, at least 1.
    pub fn frames(&self) -> usize {
        self.data.len() / self.channels
    }

    /// Duration in seconds: frames by rate.
    pub fn seconds(&self) -> f64 {
        self.frames() as f64 / f64::from(self.rate_hz)
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The planes, without the rate.
    pub fn into_planar(self) -> Vec<f32> {
        self.data
    }

    /// The samples of one channel.
    ///
    /// # Panics
    /// If `channel >= channels()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.frames();
        &self.data[channel * n..(channel + 1) * n]
    }

    /// The lattice of sample times in seconds: pitch `1 / rate_hz`, first sample at 0.
    ///
    /// A [`Domain`] computes positions in f32, with a relative error of about 1e-7: at 44.1 kHz they
    /// are good to 1 % of a sample during the first two seconds and to half a sample during the first
    /// two minutes. The samples and their number are exact at any length; only positions suffer. For
    /// long sound blend pieces ([`cropped`](Self::cropped)) and count time from the start of the
    /// piece, or use [`domain_in_samples`](Self::domain_in_samples).
    pub fn domain(&self) -> Domain<1> {
        // Rounded once from f64; `1.0 / rate as f32` would round twice.
        let pitch = (1.0 / f64::from(self.rate_hz)) as f32;
        Domain::new([self.frames()], [pitch], [0.0], Unit::Second).expect("checked when made")
    }

    /// The lattice of sample numbers: pitch 1, first sample at 0. Positions are exact for the first
    /// 2^24 frames, six minutes at 44.1 kHz.
    pub fn domain_in_samples(&self) -> Domain<1> {
        Domain::unit([self.frames()]).expect("checked when made")
    }

    /// The channels as typed samples over time in seconds ([`domain`](Self::domain)).
    ///
    /// # Errors
    /// [`Error::Audio`] when there are not exactly `C` channels.
    pub fn to_samples<const C: usize>(&self) -> Result<Samples<1, C>> {
        self.to_samples_on(self.domain())
    }

    /// The channels as typed samples over sample numbers
    /// ([`domain_in_samples`](Self::domain_in_samples)): gradients are differences of neighbours.
    ///
    /// # Errors
    /// [`Error::Audio`] when there are not exactly `C` channels.
    pub fn to_samples_by_number<const C: usize>(&self) -> Result<Samples<1, C>> {
        self.to_samples_on(self.domain_in_samples())
    }

    fn to_samples_on<const C: usize>(&self, domain: Domain<1>) -> Result<Samples<1, C>> {
        if self.channels != C {
            let found = self.channels;
            let what = format!("expected {C} channels, found {found}; convert with to_channels");
            return Err(Error::Audio { what });
        }
        Samples::from_planar(domain, self.data.clone())
            .map_err(|e| Error::Audio { what: e.to_string() })
    }

    /// Sound of these samples, with the rate and the sample type of `like`. The origin of their
    /// domain is not kept: time starts at 0.
    ///
    /// # Errors
    /// [`Error::Audio`] when `C` is 0 or more than 8, and when the samples are in seconds with a
    /// pitch that is not that of `like` (to one part in a million).
    pub fn from_samples<const C: usize>(samples: &Samples<1, C>, like: &Self) -> Result<Self> {
        let domain = samples.domain();
        let [pitch] = domain.pitch();
        let steps = f64::from(pitch) * f64::from(like.rate_hz);
        if domain.unit_of_length() == Unit::Second && (steps - 1.0).abs() > PITCH_TOLERANCE {
            let what = format!("samples {pitch} s apart for a rate of {} Hz", like.rate_hz);
            return Err(Error::Audio { what });
        }
        let mut out = Self::new(like.rate_hz, C, samples.as_planar().to_vec())?;
        out.sample = like.sample;
        Ok(out)
    }

    /// The frames `start..start + frames`; time starts at 0 again.
    ///
    /// # Errors
    /// [`Error::Audio`] when `frames` is 0 or the piece reaches beyond the end.
    pub fn cropped(&self, start: usize, frames: usize) -> Result<Self> {
        let n = self.frames();
        let end = start.checked_add(frames).filter(|end| frames > 0 && *end <= n);
        let Some(end) = end else {
            let what = format!("a piece of {frames} frames from frame {start} on, of {n}");
            return Err(Error::Audio { what });
        };
        let data = (0..self.channels).flat_map(|c| self.plane(c)[start..end].iter().copied());
        Ok(Self { data: data.collect(), ..*self })
    }

    /// The same sound in another number of channels: their mean in one, or one in each of many.
    ///
    /// # Errors
    /// [`Error::Audio`] when neither the old nor the new number is 1 (nor are they the same), and
    /// when the new one is beyond 1 to 8.
    pub fn to_channels(&self, channels: usize) -> Result<Self> {
        let data = match (self.channels, channels) {
            (old, new) if old == new => self.data.clone(),
            (1, 2..=Self::MAX_CHANNELS) => self.data.repeat(channels),
            (_, 1) => (0..self.frames()).map(|n| self.mean_at(n)).collect(),
            (old, new) => {
                let what = format!("{old} channels cannot become {new}; go through 1");
                return Err(Error::Audio { what });
            }
        };
        Ok(Self { channels, data, ..*self })
    }

    fn mean_at(&self, frame: usize) -> f32 {
        let n = self.frames();
        let sum: f64 = (0..self.channels).map(|c| f64::from(self.data[c * n + frame])).sum();
        (sum / self.channels as f64) as f32
    }
}

fn check_rate(rate_hz: u32) -> Result<()> {
    match (1..=Audio::MAX_RATE_HZ).contains(&rate_hz) {
        true => Ok(()),
        false => {
            let max = Audio::MAX_RATE_HZ;
            Err(Error::Audio { what: format!("{rate_hz} Hz; 1 to {max} Hz are possible") })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_audio_is_a_typed_error() {
        for (rate, channels, values) in [
            (44_100, 1, 0),
            (44_100, 0, 4),
            (44_100, 9, 9),
            (44_100, 2, 5),
            (0, 1, 1),
            (Audio::MAX_RATE_HZ + 1, 1, 1),
        ] {
            let planar = Audio::new(rate, channels, vec![0.0; values]);
            assert!(matches!(planar, Err(Error::Audio { .. })), "{rate} {channels} {values}");
        }
        assert!(Audio::from_interleaved(8000, usize::MAX, &[0.0]).is_err());
        assert!(Audio::from_interleaved(8000, 2, &[0.0]).is_err());
    }

    #[test]
    fn samples_round_trip() {
        let mut stereo = Audio::from_interleaved(8000, 2, &[1.0, -1.0, 0.5, -0.5]).unwrap();
        stereo.sample = AudioSample::I16;
        assert_eq!(stereo.plane(1), [-1.0, -0.5]);
        let in_seconds = stereo.to_samples::<2>().unwrap();
        assert_eq!(in_seconds.domain().position([1]), [1.0 / 8000.0]);
        assert_eq!(Audio::from_samples(&in_seconds, &stereo).unwrap(), stereo);
        let by_number = stereo.to_samples_by_number::<2>().unwrap();
        assert_eq!(by_number.domain().position([1]), [1.0]);
        assert_eq!(Audio::from_samples(&by_number, &stereo).unwrap(), stereo);

        let other_rate = Audio::new(8001, 1, vec![0.0]).unwrap();
        assert!(matches!(Audio::from_samples(&in_seconds, &other_rate), Err(Error::Audio { .. })));
        assert!(matches!(stereo.to_samples::<1>(), Err(Error::Audio { .. })));
    }

    #[test]
    fn channels_and_pieces() {
        let stereo = Audio::new(8000, 2, vec![1.0, 2.0, 3.0, 0.0, 1.0, 2.0]).unwrap();
        let mono = stereo.to_channels(1).unwrap();
        assert_eq!(mono.as_planar(), [0.5, 1.5, 2.5]);
        assert_eq!(mono.to_channels(3).unwrap().plane(2), mono.plane(0));
        assert!(stereo.to_channels(3).is_err() && mono.to_channels(9).is_err());
        assert!(mono.to_channels(0).is_err());
        assert_eq!(stereo.cropped(1, 2).unwrap().as_planar(), [2.0, 3.0, 1.0, 2.0]);
        for (start, frames) in [(0, 0), (2, 2), (usize::MAX, 2)] {
            assert!(stereo.cropped(start, frames).is_err());
        }
    }
}
