//! Animated GIF through the `image` crate, after a walk over its blocks.

mod blocks;

use std::io::Cursor;

use ::image::codecs::gif::{GifDecoder, GifEncoder, Repeat};
use ::image::{AnimationDecoder, Delay, Frame, ImageDecoder, RgbaImage};

use super::Timing;
use super::read::Decoded;
use super::rgba::{Frames, to_bytes};
use super::write::Animation;
use crate::budget::Budget;
use crate::codec::raster_fault;
use crate::error::Fault;

/// Frames of a whole file.
pub(super) fn frame_count(bytes: &[u8]) -> Option<usize> {
    blocks::check(bytes).ok()
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Decoded, Fault> {
    let count = blocks::check(bytes)?;
    let mut decoder = GifDecoder::new(Cursor::new(bytes)).map_err(raster_fault)?;
    decoder.set_limits(budget.to_image_limits()).map_err(raster_fault)?;
    let (width, height) = decoder.dimensions();
    let mut frames = Frames::new(width, height, count, budget)?;
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
    Ok((frames.into_strip(budget)?, count, Timing::DelaysMs(delays)))
}

/// The trade of time for colours in NeuQuant, 1 (best) to 30: the value its author proposes.
const SPEED: i32 = 10;

pub(super) fn encode((video, plan): Animation) -> Result<(Vec<u8>, usize), Fault> {
    let [width, height, count] = video.shape();
    let (mut bytes, mut clipped) = (Vec::new(), 0);
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, SPEED);
    let fault = |e: ::image::ImageError| Fault::Encode(e.to_string());
    encoder.set_repeat(Repeat::Infinite).map_err(fault)?;
    for (t, delay) in video.timing.delays(count, 10).into_iter().enumerate() {
        let frame = plan.prepare(&video.frame(t))?;
        let (values, clip) = to_bytes(&frame)?;
        clipped += clip;
        let rgba = opaque_or_not(&values, if frame.alpha().is_some() { 4 } else { 3 });
        let buffer = RgbaImage::from_raw(width as u32, height as u32, rgba)
            .ok_or_else(|| Fault::Encode("a frame has the wrong size".to_owned()))?;
        let delay = Delay::from_numer_denom_ms(delay.saturating_mul(10), 1);
        encoder.encode_frame(Frame::from_parts(buffer, 0, 0, delay)).map_err(fault)?;
    }
    drop(encoder); // Writes the trailer.
    Ok((bytes, clipped))
}

/// Four channels from three or four, alpha 0 or 255. Transparent pixels are black, so that they take
/// one entry of the palette.
fn opaque_or_not(values: &[u8], channels: usize) -> Vec<u8> {
    let pixel = |p: &[u8]| match p.get(3) {
        Some(..128) => [0; 4],
        _ => [p[0], p[1], p[2], 255],
    };
    values.chunks_exact(channels).flat_map(pixel).collect()
}
