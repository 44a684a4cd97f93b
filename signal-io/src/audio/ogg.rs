//! The pages of an Ogg file, checked: symphonia passes over damaged and missing ones.
//!
//! Source: RFC 3533.

use std::collections::BTreeMap;

use super::vorbis;
use crate::error::Fault;

/// Bytes before the table of segments.
const HEADER: usize = 27;
/// The flag of a page that begins with the rest of a packet.
const CONTINUED: u8 = 1;
/// The flag of the last page of a stream.
const LAST: u8 = 4;

/// Every page whole, in order, with the right checksum, and a last one at the end; and code books of
/// a sensible size.
pub(super) fn check_pages(bytes: &[u8]) -> Result<(), Fault> {
    let (mut rest, mut is_complete) = (bytes, false);
    let mut streams: BTreeMap<u32, Stream> = BTreeMap::new();
    while !rest.is_empty() {
        let page = Page::read(rest)?;
        streams.entry(page.serial).or_default().append(&page)?;
        is_complete = page.flags & LAST != 0;
        rest = &rest[page.length..];
    }
    if is_complete { Ok(()) } else { Err(Fault::cut_short()) }
}

/// The pages with the same serial number, so far.
#[derive(Default)]
struct Stream {
    number: Option<u32>,
    /// The beginning of a packet that goes on in the next page.
    packet: Vec<u8>,
}

impl Stream {
    fn append(&mut self, page: &Page) -> Result<(), Fault> {
        if let Some(before) = self.number
            && before.checked_add(1) != Some(page.number)
        {
            return Err(Fault::corrupt(format!("page {} follows {before}", page.number)));
        }
        self.number = Some(page.number);
        if (page.flags & CONTINUED != 0) == self.packet.is_empty() {
            return Err(Fault::corrupt(format!("page {} begins amid a packet", page.number)));
        }
        let mut body = page.body;
        for segment in page.segments {
            let (part, rest) = body.split_at(usize::from(*segment));
            self.packet.extend_from_slice(part);
            body = rest;
            // Packets end with a segment of less than 255 bytes.
            if *segment < 255 {
                vorbis::check_setup(&self.packet)?;
                self.packet.clear();
            }
        }
        Ok(())
    }
}

struct Page<'a> {
    flags: u8,
    serial: u32,
    number: u32,
    /// The lengths of the pieces of the body.
    segments: &'a [u8],
    body: &'a [u8],
    length: usize,
}

impl<'a> Page<'a> {
    /// The page at the start of these bytes.
    fn read(bytes: &'a [u8]) -> Result<Self, Fault> {
        let header = bytes.get(..HEADER).ok_or_else(Fault::cut_short)?;
        if header[..5] != *b"OggS\0" {
            return Err(Fault::corrupt("a page has no beginning"));
        }
        let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|k| header[at + k]));
        let body = HEADER + usize::from(header[26]);
        let segments = bytes.get(HEADER..body).ok_or_else(Fault::cut_short)?;
        let length = body + segments.iter().map(|n| usize::from(*n)).sum::<usize>();
        let page = bytes.get(..length).ok_or_else(Fault::cut_short)?;
        let (serial, number) = (u32_at(14), u32_at(18));
        match checksum(page) == u32_at(22) {
            true => {
                Ok(Self { flags: header[5], serial, number, segments, body: &page[body..], length })
            }
            false => Err(Fault::corrupt(format!("page {number} does not match its checksum"))),
        }
    }
}

/// CRC-32 with the polynomial 0x04c11db7, not reflected, from 0; its own four bytes count as 0.
fn checksum(page: &[u8]) -> u32 {
    page.iter().enumerate().fold(0, |crc: u32, (k, byte)| {
        let byte = if (22..26).contains(&k) { 0 } else { *byte };
        crc << 8 ^ TABLE[usize::from((crc >> 24) as u8 ^ byte)]
    })
}

const TABLE: [u32; 256] = table();

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut k = 0;
    while k < 256 {
        let (mut crc, mut bit) = ((k as u32) << 24, 0);
        while bit < 8 {
            crc = crc << 1 ^ if crc >> 31 == 1 { 0x04c1_1db7 } else { 0 };
            bit += 1;
        }
        table[k] = crc;
        k += 1;
    }
    table
}
