//! Compressed sound: small files made here, whole, cut short and altered.
#![cfg(feature = "compressed-audio")]

mod support;

use signal_io::{Audio, AudioSample, Error, ReadOptions, Result, decode_audio};

/// Frames in a block of the FLAC files made here.
const BLOCK: usize = 16;

fn decode(name: &str, bytes: &[u8]) -> Result<Audio> {
    let result = decode_audio(name, bytes, &ReadOptions::default());
    if let Err(error) = &result {
        assert!(error.to_string().contains(name), "{error}");
    }
    result
}

/// A checksum of `bits` bits with the given polynomial, highest bit first.
fn crc(bytes: &[u8], bits: u32, polynomial: u32) -> u32 {
    let top = 1 << (bits - 1);
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte) << (bits - 8), |crc, _| {
            let shifted = crc << 1 & ((1u64 << bits) - 1) as u32;
            if crc & top == 0 { shifted } else { shifted ^ polynomial }
        })
    })
}

/// FLAC with 16 bits and verbatim subframes: frame headers, checksums, no prediction.
///
/// Source: RFC 9639. `total` is the number of frames it claims, `md5` its checksum (0: none).
fn flac(rate: u32, channels: &[Vec<i16>], total: u64, md5: u8) -> Vec<u8> {
    let mut bytes = b"fLaC\x80\0\0\x22".to_vec();
    bytes.extend([0, BLOCK as u8, 0, BLOCK as u8, 0, 0, 0, 0, 0, 0]);
    // 20 bits rate, 3 bits channels, 5 bits depth, 36 bits number of frames.
    let packed = u64::from(rate) << 44 | (channels.len() as u64 - 1) << 41 | 15 << 36 | total;
    bytes.extend(packed.to_be_bytes());
    bytes.extend([md5; 16]);
    for block in 0..channels[0].len() / BLOCK {
        let mut frame = vec![0xff, 0xf8, 0x60, (channels.len() as u8 - 1) << 4 | 0x08];
        frame.extend([block as u8, BLOCK as u8 - 1]);
        frame.push(crc(&frame, 8, 0x07) as u8);
        for channel in channels {
            frame.push(0x02);
            let samples = &channel[block * BLOCK..][..BLOCK];
            frame.extend(samples.iter().flat_map(|v| v.to_be_bytes()));
        }
        frame.extend((crc(&frame, 16, 0x8005) as u16).to_be_bytes());
        bytes.extend(frame);
    }
    bytes
}

fn channels() -> Vec<Vec<i16>> {
    let mut next = support::random(3);
    (0..2).map(|_| (0..BLOCK * 5).map(|_| next() as i16).collect()).collect()
}

#[test]
fn flac_is_exact() {
    let channels = channels();
    let n = channels[0].len();
    for total in [n as u64, 0] {
        let audio = decode("a.flac", &flac(44_100, &channels, total, 0)).unwrap();
        assert_eq!((audio.rate_hz(), audio.channels(), audio.frames()), (44_100, 2, n));
        assert_eq!(audio.sample, AudioSample::I16);
        for (c, channel) in channels.iter().enumerate() {
            let expected: Vec<f32> = channel.iter().map(|v| f32::from(*v) / 32_768.0).collect();
            assert_eq!(audio.plane(c), expected);
        }
    }
    // With tags of MP3 before it, and under another name.
    let mut tagged = b"ID3\x04\0\0\0\0\0\x03abc".to_vec();
    tagged.extend(flac(44_100, &channels, n as u64, 0));
    assert_eq!(decode("a.wav", &tagged).unwrap().frames(), n);
    let options = ReadOptions { limit_bytes: 500, ..ReadOptions::default() };
    let limited = decode_audio("a.flac", &flac(44_100, &channels, n as u64, 0), &options);
    assert!(matches!(limited, Err(Error::TooLarge { .. })), "{limited:?}");
    let wrong = decode("a.flac", &flac(44_100, &channels, n as u64, 1));
    assert!(matches!(wrong, Err(Error::Corrupt { .. })), "{wrong:?}");
}

#[test]
fn damaged_flac() {
    let channels = channels();
    let good = flac(16_000, &channels, channels[0].len() as u64, 0);
    for length in 0..good.len() {
        assert!(decode("a.flac", &good[..length]).is_err(), "{length}");
    }
    altered("a.flac", &good);
}

/// MPEG-1 layer III, 128 kbit/s, 44.1 kHz, one channel: frames without any spectrum.
fn silent_mp3(frames: usize) -> Vec<u8> {
    let mut frame = vec![0xff, 0xfb, 0x90, 0xc0];
    frame.resize(417, 0);
    frame.repeat(frames)
}

#[test]
fn mp3_of_silence() {
    let good = silent_mp3(4);
    let audio = decode("a.mp3", &good).unwrap();
    assert_eq!((audio.rate_hz(), audio.channels()), (44_100, 1));
    assert_eq!((audio.frames(), audio.sample), (4 * 1152, AudioSample::F32));
    assert_eq!(audio.peak(), 0.0);
    for length in (0..good.len()).step_by(13) {
        if let Ok(shorter) = decode("a.mp3", &good[..length]) {
            assert!(shorter.frames() <= audio.frames());
        }
    }
    altered("a.mp3", &silent_mp3(2));
}

#[test]
fn mp3_of_changing_bitrate_is_complete() {
    // 320 kbit/s, then 32: the length cannot be guessed from the first frame.
    let mut bytes = vec![0xff, 0xfb, 0xe0, 0xc0];
    bytes.resize(1044, 0);
    let mut low = vec![0xff, 0xfb, 0x10, 0xc0];
    low.resize(104, 0);
    bytes.extend(low.repeat(20));
    assert_eq!(decode("a.mp3", &bytes).unwrap().frames(), 21 * 1152);
}

#[test]
fn mp3_without_delay_and_padding() {
    // The first frame holds the tag of the encoder LAME instead of sound: 4 frames, of which the
    // first 576 and the last 1000 samples are not part of the sound.
    let mut tag = silent_mp3(1);
    tag[21..33].copy_from_slice(b"Info\0\0\0\x01\0\0\0\x04");
    tag[33..42].copy_from_slice(b"LAME3.100");
    let trim = (576u32 << 12 | 1000).to_be_bytes();
    tag[54..57].copy_from_slice(&trim[1..]);
    tag.extend(silent_mp3(4));
    assert_eq!(decode("a.mp3", &tag).unwrap().frames(), 4 * 1152 - 1576);
}

#[test]
fn no_ogg_inside() {
    let mut next = support::random(11);
    for length in [4, 27, 28, 58, 300, 5000] {
        let mut bytes = b"OggS\0\x02".to_vec();
        bytes.extend((0..length).map(|_| next() as u8));
        assert!(decode("a.ogg", &bytes).is_err());
    }
}

/// Every byte replaced: sound or an error, never a panic.
fn altered(name: &str, good: &[u8]) {
    let mut next = support::random(5);
    for at in 0..good.len() {
        for value in [0, 0xff, good[at] ^ 1, next() as u8] {
            let mut bytes = good.to_vec();
            bytes[at] = value;
            if let Ok(audio) = decode(name, &bytes) {
                assert!(audio.frames() <= 70_000);
            }
        }
    }
}
