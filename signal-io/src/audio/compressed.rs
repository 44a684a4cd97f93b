//! FLAC, Ogg Vorbis and MP3, by the decoders of symphonia.
//!
//! They skip what is damaged, as players must; here a file is whole or it is an error. FLAC says how
//! many frames it has and their checksum; the pages of Ogg have numbers, checksums and a last one;
//! the first frame of most MP3 files counts the others.

use std::io::Cursor;
use std::panic::AssertUnwindSafe;

use symphonia::core::codecs::audio::{AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error as DecoderError;
use symphonia::core::formats::{FormatOptions, FormatReader, TrackType};
use symphonia::core::io::{MediaSourceStream, ReadOnlySource};
use symphonia::default::formats::{FlacReader, MpaReader, OggReader};
use symphonia::default::get_codecs;

use super::ogg;
use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::{Audio, AudioFormat, AudioSample};

pub(super) fn decode(format: AudioFormat, bytes: &[u8], budget: &Budget) -> Result<Audio, Fault> {
    // Altered code books can make version 0.6.1 of symphonia panic (`lookup1_values`: an overflow in
    // builds that check for it, an assertion in others).
    let decoding = || decode_unguarded(format, bytes, budget);
    std::panic::catch_unwind(AssertUnwindSafe(decoding))
        .unwrap_or_else(|_| Err(Fault::corrupt("the decoder gave up on its data")))
}

fn decode_unguarded(format: AudioFormat, bytes: &[u8], budget: &Budget) -> Result<Audio, Fault> {
    // Bytes that cannot be rewound keep symphonia from guessing the length of an MP3 file from its
    // first frame, and from cutting the sound there.
    let (forward, all) = (Box::new(ReadOnlySource::new(bytes)), Box::new(Cursor::new(bytes)));
    let options = FormatOptions::default();
    let mut reader: Box<dyn FormatReader + '_> = match format {
        AudioFormat::Flac if !bytes.starts_with(b"fLaC") => {
            return Err(Fault::corrupt("fLaC is missing at its start"));
        }
        AudioFormat::Flac => {
            let source = MediaSourceStream::new(all, Default::default());
            Box::new(FlacReader::try_new(source, options).map_err(fault)?)
        }
        AudioFormat::Ogg => {
            ogg::check_pages(bytes)?;
            let source = MediaSourceStream::new(all, Default::default());
            Box::new(OggReader::try_new(source, options).map_err(fault)?)
        }
        AudioFormat::Mp3 => {
            let source = MediaSourceStream::new(forward, Default::default());
            Box::new(MpaReader::try_new(source, options).map_err(fault)?)
        }
        AudioFormat::Wav => unreachable!("WAV has a decoder of its own"),
    };
    let track = reader.default_track(TrackType::Audio);
    let track = track.ok_or_else(|| Fault::Feature("no sound that is known".to_owned()))?.clone();
    let parameters = track.codec_params.as_ref().and_then(|p| p.audio());
    let parameters = parameters.ok_or_else(|| Fault::corrupt("it does not describe its sound"))?;
    // Gapless: what encoder and decoder add before and after the sound is cut off.
    let how = AudioDecoderOptions::default().verify(true).gapless(true);
    let mut decoder = get_codecs().make_audio_decoder(parameters, &how).map_err(fault)?;

    // The pages of Ogg have been checked; its times may begin anywhere.
    let promised = track.num_frames.filter(|_| format != AudioFormat::Ogg);
    if let (Some(frames @ 1..), Some(channels)) = (promised, parameters.channels.as_ref()) {
        budget.samples(frames, 1, channels.count() as u64)?;
    }
    let mut sound = Sound::default();
    sound.read(reader.as_mut(), decoder.as_mut(), track.id, budget)?;
    if decoder.finalize().verify_ok == Some(false) {
        return Err(Fault::corrupt("its samples do not match their checksum"));
    }
    if promised.is_some_and(|promised| (sound.frames() as u64) < promised) {
        return Err(Fault::cut_short());
    }
    let sample = match (format, parameters.bits_per_sample) {
        (AudioFormat::Flac, Some(bits)) => AudioSample::integer(bits),
        _ => AudioSample::F32,
    };
    sound.into_audio(sample)
}

/// What has been decoded so far.
#[derive(Default)]
struct Sound {
    rate_hz: u32,
    planes: Vec<Vec<f32>>,
}

impl Sound {
    fn frames(&self) -> usize {
        self.planes.first().map_or(0, Vec::len)
    }

    /// Decodes all packets of the track.
    fn read(
        &mut self,
        reader: &mut dyn FormatReader,
        decoder: &mut dyn AudioDecoder,
        track: u32,
        budget: &Budget,
    ) -> Result<(), Fault> {
        let mut piece: Vec<Vec<f32>> = Vec::new();
        while let Some(packet) = reader.next_packet().map_err(fault)? {
            if packet.track_id != track {
                continue;
            }
            let buffer = decoder.decode(&packet).map_err(fault)?;
            let (rate_hz, channels) = (buffer.spec().rate(), buffer.spec().channels().count());
            if self.planes.is_empty() {
                if channels == 0 || channels > Audio::MAX_CHANNELS {
                    return Err(Fault::Feature(format!("{channels} channels (1 to 8 are read)")));
                }
                (self.rate_hz, self.planes) = (rate_hz, vec![Vec::new(); channels]);
            }
            if (self.rate_hz, self.planes.len()) != (rate_hz, channels) {
                return Err(Fault::Feature("channels or rates that change".to_owned()));
            }
            let frames = self.frames() + buffer.frames();
            if frames > 0 {
                budget.samples(frames as u64, 1, channels as u64)?;
            }
            buffer.copy_to_vecs_planar(&mut piece);
            for (plane, piece) in self.planes.iter_mut().zip(&piece) {
                let needed = 4 * frames as u64 * channels as u64;
                plane.try_reserve(piece.len()).map_err(|_| Fault::OutOfMemory { needed })?;
                plane.extend_from_slice(piece);
            }
        }
        Ok(())
    }

    fn into_audio(self, sample: AudioSample) -> Result<Audio, Fault> {
        if self.frames() == 0 {
            return Err(Fault::Empty);
        }
        let channels = self.planes.len();
        let mut data = with_capacity(self.frames() * channels)?;
        for plane in self.planes {
            data.extend(plane); // One by one, so that each is freed as soon as it is copied.
        }
        let audio = Audio::new(self.rate_hz, channels, data);
        let mut audio = audio.map_err(|e| Fault::corrupt(e.to_string()))?;
        audio.sample = sample;
        Ok(audio)
    }
}

fn fault(error: DecoderError) -> Fault {
    match error {
        // The bytes are in memory: what can fail is that there are not enough.
        DecoderError::IoError(_) => Fault::cut_short(),
        DecoderError::Unsupported(what) => Fault::Feature(what.to_owned()),
        DecoderError::ResetRequired => Fault::Feature("several streams in a row".to_owned()),
        other => Fault::corrupt(other.to_string()),
    }
}
