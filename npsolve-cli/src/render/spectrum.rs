//! Sound as a picture: time to the right, frequency upwards, brightness in decibels.

use std::path::Path;

use anyhow::Result;
use signal_io::{Audio, Image, SampleType, Stft};

use crate::signals::audio;

/// Samples of a window of the transform, and the widest picture: longer sounds skip windows.
const WINDOW: usize = 1024;
const WIDEST: usize = 4096;
/// From black to white.
const DECIBELS: f32 = 100.0;

/// The spectrogram of a file.
pub fn picture(path: &Path) -> Result<Image> {
    of(&audio::read(path)?)
}

/// The spectrogram of the mean of all channels, 0 to -100 dB of its largest magnitude.
pub fn of(audio: &Audio) -> Result<Image> {
    let mono = audio.to_channels(1)?;
    let stft = Stft::new(WINDOW)?;
    let (bins, frames) = (stft.bins(), stft.frames(mono.frames()));
    let step = frames.div_ceil(WIDEST);
    let spectrum = stft.forward(mono.plane(0));
    let width = frames.div_ceil(step);
    let largest = spectrum.iter().map(|v| v.norm()).fold(f32::MIN_POSITIVE, f32::max);
    let mut data = vec![0.0; width * bins];
    for (x, frame) in spectrum.chunks(bins * step).enumerate() {
        for (bin, value) in frame[..bins].iter().enumerate() {
            let level = 20.0 * (value.norm() / largest).max(1e-30).log10();
            data[(bins - 1 - bin) * width + x] = (1.0 + level / DECIBELS).clamp(0.0, 1.0);
        }
    }
    let mut image = Image::new(width, bins, &["Y"], data)?;
    image.sample = SampleType::U8;
    image.transfer = signal_io::Transfer::Srgb;
    Ok(image)
}
