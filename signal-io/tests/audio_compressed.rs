//! FLAC, Ogg Vorbis and MP3 against the closed forms that `data/audio_fixtures.py` encoded.
#![cfg(feature = "compressed-audio")]

use std::f64::consts::{PI, TAU};

use signal_io::{Audio, AudioSample, ReadOptions, decode_audio, read_audio};

const RATE_HZ: u32 = 44_100;
/// Frames of the sound; the FLAC files hold its beginning.
const FRAMES: usize = 9001;

fn path(name: &str) -> std::path::PathBuf {
    std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).join(name)
}

fn read(name: &str) -> Audio {
    read_audio(path(name), &ReadOptions::default()).unwrap()
}

fn truth(channel: usize, frame: f64) -> f64 {
    let fade = (PI * (frame + 0.5) / FRAMES as f64).sin().powi(2);
    let tone = |hz: f64| 0.5 * (TAU * hz * frame / f64::from(RATE_HZ)).sin();
    fade * if channel == 0 { tone(441.0) + 0.5 * tone(1323.0) } else { tone(735.0) }
}

/// The largest difference from the truth.
fn error(audio: &Audio) -> f64 {
    let at = |c: usize, n: usize| (f64::from(audio.plane(c)[n]) - truth(c, n as f64)).abs();
    let all = (0..audio.channels()).flat_map(|c| (0..audio.frames()).map(move |n| at(c, n)));
    all.fold(0.0, f64::max)
}

#[test]
fn flac_is_exact() {
    let mono = read("mono16.flac");
    assert_eq!((mono.rate_hz(), mono.channels(), mono.frames()), (RATE_HZ, 1, 3001));
    assert_eq!(mono.sample, AudioSample::I16);
    assert!(error(&mono) <= 1.01 / 32_768.0, "{}", error(&mono)); // The encoder rounds and scales.
    let stereo = read("stereo24.flac");
    assert_eq!((stereo.channels(), stereo.frames(), stereo.sample), (2, 2001, AudioSample::I24));
    assert!(error(&stereo) <= 1.01 / 8_388_608.0, "{}", error(&stereo));
    assert!(mono.as_planar().iter().all(|v| (v * 32_768.0).fract() == 0.0));
}

/// How much lossy sound may differ: 0.009 (Vorbis) and 0.019 (MP3) observed; a shift by one frame
/// alone makes up to 0.08.
const LOSSY: f64 = 0.04;
/// Frames; 0.0005 (Vorbis) and 0.01 (MP3) observed. What is cut off wrongly is whole frames.
const SHIFT: f64 = 0.1;

#[test]
fn lossy_sound_keeps_its_time_and_length() {
    for name in ["stereo.ogg", "stereo.mp3"] {
        let audio = read(name);
        assert_eq!(
            (audio.rate_hz(), audio.channels(), audio.frames()),
            (RATE_HZ, 2, FRAMES),
            "{name}"
        );
        assert_eq!(audio.sample, AudioSample::F32);
        assert!(error(&audio) < LOSSY, "{name}: {}", error(&audio));
        // The shift that fits best, by the slope of the truth: least squares.
        let (mut product, mut square) = (0.0, 0.0);
        for n in 1..FRAMES - 1 {
            let slope = (truth(0, n as f64 + 1e-3) - truth(0, n as f64 - 1e-3)) / 2e-3;
            product += slope * (f64::from(audio.plane(0)[n]) - truth(0, n as f64));
            square += slope * slope;
        }
        let shift = product / square;
        assert!(shift.abs() < SHIFT, "{name}: {shift} frames");
    }
}

#[test]
fn the_content_decides_not_the_name() {
    for name in ["mono16.flac", "stereo.ogg", "stereo.mp3"] {
        let (bytes, right) = (std::fs::read(path(name)).unwrap(), read(name));
        for other in ["sound.wav", "sound", "sound.mp3"] {
            assert_eq!(decode_audio(other, &bytes, &ReadOptions::default()).unwrap(), right);
        }
        // Tags of MP3 files are found in front of others too.
        let tagged = [&b"ID3\x04\0\0\0\0\0\x02ab"[..], &bytes].concat();
        assert_eq!(decode_audio(name, &tagged, &ReadOptions::default()).unwrap(), right);
    }
}
