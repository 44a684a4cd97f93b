//! Animated WebP: the container is walked and written here, the pictures in it are left to the
//! `image` crate.

mod chunks;

use std::io::Cursor;

use ::image::codecs::webp::{WebPDecoder, WebPEncoder};
use ::image::{AnimationDecoder, ExtendedColorType, ImageDecoder, ImageEncoder, Rgba};

use super::Timing;
use super::read::Decoded;
use super::rgba::{Frames, to_bytes};
use super::write::Animation;
use crate::budget::Budget;
use crate::codec::{self, raster_fault};
use crate::error::Fault;
use crate::{Format, SampleType};

/// Frames of a whole file; 1 without animation.
pub(super) fn frame_count(bytes: &[u8]) -> Option<usize> {
    chunks::check(bytes).ok().map(|canvas| canvas.map_or(1, |c| c.frames))
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Decoded, Fault> {
    let Some(canvas) = chunks::check(bytes)? else {
        return Ok((codec::decode(Format::WebP, bytes, budget)?, 1, Timing::default()));
    };
    let chunks::Canvas { width, height, frames: count } = canvas;
    let mut frames = Frames::new(width, height, count, budget)?;
    let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(raster_fault)?;
    if !decoder.has_animation() || decoder.dimensions() != (width, height) {
        return Err(Fault::corrupt("its header and its frames disagree"));
    }
    // Without a colour version 0.2 of image-webp does not clear frames that ask for it. The colour
    // in the file is a hint that viewers ignore.
    decoder.set_background_color(Rgba([0; 4])).map_err(raster_fault)?;
    // Broken metadata is no reason to refuse frames that are fine.
    let icc = decoder.icc_profile().unwrap_or(None).filter(|icc| !icc.is_empty());
    let mut delays = Vec::new();
    for frame in decoder.into_frames() {
        let frame = frame.map_err(raster_fault)?;
        let (ms, one) = frame.delay().numer_denom_ms();
        delays.push(ms / one.max(1));
        frames.push(frame.buffer());
    }
    if delays.len() != count {
        let found = delays.len();
        return Err(Fault::corrupt(format!("{count} frames expected, {found} found")));
    }
    let mut strip = frames.into_strip(budget)?;
    strip.icc = icc;
    Ok((strip, count, Timing::DelaysMs(delays)))
}

/// The longest time a frame can be shown: 24 bits of milliseconds, 4.6 hours.
const LONGEST_MS: u32 = (1 << 24) - 1;

pub(super) fn encode((video, plan): Animation) -> Result<(Vec<u8>, usize), Fault> {
    let [width, height, count] = video.shape();
    debug_assert_eq!(plan.sample, SampleType::U8);
    let (width, height) = (width as u32, height as u32); // Checked by the plan: 16384 at most.
    let alpha = video.as_strip().alpha().is_some();
    let color = if alpha { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    let icc = video.as_strip().icc.as_deref();
    let mut body = chunks::head(width, height, alpha, icc);
    let mut clipped = 0;
    for (t, delay) in video.timing.delays(count, 1).into_iter().enumerate() {
        let (values, clip) = to_bytes(&plan.prepare(&video.frame(t))?)?;
        clipped += clip;
        let mut still = Vec::new();
        WebPEncoder::new_lossless(&mut still)
            .write_image(&values, width, height, color)
            .map_err(|e| Fault::Encode(e.to_string()))?;
        chunks::push_frame(&mut body, width, height, delay.min(LONGEST_MS), &still)?;
    }
    Ok((chunks::riff(&body)?, clipped))
}
