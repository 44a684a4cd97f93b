//! Sound that is cut short, altered or lying: always a typed error or a sound, never a panic and
//! never memory for what a header merely claims.

mod support;

use signal_io::{Audio, AudioSample, AudioWriteOptions, Error, ReadOptions, Result};
use signal_io::{decode_audio, read_audio, write_audio};
use support::{noise, random, wav, wav_extensible, wav_format};

fn decode(name: &str, bytes: &[u8]) -> Result<Audio> {
    decode_audio(format!("damaged.{name}"), bytes, &ReadOptions::default())
}

fn data(name: &str) -> Vec<u8> {
    let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data"));
    std::fs::read(folder.join(name)).unwrap()
}

/// WAV files of all sample types, and those of other formats that this build reads.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    use AudioSample::{F32, I16, I24, I32, U8};
    for (channels, sample) in [(1, U8), (2, I16), (3, I24), (1, I32), (2, F32)] {
        let path = folder.path().join(format!("{channels}{}.wav", sample.name()));
        let audio = noise(44_100, channels, 60, sample);
        write_audio(&path, &audio, &AudioWriteOptions::default()).unwrap();
        files.push(("wav", std::fs::read(path).unwrap()));
    }
    files.push(("wav", wav(&wav_format(3, 1, 8000, 64), &[0; 80])));
    files.push(("wav", wav(&wav_extensible(1, 2, 16, 12), &[7; 80])));
    if cfg!(feature = "compressed-audio") {
        files.extend([("flac", data("mono16.flac")), ("flac", data("stereo24.flac"))]);
        files.extend([("ogg", data("stereo.ogg")), ("mp3", data("stereo.mp3"))]);
    }
    files
}

#[test]
fn cut_files_are_errors() {
    for (name, bytes) in files() {
        let step = (bytes.len() / 60).max(1);
        let ends = (0..bytes.len()).filter(|e| e % step == 0 || *e < 100 || e + 20 > bytes.len());
        for end in ends {
            match decode(name, &bytes[..end]) {
                Err(Error::Corrupt { .. } | Error::Empty { .. }) => {}
                other => panic!("{name} cut at {end} of {}: {other:?}", bytes.len()),
            }
        }
    }
}

/// Formats with checksums notice every change of the sound.
#[test]
fn altered_samples_are_noticed() {
    for (name, bytes) in files().into_iter().filter(|(name, _)| matches!(*name, "flac" | "ogg")) {
        let whole = decode(name, &bytes).unwrap();
        let mut next = random(7);
        for _ in 0..40 {
            let mut altered = bytes.clone();
            let at = bytes.len() / 2 + (next() % (bytes.len() / 2) as u64) as usize;
            altered[at] ^= 1 << (next() % 8);
            match decode(name, &altered) {
                Err(Error::Corrupt { .. } | Error::UnsupportedFeature { .. }) => {}
                Ok(sound) if sound == whole => {} // Padding bits.
                other => panic!("{name} altered at {at}: {other:?}"),
            }
        }
    }
}

/// Enough to find the usual off-by-one in seconds; 8000 have been run without another panic than the
/// one that `audio/compressed.rs` tells of.
const ROUNDS: usize = 150;

#[test]
fn altered_files_never_panic() {
    for (name, bytes) in files() {
        let mut next = random(bytes.len() as u64);
        for round in 0..ROUNDS {
            let mut altered = bytes.clone();
            for _ in 0..1 + round % 4 {
                // Half of the changes go to the header, where they do most harm.
                let header = next().is_multiple_of(2);
                let reach = if header { altered.len().min(200) } else { altered.len() };
                let at = (next() % reach as u64) as usize;
                altered[at] = match next() % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => altered[at] ^ 1 << (next() % 8),
                    _ => next() as u8,
                };
            }
            let _ = decode(name, &altered);
            if name == "ogg" {
                seal_pages(&mut altered); // Otherwise no change gets past the checksums.
                let _ = decode(name, &altered);
            }
        }
    }
}

/// Makes the checksums of Ogg pages right again, as far as pages can be found (RFC 3533).
fn seal_pages(bytes: &mut [u8]) {
    let mut at = 0;
    while at + 27 <= bytes.len() && bytes[at..].starts_with(b"OggS") {
        let body = at + 27 + usize::from(bytes[at + 26]);
        let Some(segments) = bytes.get(at + 27..body) else { return };
        let end = body + segments.iter().map(|n| usize::from(*n)).sum::<usize>();
        let Some(page) = bytes.get_mut(at..end) else { return };
        page[22..26].fill(0);
        let step = |crc: u32, byte: &u8| {
            let bit = |c: u32, _| c << 1 ^ if c >> 31 == 1 { 0x04c1_1db7 } else { 0 };
            (0..8).fold(crc ^ u32::from(*byte) << 24, bit)
        };
        let crc = page.iter().fold(0, step);
        page[22..26].copy_from_slice(&crc.to_le_bytes());
        at = end;
    }
}

#[test]
fn sealed_pages_are_as_they_were() {
    let bytes = data("stereo.ogg");
    let mut sealed = bytes.clone();
    seal_pages(&mut sealed);
    assert!(sealed == bytes);
}

#[test]
fn garbage_is_refused() {
    let mut next = random(1);
    let noise: Vec<u8> = (0..4096).map(|_| (next() as u8) & 0x7f).collect();
    assert!(matches!(decode("wav", &noise), Err(Error::Corrupt { .. })));
    for name in signal_io::AudioFormat::READABLE.split(", ") {
        let result = decode(name, &noise);
        let refused = matches!(result, Err(Error::Corrupt { .. } | Error::FeatureOff { .. }));
        assert!(refused, "{name}: {result:?}");
        assert!(matches!(decode(name, b""), Err(Error::Empty { .. })));
    }
    let result = decode("doc", &noise);
    assert!(
        matches!(result, Err(Error::UnsupportedFormat { extension, .. }) if extension == "doc")
    );
    for (name, bytes) in files() {
        for keep in [4, 8, 12, 16, 24, 32, 44] {
            let _ = decode(name, &[&bytes[..keep], &noise].concat());
        }
    }
}

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.wav");
    std::fs::write(&path, b"RIFF\x04\0\0\0WAVE").unwrap();
    let message = read_audio(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("broken.wav") && message.contains("WAV"), "{message}");
    let missing = read_audio(folder.path().join("no.wav"), &ReadOptions::default());
    assert!(matches!(missing, Err(Error::NotFound { .. })));
}

#[test]
fn absurd_wav_headers() {
    let samples = [0u8; 48];
    let refused = |fmt: &[u8], what: &str| {
        let result = decode("wav", &wav(fmt, &samples));
        assert!(
            matches!(result, Err(Error::Corrupt { .. } | Error::UnsupportedFeature { .. })),
            "{what}: {result:?}"
        );
    };
    refused(&wav_format(1, 0, 44_100, 16), "no channels");
    refused(&wav_format(1, 9, 44_100, 16), "nine channels");
    refused(&wav_format(1, u16::MAX, 44_100, 8), "65535 channels");
    refused(&wav_format(1, 1, 0, 16), "no rate");
    refused(&wav_format(1, 1, u32::MAX, 16), "4 GHz");
    for bits in [0, 1, 4, 12, 40, 64, u16::MAX] {
        refused(&wav_format(1, 1, 44_100, bits), "odd bits");
    }
    refused(&wav_format(3, 1, 44_100, 16), "halves");
    refused(&wav_format(2, 1, 44_100, 16), "ADPCM");
    refused(&wav_format(0xfffe, 1, 44_100, 16), "extensible without extension");
    refused(&wav_format(1, 1, 44_100, 16)[..14], "short");
    refused(&[], "empty");
    refused(&wav_extensible(0x55, 1, 16, 16), "MP3 in WAV");

    let whole = wav(&wav_format(1, 1, 44_100, 16), &samples);
    // The format chunk claims 4 GiB; the samples do, with a length that is not the unknown one.
    for (at, length) in [(16, u32::MAX), (16, u32::MAX - 1), (40, u32::MAX - 1), (40, 1 << 31)] {
        let mut lying = whole.clone();
        lying[at..at + 4].copy_from_slice(&length.to_le_bytes());
        let result = decode("wav", &lying);
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{length} at {at}: {result:?}");
    }
    let empty = decode("wav", &wav(&wav_format(1, 1, 44_100, 16), &[]));
    assert!(matches!(empty, Err(Error::Empty { .. })), "{empty:?}");
    let no_format = decode("wav", b"RIFF\x10\0\0\0WAVEdata\x02\0\0\0ab");
    assert!(matches!(no_format, Err(Error::Corrupt { .. })));
    for head in [&b"RF64"[..], b"RIFX"] {
        let other = decode("wav", &[head, &whole[4..]].concat());
        assert!(matches!(other, Err(Error::UnsupportedFeature { .. })), "{other:?}");
    }
}

#[test]
fn the_limit_is_the_decoded_size() {
    for (name, bytes) in files() {
        let whole = decode(name, &bytes).unwrap();
        let needed = 4 * whole.as_planar().len() as u64;
        let with_limit =
            |limit_bytes| decode_audio("", &bytes, &ReadOptions { limit_bytes, transfer: None });
        assert_eq!(with_limit(needed).unwrap(), whole, "{name}");
        let result = with_limit(needed - 1);
        assert!(matches!(result, Err(Error::TooLarge { .. })), "{name}: {result:?}");
    }
}

/// Once took memory for 2^40 numbers: the decoder believed the header of a code book.
#[cfg(feature = "compressed-audio")]
#[test]
fn absurd_vorbis_code_books() {
    let whole = data("stereo.ogg");
    let setup = whole.windows(7).position(|w| w == b"\x05vorbis").unwrap() + 7;
    assert_eq!(whole[setup + 1..setup + 4], *b"BCV");
    for size in [[0xff; 5], [1, 0, 0xff, 0xff, 0xff], [0xff, 0xff, 0xff, 0, 0]] {
        let mut lying = whole.clone();
        lying[setup + 4..setup + 9].copy_from_slice(&size);
        seal_pages(&mut lying);
        let result = decode("ogg", &lying);
        assert!(
            matches!(&result, Err(Error::Corrupt { reason, .. }) if reason.contains("code books")),
            "{result:?}"
        );
    }
}

/// 2^36 - 1 frames, in a file of a kilobyte.
#[cfg(feature = "compressed-audio")]
#[test]
fn absurd_flac_headers() {
    let mut bytes = data("mono16.flac");
    // STREAMINFO starts at 8; its frames are 36 bits from byte 13 on, lower half.
    bytes[8 + 13] |= 0x0f;
    bytes[8 + 14..8 + 18].fill(0xff);
    assert!(matches!(decode("flac", &bytes), Err(Error::TooLarge { .. })));
    bytes[8 + 13] &= 0xf0;
    bytes[8 + 14] = 0x0f; // 2^28 - 1: within the limit.
    assert!(matches!(decode("flac", &bytes), Err(Error::Corrupt { .. })));
    for (at, value) in [(8 + 10, 0), (8 + 11, 0), (8 + 12, 0x00)] {
        let mut altered = data("mono16.flac");
        altered[at] = value;
        let _ = decode("flac", &altered); // Other rates, channels and bits.
    }
}

#[cfg(not(feature = "compressed-audio"))]
#[test]
fn other_formats_need_the_feature() {
    for name in ["stereo.ogg", "stereo.mp3", "mono16.flac"] {
        let result = decode("", &data(name));
        let message = result.as_ref().unwrap_err().to_string();
        assert!(matches!(result, Err(Error::FeatureOff { .. })), "{message}");
        assert!(message.contains("--features compressed-audio"), "{message}");
    }
}
