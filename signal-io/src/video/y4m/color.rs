//! Codes of luma and chroma to numbers and back.
//!
//! Source: ITU-R BT.601-7, section 2.5: matrix and limited range.

use super::header::{Header, Layout};
use crate::Image;

/// Which codes are black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Range {
    /// 16 and 235 of 8 bits; chroma from 16 to 240.
    Limited,
    /// The lowest and the highest code.
    Full,
}

/// The line between codes and numbers: luma 0 to 1, chroma -0.5 to 0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Codes {
    bits: u32,
    black: f32,
    luma_span: f32,
    grey: f32,
    chroma_span: f32,
}

impl Codes {
    /// `bits` from 8 to 16.
    pub(super) fn new(bits: u32, range: Range) -> Self {
        let unit = (1u32 << (bits - 8)) as f32;
        let (highest, grey) = (((1u32 << bits) - 1) as f32, 128.0 * unit);
        match range {
            Range::Limited => Self {
                bits,
                black: 16.0 * unit,
                luma_span: 219.0 * unit,
                grey,
                chroma_span: 224.0 * unit,
            },
            Range::Full => {
                Self { bits, black: 0.0, luma_span: highest, grey, chroma_span: highest }
            }
        }
    }

    fn luma(&self, code: u16) -> f32 {
        (f32::from(code) - self.black) / self.luma_span
    }

    fn chroma(&self, code: u16) -> f32 {
        (f32::from(code) - self.grey) / self.chroma_span
    }
}

/// BT.601: the shares of red and blue in luma.
const RED: f32 = 0.299;
const BLUE: f32 = 0.114;
const GREEN: f32 = 1.0 - RED - BLUE;

/// Luma and the two colour differences of non-linear red, green and blue.
fn to_ycc(r: f32, g: f32, b: f32) -> [f32; 3] {
    let y = RED * r + GREEN * g + BLUE * b;
    [y, (b - y) / (2.0 * (1.0 - BLUE)), (r - y) / (2.0 * (1.0 - RED))]
}

/// The inverse of [`to_ycc`].
fn to_rgb([y, cb, cr]: [f32; 3]) -> [f32; 3] {
    let (r, b) = (y + 2.0 * (1.0 - RED) * cr, y + 2.0 * (1.0 - BLUE) * cb);
    [r, (y - RED * r - BLUE * b) / GREEN, b]
}

/// Frames to planes, with room that is used for all of them.
pub(super) struct Decoder<'a> {
    header: &'a Header,
    codes: Codes,
    planes: Vec<Vec<f32>>,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(header: &'a Header, codes: Codes) -> Self {
        Self { header, codes, planes: Vec::new() }
    }

    /// The planes of a frame of [`Header::frame_bytes`] bytes: `Y`, or red, green and blue.
    pub(super) fn planes(&mut self, frame: &[u8]) -> Vec<&[f32]> {
        let size = if self.header.bits > 8 { 2 } else { 1 };
        let [w, h] = [self.header.width as usize, self.header.height as usize];
        let [cw, ch] = self.header.chroma_size().map(|n| n as usize);
        let (luma, chroma) = frame.split_at(w * h * size);
        let (cb, cr) = chroma.split_at(cw * ch * size);
        let codes = self.codes;
        let y = values(luma, size, |code| codes.luma(code));
        self.planes = match self.header.layout {
            Layout::Mono => vec![y],
            layout => {
                let plane = |bytes| {
                    let small = values(bytes, size, |code| codes.chroma(code));
                    upsampled(small, [cw, ch], [w, h], layout)
                };
                let mut planes = vec![y, plane(cb), plane(cr)];
                for k in 0..w * h {
                    let rgb = to_rgb([planes[0][k], planes[1][k], planes[2][k]]);
                    (0..3).for_each(|c| planes[c][k] = rgb[c]);
                }
                planes
            }
        };
        self.planes.iter().map(Vec::as_slice).collect()
    }
}

fn values(bytes: &[u8], size: usize, convert: impl Fn(u16) -> f32) -> Vec<f32> {
    match size {
        1 => bytes.iter().map(|b| convert(u16::from(*b))).collect(),
        _ => bytes.as_chunks::<2>().0.iter().map(|b| convert(u16::from_le_bytes(*b))).collect(),
    }
}

/// Chroma for every pixel: linear between the two neighbours per axis, constant beyond the border.
fn upsampled(plane: Vec<f32>, small: [usize; 2], size: [usize; 2], layout: Layout) -> Vec<f32> {
    let Layout::Subsampled { step, offset } = layout else { return plane };
    let taps = |axis: usize| -> Vec<(usize, usize, f32)> {
        let place = |k: usize| (k as f32 - offset[axis]) / step[axis] as f32;
        let last = small[axis] - 1;
        let tap = |k| {
            let at = place(k).clamp(0.0, last as f32);
            let low = at as usize;
            (low, (low + 1).min(last), at - low as f32)
        };
        (0..size[axis]).map(tap).collect()
    };
    let (columns, rows) = (taps(0), taps(1));
    let mut out = Vec::with_capacity(size[0] * size[1]);
    for &(y0, y1, t) in &rows {
        let (upper, lower) = (&plane[y0 * small[0]..], &plane[y1 * small[0]..]);
        out.extend(columns.iter().map(|&(x0, x1, s)| {
            let mix = |row: &[f32]| row[x0] + s * (row[x1] - row[x0]);
            mix(upper) + t * (mix(lower) - mix(upper))
        }));
    }
    out
}

/// Pictures of one or three channels to codes.
pub(super) struct Encoder {
    codes: Codes,
    clipped: usize,
}

impl Encoder {
    pub(super) fn new(codes: Codes) -> Self {
        Self { codes, clipped: 0 }
    }

    /// How many codes were moved into the range of their bits by more than rounding.
    pub(super) fn clipped(&self) -> usize {
        self.clipped
    }

    /// Appends the planes of a picture: luma, then both colour differences where there is colour.
    pub(super) fn push(&mut self, image: &Image, out: &mut Vec<u8>) {
        let codes = self.codes;
        let planes: Vec<&[f32]> = (0..image.channels().len()).map(|c| image.plane(c)).collect();
        let [r, g, b] = planes[..] else {
            planes[0].iter().for_each(|y| self.code(y * codes.luma_span + codes.black, out));
            return;
        };
        for part in 0..3 {
            let (span, zero) = match part {
                0 => (codes.luma_span, codes.black),
                _ => (codes.chroma_span, codes.grey),
            };
            for k in 0..r.len() {
                self.code(to_ycc(r[k], g[k], b[k])[part] * span + zero, out);
            }
        }
    }

    /// To nearest; NaN becomes 0.
    fn code(&mut self, value: f32, out: &mut Vec<u8>) {
        let highest = ((1u32 << self.codes.bits) - 1) as f32;
        // Half a step beyond the ends is rounding: chroma 0.5 is code 255.5 in the full range.
        self.clipped += usize::from(!(-0.5..=highest + 0.5).contains(&value));
        let code = value.round().clamp(0.0, highest) as u16;
        match self.codes.bits {
            8 => out.push(code as u8),
            _ => out.extend_from_slice(&code.to_le_bytes()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1e-6: a few roundings of numbers up to 2.
    const TOLERANCE: f32 = 1e-6;

    #[test]
    fn published_codes_of_colour_bars() {
        // Bars of 100 % in 8 bits, limited: white, black, red, blue.
        let codes = Codes::new(8, Range::Limited);
        for (code, rgb) in [
            ([235, 128, 128], [1.0, 1.0, 1.0]),
            ([16, 128, 128], [0.0, 0.0, 0.0]),
            ([81, 90, 240], [1.0, 0.0, 0.0]),
            ([41, 240, 110], [0.0, 0.0, 1.0]),
        ] {
            let [y, cb, cr] = code;
            let got = to_rgb([codes.luma(y), codes.chroma(cb), codes.chroma(cr)]);
            for (got, expected) in got.iter().zip(rgb) {
                assert!((got - expected).abs() < 2.0 / 255.0, "{code:?}: {got} for {expected}");
            }
        }
    }

    #[test]
    fn the_matrices_are_inverse() {
        for k in 0..1000 {
            let part = |n: i32| ((k * n) % 101) as f32 / 100.0;
            let rgb = [part(7), part(31), part(57)];
            let back = to_rgb(to_ycc(rgb[0], rgb[1], rgb[2]));
            for (got, expected) in back.iter().zip(rgb) {
                assert!((got - expected).abs() < TOLERANCE, "{got} for {expected}");
            }
        }
    }

    #[test]
    fn linear_chroma_stays_linear_where_it_is_sited() {
        for offset in [0.0, 0.5] {
            for (step, n) in [(2u32, 9usize), (2, 8), (4, 11)] {
                let small = n.div_ceil(step as usize);
                // The line v = x, sampled where the chroma samples are.
                let plane: Vec<f32> = (0..small).map(|i| i as f32 * step as f32 + offset).collect();
                let layout = Layout::Subsampled { step: [step, 1], offset: [offset, 0.0] };
                let full = upsampled(plane.clone(), [small, 1], [n, 1], layout);
                for (x, got) in full.iter().enumerate() {
                    let expected = (x as f32).clamp(plane[0], plane[small - 1]);
                    assert!((got - expected).abs() < 1e-5, "{x}: {got} for {expected}");
                }
            }
        }
    }
}
