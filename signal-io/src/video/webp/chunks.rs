//! The RIFF container of WebP.
//!
//! Source: the WebP Container Specification, sections "Extended File Format" and "Animation".

use crate::error::Fault;

/// What the container says about an animation.
#[derive(Debug, PartialEq)]
pub(super) struct Canvas {
    pub(super) width: u32,
    pub(super) height: u32,
    /// At least 1.
    pub(super) frames: usize,
}

/// Walks over all chunks; `None` for a picture without animation.
///
/// The decoder takes memory for the canvas and for a frame of any size before it reads their data,
/// and multiplies sizes in 32 bits; neither is left to find out for it.
pub(super) fn check(bytes: &[u8]) -> Result<Option<Canvas>, Fault> {
    let Some((head, rest)) = bytes.split_at_checked(12) else { return Err(Fault::cut_short()) };
    if !head.starts_with(b"RIFF") || !head.ends_with(b"WEBP") {
        return Err(Fault::corrupt("it does not start with its signature"));
    }
    let size = (u32_at(head, 4) as usize).saturating_sub(4);
    let mut rest = rest.get(..size).ok_or_else(Fault::cut_short)?;
    let (mut canvas, mut frames) = (None, 0);
    while !rest.is_empty() {
        let (Chunk { name, payload }, after) = split_chunk(rest)?;
        rest = after;
        match name {
            b"VP8X" if canvas.is_none() => {
                if payload.len() < 10 {
                    return Err(Fault::cut_short());
                }
                let animated = payload[0] & ANIMATION != 0;
                canvas = Some((animated, u24_at(payload, 4) + 1, u24_at(payload, 7) + 1));
            }
            b"ANMF" => {
                let (_, width, height) = canvas.ok_or_else(|| Fault::corrupt("no canvas"))?;
                check_frame(payload, width, height, frames)?;
                frames += 1;
            }
            _ => {}
        }
    }
    let Some((true, width, height)) = canvas else { return Ok(None) };
    if frames == 0 {
        return Err(Fault::Empty);
    }
    if u64::from(width) * u64::from(height) * 4 > u64::from(u32::MAX) {
        return Err(Fault::Feature(format!("a canvas of {width} x {height} pixels")));
    }
    Ok(Some(Canvas { width, height, frames }))
}

/// Refuses a frame that is not on the canvas.
fn check_frame(payload: &[u8], width: u32, height: u32, number: usize) -> Result<(), Fault> {
    if payload.len() < 16 {
        return Err(Fault::cut_short());
    }
    let (x, y) = (2 * u24_at(payload, 0), 2 * u24_at(payload, 3));
    let (w, h) = (u24_at(payload, 6) + 1, u24_at(payload, 9) + 1);
    match x + w <= width && y + h <= height {
        true => Ok(()),
        false => Err(Fault::corrupt(format!("frame {number} is larger than the canvas"))),
    }
}

struct Chunk<'a> {
    name: &'a [u8],
    payload: &'a [u8],
}

/// The first chunk, and what follows.
fn split_chunk(bytes: &[u8]) -> Result<(Chunk<'_>, &[u8]), Fault> {
    let (head, rest) = bytes.split_at_checked(8).ok_or_else(Fault::cut_short)?;
    let size = u32_at(head, 4) as usize;
    let payload = rest.get(..size).ok_or_else(Fault::cut_short)?;
    // A byte of padding after odd lengths; some writers leave it out at the end.
    let after = rest.get(size + size % 2..).unwrap_or(&[]);
    Ok((Chunk { name: &head[..4], payload }, after))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u24_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0])
}

const ANIMATION: u8 = 0x02;
const ALPHA: u8 = 0x10;
const PROFILE: u8 = 0x20;

/// The chunks before the frames: canvas, profile, and repetition for ever.
pub(super) fn head(width: u32, height: u32, alpha: bool, icc: Option<&[u8]>) -> Vec<u8> {
    let mut out = Vec::new();
    let alpha = if alpha { ALPHA } else { 0 };
    let profile = if icc.is_some() { PROFILE } else { 0 };
    let sizes = [u24(width - 1), u24(height - 1)].concat();
    push(&mut out, b"VP8X", &[&[ANIMATION | alpha | profile, 0, 0, 0][..], &sizes].concat());
    if let Some(icc) = icc {
        push(&mut out, b"ICCP", icc);
    }
    push(&mut out, b"ANIM", &[0; 6]); // Four bytes of background colour, two of repetitions.
    out
}

/// Adds a frame that covers the canvas and replaces it: the picture of a still file.
pub(super) fn push_frame(
    out: &mut Vec<u8>,
    width: u32,
    height: u32,
    delay_ms: u32,
    still: &[u8],
) -> Result<(), Fault> {
    const DO_NOT_BLEND: u8 = 0x02;
    let unexpected = || Fault::Encode("the encoder gave no picture".to_owned());
    let mut rest = still.get(12..).ok_or_else(unexpected)?;
    let picture = loop {
        let (chunk, after) = split_chunk(rest).map_err(|_| unexpected())?;
        if chunk.name == b"VP8L" {
            break chunk.payload;
        }
        rest = after;
    };
    let mut frame = [[0; 3], [0; 3], u24(width - 1), u24(height - 1), u24(delay_ms)].concat();
    frame.push(DO_NOT_BLEND);
    push(&mut frame, b"VP8L", picture);
    push(out, b"ANMF", &frame);
    Ok(())
}

/// The whole file around its chunks.
pub(super) fn riff(body: &[u8]) -> Result<Vec<u8>, Fault> {
    let size = u32::try_from(body.len() + 4).map_err(|_| {
        Fault::cannot_hold(
            format!("{} bytes", body.len()),
            "it ends at 4 GiB; write a folder of pictures, or fewer frames",
        )
    })?;
    Ok([&b"RIFF"[..], &size.to_le_bytes(), b"WEBP", body].concat())
}

fn push(out: &mut Vec<u8>, name: &[u8; 4], payload: &[u8]) {
    out.extend_from_slice(name);
    out.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    out.extend_from_slice(payload);
    out.extend(std::iter::repeat_n(0, payload.len() % 2));
}

fn u24(number: u32) -> [u8; 3] {
    let [a, b, c, _] = number.to_le_bytes();
    [a, b, c]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(width: u32, x: u32) -> Vec<u8> {
        let mut out = Vec::new();
        let payload = [u24(x), [0; 3], u24(width - 1), [0; 3], [40, 0, 0], [2, 0, 0]].concat();
        push(&mut out, b"ANMF", &payload);
        out
    }

    #[test]
    fn frames_are_counted_and_stay_on_the_canvas() {
        let head = head(5, 3, true, Some(b"icc"));
        let file = |frames: &[Vec<u8>]| riff(&[head.clone(), frames.concat()].concat()).unwrap();
        let two = file(&[frame(5, 0), frame(1, 2)]);
        let expected = Canvas { width: 5, height: 3, frames: 2 };
        assert_eq!(check(&two).unwrap(), Some(expected));
        for end in 0..two.len() {
            assert!(matches!(check(&two[..end]), Err(Fault::Corrupt(_))), "cut at {end}");
        }
        assert!(matches!(check(&file(&[])), Err(Fault::Empty)));
        assert!(matches!(check(&file(&[frame(2, 2)])), Err(Fault::Corrupt(_))));
        let wide = riff(&self::head(1 << 24, 1 << 24, false, None)).unwrap();
        assert!(matches!(check(&wide), Err(Fault::Empty)));
    }
}
