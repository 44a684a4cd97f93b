//! Rows of TIFF in strips or tiles, and the head of a TIFF whose rows follow one another.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::tiff::decoder::{Decoder, Limits};
use ::tiff::tags::Tag;

use super::{Opened, PictureInfo, Rows};
use crate::budget::check_plausible;
use crate::codec::tiff::{SMALL_TIFF_BYTES, channel_names, fault, to_planar};
use crate::error::Fault;
use crate::{SampleType, Transfer};

struct TiffRows {
    decoder: Decoder<BufReader<File>>,
    width: usize,
    height: usize,
    channels: usize,
    bits: u8,
    /// Chunks side by side, and rows of each.
    across: u32,
    chunk_rows: usize,
    /// The row of chunks that is decoded, as planes, and its first row of the picture.
    strip: Vec<f32>,
    strip_rows: usize,
    strip_start: usize,
    row: usize,
}

pub(super) fn open(path: &Path, limit_bytes: u64) -> Result<Opened, Fault> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut decoder = Decoder::new(BufReader::with_capacity(1 << 18, file)).map_err(fault)?;
    let (width, height) = decoder.dimensions().map_err(fault)?;
    if width == 0 || height == 0 {
        return Err(Fault::Empty);
    }
    let (names, bits) = channel_names(&mut decoder)?;
    let mut number = |tag| decoder.find_tag_unsigned::<u16>(tag).ok().flatten();
    if number(Tag::Orientation).is_some_and(|turn| turn > 1) {
        return Ok(Opened::Whole("it is stored turned"));
    }
    if number(Tag::PlanarConfiguration).is_some_and(|p| p > 1) && names.len() > 1 {
        return Ok(Opened::Whole("its channels are stored one after the other"));
    }
    let bare = number(Tag::Compression).unwrap_or(1) == 1;
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok().flatten();
    let float = formats.and_then(|f| f.first().copied()) == Some(3);
    let sample = match (bits, float) {
        (8, false) => SampleType::U8,
        (16, false) => SampleType::U16,
        (16, true) => SampleType::F16,
        (32 | 64, true) => SampleType::F32,
        _ => return Ok(Opened::Whole("its numbers are of an unusual type")),
    };
    let (chunk_width, chunk_rows) = decoder.chunk_dimensions();
    let (chunk_width, chunk_rows) = (chunk_width.max(1), chunk_rows.clamp(1, height));
    let across = width.div_ceil(chunk_width);
    // Decoded and as floats; a strip may be the whole picture.
    let sample_bytes = 4 + u64::from(bits) / 8;
    let strip = u64::from(width)
        .saturating_mul(u64::from(chunk_rows))
        .saturating_mul(names.len() as u64 * sample_bytes);
    if strip > limit_bytes {
        return Ok(Opened::Whole("its strips or tiles are too high"));
    }
    let samples = u64::from(width) * u64::from(height);
    let raw = samples.saturating_mul(names.len() as u64 * u64::from(bits)) / 8;
    // 4096: LZW at its best.
    check_plausible(raw, length as usize, if bare { 1 } else { 4096 })?;
    let icc = decoder.get_tag_u8_vec(Tag::IccProfile).ok().filter(|icc| !icc.is_empty());
    let mut limits = Limits::default();
    limits.decoding_buffer_size = strip.max(1 << 20) as usize;
    limits.intermediate_buffer_size = strip.saturating_mul(2).max(1 << 20) as usize;
    let info = PictureInfo {
        width: width as usize,
        height: height as usize,
        channels: names,
        sample,
        transfer: if sample.is_float() { Transfer::Unspecified } else { Transfer::Srgb },
        icc,
    };
    let rows = TiffRows {
        decoder: decoder.with_limits(limits),
        width: info.width,
        height: info.height,
        channels: info.channels.len(),
        bits,
        across,
        chunk_rows: chunk_rows as usize,
        strip: Vec::new(),
        strip_rows: 0,
        strip_start: 0,
        row: 0,
    };
    Ok(Opened::Rows(info, Box::new(rows)))
}

impl TiffRows {
    /// Decodes the row of chunks that holds the next row.
    fn load(&mut self) -> Result<(), Fault> {
        let down = self.row / self.chunk_rows;
        self.strip_start = down * self.chunk_rows;
        self.strip_rows = self.chunk_rows.min(self.height - self.strip_start);
        self.strip.resize(self.width * self.strip_rows * self.channels, 0.0);
        let mut left = 0;
        for k in 0..self.across {
            let index = down as u32 * self.across + k;
            let (w, h) = self.decoder.chunk_data_dimensions(index);
            let (w, h) = (w as usize, h as usize);
            let raw = self.decoder.read_chunk(index).map_err(fault)?;
            let (values, _) = to_planar(raw, w, h, self.channels, self.bits, false)?;
            if h != self.strip_rows
                || left + w > self.width
                || values.len() != w * h * self.channels
            {
                return Err(Fault::corrupt("its strips or tiles do not cover it"));
            }
            for (line, from) in values.chunks_exact(w).enumerate() {
                self.strip[line * self.width + left..][..w].copy_from_slice(from);
            }
            left += w;
        }
        Ok(())
    }
}

impl Rows for TiffRows {
    fn read(&mut self, rows: usize, out: &mut [f32]) -> Result<(), Fault> {
        let mut done = 0;
        while done < rows {
            if self.strip.is_empty() || self.row >= self.strip_start + self.strip_rows {
                self.load()?;
            }
            let from = self.row - self.strip_start;
            let count = (self.strip_rows - from).min(rows - done);
            for c in 0..self.channels {
                let source = &self.strip[(c * self.strip_rows + from) * self.width..];
                let target = &mut out[(c * rows + done) * self.width..];
                let n = count * self.width;
                target[..n].copy_from_slice(&source[..n]);
            }
            done += count;
            self.row += count;
        }
        Ok(())
    }
}

/// The head of an uncompressed little-endian TIFF whose rows follow right behind it.
pub(super) fn head(info: &PictureInfo, sample: SampleType) -> Vec<u8> {
    let (bits, format) = match sample {
        SampleType::U8 => (8u16, 1u16),
        SampleType::U16 => (16, 1),
        SampleType::F16 => (16, 3),
        SampleType::F32 => (32, 3),
    };
    let channels = info.channels.len();
    let colors = info.channels.iter().filter(|c| *c != "A").count();
    let row = info.width as u64 * channels as u64 * u64::from(bits) / 8;
    // Strips of about a megabyte, as readers like them.
    let per_strip = ((1u64 << 20) / row).clamp(1, info.height as u64);
    let strips = (info.height as u64).div_ceil(per_strip);
    let big = row * info.height as u64 >= SMALL_TIFF_BYTES;
    let mut entries = vec![
        Entry::long(256, info.width as u64),
        Entry::long(257, info.height as u64),
        Entry::shorts(258, &vec![bits; channels]),
        Entry::shorts(259, &[1]),
        Entry::shorts(262, &[if colors == 1 { 1 } else { 2 }]),
        Entry::offsets(273, vec![0; strips as usize], big),
        Entry::shorts(277, &[channels as u16]),
        Entry::long(278, per_strip),
        Entry::offsets(
            279,
            (0..strips).map(|k| row * per_strip.min(info.height as u64 - k * per_strip)).collect(),
            big,
        ),
        Entry::shorts(284, &[1]),
    ];
    if colors < channels {
        entries.push(Entry::shorts(338, &[2])); // Alpha that is not multiplied into the colours.
    }
    entries.push(Entry::shorts(339, &vec![format; channels]));
    if let Some(icc) = &info.icc {
        entries.push(Entry { tag: 34_675, kind: 7, count: icc.len() as u64, bytes: icc.clone() });
    }
    let begin = assemble(&entries, big).len() as u64;
    let starts: Vec<u64> = (0..strips).map(|k| begin + k * per_strip * row).collect();
    entries[5] = Entry::offsets(273, starts, big);
    assemble(&entries, big)
}

/// A tag with its values.
struct Entry {
    tag: u16,
    /// Number of the type: 3 for 16 bits, 4 for 32, 7 for bytes, 16 for 64.
    kind: u16,
    count: u64,
    bytes: Vec<u8>,
}

impl Entry {
    fn shorts(tag: u16, values: &[u16]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self { tag, kind: 3, count: values.len() as u64, bytes }
    }

    fn long(tag: u16, value: u64) -> Self {
        Self { tag, kind: 4, count: 1, bytes: (value as u32).to_le_bytes().to_vec() }
    }

    fn offsets(tag: u16, values: Vec<u64>, big: bool) -> Self {
        let count = values.len() as u64;
        let bytes = match big {
            true => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            false => values.iter().flat_map(|v| (*v as u32).to_le_bytes()).collect(),
        };
        Self { tag, kind: if big { 16 } else { 4 }, count, bytes }
    }
}

/// Header, directory, and the values that do not fit into it.
fn assemble(entries: &[Entry], big: bool) -> Vec<u8> {
    let word = if big { 8 } else { 4 };
    let number = |v: u64| v.to_le_bytes()[..word].to_vec();
    let mut out: Vec<u8> = match big {
        true => [&b"II\x2b\0\x08\0\0\0"[..], &16u64.to_le_bytes()].concat(),
        false => [&b"II\x2a\0"[..], &8u32.to_le_bytes()].concat(),
    };
    let count = entries.len() as u64;
    out.extend(if big {
        count.to_le_bytes().to_vec()
    } else {
        (count as u16).to_le_bytes().into()
    });
    let mut beyond = Vec::new();
    // Behind the entries stands the place of the next directory: none.
    let after = out.len() + entries.len() * (4 + 2 * word) + word;
    for entry in entries {
        out.extend(entry.tag.to_le_bytes());
        out.extend(entry.kind.to_le_bytes());
        out.extend(number(entry.count));
        let mut bytes = entry.bytes.clone();
        if bytes.len() > word {
            let place = number((after + beyond.len()) as u64);
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            beyond.extend(std::mem::replace(&mut bytes, place));
        }
        bytes.resize(word, 0);
        out.extend(bytes);
    }
    out.extend(number(0));
    out.extend(beyond);
    out
}

/// A TIFF of one byte a sample in tiles of 16 x 16, which no encoder here writes.
#[cfg(test)]
pub(super) fn tiled(info: &PictureInfo, value: impl Fn(usize, usize, usize) -> u8) -> Vec<u8> {
    let channels = info.channels.len();
    let [across, down] = [info.width, info.height].map(|n| n.div_ceil(16));
    let (count, size) = (across * down, 256 * channels);
    let entries = |begin: u64| {
        vec![
            Entry::long(256, info.width as u64),
            Entry::long(257, info.height as u64),
            Entry::shorts(258, &vec![8; channels]),
            Entry::shorts(259, &[1]),
            Entry::shorts(262, &[if channels == 1 { 1 } else { 2 }]),
            Entry::shorts(277, &[channels as u16]),
            Entry::shorts(322, &[16]),
            Entry::shorts(323, &[16]),
            Entry::offsets(324, (0..count).map(|k| begin + (k * size) as u64).collect(), false),
            Entry::offsets(325, vec![size as u64; count], false),
        ]
    };
    let begin = assemble(&entries(0), false).len() as u64;
    let mut out = assemble(&entries(begin), false);
    for tile in 0..count {
        for k in 0..256 {
            let x = (tile % across * 16 + k % 16).min(info.width - 1);
            let y = (tile / across * 16 + k / 16).min(info.height - 1);
            out.extend((0..channels).map(|c| value(x, y, c)));
        }
    }
    out
}
