//! FLAC, Ogg Vorbis and MP3, decoded by the symphonia crates.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

use symphonia::core::codecs::audio::{AudioCodecParameters, AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error as Refusal;
use symphonia::core::formats::{FormatReader, TrackType};
use symphonia::core::io::{MediaSource, MediaSourceStream, ReadOnlySource};
use symphonia::default::codecs::{FlacDecoder, MpaDecoder, VorbisDecoder};
use symphonia::default::formats::{FlacReader, MpaReader, OggReader};

use super::{AudioFormat, AudioSample};
use crate::Audio;
use crate::budget::Budget;
use crate::error::Fault;

/// Decodes the file. Delay and padding of the encoder are cut off where the file states them.
pub(super) fn decode(format: AudioFormat, bytes: &[u8], budget: &Budget) -> Result<Audio, Fault> {
    // Last resort: the decoders return errors for damage, but are much code that is not this
    // crate's, and a damaged file must not end the program.
    catch_unwind(AssertUnwindSafe(|| decode_stream(format, bytes, budget)))
        .unwrap_or_else(|_| Err(Fault::corrupt("its decoder stopped at damaged data")))
}

fn decode_stream(format: AudioFormat, bytes: &[u8], budget: &Budget) -> Result<Audio, Fault> {
    let cursor = Cursor::new(bytes);
    let source: Box<dyn MediaSource + '_> = match format {
        // Where it can go back and forth, the reader guesses the length of a file without a header
        // from its first bit rate, and leaves out what comes later.
        AudioFormat::Mp3 => Box::new(ReadOnlySource::new(cursor)),
        _ => Box::new(cursor),
    };
    let source = MediaSourceStream::new(source, Default::default());
    let mut reader: Box<dyn FormatReader + '_> = match format {
        AudioFormat::Flac => {
            Box::new(FlacReader::try_new(source, Default::default()).map_err(fault)?)
        }
        AudioFormat::Ogg => {
            Box::new(OggReader::try_new(source, Default::default()).map_err(fault)?)
        }
        AudioFormat::Mp3 => {
            Box::new(MpaReader::try_new(source, Default::default()).map_err(fault)?)
        }
        AudioFormat::Wav => return Err(Fault::Feature("another kind of sound inside".to_owned())),
    };
    let track = reader
        .default_track(TrackType::Audio)
        .ok_or_else(|| Fault::Feature("no sound of a known kind".to_owned()))?;
    let (id, promised) = (track.id, track.num_frames);
    let parameters = track
        .codec_params
        .as_ref()
        .and_then(|p| p.audio())
        .ok_or_else(|| Fault::corrupt("it does not describe its sound"))?;
    let sample = match format {
        AudioFormat::Flac => AudioSample::integer(parameters.bits_per_sample.unwrap_or(16)),
        _ => AudioSample::F32,
    };
    let mut decoder = decoder(format, parameters).map_err(fault)?;

    let mut sound = Sound::default();
    while let Some(packet) = reader.next_packet().map_err(fault)? {
        if packet.track_id != id {
            continue;
        }
        let decoded = match decoder.decode(&packet) {
            Ok(decoded) => decoded,
            // The first frames of a file cut out of another refer to data that is not there.
            Err(Refusal::DecodeError(_)) if format == AudioFormat::Mp3 && sound.frames == 0 => {
                continue;
            }
            Err(e) => return Err(fault(e)),
        };
        let spec = decoded.spec();
        let (rate_hz, channels) = (spec.rate(), spec.channels().count());
        if decoded.frames() == 0 {
            continue;
        }
        sound.check(rate_hz, channels)?;
        budget.samples((sound.frames + decoded.frames()) as u64, 1, channels as u64)?;
        decoded.copy_to_vecs_planar::<f32>(&mut sound.part);
        sound.append()?;
    }
    if decoder.finalize().verify_ok == Some(false) {
        return Err(Fault::corrupt("its sound does not match its checksum"));
    }
    // FLAC states how long it is; the length of the others is that of what they hold.
    if format == AudioFormat::Flac && promised.is_some_and(|n| n > sound.frames as u64) {
        return Err(Fault::cut_short());
    }
    if sound.frames == 0 {
        return Err(Fault::Empty);
    }
    let channels = sound.planes.len();
    let mut planes = sound.planes.into_iter();
    let mut data = planes.next().unwrap_or_default();
    data.try_reserve_exact(data.len() * (channels - 1)).map_err(|_| out_of_memory(data.len()))?;
    planes.for_each(|plane| data.extend(plane));
    let mut audio = Audio::new(sound.rate_hz, channels, data)?;
    audio.sample = sample;
    Ok(audio)
}

fn decoder(
    format: AudioFormat,
    parameters: &AudioCodecParameters,
) -> Result<Box<dyn AudioDecoder>, Refusal> {
    let options = AudioDecoderOptions::default().gapless(true).verify(true);
    Ok(match format {
        AudioFormat::Flac => Box::new(FlacDecoder::try_new(parameters, &options)?),
        AudioFormat::Ogg => Box::new(VorbisDecoder::try_new(parameters, &options)?),
        AudioFormat::Mp3 => Box::new(MpaDecoder::try_new(parameters, &options)?),
        AudioFormat::Wav => return Err(Refusal::Unsupported("WAV")),
    })
}

/// What is decoded so far.
#[derive(Default)]
struct Sound {
    rate_hz: u32,
    frames: usize,
    planes: Vec<Vec<f32>>,
    /// The last packet.
    part: Vec<Vec<f32>>,
}

impl Sound {
    /// Takes rate and number of channels from the first packet and compares those of the others.
    fn check(&mut self, rate_hz: u32, channels: usize) -> Result<(), Fault> {
        if !(1..=Audio::MAX_CHANNELS).contains(&channels) {
            return Err(Fault::Feature(format!("{channels} channels (1 to 8 are read)")));
        }
        if !(1..=Audio::MAX_RATE_HZ).contains(&rate_hz) {
            return Err(Fault::corrupt(format!("a sampling rate of {rate_hz} Hz")));
        }
        if self.planes.is_empty() {
            self.rate_hz = rate_hz;
            self.planes.resize(channels, Vec::new());
        }
        match (self.rate_hz, self.planes.len()) == (rate_hz, channels) {
            true => Ok(()),
            false => Err(Fault::Feature("rates or channels that change".to_owned())),
        }
    }

    fn append(&mut self) -> Result<(), Fault> {
        for (plane, part) in self.planes.iter_mut().zip(&self.part) {
            plane.try_reserve(part.len()).map_err(|_| out_of_memory(plane.len()))?;
            plane.extend(part);
        }
        self.frames = self.planes.first().map_or(0, Vec::len);
        Ok(())
    }
}

fn out_of_memory(values: usize) -> Fault {
    Fault::OutOfMemory { needed: (values as u64).saturating_mul(2 * size_of::<f32>() as u64) }
}

fn fault(refusal: Refusal) -> Fault {
    match refusal {
        // The bytes are in memory: the only failure of reading is their end.
        Refusal::IoError(_) => Fault::cut_short(),
        Refusal::Unsupported(what) => Fault::Feature(what.to_owned()),
        Refusal::ResetRequired => Fault::Feature("several pieces one after the other".to_owned()),
        other => Fault::corrupt(other.to_string()),
    }
}
