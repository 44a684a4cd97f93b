use std::path::Path;

use super::{Timing, Video, VideoFormat, gif, webp, y4m};
use crate::budget::Budget;
use crate::format::extension;
use crate::read::{HEAD, read_bytes};
use crate::strip::{listing, pictures};
use crate::{Error, Image, ReadOptions, Result};

/// Reads a video: an animation, a raw video file, or a series of pictures.
///
/// * A folder: all files in it that have the extension of a picture. A pattern such as
///   `shots/frame_%04d.png` or `shots/frame_*.png` (in the last part of the path only): the files that
///   fit. Both are sorted by the numbers in their names (9 before 10). Numbers have equal steps; only
///   a pattern with `*` or `?` allows gaps. All must have one size, the same channels and transfer;
///   25 frames a second.
/// * GIF and WebP: frames composited onto a transparent canvas as viewers show them, alpha where
///   anything is not opaque, with their delays. A WebP without animation is a video of one frame.
/// * Y4M (YUV4MPEG2): 4:2:0 in all sitings, 4:2:2 and 4:1:1 (sited on the left pixels, as the format
///   has it; files made of pictures may be centred), 4:4:4 and mono, 8 to 16 bits, as BT.601 in the
///   limited range unless it says `XCOLORRANGE=FULL`. Becomes `Y` or `R G B`, not clamped to [0, 1];
///   chroma between its samples is linear. Interlaced lines stay where they are. A rate of 0:0 is
///   unknown and counts as 25. The number of frames is not in the file, so whole frames that are
///   missing at its end go unnoticed.
///
/// # Errors
/// Those of [`read_image`](crate::read_image), where `limit_bytes` bounds the whole video, and
/// [`Error::Mismatch`] with the first picture that is not like the first one, [`Error::MissingFrame`]
/// with the first name that is left out.
pub fn read_video(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Video> {
    let path = path.as_ref();
    if let Some(files) = listing::sequence(path) {
        let files = files?;
        return Video::from_strip(pictures::read(path, &files, options)?, files.len());
    }
    let (format, bytes) = read_bytes(path, options, |head| find_format(path, head))?;
    decode(path, format, &bytes, options)
}

/// The same for a GIF, WebP or Y4M file that is in memory already; `name` stands for the path in
/// messages.
///
/// # Errors
/// Those of [`read_video`], without the ones of the file system.
pub fn decode_video(name: impl AsRef<Path>, bytes: &[u8], options: &ReadOptions) -> Result<Video> {
    let format = find_format(name.as_ref(), &bytes[..bytes.len().min(HEAD)])?;
    decode(name.as_ref(), format, bytes, options)
}

fn find_format(path: &Path, head: &[u8]) -> Result<VideoFormat> {
    match head {
        [] => Err(Error::Empty { path: path.to_path_buf() }),
        [b'G', b'I', b'F', b'8', ..] => Ok(VideoFormat::Gif),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Ok(VideoFormat::WebP),
        head if head.starts_with(b"YUV4MPEG2") => Ok(VideoFormat::Y4m),
        _ => VideoFormat::from_extension(path).ok_or_else(|| Error::UnsupportedFormat {
            path: path.to_path_buf(),
            extension: extension(path),
            known: VideoFormat::READABLE,
        }),
    }
}

/// What a decoder of videos gives: the frames one below the other, how many, how long.
pub(super) type Decoded = (Image, usize, Timing);

fn decode(path: &Path, format: VideoFormat, bytes: &[u8], options: &ReadOptions) -> Result<Video> {
    let budget = Budget::new(options.limit_bytes);
    let decoded = match format {
        VideoFormat::Gif => gif::decode(bytes, &budget),
        VideoFormat::WebP => webp::decode(bytes, &budget),
        VideoFormat::Y4m | VideoFormat::Pictures => y4m::decode(bytes, &budget),
    };
    let (mut strip, frames, timing) =
        decoded.map_err(|fault| fault.at(path, format.name(), "read"))?;
    strip.transfer = options.transfer.unwrap_or(strip.transfer);
    let mut video = Video::from_strip(strip, frames)?;
    video.timing = timing;
    Ok(video)
}
