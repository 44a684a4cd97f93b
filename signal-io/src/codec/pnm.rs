//! The Netpbm family: PBM, PGM, PPM (plain and binary) and PAM.
//!
//! Source: the manual pages pbm(5), pgm(5), ppm(5) and pam(5).

use std::io::Write;

use super::quantize::{interleave, to_u8, to_u16};
use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::image::usual_names;
use crate::plan::Plan;
use crate::{Image, SampleType, Transfer};

/// The words of a text header; a comment runs from `#` to the end of its line.
pub(crate) struct Tokens<'a> {
    rest: &'a [u8],
}

impl<'a> Tokens<'a> {
    pub(crate) fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    fn skip_blanks(&mut self) {
        while let [first, rest @ ..] = self.rest {
            match first {
                b'#' => {
                    let end = self.rest.iter().position(|b| *b == b'\n');
                    self.rest = &self.rest[end.unwrap_or(self.rest.len())..];
                }
                b if b.is_ascii_whitespace() => self.rest = rest,
                _ => break,
            }
        }
    }

    pub(crate) fn word(&mut self) -> Result<&'a str, Fault> {
        self.skip_blanks();
        let end = self.rest.iter().position(|b| b.is_ascii_whitespace() || *b == b'#');
        let (word, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = rest;
        match std::str::from_utf8(word) {
            Ok("") => Err(Fault::cut_short()),
            Ok(word) => Ok(word),
            Err(_) => Err(Fault::corrupt("its header is not text")),
        }
    }

    pub(crate) fn number(&mut self) -> Result<u64, Fault> {
        let word = self.word()?;
        word.parse().map_err(|_| Fault::corrupt(format!("its header has {word:?} for a number")))
    }

    /// The rest of the line, without blanks around it.
    fn line(&mut self) -> String {
        let end = self.rest.iter().position(|b| *b == b'\n').unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        String::from_utf8_lossy(line).trim().to_owned()
    }

    /// What follows the single blank after the header.
    pub(crate) fn body(self) -> Result<&'a [u8], Fault> {
        match self.rest {
            [first, rest @ ..] if first.is_ascii_whitespace() => Ok(rest),
            _ => Err(Fault::cut_short()),
        }
    }
}

struct Header {
    width: u64,
    height: u64,
    channels: u64,
    max: u64,
    names: Option<&'static [&'static str]>,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let kind = bytes.get(1).copied().unwrap_or(0);
    if bytes.first() != Some(&b'P') || !kind.is_ascii_digit() {
        return Err(Fault::corrupt("it does not start with P1 to P7"));
    }
    let mut tokens = Tokens::new(&bytes[2..]);
    let header = match kind {
        b'7' => read_pam_header(&mut tokens)?,
        _ => read_pnm_header(&mut tokens, kind)?,
    };
    let Header { width, height, channels, max, names } = header;
    if !(1..=65_535).contains(&max) {
        return Err(Fault::corrupt(format!("its maximum is {max}, not 1 to 65535")));
    }
    let count = budget.samples(width, height, channels)?;
    let (w, h, c) = (width as usize, height as usize, channels as usize);
    let values = match kind {
        b'1' => plain_bits(tokens.rest, count)?,
        b'2' | b'3' => plain_numbers(tokens, count)?,
        b'4' => packed_bits(tokens.body()?, w, h)?,
        _ => binary_numbers(tokens.body()?, count, max)?,
    };
    if let Some(v) = values.iter().find(|v| u64::from(**v) > max) {
        return Err(Fault::corrupt(format!("a sample is {v}, the maximum is {max}")));
    }
    let scale = max as f32;
    let data = super::raster::deinterleave(&values, c, |v| f32::from(*v) / scale)?;
    let names = match names {
        Some(names) => names.iter().map(|n| (*n).to_owned()).collect(),
        None => usual_names(c),
    };
    let mut image = Image::new(w, h, &names, data)?;
    image.sample = if max < 256 { SampleType::U8 } else { SampleType::U16 };
    image.transfer = Transfer::Srgb;
    Ok(image)
}

fn read_pnm_header(tokens: &mut Tokens<'_>, kind: u8) -> Result<Header, Fault> {
    let (width, height) = (tokens.number()?, tokens.number()?);
    let max = if matches!(kind, b'1' | b'4') { 1 } else { tokens.number()? };
    let channels = if matches!(kind, b'3' | b'6') { 3 } else { 1 };
    Ok(Header { width, height, channels, max, names: None })
}

fn read_pam_header(tokens: &mut Tokens<'_>) -> Result<Header, Fault> {
    let mut header = Header { width: 0, height: 0, channels: 0, max: 0, names: None };
    let mut tuple_type = String::new();
    loop {
        match tokens.word()? {
            "WIDTH" => header.width = tokens.number()?,
            "HEIGHT" => header.height = tokens.number()?,
            "DEPTH" => header.channels = tokens.number()?,
            "MAXVAL" => header.max = tokens.number()?,
            "TUPLTYPE" => tuple_type = tokens.line(),
            "ENDHDR" => break,
            other => return Err(Fault::corrupt(format!("its header has the entry {other:?}"))),
        }
    }
    header.names = match (tuple_type.as_str(), header.channels) {
        ("GRAYSCALE_ALPHA" | "BLACKANDWHITE_ALPHA", 2) => Some(&["Y", "A"]),
        ("RGB_ALPHA", 4) => Some(&["R", "G", "B", "A"]),
        (_, 4) => Some(&["C0", "C1", "C2", "C3"]), // Four channels of which none is said to be alpha.
        _ => None,
    };
    Ok(header)
}

/// P1: digits 0 and 1, blanks optional; 1 is black.
fn plain_bits(text: &[u8], count: usize) -> Result<Vec<u16>, Fault> {
    if count > text.len() {
        return Err(Fault::cut_short());
    }
    let mut out = with_capacity(count)?;
    let mut tokens = Tokens::new(text);
    while out.len() < count {
        tokens.skip_blanks();
        match tokens.rest {
            [b @ (b'0' | b'1'), rest @ ..] => {
                out.push(u16::from(*b == b'0'));
                tokens.rest = rest;
            }
            [] => return Err(Fault::cut_short()),
            _ => return Err(Fault::corrupt("a sample is neither 0 nor 1")),
        }
    }
    Ok(out)
}

/// P2 and P3: decimal numbers between blanks.
fn plain_numbers(mut tokens: Tokens<'_>, count: usize) -> Result<Vec<u16>, Fault> {
    if count > tokens.rest.len() {
        return Err(Fault::cut_short()); // Each sample takes a byte at least.
    }
    let mut out = with_capacity(count)?;
    for _ in 0..count {
        let value = tokens.number()?;
        out.push(value.try_into().map_err(|_| Fault::corrupt(format!("a sample is {value}")))?);
    }
    Ok(out)
}

/// P4: eight pixels per byte, rows padded to bytes; 1 is black.
fn packed_bits(body: &[u8], w: usize, h: usize) -> Result<Vec<u16>, Fault> {
    let row = w.div_ceil(8);
    let body = row.checked_mul(h).and_then(|n| body.get(..n)).ok_or_else(Fault::cut_short)?;
    let mut out = with_capacity(w * h)?;
    for line in body.chunks_exact(row) {
        out.extend((0..w).map(|x| u16::from(line[x / 8] >> (7 - x % 8) & 1 == 0)));
    }
    Ok(out)
}

/// P5, P6 and P7: one byte per sample, or two, high byte first, when the maximum needs them.
fn binary_numbers(body: &[u8], count: usize, max: u64) -> Result<Vec<u16>, Fault> {
    let bytes = if max < 256 { 1 } else { 2 };
    let body = count.checked_mul(bytes).and_then(|n| body.get(..n)).ok_or_else(Fault::cut_short)?;
    let mut out = with_capacity(count)?;
    match bytes {
        1 => out.extend(body.iter().map(|v| u16::from(*v))),
        _ => out.extend(body.as_chunks::<2>().0.iter().map(|v| u16::from_be_bytes(*v))),
    }
    Ok(out)
}

pub(super) fn encode(image: &Image, plan: &Plan, w: &mut impl Write) -> Result<usize, Fault> {
    let (width, height, channels) = (image.width(), image.height(), image.channels().len());
    let max = if plan.sample == SampleType::U8 { 255 } else { 65_535 };
    let alpha = image.channels().last().is_some_and(|c| c == "A");
    match (channels, alpha) {
        (1, false) if !plan.is_pam => write!(w, "P5\n{width} {height}\n{max}\n")?,
        (3, false) if !plan.is_pam => write!(w, "P6\n{width} {height}\n{max}\n")?,
        _ => {
            let tuple_type = match (channels, alpha) {
                (1, false) => "TUPLTYPE GRAYSCALE\n",
                (2, true) => "TUPLTYPE GRAYSCALE_ALPHA\n",
                (3, false) => "TUPLTYPE RGB\n",
                (4, true) => "TUPLTYPE RGB_ALPHA\n",
                _ => "",
            };
            write!(w, "P7\nWIDTH {width}\nHEIGHT {height}\nDEPTH {channels}\nMAXVAL {max}\n")?;
            writeln!(w, "{tuple_type}ENDHDR")?;
        }
    }
    match plan.sample {
        SampleType::U8 => {
            let q = interleave(image, to_u8);
            w.write_all(&q.values)?;
            Ok(q.clipped)
        }
        _ => {
            let q = interleave(image, to_u16);
            for v in &q.values {
                w.write_all(&v.to_be_bytes())?;
            }
            Ok(q.clipped)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<Image, Fault> {
        decode(bytes, &Budget::new(1 << 30))
    }

    #[test]
    fn the_plain_and_binary_forms_agree() {
        let plain = read(b"P3 # red, then\n2 1\n# comment\n255\n255 0 0  0 51 255").unwrap();
        let binary = read(b"P6\n2 1\n255\n\xff\0\0\0\x33\xff").unwrap();
        assert_eq!(plain, binary);
        assert_eq!(plain.as_planar(), [1.0, 0.0, 0.0, 0.2, 0.0, 1.0]);
        let plain = read(b"P1\n10 2\n0101010101\n1 1 1 1 1 0 0 0 0 0\n").unwrap();
        let binary = read(b"P4\n10 2\n\x55\x40\xf8\0").unwrap();
        assert_eq!(plain, binary);
        assert_eq!(plain.as_planar()[..3], [1.0, 0.0, 1.0]);
    }

    #[test]
    fn the_maximum_scales() {
        assert_eq!(read(b"P2 2 1 100 50 100").unwrap().as_planar(), [0.5, 1.0]);
        let deep = read(b"P5 1 1 1023\n\x03\xff").unwrap();
        assert_eq!((deep.as_planar()[0], deep.sample), (1.0, SampleType::U16));
        for bad in [&b"P5 1 1 0\n\0"[..], b"P5 1 1 65536\n\0\0", b"P2 1 1 7 8", b"P2 1 1 7 x"] {
            assert!(matches!(read(bad), Err(Fault::Corrupt(_))), "{bad:?}");
        }
    }

    #[test]
    fn pam_names_its_channels() {
        let pam = |depth: u8, kind: &str| {
            let head = format!(
                "P7\nWIDTH 1\nHEIGHT 1\nDEPTH {depth}\nMAXVAL 255\nTUPLTYPE {kind}\nENDHDR\n"
            );
            read(&[head.as_bytes(), &vec![7; depth.into()]].concat()).unwrap().channels().join("")
        };
        assert_eq!(pam(2, "GRAYSCALE_ALPHA"), "YA");
        assert_eq!(pam(4, "RGB_ALPHA"), "RGBA");
        assert_eq!(pam(4, "CMYK"), "C0C1C2C3");
        assert_eq!(pam(3, "RGB"), "RGB");
    }

    #[test]
    fn absurd_headers_are_typed_errors() {
        for kind in 1..=6 {
            let text = format!("P{kind} 1000000000 1000000000 255\n");
            assert!(matches!(read(text.as_bytes()), Err(Fault::TooLarge { .. })));
            // Within the limit, but not in the file.
            let text = format!("P{kind} 9000 9000 255\n");
            assert!(matches!(read(text.as_bytes()), Err(Fault::Corrupt(_))));
            let text = format!("P{kind} 0 9 255\n");
            assert!(matches!(read(text.as_bytes()), Err(Fault::Empty)));
        }
    }
}
