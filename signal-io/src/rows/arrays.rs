//! Rows of files that are a header and bare numbers: npy and PFM.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::{Opened, PictureInfo, Rows, spread};
use crate::codec::npy::{Convert, number_type, split_header};
use crate::codec::pnm::Tokens;
use crate::error::Fault;
use crate::image::usual_names;
use crate::read::head_of;
use crate::{SampleType, Transfer};

/// Longest header that is looked at. That of an npy file of version 1 ends within.
const HEADER_BYTES: usize = 66 << 10;

struct ArrayRows {
    file: BufReader<File>,
    /// Bytes of a row.
    row_bytes: usize,
    size: usize,
    channels: usize,
    convert: Convert,
    /// Where the last row begins, and how many rows are still to come, if they stand from bottom to top.
    upwards: Option<(u64, u64)>,
    line: Vec<u8>,
}

pub(super) fn open_npy(path: &Path) -> Result<Opened, Fault> {
    let head = head_of(path, HEADER_BYTES)?;
    let (header, body) = split_header(&head)?;
    let (h, w, c) = match header.shape[..] {
        [h, w] => (h, w, 1),
        [h, w, c] => (h, w, c),
        _ => {
            let what = format!("shape {:?} (a picture is (H, W) or (H, W, C))", header.shape);
            return Err(Fault::Feature(what));
        }
    };
    if header.fortran_order {
        return Ok(Opened::Whole("its numbers are in Fortran order"));
    }
    let (size, sample, convert) = number_type(&header.descr)?;
    let begin = (head.len() - body.len()) as u64;
    let transfer = Transfer::Unspecified;
    open(path, begin, [w, h, c], Numbers { size, sample, transfer, convert, upwards: false })
}

pub(super) fn open_pfm(path: &Path) -> Result<Opened, Fault> {
    let head = head_of(path, HEADER_BYTES)?;
    let channels = match head.get(..2) {
        Some(b"PF") => 3,
        Some(b"Pf") => 1,
        _ => return Err(Fault::corrupt("it does not start with PF or Pf")),
    };
    let mut tokens = Tokens::new(&head[2..]);
    let (w, h) = (tokens.number()?, tokens.number()?);
    let scale: f32 =
        tokens.word()?.parse().map_err(|_| Fault::corrupt("its scale is no number"))?;
    let begin = (head.len() - tokens.body()?.len()) as u64;
    let convert: Convert = match scale < 0.0 {
        true => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        false => |b| f32::from_be_bytes([b[0], b[1], b[2], b[3]]),
    };
    let (sample, transfer) = (SampleType::F32, Transfer::Linear);
    let numbers = Numbers { size: 4, sample, transfer, convert, upwards: true };
    open(path, begin, [w, h, channels], numbers)
}

struct Numbers {
    size: usize,
    sample: SampleType,
    transfer: Transfer,
    convert: Convert,
    upwards: bool,
}

fn open(path: &Path, begin: u64, [w, h, c]: [u64; 3], numbers: Numbers) -> Result<Opened, Fault> {
    if w == 0 || h == 0 || c == 0 {
        return Err(Fault::Empty);
    }
    let Numbers { size, sample, transfer, convert, upwards } = numbers;
    let mut file = File::open(path)?;
    let found = file.metadata()?.len() - begin;
    let expected = w.saturating_mul(h).saturating_mul(c).saturating_mul(size as u64);
    // What follows the last row of a PFM is nobody's business; arrays are exactly as long as they say.
    if found < expected || (found != expected && !upwards) {
        let message = format!("{expected} bytes of numbers expected, {found} found");
        return Err(Fault::corrupt(message));
    }
    let row_bytes = expected / h;
    file.seek(SeekFrom::Start(begin))?;
    let (width, height, channels) = (w as usize, h as usize, c as usize);
    let info =
        PictureInfo { width, height, channels: usual_names(channels), sample, transfer, icc: None };
    let rows = ArrayRows {
        file: BufReader::with_capacity(1 << 18, file),
        row_bytes: row_bytes as usize,
        size,
        channels,
        convert,
        upwards: upwards.then_some((begin, h)),
        line: Vec::new(),
    };
    Ok(Opened::Rows(info, Box::new(rows)))
}

impl Rows for ArrayRows {
    fn read(&mut self, rows: usize, out: &mut [f32]) -> Result<(), Fault> {
        self.line.resize(self.row_bytes, 0);
        if let Some((begin, left)) = &mut self.upwards {
            *left -= rows as u64;
            self.file.seek(SeekFrom::Start(*begin + *left * self.row_bytes as u64))?;
        }
        for k in 0..rows {
            self.file.read_exact(&mut self.line)?;
            let row = if self.upwards.is_some() { rows - 1 - k } else { k };
            spread(&self.line, self.size, self.convert, [row, rows], out, self.channels);
        }
        Ok(())
    }
}
