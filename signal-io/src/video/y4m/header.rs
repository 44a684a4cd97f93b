use super::color::Range;
use crate::error::Fault;
use crate::video::Timing;

/// Where the chroma samples are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Layout {
    /// None at all.
    Mono,
    /// 4:4:4: one for every pixel.
    Full,
    /// One for `step_x` by `step_y` pixels (1, 2 or 4); `offset` is the position of the first one,
    /// in pixels.
    Subsampled { step: [u32; 2], offset: [f32; 2] },
}

/// The first line of a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) layout: Layout,
    /// 8 to 16; above 8 a value takes two bytes.
    pub(super) bits: u32,
    pub(super) range: Range,
    /// `0 / 0` where unknown.
    rate: (u32, u32),
}

/// More than any header: all known parameters take 200 bytes or so, comments a few more.
const LONGEST_LINE: usize = 4096;

/// The bytes up to the end of the line.
pub(super) fn line(bytes: &[u8]) -> Result<&[u8], Fault> {
    let head = &bytes[..bytes.len().min(LONGEST_LINE)];
    match head.iter().position(|b| *b == b'\n') {
        Some(end) => Ok(&head[..end]),
        None if bytes.len() < LONGEST_LINE => Err(Fault::cut_short()),
        None => Err(Fault::corrupt("a header line does not end")),
    }
}

impl Header {
    /// The header and the bytes behind it.
    pub(super) fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), Fault> {
        let line = line(bytes)?;
        let text =
            std::str::from_utf8(line).map_err(|_| Fault::corrupt("its header is no text"))?;
        let mut words = text.trim_end_matches('\r').split(' ').filter(|w| !w.is_empty());
        if words.next() != Some("YUV4MPEG2") {
            return Err(Fault::corrupt("it does not start with its signature"));
        }
        let (mut width, mut height, mut rate, mut space) = (None, None, (0, 0), "420jpeg");
        let mut range = Range::Limited;
        for word in words {
            let mut chars = word.chars();
            let key = chars.next();
            let value = chars.as_str();
            let bad = || Fault::corrupt(format!("the parameter {word:?} in its header"));
            match key {
                Some('W') => width = Some(value.parse().map_err(|_| bad())?),
                Some('H') => height = Some(value.parse().map_err(|_| bad())?),
                Some('C') => space = value,
                Some('F') => rate = parse_rate(value).ok_or_else(bad)?,
                Some('X') if value == "COLORRANGE=FULL" => range = Range::Full,
                // Interlacing, aspect and comments do not change the numbers.
                _ => {}
            }
        }
        let (layout, bits) = parse_space(space)?;
        let missing = |what| Fault::corrupt(format!("its header has no {what}"));
        let width: u32 = width.ok_or_else(|| missing("width"))?;
        let height: u32 = height.ok_or_else(|| missing("height"))?;
        Ok((Self { width, height, layout, bits, range, rate }, &bytes[line.len() + 1..]))
    }

    /// Columns and rows of a chroma plane; none in mono.
    pub(super) fn chroma_size(&self) -> [u32; 2] {
        match self.layout {
            Layout::Mono => [0, 0],
            Layout::Full => [self.width, self.height],
            Layout::Subsampled { step, .. } => {
                [self.width.div_ceil(step[0]), self.height.div_ceil(step[1])]
            }
        }
    }

    /// Bytes of a frame behind its line.
    pub(super) fn frame_bytes(&self) -> u64 {
        let [w, h] = self.chroma_size().map(u64::from);
        let luma = u64::from(self.width).saturating_mul(self.height.into());
        let values = luma.saturating_add(w.saturating_mul(h).saturating_mul(2));
        values.saturating_mul(if self.bits > 8 { 2 } else { 1 })
    }

    /// The rate, where the file has one.
    pub(super) fn timing(&self) -> Timing {
        match self.rate {
            (0, 0) => Timing::default(),
            (frames, seconds) => Timing::Rate { frames, seconds },
        }
    }
}

/// Two numbers, both 0 for "unknown" or none of them.
fn parse_rate(text: &str) -> Option<(u32, u32)> {
    let (frames, seconds) = text.split_once(':')?;
    let (frames, seconds) = (frames.parse().ok()?, seconds.parse().ok()?);
    ((frames == 0) == (seconds == 0)).then_some((frames, seconds))
}

/// Layout and bits of a colour space such as `420mpeg2` or `444p10`.
fn parse_space(space: &str) -> Result<(Layout, u32), Fault> {
    let unknown = || Fault::Feature(format!("the colour space {space:?}"));
    let sub = |step, offset| Layout::Subsampled { step, offset };
    // Centred as in JPEG: between the pixels; as in MPEG-2: on the left ones; DV: on the upper left.
    let (centred, left, corner) = ([0.5, 0.5], [0.0, 0.5], [0.0, 0.0]);
    if let Some(depth) = space.strip_prefix("mono") {
        let bits = if depth.is_empty() { Some(8) } else { depth.parse().ok() };
        return Ok((Layout::Mono, bits.filter(is_depth).ok_or_else(unknown)?));
    }
    let (kind, bits) = match space.split_once('p').filter(|(_, d)| !d.is_empty()) {
        Some((kind, depth)) if depth.bytes().all(|b| b.is_ascii_digit()) => {
            (kind, depth.parse().ok().filter(is_depth).ok_or_else(unknown)?)
        }
        _ => (space, 8),
    };
    let layout = match kind {
        "420" | "420jpeg" => sub([2, 2], centred),
        "420mpeg2" => sub([2, 2], left),
        "420paldv" => sub([2, 2], corner),
        "422" => sub([2, 1], corner),
        "411" => sub([4, 1], corner),
        "444" => Layout::Full,
        _ => return Err(unknown()),
    };
    Ok((layout, bits))
}

fn is_depth(bits: &u32) -> bool {
    (8..=16).contains(bits)
}

/// The first line of a file that is written.
pub(super) fn text(
    width: usize,
    height: usize,
    layout: Layout,
    bits: u8,
    range: Range,
    timing: &Timing,
) -> String {
    let space = match (layout, bits) {
        (Layout::Mono, 8) => "mono".to_owned(),
        (Layout::Mono, bits) => format!("mono{bits}"),
        (_, 8) => "444".to_owned(),
        (_, bits) => format!("444p{bits}"),
    };
    let range = if range == Range::Full { "FULL" } else { "LIMITED" };
    let Timing::Rate { frames, seconds } = timing.to_rate() else { unreachable!("a rate") };
    format!(
        "YUV4MPEG2 W{width} H{height} F{frames}:{seconds} Ip A1:1 C{space} XCOLORRANGE={range}\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Header, Fault> {
        Header::parse(text.as_bytes()).map(|(header, _)| header)
    }

    #[test]
    fn colour_spaces() {
        let sub = |step, offset| Layout::Subsampled { step, offset };
        for (space, layout, bits, bytes) in [
            ("C420", sub([2, 2], [0.5, 0.5]), 8, 15 + 2 * 6),
            ("C420p10", sub([2, 2], [0.5, 0.5]), 10, 2 * (15 + 2 * 6)),
            ("C420mpeg2", sub([2, 2], [0.0, 0.5]), 8, 15 + 2 * 6),
            ("C420paldv", sub([2, 2], [0.0, 0.0]), 8, 15 + 2 * 6),
            ("C422p16", sub([2, 1], [0.0, 0.0]), 16, 2 * (15 + 2 * 9)),
            ("C411", sub([4, 1], [0.0, 0.0]), 8, 15 + 2 * 6),
            ("C444p12", Layout::Full, 12, 90),
            ("Cmono", Layout::Mono, 8, 15),
            ("Cmono12", Layout::Mono, 12, 30),
            ("", sub([2, 2], [0.5, 0.5]), 8, 15 + 2 * 6),
        ] {
            let header = parse(&format!("YUV4MPEG2 W5 H3 F30:1 {space}\n")).unwrap();
            assert_eq!((header.layout, header.bits), (layout, bits), "{space}");
            assert_eq!(header.frame_bytes(), bytes, "{space}");
        }
        for space in ["C444alpha", "C420p7", "C420p17", "C420p99999999999", "Cmono1", "C", "Cxyz"] {
            let result = parse(&format!("YUV4MPEG2 W5 H3 {space}\n"));
            assert!(matches!(result, Err(Fault::Feature(_))), "{space}: {result:?}");
        }
    }

    #[test]
    fn rates_may_be_unknown_but_not_absurd() {
        let timing = |text: &str| parse(&format!("YUV4MPEG2 W5 H3 {text}\n")).map(|h| h.timing());
        let ntsc = Timing::Rate { frames: 30_000, seconds: 1001 };
        assert_eq!(timing("F30000:1001").unwrap(), ntsc);
        assert_eq!(timing("F0:0").unwrap(), Timing::default());
        assert_eq!(timing("").unwrap(), Timing::default());
        for bad in ["F25:0", "F0:1", "F25", "F-1:1", "F99999999999:1", "W5x", "H-3"] {
            assert!(matches!(timing(bad), Err(Fault::Corrupt(_))), "{bad}");
        }
    }
}
