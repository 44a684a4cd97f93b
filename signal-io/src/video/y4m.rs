//! YUV4MPEG2: a line of text, then frames, each a line and bare planes of luma and chroma.
//!
//! Source: yuv4mpeg(5) of mjpegtools; the depths above 8 bits and the range as FFmpeg writes them.

mod color;
mod header;

use std::io::Write;

use self::color::{Codes, Range};
use self::header::{Header, Layout};
use super::Video;
use super::read::Decoded;
use crate::budget::{Budget, zeros};
use crate::error::Fault;
use crate::image::usual_names;
use crate::{Image, SampleType, Transfer};

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Decoded, Fault> {
    let (header, body) = Header::parse(bytes)?;
    let (width, height) = (u64::from(header.width), u64::from(header.height));
    let channels = if header.layout == Layout::Mono { 1 } else { 3 };
    budget.samples(width, height, channels)?;
    let frames = split_frames(body, header.frame_bytes())?;
    let rows = height.saturating_mul(frames.len() as u64);
    let count = budget.samples(width, rows, channels)?;

    let mut data = zeros::<f32>(count)?;
    let pixels = (width * height) as usize;
    let codes = Codes::new(header.bits, header.range);
    let mut decoder = color::Decoder::new(&header, codes);
    for (t, frame) in frames.iter().enumerate() {
        for (c, plane) in decoder.planes(frame).into_iter().enumerate() {
            data[(c * frames.len() + t) * pixels..][..pixels].copy_from_slice(plane);
        }
    }
    let mut strip =
        Image::new(width as usize, rows as usize, &usual_names(channels as usize), data)?;
    strip.sample = if header.bits > 8 { SampleType::U16 } else { SampleType::U8 };
    strip.transfer = Transfer::Srgb;
    Ok((strip, frames.len(), header.timing()))
}

/// The data of the frames; the file ends with the last one.
fn split_frames(mut body: &[u8], frame_bytes: u64) -> Result<Vec<&[u8]>, Fault> {
    let mut frames = Vec::new();
    while !body.is_empty() {
        let line = header::line(body)?;
        if line.split(|b| *b == b' ').next() != Some(b"FRAME") {
            return Err(Fault::corrupt(format!(
                "frame {} does not start with FRAME",
                frames.len()
            )));
        }
        body = &body[line.len() + 1..];
        let size = usize::try_from(frame_bytes).map_err(|_| Fault::cut_short())?;
        let (frame, rest) = body.split_at_checked(size).ok_or_else(Fault::cut_short)?;
        frames.push(frame);
        body = rest;
    }
    match frames.is_empty() {
        true => Err(Fault::Empty),
        false => Ok(frames),
    }
}

/// Writes 4:4:4, or mono for one channel; answers the file and how many codes were clipped.
pub(super) fn encode(video: &Video, bits: u8, full_range: bool) -> Result<(Vec<u8>, usize), Fault> {
    let strip = video.as_strip();
    let colors = strip.color_count();
    if !matches!(bits, 8 | 10 | 12 | 16) {
        return Err(Fault::cannot_hold(format!("{bits} bits"), "ask for 8, 10, 12 or 16"));
    }
    if strip.alpha().is_some() {
        let instead = "drop alpha (split_alpha), or write .webp or pictures";
        return Err(Fault::cannot_hold("alpha", instead));
    }
    if !matches!(colors, 1 | 3) {
        let instead = "choose channels (select, to_gray), or write pictures";
        return Err(Fault::cannot_hold(format!("{colors} colour channels"), instead));
    }
    let [width, height, frames] = video.shape();
    let range = if full_range { Range::Full } else { Range::Limited };
    let layout = if colors == 1 { Layout::Mono } else { Layout::Full };
    let mut out = header::text(width, height, layout, bits, range, &video.timing).into_bytes();
    let mut encoder = color::Encoder::new(Codes::new(u32::from(bits), range));
    for t in 0..frames {
        out.write_all(b"FRAME\n")?;
        let frame = video.frame(t);
        let display = match frame.transfer {
            Transfer::Linear => frame.to_transfer(Transfer::Srgb),
            _ => frame,
        };
        encoder.push(&display, &mut out);
    }
    Ok((out, encoder.clipped()))
}
