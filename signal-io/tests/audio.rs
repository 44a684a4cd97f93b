//! Sound: what is written comes back, and bad files are typed errors.

mod support;

use signal_io::{Audio, AudioFormat, AudioSample, AudioWriteOptions, Error, ReadOptions, Result};
use signal_io::{check_audio_target, decode_audio, read_audio, write_audio};

/// A ramp from -0.99 to 0.99 in every channel, each channel a little further.
fn ramp(channels: usize, frames: usize) -> Audio {
    let value = |k: usize| (k % frames * channels + k / frames) as f32;
    let scale = 1.98 / (channels * frames) as f32;
    let data = (0..channels * frames).map(|k| value(k) * scale - 0.99).collect();
    Audio::new(16_000, channels, data).unwrap()
}

#[test]
fn wav_round_trips_in_every_type() {
    use AudioSample::{F32, I16, I24, I32, U8};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ramp.wav");
    for channels in [1, 2, 3, 8] {
        let sound = ramp(channels, 301);
        for sample in [U8, I16, I24, I32, F32] {
            let options = AudioWriteOptions { force: true, sample: Some(sample) };
            let report = write_audio(&path, &sound, &options).unwrap();
            assert_eq!((report.clipped, report.samples), (0, channels * 301));
            let back = read_audio(&path, &ReadOptions::default()).unwrap();
            assert_eq!((back.sample, back.rate_hz()), (sample, 16_000));
            assert_eq!((back.channels(), back.frames()), (channels, 301));
            let step =
                if sample.is_float() { 0.0 } else { 2f32.powi(1 - i32::from(sample.bits())) };
            for (a, b) in sound.as_planar().iter().zip(back.as_planar()) {
                assert!((a - b).abs() <= step / 2.0 + 6e-8 * step.ceil(), "{sample:?}: {a} {b}");
            }
            // Written again in its own type, nothing changes.
            write_audio(&path, &back, &AudioWriteOptions { force: true, sample: None }).unwrap();
            assert_eq!(read_audio(&path, &ReadOptions::default()).unwrap(), back);
        }
    }
}

#[test]
fn targets_are_checked_first() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    assert!(check_audio_target(at("a.WAV"), false).is_ok());
    let bad = check_audio_target(at("a.flac"), false);
    assert!(matches!(bad, Err(Error::UnsupportedFormat { .. })));
    let bad = check_audio_target(at("none/a.wav"), false);
    assert!(matches!(bad, Err(Error::NoFolder { .. })));
    write_audio(at("a.wav"), &ramp(1, 4), &AudioWriteOptions::default()).unwrap();
    let bad = write_audio(at("a.wav"), &ramp(1, 4), &AudioWriteOptions::default());
    assert!(matches!(bad, Err(Error::Exists { .. })));
}

fn decode(bytes: &[u8]) -> Result<Audio> {
    decode_audio("damaged.wav", bytes, &ReadOptions::default())
}

/// The error, which names the file.
fn refusal(bytes: &[u8]) -> Error {
    let error = decode(bytes).unwrap_err();
    assert!(error.to_string().contains("damaged.wav"), "{error}");
    error
}

fn file_bytes(audio: &Audio, sample: AudioSample) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sound.wav");
    write_audio(&path, audio, &AudioWriteOptions { force: false, sample: Some(sample) }).unwrap();
    std::fs::read(path).unwrap()
}

/// A file with these fields of its fmt chunk and four bytes of samples, which it says are `length`.
fn wav(tag: u16, channels: u16, rate: u32, frame: u16, bits: u16, length: u32) -> Vec<u8> {
    let mut bytes = b"RIFF\x28\0\0\0WAVEfmt \x10\0\0\0".to_vec();
    bytes.extend([tag.to_le_bytes(), channels.to_le_bytes()].concat());
    bytes.extend([rate.to_le_bytes(), rate.wrapping_mul(2).to_le_bytes()].concat());
    bytes.extend([frame.to_le_bytes(), bits.to_le_bytes()].concat());
    bytes.extend(b"data");
    bytes.extend(length.to_le_bytes());
    bytes.extend([0, 0x40, 0, 0xc0]);
    bytes
}

#[test]
fn truncated_files_are_errors() {
    for sample in [AudioSample::U8, AudioSample::I16, AudioSample::I24, AudioSample::F32] {
        let bytes = file_bytes(&ramp(2, 20), sample);
        assert!(decode(&bytes).is_ok());
        assert!(matches!(refusal(&[]), Error::Empty { .. }));
        for length in 1..bytes.len() {
            let error = refusal(&bytes[..length]);
            assert!(matches!(error, Error::Corrupt { .. }), "{length}: {error}");
        }
    }
}

#[test]
fn altered_bytes_are_sound_or_errors() {
    for sample in [AudioSample::U8, AudioSample::I16, AudioSample::I24, AudioSample::F32] {
        let good = file_bytes(&ramp(3, 9), sample);
        for at in 0..good.len() {
            for bits in [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff] {
                let mut bytes = good.clone();
                bytes[at] ^= bits;
                match decode(&bytes) {
                    // Never more than the bytes there are.
                    Ok(audio) => assert!(audio.as_planar().len() <= good.len()),
                    Err(_) => drop(refusal(&bytes)),
                }
            }
        }
    }
    let mut next = support::random(7);
    let good = file_bytes(&ramp(2, 9), AudioSample::I16);
    for _ in 0..2000 {
        let mut bytes = good.clone();
        for _ in 0..1 + next() % 4 {
            bytes[next() as usize % 48] = next() as u8;
        }
        if decode(&bytes).is_err() {
            refusal(&bytes);
        }
    }
}

#[test]
fn absurd_headers() {
    let good = decode(&wav(1, 1, 8000, 2, 16, 4)).unwrap();
    assert_eq!((good.as_planar(), good.rate_hz()), ([0.5, -0.5].as_slice(), 8000));
    // Lengths that are not known while writing: the samples go to the end of the file.
    assert_eq!(decode(&wav(1, 1, 8000, 2, 16, u32::MAX)).unwrap(), good);
    for (bytes, what) in [
        (wav(1, 0, 8000, 2, 16, 4), "no channels"),
        (wav(1, 1, 0, 2, 16, 4), "0 Hz"),
        (wav(1, 1, u32::MAX, 2, 16, 4), "4 GHz"),
        (wav(1, 1, 8000, 0, 16, 4), "frames of 0 bytes"),
        (wav(1, 2, 8000, 3, 16, 4), "half bytes"),
        (wav(1, 1, 8000, 2, 16, u32::MAX - 1), "4 GiB that are not there"),
        (wav(1, 1, 8000, 2, 16, 3), "one and a half frames"),
    ] {
        let error = refusal(&bytes);
        assert!(matches!(error, Error::Corrupt { .. }), "{what}: {error}");
    }
    for (bytes, what) in [
        (wav(1, 9, 8000, 18, 16, 4), "nine channels"),
        (wav(1, 65_535, 8000, 65_535, 8, 4), "channels"),
        (wav(1, 1, 8000, 2, 12, 4), "12 bits"),
        (wav(1, 1, 8000, 8, 64, 4), "64 bits"),
        (wav(2, 1, 8000, 2, 4, 4), "ADPCM"),
        (b"RF64\0\0\0\0WAVE".to_vec(), "64-bit lengths"),
        (b"RIFX\0\0\0\0WAVE".to_vec(), "big-endian"),
    ] {
        let error = refusal(&bytes);
        assert!(matches!(error, Error::UnsupportedFeature { .. }), "{what}: {error}");
    }
    assert!(matches!(refusal(&wav(1, 1, 8000, 2, 16, 0)), Error::Empty { .. }));
    for at in [16, 40] {
        // The length of the fmt chunk; an unknown chunk of 4 GiB where the samples should be.
        let mut bytes = wav(1, 1, 8000, 2, 16, u32::MAX);
        bytes[at..at + 4].fill(0xff);
        bytes[36..40].copy_from_slice(b"LIST");
        assert!(matches!(refusal(&bytes), Error::Corrupt { .. }));
    }
    let options = ReadOptions { limit_bytes: 7, ..ReadOptions::default() };
    let limited = decode_audio("a.wav", &wav(1, 1, 8000, 2, 16, 4), &options);
    assert!(matches!(limited, Err(Error::TooLarge { needed: 8, limit: 7, .. })));
    let unknown = decode_audio("a.txt", b"some text, no sound", &ReadOptions::default());
    assert!(matches!(unknown, Err(Error::UnsupportedFormat { .. })));
    let missing = read_audio("no such folder/a.wav", &ReadOptions::default());
    assert!(matches!(missing, Err(Error::NotFound { .. })));
}

#[test]
fn floats_are_read_as_they_are() {
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 443.0, -0.0, 1e-45, f32::MIN, 1.0];
    let sound = Audio::new(44_100, 2, values.to_vec()).unwrap();
    let back = decode(&file_bytes(&sound, AudioSample::F32)).unwrap();
    let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(back.as_planar()), bits(&values));

    let folder = tempfile::tempdir().unwrap();
    let options = AudioWriteOptions { force: false, sample: Some(AudioSample::I16) };
    let report = write_audio(folder.path().join("a.wav"), &sound, &options).unwrap();
    assert_eq!((report.clipped, report.samples, report.format), (5, 8, AudioFormat::Wav));
}

#[test]
#[cfg(not(feature = "compressed-audio"))]
fn compressed_sound_needs_its_feature() {
    for (name, head) in [("a.flac", b"fLaC"), ("a.ogg", b"OggS"), ("a.mp3", b"\xff\xfb\x90\xc0")] {
        let error = decode_audio(name, head, &ReadOptions::default()).unwrap_err();
        assert!(matches!(error, Error::FeatureOff { .. }), "{error}");
        assert!(error.to_string().contains("--features compressed-audio"), "{error}");
    }
}

#[test]
fn recordings_open_and_can_be_measured() {
    let Some(data) = support::sample_sounds() else { return };
    let mut count = 0;
    for file in std::fs::read_dir(data).unwrap() {
        let path = file.unwrap().path();
        if AudioFormat::from_extension(&path) != Some(AudioFormat::Wav) {
            continue;
        }
        let sound = read_audio(&path, &ReadOptions::default()).unwrap();
        assert!(sound.seconds() > 0.5 && sound.peak() > 0.01 && sound.peak() <= 1.0);
        assert!(sound.mean().abs() < 0.05);
        let loudness = sound.loudness().unwrap();
        assert!((-50.0..0.0).contains(&loudness), "{}: {loudness}", path.display());
        // A second at half the rate is as loud, apart from what the lower rate cannot hold.
        let second = sound.cropped(0, sound.rate_hz() as usize).unwrap();
        let lower = second.resampled(sound.rate_hz() / 2).unwrap();
        assert_eq!(lower.seconds(), second.seconds());
        if let (Some(a), Some(b)) = (second.loudness(), lower.loudness()) {
            assert!((a - b).abs() < 6.0, "{}: {a} {b}", path.display());
        }
        count += 1;
    }
    assert!(count > 0);
}
