//! RIFF WAVE: chunks, of which `fmt ` describes the samples and `data` holds them.
//!
//! The chunks are found here, because lengths in the wild are often wrong; numbers are decoded and
//! files written by the hound crate.
//!
//! Source: Microsoft, "Multimedia Programming Interface and Data Specifications 1.0" and
//! `WAVEFORMATEXTENSIBLE`.

use std::io::{Cursor, Read, Seek, Write};

use hound::{SampleFormat, WavReader, WavSpec, WavWriter};

use super::sample::to_integer;
use crate::budget::{Budget, zeros};
use crate::error::Fault;
use crate::{Audio, AudioSample};

/// The length that programs write who cannot go back to correct it.
const UNKNOWN_LENGTH: u32 = u32::MAX;
/// Format tags: integers, floats, and "see the extension".
const PCM: u16 = 1;
const FLOAT: u16 = 3;
const EXTENSIBLE: u16 = 0xfffe;

/// What the `fmt ` chunk says, checked.
struct Description {
    channels: usize,
    rate_hz: u32,
    sample: AudioSample,
    /// Bytes per frame.
    frame: usize,
    /// The chunk, without the variations that hound does not take.
    chunk: Vec<u8>,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Audio, Fault> {
    let (description, data) = find_chunks(bytes)?;
    let Description { channels, rate_hz, sample, frame, ref chunk } = description;
    let count = budget.samples((data.len() / frame) as u64, 1, channels as u64)?;
    if sample == AudioSample::F32 && frame / channels == 8 {
        return doubles(&description, data, count);
    }
    let length = u32::try_from(data.len())
        .map_err(|_| Fault::Feature("more than 4 GiB of samples".to_owned()))?;

    let (fmt_length, data_length) = ((chunk.len() as u32).to_le_bytes(), length.to_le_bytes());
    let parts: [&[u8]; 6] =
        [b"RIFF\0\0\0\0WAVEfmt ", &fmt_length, chunk, b"data", &data_length, &[]];
    let header = Cursor::new(parts.concat());
    let mut reader = WavReader::new(header.chain(data)).map_err(fault)?;
    let mut out = zeros(count)?;
    let mut planes = Planes { frames: count / channels, out: &mut out };
    match sample {
        AudioSample::F32 => planes.fill(channels, reader.samples::<f32>(), |v| v)?,
        _ => {
            // The container counts, not the significant bits, which are at its upper end.
            let scale = f64::from(1u32 << (reader.spec().bits_per_sample - 1));
            planes.fill(channels, reader.samples::<i32>(), |v| (f64::from(v) / scale) as f32)?;
        }
    }
    let mut audio = Audio::new(rate_hz, channels, out)?;
    audio.sample = sample;
    Ok(audio)
}

/// Floats of 64 bits, which hound does not read: rounded to 32.
fn doubles(description: &Description, data: &[u8], count: usize) -> Result<Audio, Fault> {
    let channels = description.channels;
    let mut out = zeros(count)?;
    let value = |bytes: &[u8]| f64::from_le_bytes(std::array::from_fn(|k| bytes[k])) as f32;
    let mut planes = Planes { frames: count / channels, out: &mut out };
    planes.fill(channels, data.chunks_exact(8).map(Ok), value)?;
    Ok(Audio::new(description.rate_hz, channels, out)?)
}

/// Where interleaved samples go.
struct Planes<'a> {
    frames: usize,
    out: &'a mut [f32],
}

impl Planes<'_> {
    fn fill<S>(
        &mut self,
        channels: usize,
        samples: impl Iterator<Item = hound::Result<S>>,
        convert: impl Fn(S) -> f32,
    ) -> Result<(), Fault> {
        for (k, value) in samples.enumerate() {
            self.out[k % channels * self.frames + k / channels] = convert(value.map_err(fault)?);
        }
        Ok(())
    }
}

/// The description of the samples and their bytes.
fn find_chunks(bytes: &[u8]) -> Result<(Description, &[u8]), Fault> {
    match bytes {
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'A', b'V', b'E', ..] => {}
        [b'R', b'F', b'6', b'4', ..] => {
            return Err(Fault::Feature("64-bit lengths (RF64)".to_owned()));
        }
        [b'R', b'I', b'F', b'X', ..] => {
            return Err(Fault::Feature("big-endian numbers (RIFX)".to_owned()));
        }
        _ => return Err(Fault::corrupt("RIFF and WAVE are missing at its start")),
    }
    let riff_length = u32_at(bytes, 4);
    let (mut rest, mut description) = (&bytes[12..], None);
    loop {
        let (head, body) = rest.split_at_checked(8).ok_or_else(Fault::cut_short)?;
        let length = u32_at(head, 4);
        if &head[..4] == b"data" {
            let found = description
                .ok_or_else(|| Fault::corrupt("no fmt chunk comes before its data chunk"))?;
            return data(body, length, riff_length, &found).map(|data| (found, data));
        }
        let content = body.get(..length as usize).ok_or_else(Fault::cut_short)?;
        if &head[..4] == b"fmt " {
            description = Some(describe(content)?);
        }
        // Chunks start at even positions; the last one may lack its padding.
        rest = body.get(length as usize + (length % 2) as usize..).unwrap_or_default();
    }
}

/// The bytes of the samples. When the length was not known while writing, they go to the end of the
/// file, in whole frames; a stated length must be there.
fn data<'a>(
    body: &'a [u8],
    length: u32,
    riff_length: u32,
    found: &Description,
) -> Result<&'a [u8], Fault> {
    let streamed = length == 0 && matches!(riff_length, 0 | UNKNOWN_LENGTH);
    if length == UNKNOWN_LENGTH || streamed {
        return Ok(&body[..body.len() - body.len() % found.frame]);
    }
    let data = body.get(..length as usize).ok_or_else(Fault::cut_short)?;
    match data.len().is_multiple_of(found.frame) {
        true => Ok(data),
        false => {
            let (n, frame) = (data.len(), found.frame);
            Err(Fault::corrupt(format!("{n} bytes of samples in frames of {frame}")))
        }
    }
}

fn describe(fmt: &[u8]) -> Result<Description, Fault> {
    if fmt.len() < 16 {
        return Err(Fault::corrupt(format!("a fmt chunk of {} bytes", fmt.len())));
    }
    let (tag, channels, rate_hz) = (u16_at(fmt, 0), usize::from(u16_at(fmt, 2)), u32_at(fmt, 4));
    let (frame, container) = (usize::from(u16_at(fmt, 12)), u16_at(fmt, 14));
    let mut chunk = fmt[..16].to_vec();
    let (encoding, bits) = match tag {
        EXTENSIBLE if fmt.len() < 40 => return Err(Fault::corrupt("its fmt chunk is cut short")),
        EXTENSIBLE => {
            // 22 bytes of extension. Significant bits 0: hound would look for them at the lower end
            // of the container, where they are not.
            chunk.extend([22, 0, 0, 0]);
            chunk.extend(&fmt[20..40]);
            let bits = u16_at(fmt, 18);
            (u16_at(fmt, 24), if (1..=container).contains(&bits) { bits } else { container })
        }
        _ => (tag, container),
    };
    if channels == 0 || frame == 0 || frame % channels != 0 {
        return Err(Fault::corrupt(format!("{channels} channels in frames of {frame} bytes")));
    }
    if channels > Audio::MAX_CHANNELS {
        return Err(Fault::Feature(format!("{channels} channels (1 to 8 are read)")));
    }
    if !(1..=Audio::MAX_RATE_HZ).contains(&rate_hz) {
        return Err(Fault::corrupt(format!("a sampling rate of {rate_hz} Hz")));
    }
    let sample = match (encoding, frame / channels, container) {
        (PCM, 1, 8) | (PCM, 2, 16) | (PCM, 3 | 4, 24) | (PCM, 4, 32) => {
            AudioSample::integer(u32::from(bits))
        }
        (FLOAT, 4, 32) | (FLOAT, 8, 64) => AudioSample::F32,
        (PCM, size, bits) => {
            return Err(Fault::Feature(format!("integers of {bits} bits in {size} bytes")));
        }
        (FLOAT, _, bits) => return Err(Fault::Feature(format!("floats of {bits} bits"))),
        _ => {
            return Err(Fault::Feature(format!(
                "encoding {encoding:#06x} (PCM and float are read)"
            )));
        }
    };
    // Redundant and sometimes wrong, but hound insists.
    chunk[8..12].copy_from_slice(&(rate_hz * frame as u32).to_le_bytes());
    Ok(Description { channels, rate_hz, sample, frame, chunk })
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|k| bytes[at + k]))
}

/// Writes the file; returns how many samples were clipped.
pub(super) fn encode(
    audio: &Audio,
    sample: AudioSample,
    writer: &mut (impl Write + Seek),
) -> Result<usize, Fault> {
    let bytes = audio.as_planar().len() as u64 * u64::from(sample.bits() / 8);
    // The lengths have 32 bits and count up to 60 bytes of header.
    if bytes > u64::from(u32::MAX) - 64 {
        let instead = "write shorter pieces, or samples of fewer bits";
        return Err(Fault::cannot_hold(format!("{bytes} bytes of samples"), instead));
    }
    let spec = WavSpec {
        channels: audio.channels() as u16,
        sample_rate: audio.rate_hz(),
        bits_per_sample: sample.bits(),
        sample_format: if sample.is_float() { SampleFormat::Float } else { SampleFormat::Int },
    };
    let mut wav = WavWriter::new(writer, spec).map_err(fault)?;
    let planes: Vec<&[f32]> = (0..audio.channels()).map(|c| audio.plane(c)).collect();
    let mut clipped = 0;
    for n in 0..audio.frames() {
        for plane in &planes {
            if sample.is_float() {
                wav.write_sample(plane[n]).map_err(fault)?;
            } else {
                let (value, clip) = to_integer(plane[n], sample.full_scale());
                clipped += usize::from(clip);
                wav.write_sample(value).map_err(fault)?;
            }
        }
    }
    wav.finalize().map_err(fault)?;
    Ok(clipped)
}

fn fault(error: hound::Error) -> Fault {
    match error {
        hound::Error::IoError(e) => Fault::Io(e),
        hound::Error::Unsupported => Fault::Feature("an unusual encoding".to_owned()),
        other => Fault::corrupt(other.to_string()),
    }
}
