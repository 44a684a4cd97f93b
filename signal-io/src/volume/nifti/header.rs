//! The headers of NIfTI-1 (348 bytes) and NIfTI-2 (540 bytes) as one struct.
//!
//! Source: `nifti1.h` and `nifti2.h` of the NIfTI data format working group.

use crate::error::Fault;

/// Every field of both versions, in the widest types.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Header {
    pub(super) second: bool,
    pub(super) dim: [i64; 8],
    pub(super) pixdim: [f64; 8],
    pub(super) datatype: i64,
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    pub(super) units: i64,
    pub(super) qform_code: i64,
    pub(super) sform_code: i64,
    /// `b`, `c`, `d` and the offset in x, y, z.
    pub(super) quaternion: [f64; 6],
    pub(super) rows: [[f64; 4]; 3],
    pub(super) descrip: Vec<u8>,
    aux_file: Vec<u8>,
    intent_name: Vec<u8>,
    pub(super) intent_code: i64,
    intent: [f64; 3],
    /// `cal_max`, `cal_min`, `slice_duration`, `toffset`: neighbours in both versions.
    calibration: [f64; 4],
    slice_start: i64,
    slice_end: i64,
    slice_code: i64,
    dim_info: i64,
}

/// Where a field begins: in version 1, in version 2.
type Place = [usize; 2];

/// What the fields are in bytes: those of version 1 and of version 2.
const SHORT_OR_LONG: Place = [2, 8];
const SHORT_OR_INT: Place = [2, 4];
const SHORT: Place = [2, 2];
const BYTE_OR_INT: Place = [1, 4];
const BYTE: Place = [1, 1];

/// Reads or writes fields: the layout is written once, in [`Header::visit`].
trait Visit {
    fn int(&mut self, place: Place, bytes: Place, value: &mut i64);
    fn real(&mut self, place: Place, value: &mut f64);
    fn text(&mut self, place: Place, length: usize, value: &mut Vec<u8>);
}

impl Header {
    /// Bytes of the header.
    pub(super) fn bytes(second: bool) -> usize {
        if second { 540 } else { 348 }
    }

    /// Calls the visitor for every field that is kept.
    fn visit(&mut self, v: &mut impl Visit) {
        for k in 0..8 {
            v.int([40 + 2 * k, 16 + 8 * k], SHORT_OR_LONG, &mut self.dim[k]);
            v.real([76 + 4 * k, 104 + 8 * k], &mut self.pixdim[k]);
        }
        for k in 0..3 {
            v.real([56 + 4 * k, 80 + 8 * k], &mut self.intent[k]);
            for c in 0..4 {
                let at = 4 * k + c;
                v.real([280 + 4 * at, 400 + 8 * at], &mut self.rows[k][c]);
            }
        }
        for k in 0..6 {
            v.real([256 + 4 * k, 352 + 8 * k], &mut self.quaternion[k]);
        }
        for k in 0..4 {
            v.real([124 + 4 * k, 192 + 8 * k], &mut self.calibration[k]);
        }
        v.int([70, 12], SHORT, &mut self.datatype);
        v.real([112, 176], &mut self.slope);
        v.real([116, 184], &mut self.intercept);
        v.int([74, 224], SHORT_OR_LONG, &mut self.slice_start);
        v.int([120, 232], SHORT_OR_LONG, &mut self.slice_end);
        v.int([122, 496], BYTE_OR_INT, &mut self.slice_code);
        v.int([123, 500], BYTE_OR_INT, &mut self.units);
        v.int([68, 504], SHORT_OR_INT, &mut self.intent_code);
        v.int([252, 344], SHORT_OR_INT, &mut self.qform_code);
        v.int([254, 348], SHORT_OR_INT, &mut self.sform_code);
        v.int([39, 524], BYTE, &mut self.dim_info);
        v.text([148, 240], 80, &mut self.descrip);
        v.text([228, 320], 24, &mut self.aux_file);
        v.text([328, 508], 16, &mut self.intent_name);
    }

    /// The version and the byte order (true: little) that the first bytes show.
    pub(super) fn kind(head: &[u8; 4]) -> Result<(bool, bool), Fault> {
        Ok(match (u32::from_le_bytes(*head), u32::from_be_bytes(*head)) {
            (348, _) => (false, true),
            (_, 348) => (false, false),
            (540, _) => (true, true),
            (_, 540) => (true, false),
            (other, _) => {
                return Err(Fault::corrupt(format!(
                    "a header of {other} bytes (348 and 540 are known)"
                )));
            }
        })
    }

    /// Reads the header of the given version and byte order.
    ///
    /// # Panics
    /// If there are not [`Header::bytes`] bytes.
    pub(super) fn parse(bytes: &[u8], second: bool, little: bool) -> Result<Self, Fault> {
        let magic = if second { &bytes[4..8] } else { &bytes[344..348] };
        match magic {
            b"n+1\0" | b"n+2\0" => {}
            b"ni1\0" | b"ni2\0" => {
                return Err(Fault::Feature("its data in another file (.hdr and .img)".to_owned()));
            }
            _ => return Err(Fault::corrupt("the magic is missing")),
        }
        let mut header = Self { second, ..Self::default() };
        header.visit(&mut Parse { bytes, version: usize::from(second), little });
        // A float in version 1, an integer in version 2.
        header.vox_offset = match second {
            false => f64::from(f32::from_bits(word(&bytes[108..112], little) as u32)),
            true => word(&bytes[168..176], little) as i64 as f64,
        };
        Ok(header)
    }

    /// The little-endian bytes of the header, for data that begin at `offset` with numbers of `bits`.
    pub(super) fn to_bytes(&self, offset: usize, bits: usize) -> Vec<u8> {
        let mut out = vec![0; Self::bytes(self.second)];
        self.clone().visit(&mut Emit { out: &mut out, version: usize::from(self.second) });
        let (size, bits) = ((out.len() as u32).to_le_bytes(), (bits as u16).to_le_bytes());
        out[..4].copy_from_slice(&size);
        match self.second {
            false => {
                out[38] = b'r'; // "regular": older readers look for it.
                out[72..74].copy_from_slice(&bits);
                out[108..112].copy_from_slice(&(offset as f32).to_le_bytes());
                out[344..348].copy_from_slice(b"n+1\0");
            }
            true => {
                out[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
                out[14..16].copy_from_slice(&bits);
                out[168..176].copy_from_slice(&(offset as i64).to_le_bytes());
            }
        }
        out
    }
}

/// Up to 8 bytes as a number without sign.
pub(super) fn word(bytes: &[u8], little: bool) -> u64 {
    let join = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
    if little { bytes.iter().rev().fold(0, join) } else { bytes.iter().fold(0, join) }
}

struct Parse<'a> {
    bytes: &'a [u8],
    version: usize,
    little: bool,
}

impl Visit for Parse<'_> {
    fn int(&mut self, place: Place, bytes: Place, value: &mut i64) {
        let (at, n) = (place[self.version], bytes[self.version]);
        let shift = 64 - 8 * n as u32;
        let unsigned = word(&self.bytes[at..at + n], self.little) << shift;
        // Bytes are flags, all others have a sign.
        *value = if n == 1 { (unsigned >> shift) as i64 } else { unsigned as i64 >> shift };
    }

    fn real(&mut self, place: Place, value: &mut f64) {
        let at = place[self.version];
        *value = match self.version {
            0 => f64::from(f32::from_bits(word(&self.bytes[at..at + 4], self.little) as u32)),
            _ => f64::from_bits(word(&self.bytes[at..at + 8], self.little)),
        };
    }

    fn text(&mut self, place: Place, length: usize, value: &mut Vec<u8>) {
        let at = place[self.version];
        let text = &self.bytes[at..at + length];
        let end = text.iter().position(|b| *b == 0).unwrap_or(length);
        *value = text[..end].to_vec();
    }
}

struct Emit<'a> {
    out: &'a mut [u8],
    version: usize,
}

impl Visit for Emit<'_> {
    fn int(&mut self, place: Place, bytes: Place, value: &mut i64) {
        let (at, n) = (place[self.version], bytes[self.version]);
        self.out[at..at + n].copy_from_slice(&value.to_le_bytes()[..n]);
    }

    fn real(&mut self, place: Place, value: &mut f64) {
        let at = place[self.version];
        match self.version {
            0 => self.out[at..at + 4].copy_from_slice(&(*value as f32).to_le_bytes()),
            _ => self.out[at..at + 8].copy_from_slice(&value.to_le_bytes()),
        }
    }

    fn text(&mut self, place: Place, length: usize, value: &mut Vec<u8>) {
        let at = place[self.version];
        let n = value.len().min(length);
        self.out[at..at + n].copy_from_slice(&value[..n]);
    }
}
