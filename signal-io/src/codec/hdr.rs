//! Radiance pictures: three 8-bit mantissas with a shared exponent, run-length coded.
//!
//! Source: G. Ward, "Real Pixels", Graphics Gems II (1991), and the Radiance file format notes.

use std::io::Write;

use super::pnm::Tokens;
use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::{Image, SampleType, Transfer};

/// Red, green and blue mantissa, exponent.
type Rgbe = [u8; 4];

/// Scanlines of these widths have a run-length code per component; others have the old one.
const RUN_WIDTHS: std::ops::Range<usize> = 8..32_768;

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let (resolution, body) = split_header(bytes)?;
    let (y_first, x_first, height, width) = parse_resolution(&resolution)?;
    let count = budget.samples(width, height, 3)?;
    let (w, h) = (width as usize, height as usize);
    let mut input = Input { rest: body };
    // Grown line by line: a header that promises too much fails before it costs memory.
    let mut pixels: Vec<Rgbe> = Vec::new();
    for _ in 0..h {
        read_scanline(&mut input, w, &mut pixels)?;
    }
    let mut data = with_capacity(count)?;
    for c in 0..3 {
        data.extend(pixels.iter().map(|p| to_float(*p, c)));
    }
    let mut image = Image::new(w, h, &["R", "G", "B"], data)?;
    (image.sample, image.transfer) = (SampleType::F32, Transfer::Linear);
    // Y counts upwards, so the usual picture runs along -Y, then +X.
    let (flip_y, flip_x) = (y_first == '+', x_first == '-');
    Ok(match flip_x || flip_y {
        false => image,
        true => image.rearranged(w, h, |x, y| {
            (if flip_x { w - 1 - x } else { x }, if flip_y { h - 1 - y } else { y })
        }),
    })
}

/// The resolution line and what follows it.
fn split_header(bytes: &[u8]) -> Result<(String, &[u8]), Fault> {
    if !bytes.starts_with(b"#?") {
        return Err(Fault::corrupt("it does not start with #?"));
    }
    let mut rest = bytes;
    let mut in_header = true;
    loop {
        let end = rest.iter().position(|b| *b == b'\n').ok_or_else(Fault::cut_short)?;
        let line = String::from_utf8_lossy(&rest[..end]).trim().to_owned();
        rest = &rest[end + 1..];
        match line.strip_prefix("FORMAT=") {
            _ if !in_header => return Ok((line, rest)),
            Some("32-bit_rle_rgbe") => {}
            Some(other) => return Err(Fault::Feature(format!("format {other:?}"))),
            None if line.is_empty() => in_header = false,
            None => {}
        }
    }
}

/// Signs and sizes of a line like `-Y 480 +X 640`. Pictures stored by columns are not read.
fn parse_resolution(line: &str) -> Result<(char, char, u64, u64), Fault> {
    let mut tokens = Tokens::new(line.as_bytes());
    let (y, height) = (tokens.word()?, tokens.number()?);
    let (x, width) = (tokens.word()?, tokens.number()?);
    let sign = |word: &str, axis| {
        word.strip_suffix(axis).and_then(|s| s.parse().ok()).filter(|s| matches!(s, '+' | '-'))
    };
    match (sign(y, 'Y'), sign(x, 'X')) {
        (Some(y), Some(x)) => Ok((y, x, height, width)),
        _ if sign(y, 'X').is_some() => Err(Fault::Feature("columns for lines".to_owned())),
        _ => Err(Fault::corrupt(format!("its resolution is {line:?}"))),
    }
}

struct Input<'a> {
    rest: &'a [u8],
}

impl Input<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (head, rest) = self.rest.split_first_chunk().ok_or_else(Fault::cut_short)?;
        self.rest = rest;
        Ok(*head)
    }
}

/// Appends a line of `width` pixels.
fn read_scanline(input: &mut Input<'_>, width: usize, out: &mut Vec<Rgbe>) -> Result<(), Fault> {
    let start = input.rest;
    let marker: Rgbe = input.take()?;
    let stated = usize::from(marker[2]) << 8 | usize::from(marker[3]);
    if RUN_WIDTHS.contains(&width) && marker[..2] == [2, 2] && stated == width {
        let from = out.len();
        for c in 0..4 {
            read_component(input, width, c, from, out)?;
        }
        return Ok(());
    }
    input.rest = start;
    read_old_scanline(input, width, out)
}

/// One component of a line: counts up to 128 announce as many bytes, larger ones a repeated byte.
fn read_component(
    input: &mut Input<'_>,
    width: usize,
    c: usize,
    from: usize,
    out: &mut Vec<Rgbe>,
) -> Result<(), Fault> {
    let mut x = 0;
    while x < width {
        let [count] = input.take()?;
        let (run, count) = match count {
            0 => return Err(Fault::corrupt("a run of no pixels")),
            1..=128 => (None, usize::from(count)),
            _ => (Some(input.take::<1>()?[0]), usize::from(count - 128)),
        };
        if x + count > width {
            return Err(Fault::corrupt("a run crosses the end of its line"));
        }
        for at in from + x..from + x + count {
            let value = match run {
                Some(value) => value,
                None => input.take::<1>()?[0],
            };
            if at == out.len() {
                out.push([0; 4]); // The first component makes the pixels.
            }
            out[at][c] = value;
        }
        x += count;
    }
    Ok(())
}

/// Bare pixels; mantissas 1 1 1 repeat the pixel before, a run of such markers counts in base 256.
fn read_old_scanline(
    input: &mut Input<'_>,
    width: usize,
    out: &mut Vec<Rgbe>,
) -> Result<(), Fault> {
    let end = out.len() + width;
    let mut shift = 0;
    while out.len() < end {
        let pixel: Rgbe = input.take()?;
        if pixel[..3] != [1, 1, 1] {
            out.push(pixel);
            shift = 0;
            continue;
        }
        let previous = *out.last().ok_or_else(|| Fault::corrupt("a run before any pixel"))?;
        let count = usize::from(pixel[3]) << shift;
        if count > end - out.len() || shift > 16 {
            return Err(Fault::corrupt("a run crosses the end of its line"));
        }
        out.extend(std::iter::repeat_n(previous, count));
        shift += 8;
    }
    Ok(())
}

/// Mantissa times `2^(exponent - 136)`; exponent 0 is black.
fn to_float(pixel: Rgbe, c: usize) -> f32 {
    match pixel[3] {
        0 => 0.0,
        e => (f64::from(pixel[c]) * 2f64.powi(i32::from(e) - 136)) as f32,
    }
}

/// The nearest pixel: the largest component gets 8 significant bits, the others share its exponent.
///
/// Answers how many components were out of range: negative and NaN become 0, and values from
/// `2^127` on the largest there is.
fn from_float(rgb: [f32; 3]) -> (Rgbe, usize) {
    const LARGEST: f64 = 255.0 / 256.0 * (1u128 << 127) as f64;
    // Not `clamp`, which would keep NaN; `max` takes the number.
    let clamped = rgb.map(|v| LARGEST.min(f64::from(v).max(0.0)));
    let clipped = (0..3).filter(|c| f64::from(rgb[*c]) != clamped[*c]).count();
    let largest = clamped.iter().fold(0.0_f64, |a, b| a.max(*b));
    if largest < 2f64.powi(-128) {
        return ([0; 4], clipped); // Below the smallest normal pixel.
    }
    // The exponent with largest = m * 2^exponent, 0.5 <= m < 1, from the bits of the double.
    let mut exponent = (largest.to_bits() >> 52) as i32 - 1022;
    if (largest * 2f64.powi(8 - exponent)).round() > 255.0 {
        exponent += 1; // Rounding carries into the next power of two.
    }
    let mantissa = clamped.map(|v| (v * 2f64.powi(8 - exponent)).round() as u8);
    let [r, g, b] = mantissa;
    ([r, g, b, (exponent + 128) as u8], clipped)
}

pub(super) fn encode(image: &Image, w: &mut impl Write) -> Result<usize, Fault> {
    let (width, height) = (image.width(), image.height());
    write!(w, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n")?;
    let planes = [image.plane(0), image.plane(1), image.plane(2)];
    let mut clipped = 0;
    let mut line: Vec<Rgbe> = Vec::with_capacity(width);
    let mut packed = Vec::new();
    for y in 0..height {
        line.clear();
        for k in y * width..(y + 1) * width {
            let (pixel, clips) = from_float(planes.map(|p| p[k]));
            line.push(pixel);
            clipped += clips;
        }
        packed.clear();
        if RUN_WIDTHS.contains(&width) {
            packed.extend([2, 2, (width >> 8) as u8, width as u8]);
            (0..4).for_each(|c| pack_component(&line, c, &mut packed));
        } else {
            // Unambiguous: the largest mantissa is at least 128, so no pixel looks like a marker.
            packed.extend(line.iter().flatten());
        }
        w.write_all(&packed)?;
    }
    Ok(clipped)
}

/// Runs of four equal bytes and more are stored as runs; shorter ones would not save anything.
fn pack_component(line: &[Rgbe], c: usize, out: &mut Vec<u8>) {
    let run_at = |x: usize| line[x..].iter().take(127).take_while(|p| p[c] == line[x][c]).count();
    let mut x = 0;
    while x < line.len() {
        let run = run_at(x);
        if run >= 4 {
            out.extend([128 + run as u8, line[x][c]]);
            x += run;
            continue;
        }
        let mut end = x + run;
        while end < line.len() && end - x < 128 && run_at(end) < 4 {
            end += 1;
        }
        let end = end.min(x + 128);
        out.push((end - x) as u8);
        out.extend(line[x..end].iter().map(|p| p[c]));
        x = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_keep_eight_bits_of_the_largest() {
        for k in -400..400 {
            let v = 1.17_f32.powi(k / 3) * (1.0 + k as f32 * 1e-3).abs();
            if !(1e-30..1e30).contains(&v) {
                continue;
            }
            let (pixel, clipped) = from_float([v, v * 0.3, 0.0]);
            assert_eq!(clipped, 0);
            for (c, expected) in [(0, v), (1, v * 0.3), (2, 0.0)] {
                // Half a step of 1/256 in the worst case of the largest being just over 2^n.
                let error = (to_float(pixel, c) - expected).abs();
                assert!(error <= v / 256.0 * 1.001, "{expected}: off by {error}");
            }
            let again = from_float([to_float(pixel, 0), to_float(pixel, 1), 0.0]).0;
            assert_eq!(again, pixel, "what was read is written back unchanged");
        }
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        assert_eq!(from_float([-1.0, f32::NAN, 0.0]), ([0; 4], 2));
        assert_eq!(from_float([f32::INFINITY, 0.0, 0.0]).1, 1);
        assert_eq!(from_float([f32::MAX, 0.0, 0.0]), ([255, 0, 0, 255], 1));
        assert_eq!(from_float([1.0, 1.0, 1.0]), ([128, 128, 128, 129], 0));
    }

    #[test]
    fn old_runs_and_orientation() {
        let head = "#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n+Y 2 -X 3\n";
        let body =
            [[128, 0, 0, 129], [1, 1, 1, 2], [0, 128, 0, 129], [0, 0, 128, 129], [1, 1, 1, 1]];
        let bytes = [head.as_bytes(), body.as_flattened()].concat();
        let image = decode(&bytes, &Budget::new(1 << 20)).unwrap();
        // Stored: RRR, then G B B; turned by half a turn: B B G over RRR.
        assert_eq!(image.plane(0), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        assert_eq!(image.plane(1), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(image.plane(2), [1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        // A chain of empty runs must neither hang nor overflow.
        let bytes = [head.as_bytes(), &[9, 9, 9, 9], &[1, 1, 1, 0].repeat(20)].concat();
        assert!(matches!(decode(&bytes, &Budget::new(1 << 20)), Err(Fault::Corrupt(_))));
    }

    #[test]
    fn other_colours_and_columns_are_refused() {
        for head in ["FORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n", "\n+X 1 -Y 1\n"] {
            let bytes = format!("#?RADIANCE\n{head}abcd");
            let result = decode(bytes.as_bytes(), &Budget::new(1 << 20));
            assert!(matches!(result, Err(Fault::Feature(_))), "{head}");
        }
    }
}
