//! Animations and videos that are cut short, altered or lying: always a typed error or a video, never
//! a panic and never memory for what a header merely claims.

mod support;

use signal_io::{
    Error, ReadOptions, Result, SampleType, Video, VideoWriteOptions, decode_video, write_video,
};
use support::{random, video};

fn decode(extension: &str, bytes: &[u8]) -> Result<Video> {
    decode_video(format!("damaged.{extension}"), bytes, &ReadOptions::default())
}

fn bytes_of(extension: &str, video: &Video, options: &VideoWriteOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("video.{extension}"));
    write_video(&path, video, options).unwrap();
    std::fs::read(path).unwrap()
}

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let plain = VideoWriteOptions::default();
    let ten = VideoWriteOptions { y4m_bits: 10, ..plain };
    let rgb = video([13, 9, 3], &["R", "G", "B"], SampleType::U8);
    let rgba = video([8, 7, 3], &["R", "G", "B", "A"], SampleType::U8);
    let mut subsampled = b"YUV4MPEG2 W5 H3 F25:1 C420mpeg2\n".to_vec();
    for _ in 0..3 {
        subsampled.extend(b"FRAME Ip\n");
        subsampled.extend((0..15 + 2 * 6).map(|k| k * 9));
    }
    vec![
        ("gif", bytes_of("gif", &rgb, &plain)),
        ("gif", bytes_of("gif", &rgba, &plain)),
        ("webp", bytes_of("webp", &rgb, &plain)),
        ("webp", bytes_of("webp", &rgba, &plain)),
        ("y4m", bytes_of("y4m", &rgb, &plain)),
        ("y4m", bytes_of("y4m", &rgb, &ten)),
        ("y4m", subsampled),
    ]
}

#[test]
fn cut_videos_are_errors() {
    for (extension, bytes) in files() {
        let whole = decode(extension, &bytes).unwrap();
        for end in 0..bytes.len() {
            match decode(extension, &bytes[..end]) {
                Err(Error::Corrupt { .. } | Error::Empty { .. }) => {}
                // Y4M does not say how many frames there are.
                Ok(video) if extension == "y4m" => {
                    let [w, h, frames] = video.shape();
                    assert!(frames < whole.shape()[2], "cut at {end}");
                    assert_eq!(video.plane(0), &whole.plane(0)[..w * h * frames]);
                }
                other => panic!("{extension} cut at {end}: {other:?}"),
            }
        }
    }
}

#[test]
fn altered_videos_never_panic() {
    for (extension, bytes) in files() {
        let mut next = random(bytes.len() as u64);
        for round in 0..ROUNDS {
            let mut altered = bytes.clone();
            for _ in 0..1 + round % 4 {
                // Half of the changes go to the header, where they do most harm.
                let reach = match next() % 2 {
                    0 => altered.len().min(120),
                    _ => altered.len(),
                };
                let at = (next() % reach as u64) as usize;
                altered[at] = match next() % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => altered[at] ^ 1 << (next() % 8),
                    _ => next() as u8,
                };
            }
            // A canvas of 64 MiB at most: larger ones would only take time.
            let options = ReadOptions { limit_bytes: 1 << 26, transfer: None };
            let _ = decode_video(format!("altered.{extension}"), &altered, &options);
        }
    }
}

/// Enough to find the usual off-by-one in seconds.
const ROUNDS: usize = 300;

#[test]
fn garbage_is_refused() {
    let mut next = random(1);
    let noise: Vec<u8> = (0..4096).map(|_| next() as u8).collect();
    for extension in ["gif", "webp", "y4m"] {
        let result = decode(extension, &noise);
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{extension}: {result:?}");
        assert!(matches!(decode(extension, b""), Err(Error::Empty { .. })));
    }
    assert!(matches!(decode("mp4", &noise), Err(Error::UnsupportedFormat { .. })));
    for (extension, bytes) in files() {
        for keep in [4, 8, 12, 16, 24, 32, 64] {
            let _ = decode(extension, &[&bytes[..keep], &noise].concat());
        }
        // The content decides, not the name.
        assert_eq!(decode("jpg", &bytes).unwrap(), decode(extension, &bytes).unwrap());
    }
}

#[test]
fn absurd_y4m_headers() {
    let with = |header: &str, body: usize| {
        decode("y4m", &[header.as_bytes(), b"\nFRAME\n", &vec![9; body]].concat())
    };
    for size in ["W1048576 H1048576", "W4294967295 H4294967295"] {
        for space in ["", "C444p16", "Cmono"] {
            let result = with(&format!("YUV4MPEG2 {size} {space}"), 64);
            assert!(matches!(result, Err(Error::TooLarge { .. })), "{size} {space}: {result:?}");
        }
    }
    let corrupt = |text: &str| {
        let result = with(text, 12);
        assert!(matches!(result, Err(Error::Corrupt { .. })), "{text}: {result:?}");
        assert!(result.unwrap_err().to_string().contains("damaged.y4m"));
    };
    corrupt("YUV4MPEG2 W9000 H9000 F25:1"); // Within the limit, but not there.
    corrupt("YUV4MPEG2 W2 H2 F25:0 C444");
    corrupt("YUV4MPEG2 W2 H2 F25 C444");
    corrupt("YUV4MPEG2 W99999999999 H2 C444");
    corrupt("YUV4MPEG2 H2 C444");
    corrupt("YUV4MPEG2 W2 C444");
    corrupt(&format!("YUV4MPEG2 W2 H2 C444 X{}", "x".repeat(5000)));
    assert!(with("YUV4MPEG2 W2 H2 F0:0 C444", 12).is_ok(), "0:0 is the way to say unknown");
    assert!(matches!(with("YUV4MPEG2 W0 H2", 0), Err(Error::Empty { .. })));
    assert!(matches!(decode("y4m", b"YUV4MPEG2 W2 H2\n"), Err(Error::Empty { .. })), "no frames");
    let odd = with("YUV4MPEG2 W2 H2 C444alpha", 16);
    assert!(matches!(odd, Err(Error::UnsupportedFeature { .. })), "{odd:?}");
}

#[test]
fn absurd_canvases() {
    // A GIF of 65535 x 65535, whose only frame is a pixel.
    let mut gif =
        bytes_of("gif", &video([1, 1, 1], &["Y"], SampleType::U8), &VideoWriteOptions::default());
    gif[6..10].fill(0xff);
    assert!(matches!(decode("gif", &gif), Err(Error::TooLarge { .. })));
    gif[6..10].fill(0);
    assert!(decode("gif", &gif).is_err());
    // A WebP whose canvas has 2^48 pixels, and one that has none of its frames.
    let webp = bytes_of(
        "webp",
        &video([2, 2, 2], &["R", "G", "B"], SampleType::U8),
        &VideoWriteOptions::default(),
    );
    let canvas = webp.windows(4).position(|w| w == b"VP8X").unwrap() + 8 + 4;
    let mut wide = webp.clone();
    wide[canvas..canvas + 6].fill(0xff);
    let result = decode("webp", &wide);
    assert!(
        matches!(result, Err(Error::TooLarge { .. } | Error::UnsupportedFeature { .. })),
        "{result:?}"
    );
    let mut small = webp.clone();
    small[canvas..canvas + 6].fill(0);
    assert!(matches!(decode("webp", &small), Err(Error::Corrupt { .. })));
}

#[test]
fn the_limit_is_the_whole_video() {
    let video = video([9, 5, 4], &["R", "G", "B"], SampleType::U8);
    let needed = 9 * 5 * 4 * 3 * 4;
    for extension in ["gif", "webp", "y4m"] {
        let bytes = bytes_of(extension, &video, &VideoWriteOptions::default());
        let with_limit =
            |limit_bytes| decode_video("a", &bytes, &ReadOptions { limit_bytes, transfer: None });
        assert!(with_limit(needed).is_ok(), "{extension}");
        let result = with_limit(needed - 1);
        assert!(
            matches!(result, Err(Error::TooLarge { needed: n, .. }) if n == needed),
            "{extension}: {result:?}"
        );
    }
}
