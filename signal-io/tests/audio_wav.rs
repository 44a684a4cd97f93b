//! WAV: what is written is read back, and files of other programs, byte by byte.

mod support;

use signal_io::{
    Audio, AudioFormat, AudioSample, AudioWriteOptions, Error, ReadOptions, check_audio_target,
    decode_audio, read_audio, write_audio,
};
use support::{noise, wav, wav_extensible, wav_format};

use AudioSample::{F32, I16, I24, I32, U8};

fn decode(bytes: &[u8]) -> Audio {
    decode_audio("sound.wav", bytes, &ReadOptions::default()).unwrap()
}

fn bits(audio: &Audio) -> Vec<u32> {
    audio.as_planar().iter().map(|v| v.to_bits()).collect()
}

#[test]
fn everything_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    for sample in [U8, I16, I24, I32, F32] {
        for channels in 1..=Audio::MAX_CHANNELS {
            for (rate, frames) in [(1, 1), (44_100, 7), (48_000, 1000), (Audio::MAX_RATE_HZ, 2)] {
                let audio = noise(rate, channels, frames, sample);
                let path = folder.path().join("sound.WAV");
                let options = AudioWriteOptions { force: true, sample: None };
                let report = write_audio(&path, &audio, &options).unwrap();
                assert_eq!((report.format, report.sample), (AudioFormat::Wav, sample));
                assert_eq!((report.samples, report.clipped), (channels * frames, 0));
                let back = read_audio(&path, &ReadOptions::default()).unwrap();
                assert_eq!(bits(&back), bits(&audio), "{sample:?}, {channels} channels");
                assert_eq!(back, audio);
            }
        }
    }
}

#[test]
fn floats_are_not_clipped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sound.wav");
    let values = vec![1.5, -443.0, f32::INFINITY, f32::NAN, 1e-30, -0.0];
    let audio = Audio::new(44_100, 1, values).unwrap();
    let report = write_audio(&path, &audio, &AudioWriteOptions::default()).unwrap();
    assert_eq!((report.sample, report.clipped), (F32, 0));
    assert_eq!(bits(&read_audio(&path, &ReadOptions::default()).unwrap()), bits(&audio));
}

#[test]
fn integers_are_clipped_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sound.wav");
    let values = vec![1.5, -443.0, f32::INFINITY, f32::NAN, 0.25, 1.0, -1.0];
    let audio = Audio::new(44_100, 1, values).unwrap();
    for (sample, step) in [(U8, 128.0), (I16, 32_768.0), (I24, 8_388_608.0), (I32, f32::INFINITY)] {
        let options = AudioWriteOptions { force: true, sample: Some(sample) };
        let report = write_audio(&path, &audio, &options).unwrap();
        assert_eq!((report.sample, report.clipped), (sample, 4), "{sample:?}");
        let back = read_audio(&path, &ReadOptions::default()).unwrap();
        assert_eq!(back.sample, sample);
        let most = 1.0 - 1.0 / step;
        assert_eq!(back.as_planar(), [most, -1.0, most, 0.0, 0.25, most, -1.0], "{sample:?}");
    }
}

#[test]
fn targets_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let audio = noise(8000, 1, 10, I16);
    let write = |name: &str| write_audio(path(name), &audio, &AudioWriteOptions::default());
    for name in ["sound.mp3", "sound.flac", "sound", "sound.png"] {
        assert!(matches!(write(name), Err(Error::UnsupportedFormat { .. })), "{name}");
        assert!(check_audio_target(path(name), true).is_err());
    }
    assert!(matches!(write("no/folder.wav"), Err(Error::NoFolder { .. })));
    write("sound.wav").unwrap();
    let before = std::fs::read(path("sound.wav")).unwrap();
    assert!(matches!(write("sound.wav"), Err(Error::Exists { .. })));
    assert!(matches!(check_audio_target(path("sound.wav"), false), Err(Error::Exists { .. })));
    assert_eq!(std::fs::read(path("sound.wav")).unwrap(), before);
    check_audio_target(path("sound.wav"), true).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Encoding, bits, bytes of two samples, their values, and the type they are of.
type Case = (u16, u16, &'static [u8], [f32; 2], AudioSample);

/// Integers as the standard stores them: 8 bits from 128 up, others signed, low byte first.
#[test]
fn numbers_of_every_size() {
    let cases: [Case; 6] = [
        (1, 8, &[0xc0, 0x40], [0.5, -0.5], U8),
        (1, 16, &[0, 0x40, 0, 0xc0], [0.5, -0.5], I16),
        (1, 24, &[0, 0, 0x40, 0, 0, 0xc0], [0.5, -0.5], I24),
        (1, 32, &[0, 0, 0, 0x40, 0, 0, 0, 0xc0], [0.5, -0.5], I32),
        (3, 32, &[0, 0, 0x20, 0x41, 0, 0, 0x80, 0xbf], [10.0, -1.0], F32),
        (3, 64, &[0, 0, 0, 0, 0, 0, 0x24, 0x40, 0, 0, 0, 0, 0, 0, 0xf0, 0xbf], [10.0, -1.0], F32),
    ];
    for (encoding, bits, data, values, sample) in cases {
        let plain = decode(&wav(&wav_format(encoding, 1, 48_000, bits), data));
        assert_eq!(plain.as_planar(), values, "{bits} bits");
        assert_eq!((plain.sample, plain.rate_hz()), (sample, 48_000), "{bits} bits");
        for valid in [0, bits] {
            let extended = decode(&wav(&wav_extensible(encoding, 1, bits, valid), data));
            assert_eq!(extended, plain, "{bits} bits, extensible");
        }
    }
    // 20 significant bits in 24, 24 in 32: at the upper end.
    let twenty = decode(&wav(&wav_extensible(1, 1, 24, 20), &[0xf0, 0xff, 0x3f]));
    assert_eq!((twenty.plane(0)[0], twenty.sample), (0.5 - 1.0 / 524_288.0, I24));
    let padded = decode(&wav(&wav_extensible(1, 1, 32, 24), &[0, 0, 0, 0xc0]));
    assert_eq!((padded.plane(0)[0], padded.sample), (-0.5, I24));
}

#[test]
fn other_chunks_are_passed_over() {
    let plain = wav(&wav_format(1, 2, 8000, 16), &[1, 0, 2, 0, 3, 0, 4, 0]);
    let truth = decode(&plain);
    assert_eq!(truth.plane(1), [2.0 / 32_768.0, 4.0 / 32_768.0]);
    // Of odd and even length, with padding where it is due, before and after the format.
    let odd = b"LIST\x03\0\0\0abc\0";
    let even = b"bext\x04\0\0\0abcd";
    for chunk in [&odd[..], even] {
        for at in [12, 12 + 8 + 16] {
            let more = [&plain[..at], chunk, &plain[at..]].concat();
            assert_eq!(decode(&more), truth, "{chunk:?} at {at}");
        }
        assert_eq!(decode(&[&plain[..], chunk].concat()), truth);
    }
    // An odd number of bytes of samples, without padding at the end of the file.
    let odd = wav(&wav_format(1, 1, 8000, 8), &[128, 192, 64]);
    assert_eq!(decode(&odd[..odd.len() - 1]).as_planar(), [0.0, 0.5, -0.5]);
    // Tags of MP3 files before it.
    let tagged = [&b"ID3\x04\0\0\0\0\0\x02ab"[..], &plain].concat();
    assert_eq!(decode(&tagged), truth);
}

#[test]
fn streams_of_unknown_length_end_with_the_file() {
    let mut bytes = wav(&wav_format(1, 2, 8000, 16), &[1, 0, 2, 0, 3, 0, 4, 0]);
    let truth = decode(&bytes);
    for (riff, data) in [(u32::MAX, u32::MAX), (0, 0), (u32::MAX, 0), (0, u32::MAX)] {
        bytes[4..8].copy_from_slice(&riff.to_le_bytes());
        bytes[40..44].copy_from_slice(&data.to_le_bytes());
        assert_eq!(decode(&bytes), truth);
        // The last frame was being written.
        assert_eq!(decode(&[&bytes[..], &[1, 2, 3]].concat()), truth);
    }
}
