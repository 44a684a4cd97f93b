//! Videos come back as they were written, with their times.

mod support;

use std::fs;
use std::path::Path;

use signal_io::{
    Error, Image, ReadOptions, Result, SampleType, Timing, Transfer, Video, VideoFormat,
    VideoReport, VideoWriteOptions, WriteOptions, check_video_target, read_video, write_image,
    write_video,
};
use support::{names_in, picture, video};

const RGB: [&str; 3] = ["R", "G", "B"];
const RGBA: [&str; 4] = ["R", "G", "B", "A"];

fn read(path: impl AsRef<Path>) -> Result<Video> {
    read_video(path, &ReadOptions::default())
}

/// Writes and reads back.
fn there_and_back(
    name: &str,
    video: &Video,
    options: &VideoWriteOptions,
) -> Result<(Video, VideoReport)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    check_video_target(&path, false)?;
    let report = write_video(&path, video, options)?;
    assert_eq!(report.frames, video.shape()[2]);
    Ok((read(&path)?, report))
}

fn plain() -> VideoWriteOptions {
    VideoWriteOptions::default()
}

#[test]
fn shapes_and_samples() {
    let data: Vec<f32> = (0..2 * 3 * 4 * 2).map(|k| k as f32).collect();
    let video = Video::new([2, 3, 4], &["u", "v"], data).unwrap();
    // (x, y, t) = (1, 2, 3) of channel 1.
    assert_eq!(video.as_planar()[((4 + 3) * 3 + 2) * 2 + 1], 47.0);
    assert_eq!(video.frame(3).plane(1)[2 * 2 + 1], 47.0);
    let samples = video.to_samples::<2>(0.5).unwrap();
    let domain = samples.domain();
    assert_eq!((domain.shape(), domain.pitch()), ([2, 3, 4], [1.0, 1.0, 0.5]));
    assert_eq!(Video::from_samples(&samples, &video).unwrap(), video);
    let frames = (0..4).map(|t| video.frame(t)).collect();
    assert_eq!(Video::from_frames(frames).unwrap(), video);
    assert!(matches!(video.to_samples::<2>(0.0), Err(Error::Shape { .. })));
    assert!(matches!(video.to_samples::<1>(1.0), Err(Error::ChannelCount { .. })));
    assert!(matches!(Video::new([2, 3, 0], &["Y"], vec![]), Err(Error::Shape { .. })));
    assert!(matches!(Video::from_frames(vec![]), Err(Error::Shape { .. })));
}

#[test]
fn animated_webp_is_exact() {
    for (channels, shape) in
        [(&RGB[..], [13, 7, 5]), (&RGBA, [8, 9, 3]), (&RGB, [1, 1, 1]), (&RGBA, [2, 1, 2])]
    {
        let mut video = video(shape, channels, SampleType::U8);
        video.timing = Timing::DelaysMs((0..shape[2] as u32).map(|t| 7 + 31 * t).collect());
        let (back, report) = there_and_back("a.webp", &video, &plain()).unwrap();
        assert_eq!(back, video, "{shape:?}");
        assert_eq!((report.format, report.clipped), (VideoFormat::WebP, 0));
    }
}

#[test]
fn animations_keep_their_profile_in_webp() {
    let mut strip = picture(4, 6, &RGB, SampleType::U8);
    strip.icc = Some(vec![1, 2, 3]);
    let video = Video::from_strip(strip, 2).unwrap();
    let (back, _) = there_and_back("a.webp", &video, &plain()).unwrap();
    assert_eq!(back.as_strip(), video.as_strip());
    assert_eq!(back.timing, Timing::DelaysMs(vec![40, 40]));
}

/// The bytes of a WebP chunk.
fn chunk(name: &[u8; 4], payload: &[u8]) -> Vec<u8> {
    let padding = vec![0; payload.len() % 2];
    [&name[..], &(payload.len() as u32).to_le_bytes(), payload, &padding].concat()
}

#[test]
fn webp_frames_are_composited() {
    // Three frames of 2 x 2 on a canvas of 4 x 2: (column, flags: 1 disposes, 2 does not blend).
    let red = [1.0, 0.0, 0.0, 1.0];
    let blue = [0.0, 0.0, 1.0, 1.0];
    let half = [0.0, 1.0, 0.0, 128.0 / 255.0];
    let mut body = chunk(b"VP8X", &[0x12, 0, 0, 0, 3, 0, 0, 1, 0, 0]);
    body.extend(chunk(b"ANIM", &[9, 9, 9, 9, 0, 0])); // A background colour that nobody shows.
    for (color, column, flags) in [(red, 0, 1), (blue, 2, 2), (half, 2, 0)] {
        let data = color.iter().flat_map(|v| [*v; 4]).collect();
        let mut image = Image::new(2, 2, &RGBA, data).unwrap();
        (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
        let still = support::file_bytes("webp", &image);
        let frame =
            [&[column / 2, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 50, 0, 0, flags][..], &still[12..]];
        body.extend(chunk(b"ANMF", &frame.concat()));
    }
    let size = (body.len() as u32 + 4).to_le_bytes();
    let bytes = [&b"RIFF"[..], &size, b"WEBP", &body].concat();
    let video = signal_io::decode_video("a.webp", &bytes, &ReadOptions::default()).unwrap();
    assert_eq!(video.timing, Timing::DelaysMs(vec![50; 3]));
    let none = [0.0; 4];
    // Green at one half over blue.
    let over = [0.0, 128.0 / 255.0, 127.0 / 255.0, 1.0];
    for (t, left, right) in [(0, red, none), (1, none, blue), (2, none, over)] {
        let frame = video.frame(t);
        for (x, expected) in [(0, left), (1, left), (2, right), (3, right)] {
            for y in 0..2 {
                let got: Vec<f32> = (0..4).map(|c| frame.plane(c)[y * 4 + x]).collect();
                // A step of 8 bits for the rounding of the mixture.
                let close = |(a, b): (&f32, f32)| (a - b).abs() < 1.01 / 255.0;
                assert!(got.iter().zip(expected).all(close), "{t} {x}: {got:?} for {expected:?}");
            }
        }
    }
}

#[test]
fn gif_keeps_frames_of_few_colours() {
    // 12 x 12 noise has at most 144 colours.
    for channels in [&RGB[..], &["Y"]] {
        let mut video = video([12, 12, 4], channels, SampleType::U8);
        video.timing = Timing::DelaysMs(vec![10, 20, 400, 0]);
        let (back, report) = there_and_back("a.gif", &video, &plain()).unwrap();
        let expected = video.as_strip().to_rgb().unwrap();
        assert_eq!(back.as_strip(), &expected);
        assert_eq!(back.timing, video.timing);
        assert_eq!((report.clipped, report.samples), (0, 12 * 12 * 4 * channels.len()));
    }
}

#[test]
fn gif_transparency_is_on_or_off() {
    let mut video = video([6, 5, 3], &RGBA, SampleType::U8);
    let n = 6 * 5 * 3;
    for (k, alpha) in video.as_planar_mut()[3 * n..].iter_mut().enumerate() {
        *alpha = [0.0, 0.4, 0.6, 1.0][k % 4];
    }
    let (back, _) = there_and_back("a.gif", &video, &plain()).unwrap();
    for t in 0..3 {
        let (got, expected) = (back.frame(t), video.frame(t));
        for k in 0..30 {
            let on = expected.plane(3)[k] >= 0.5;
            // Once something has been painted GIF shows it through the holes of later frames.
            assert!(got.plane(3)[k] == 1.0 || (!on && got.plane(3)[k] == 0.0), "{t} {k}");
            if on {
                (0..3).for_each(|c| assert_eq!(got.plane(c)[k], expected.plane(c)[k]));
            }
        }
    }
    assert_eq!(back.frame(0).plane(3)[0], 0.0);
}

/// Half a step of luma and half a step of chroma times 1.772, the largest weight, in the limited range;
/// a millionth for the roundings of numbers near 1.
fn y4m_tolerance(bits: u8) -> f32 {
    (0.5 / 219.0 + 1.772 * 0.5 / 224.0) / f32::from(1u16 << (bits - 8)) + 1e-6
}

#[test]
fn y4m_comes_back_within_a_code() {
    for bits in [8, 10, 12, 16] {
        for full in [false, true] {
            for channels in [&RGB[..], &["Y"]] {
                let mut video = video([9, 5, 3], channels, SampleType::U16);
                video.timing = Timing::Rate { frames: 30_000, seconds: 1001 };
                let options = VideoWriteOptions { y4m_bits: bits, y4m_full_range: full, ..plain() };
                let (back, report) = there_and_back("a.y4m", &video, &options).unwrap();
                assert_eq!(back.channels(), video.channels());
                assert_eq!((back.timing.clone(), report.clipped), (video.timing.clone(), 0));
                let expected = if bits > 8 { SampleType::U16 } else { SampleType::U8 };
                assert_eq!((back.sample(), back.transfer()), (expected, Transfer::Srgb));
                for (got, expected) in back.as_planar().iter().zip(video.as_planar()) {
                    let error = (got - expected).abs();
                    assert!(error <= y4m_tolerance(bits), "{bits} {full}: {got} for {expected}");
                }
            }
        }
    }
}

#[test]
fn y4m_counts_what_it_clips() {
    let video = Video::new([2, 1, 1], &["Y"], vec![0.5, 9.0]).unwrap();
    let (back, report) = there_and_back("a.y4m", &video, &plain()).unwrap();
    assert_eq!((report.clipped, report.samples), (1, 2));
    assert!((back.plane(0)[1] - 239.0 / 219.0).abs() < 1e-6, "code 255 is a little above white");
    for channels in [&RGBA[..], &["Y", "A"], &["u", "v"]] {
        let video = Video::from_strip(picture(2, 2, channels, SampleType::U8), 1).unwrap();
        let result = there_and_back("a.y4m", &video, &plain());
        assert!(matches!(result, Err(Error::CannotHold { .. })), "{channels:?}");
    }
    let odd = VideoWriteOptions { y4m_bits: 9, ..plain() };
    assert!(matches!(there_and_back("a.y4m", &video, &odd), Err(Error::CannotHold { .. })));
}

#[test]
fn grey_y4m_of_every_layout() {
    // A frame of 3 x 3 whose luma is 16 + 219 / 2 and whose chroma is grey, in every layout.
    for (space, values, wide) in [
        ("420jpeg", 9 + 8, false),
        ("420mpeg2", 9 + 8, false),
        ("420paldv", 9 + 8, false),
        ("422", 9 + 12, false),
        ("444", 27, false),
        ("420p10", 9 + 8, true),
        ("422p10", 9 + 12, true),
        ("mono", 9, false),
        ("mono10", 9, true),
    ] {
        let mut bytes = format!("YUV4MPEG2 W3 H3 F24:1 Ip C{space}\nFRAME\n").into_bytes();
        for k in 0..values {
            let code: u16 = if k < 9 { 126 } else { 128 };
            match wide {
                true => bytes.extend((code * 4).to_le_bytes()),
                false => bytes.push(code as u8),
            }
        }
        let video = signal_io::decode_video("a.y4m", &bytes, &ReadOptions::default()).unwrap();
        assert_eq!(video.shape(), [3, 3, 1]);
        assert_eq!(video.timing, Timing::Rate { frames: 24, seconds: 1 });
        for got in video.as_planar() {
            assert!((got - 110.0 / 219.0).abs() < 1e-6, "{space}: {got}");
        }
    }
}

#[test]
fn light_is_encoded_for_display() {
    let mut strip = picture(4, 4, &["Y"], SampleType::U8);
    strip.transfer = Transfer::Linear;
    let video = Video::from_strip(strip.clone(), 2).unwrap();
    let encoded = strip.to_transfer(Transfer::Srgb);
    for name in ["a.y4m", "a.webp", "a.gif", "folder"] {
        let (back, report) = there_and_back(name, &video, &plain()).unwrap();
        assert_eq!((report.transfer, back.transfer()), (Transfer::Srgb, Transfer::Srgb), "{name}");
        for (got, expected) in back.plane(0).iter().zip(encoded.plane(0)) {
            assert!((got - expected).abs() <= 0.5 / 219.0 + 1e-6, "{name}: {got}");
        }
    }
}

#[test]
fn sequences_of_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let video = video([5, 4, 12], &RGB, SampleType::U16);
    // A new folder, a pattern in it, and a pattern without leading zeros in another one.
    let shots = folder.path().join("shots");
    let report = write_video(&shots, &video, &plain()).unwrap();
    assert_eq!((report.format, report.samples), (VideoFormat::Pictures, 5 * 4 * 12 * 3));
    assert_eq!(names_in(&shots)[11], "frame_0011.png");
    assert_eq!(names_in(folder.path()), ["shots"]);
    let tiffs = folder.path().join("new/f%d.tif");
    write_video(&tiffs, &video, &plain()).unwrap();
    let deep = write_video(folder.path().join("no/such/f%d.tif"), &video, &plain());
    assert!(matches!(deep, Err(Error::NoFolder { .. })), "{deep:?}");
    for path in ["shots", "shots/frame_%04d.png", "shots/*_????.png", "new", "new/f%d.tif"] {
        assert_eq!(read(folder.path().join(path)).unwrap(), video, "{path}");
    }
    // Other files in the folder are no frames.
    fs::write(shots.join("notes.txt"), "take 3").unwrap();
    assert_eq!(read(&shots).unwrap(), video);
}

#[test]
fn sequences_are_replaced_completely_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let shots = folder.path().join("shots");
    let (old, new) =
        (video([5, 4, 3], &RGB, SampleType::U8), video([6, 4, 3], &RGB, SampleType::U8));
    write_video(&shots, &old, &plain()).unwrap();
    assert!(matches!(check_video_target(&shots, false), Err(Error::Exists { .. })));
    assert!(matches!(write_video(&shots, &new, &plain()), Err(Error::Exists { .. })));
    let force = VideoWriteOptions { force: true, ..plain() };
    // Refused before anything is written.
    let float = VideoWriteOptions { sample: Some(SampleType::F32), ..force };
    assert!(matches!(write_video(&shots, &new, &float), Err(Error::CannotHold { .. })));
    let shorter = video([6, 4, 2], &RGB, SampleType::U8);
    assert!(matches!(write_video(&shots, &shorter, &force), Err(Error::CannotHold { .. })));
    assert_eq!(read(&shots).unwrap(), old);
    // Found after the frames were written: the last name belongs to a folder.
    let last = shots.join("frame_0002.png");
    fs::rename(&last, folder.path().join("kept.png")).unwrap();
    fs::create_dir(&last).unwrap();
    assert!(matches!(write_video(&shots, &new, &force), Err(Error::NotAFile { .. })));
    fs::remove_dir(&last).unwrap();
    fs::rename(folder.path().join("kept.png"), &last).unwrap();
    assert_eq!((read(&shots).unwrap(), names_in(&shots).len()), (old, 3));

    write_video(&shots, &new, &force).unwrap();
    assert_eq!(read(&shots).unwrap(), new);
    assert_eq!(names_in(&shots).len(), 3);
    // A new folder that cannot be completed is not there.
    let other = folder.path().join("other/%d.exr");
    fs::create_dir(folder.path().join("other")).unwrap();
    let odd = Image::new(1, 2, &["深度"], vec![0.0; 2]).unwrap();
    let result = write_video(&other, &Video::from_strip(odd, 2).unwrap(), &plain());
    assert!(matches!(result, Err(Error::CannotHold { .. })), "{result:?}");
    assert!(names_in(&folder.path().join("other")).is_empty());
}

#[test]
fn odd_sequences_are_typed_errors() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, image: &Image| {
        let options = WriteOptions { force: true, ..Default::default() };
        write_image(folder.path().join(name), image, &options).unwrap();
    };
    assert!(matches!(read(folder.path()), Err(Error::Empty { .. })));
    assert!(matches!(read(folder.path().join("f%d.png")), Err(Error::Empty { .. })));
    assert!(matches!(read(folder.path().join("no/f%d.png")), Err(Error::NotFound { .. })));
    for name in ["f8.png", "f9.png", "f11.png"] {
        write(name, &picture(4, 3, &RGB, SampleType::U8));
    }
    for path in ["", "f%d.png"] {
        let result = read(folder.path().join(path));
        let Err(Error::MissingFrame { path }) = result else { panic!("{result:?}") };
        assert_eq!(path, folder.path().join("f10.png"));
    }
    assert_eq!(read(folder.path().join("f*.png")).unwrap().shape(), [4, 3, 3]);
    for odd in [picture(4, 4, &RGB, SampleType::U8), picture(4, 3, &["Y"], SampleType::U8)] {
        write("f10.png", &odd);
        let result = read(folder.path());
        let Err(Error::Mismatch { path, first, .. }) = result else { panic!("{result:?}") };
        assert_eq!((path, first), (folder.path().join("f10.png"), folder.path().join("f8.png")));
    }
    fs::write(folder.path().join("f10.png"), "no picture").unwrap();
    let error = read(folder.path()).unwrap_err();
    assert!(matches!(error, Error::Corrupt { .. }) && error.to_string().contains("f10.png"));
    // The limit is for all frames.
    write("f10.png", &picture(4, 3, &RGB, SampleType::U8));
    let with_limit =
        |limit_bytes| read_video(folder.path(), &ReadOptions { limit_bytes, transfer: None });
    assert!(with_limit(4 * 4 * 3 * 3 * 4).is_ok());
    assert!(matches!(with_limit(4 * 4 * 3 * 3 * 4 - 1), Err(Error::TooLarge { .. })));
}

#[test]
fn still_pictures_are_videos_of_one_frame() {
    let image = picture(5, 4, &RGB, SampleType::U8);
    let bytes = support::file_bytes("webp", &image);
    let video = signal_io::decode_video("a.webp", &bytes, &ReadOptions::default()).unwrap();
    assert_eq!((video.shape(), video.frame(0)), ([5, 4, 1], image));
}

#[test]
fn targets_without_a_form() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mp4", "a.png", "a.doc", "f_%d_%d.png", "f%d.mov", "f*.gif", "f_%d_%d.webp"] {
        let result = check_video_target(folder.path().join(name), false);
        assert!(matches!(result, Err(Error::UnsupportedFormat { .. })), "{name}: {result:?}");
    }
    for name in ["a.gif", "a.webp", "a.y4m", "new", "f%d.webp"] {
        assert!(check_video_target(folder.path().join(name), false).is_ok(), "{name}");
    }
}
