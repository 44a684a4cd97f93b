//! NIfTI-1 and NIfTI-2: a header of fixed places, then the bare numbers.
//!
//! Source: nifti1.h (R. Cox, 2003) and nifti2.h (2011) of the NIfTI Data Format Working Group.

use std::io::{Read, Write};

use super::affine::{self, Affine};
use super::numbers::{self, Coding, Order};
use super::voxel_type::{Scaling, VoxelType};
use super::{Volume, numbers::damage};
use crate::budget::{Budget, zeros};
use crate::error::Fault;

/// Headers with their extensions are this long at most; scanners write texts of some megabytes.
const MAX_HEADER: u64 = 64 << 20;

/// Where the fields of a version are, in bytes.
struct Places {
    length: usize,
    dim: usize,
    datatype: usize,
    pixdim: usize,
    offset: usize,
    slope: usize,
    qform: usize,
    quaternion: usize,
    rows: usize,
    units: usize,
}

const FIRST: Places = Places {
    length: 348,
    dim: 40,
    datatype: 70,
    pixdim: 76,
    offset: 108,
    slope: 112,
    qform: 252,
    quaternion: 256,
    rows: 280,
    units: 123,
};

const SECOND: Places = Places {
    length: 540,
    dim: 16,
    datatype: 12,
    pixdim: 104,
    offset: 168,
    slope: 176,
    qform: 344,
    quaternion: 352,
    rows: 400,
    units: 500,
};

/// Codes of number types.
const TYPES: [(u64, VoxelType); 8] = [
    (2, VoxelType::U8),
    (4, VoxelType::I16),
    (8, VoxelType::I32),
    (16, VoxelType::F32),
    (64, VoxelType::F64),
    (256, VoxelType::I8),
    (512, VoxelType::U16),
    (768, VoxelType::U32),
];

/// A header with its version and byte order.
struct Header {
    bytes: Vec<u8>,
    second: bool,
    little: bool,
}

impl Header {
    fn places(&self) -> &'static Places {
        if self.second { &SECOND } else { &FIRST }
    }

    fn number(&self, voxel: VoxelType, at: usize) -> f64 {
        let mut value = 0.0;
        voxel.decode(&self.bytes[at..at + voxel.bytes()], self.little, |v| value = v);
        value
    }

    /// A whole number of 2 bytes, or of 8 in the second version.
    fn whole(&self, at: usize, k: usize) -> i64 {
        if !self.second {
            return self.number(VoxelType::I16, at + 2 * k) as i64;
        }
        let raw = std::array::from_fn(|i| self.bytes[at + 8 * k + i]);
        if self.little { i64::from_le_bytes(raw) } else { i64::from_be_bytes(raw) }
    }

    /// A whole number of 2 bytes, or of 4 in the second version.
    fn code(&self, at: usize, k: usize) -> i64 {
        match self.second {
            true => self.number(VoxelType::I32, at + 4 * k) as i64,
            false => self.number(VoxelType::I16, at + 2 * k) as i64,
        }
    }

    /// A float, or a double in the second version.
    fn float(&self, at: usize, k: usize) -> f64 {
        match self.second {
            true => self.number(VoxelType::F64, at + 8 * k),
            false => self.number(VoxelType::F32, at + 4 * k),
        }
    }

    fn put(&mut self, voxel: VoxelType, at: usize, value: f64) {
        let mut out = Vec::new();
        voxel.encode(value, self.little, &mut out);
        self.bytes[at..at + out.len()].copy_from_slice(&out);
    }

    fn put_float(&mut self, at: usize, k: usize, value: f64) {
        match self.second {
            true => self.put(VoxelType::F64, at + 8 * k, value),
            false => self.put(VoxelType::F32, at + 4 * k, value),
        }
    }

    fn voxel(&self) -> Result<VoxelType, Fault> {
        // 2 bytes in both versions.
        let code = self.number(VoxelType::I16, self.places().datatype) as i64;
        TYPES
            .iter()
            .find(|(known, _)| i64::try_from(*known) == Ok(code))
            .map(|(_, voxel)| *voxel)
            .ok_or_else(|| Fault::Feature(format!("number type {code} (complex, RGB or other)")))
    }

    fn scaling(&self) -> Scaling {
        let at = self.places().slope;
        let scaling = Scaling { slope: self.float(at, 0), intercept: self.float(at, 1) };
        // A slope of 0 means that there is none.
        if scaling.is_valid() { scaling } else { Scaling::IDENTITY }
    }

    /// Spatial shape and the product of all further axes.
    fn shape(&self) -> Result<([usize; 3], u64), Fault> {
        let at = self.places().dim;
        let axes = self.whole(at, 0);
        if !(1..=7).contains(&axes) {
            return Err(Fault::corrupt(format!("its header tells of {axes} axes")));
        }
        let size = |k: i64| match self.whole(at, k as usize) {
            _ if k > axes => Ok(1),
            n if n > 0 => Ok(n as u64),
            n => Err(Fault::corrupt(format!("its axis {k} has {n} samples"))),
        };
        let mut further = 1u64;
        for k in 4..=7 {
            further = further.saturating_mul(size(k)?);
        }
        let mut shape = [0; 3];
        for (d, n) in shape.iter_mut().enumerate() {
            *n = usize::try_from(size(d as i64 + 1)?).map_err(|_| Fault::corrupt("its size"))?;
        }
        Ok((shape, further))
    }

    /// Millimetres per unit of length.
    fn unit(&self) -> f64 {
        match self.bytes[self.places().units + if self.little || !self.second { 0 } else { 3 }] & 7
        {
            1 => 1e3,
            3 => 1e-3,
            _ => 1.0,
        }
    }

    /// The place in the world, and whether the header tells one.
    fn affine(&self) -> (Affine, bool) {
        let at = self.places();
        let unit = self.unit();
        let edges: [f64; 3] = std::array::from_fn(|d| self.float(at.pixdim, d + 1).abs());
        let edge = |d: usize| if edges[d] > 0.0 { edges[d] } else { 1.0 };
        let map: Affine = if self.code(at.qform, 1) > 0 {
            std::array::from_fn(|r| std::array::from_fn(|c| self.float(at.rows, 4 * r + c)))
        } else if self.code(at.qform, 0) > 0 {
            self.rotated([edge(0), edge(1), edge(2)])
        } else {
            let size = [0, 1, 2].map(|d| unit * edge(d));
            return (affine::diagonal(size), edges.iter().any(|e| *e > 0.0 && *e != 1.0));
        };
        (map.map(|row| row.map(|v| v * unit)), true)
    }

    /// "Method 2" of nifti1.h: a quaternion, the edges, an offset.
    fn rotated(&self, edges: [f64; 3]) -> Affine {
        let at = self.places();
        let [b, c, d] = [0, 1, 2].map(|k| self.float(at.quaternion, k));
        let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
        let flip = if self.float(at.pixdim, 0) < 0.0 { -1.0 } else { 1.0 };
        let turn = [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
            [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
            [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ];
        let edges = [edges[0], edges[1], flip * edges[2]];
        std::array::from_fn(|r| {
            std::array::from_fn(|k| match k {
                3 => self.float(at.quaternion, 3 + r),
                _ => turn[r][k] * edges[k],
            })
        })
    }
}

/// Whether a file begins like one of the two versions, not compressed.
pub(super) fn is_head(head: &[u8]) -> bool {
    matches!(
        head,
        [0x5c, 1, 0, 0, ..] | [0, 0, 1, 0x5c, ..] | [0x1c, 2, 0, 0, ..] | [0, 0, 2, 0x1c, ..]
    )
}

/// Reads the header from the start of a stream, with everything up to the numbers.
fn read_header(source: &mut impl Read) -> Result<Header, Fault> {
    let mut bytes = vec![0; 4];
    source.read_exact(&mut bytes).map_err(damage)?;
    let (second, little) = match bytes[..] {
        [0x5c, 1, 0, 0] => (false, true),
        [0, 0, 1, 0x5c] => (false, false),
        [0x1c, 2, 0, 0] => (true, true),
        [0, 0, 2, 0x1c] => (true, false),
        _ => return Err(Fault::corrupt("it does not start with the size of its header")),
    };
    let mut header = Header { bytes, second, little };
    let length = header.places().length;
    header.bytes.resize(length, 0);
    source.read_exact(&mut header.bytes[4..]).map_err(damage)?;
    let magic = if second { &header.bytes[4..8] } else { &header.bytes[344..348] };
    match magic {
        b"n+1\0" | b"n+2\0" => {}
        b"ni1\0" | b"ni2\0" => {
            return Err(Fault::Feature("a header without its voxels (.hdr and .img)".to_owned()));
        }
        _ => return Err(Fault::corrupt("the magic is missing")),
    }
    let offset = match second {
        true => header.whole(SECOND.offset, 0) as f64,
        false => header.number(VoxelType::F32, FIRST.offset),
    };
    if !(offset >= length as f64 && offset <= MAX_HEADER as f64 && offset.fract() == 0.0) {
        return Err(Fault::corrupt(format!("its voxels begin at byte {offset}")));
    }
    let rest = offset as u64 - length as u64;
    let read = source.take(rest).read_to_end(&mut header.bytes)?;
    if read as u64 != rest {
        return Err(Fault::cut_short());
    }
    Ok(header)
}

/// Decodes a stream; `possible` is how many bytes it can have at most.
pub(super) fn decode(
    mut source: impl Read,
    possible: u64,
    budget: &Budget,
) -> Result<Volume, Fault> {
    let header = read_header(&mut source)?;
    let (voxel, scaling) = (header.voxel()?, header.scaling());
    let (shape, channels) = header.shape()?;
    let [x, y, z] = shape.map(|n| n as u64);
    let count = budget.samples(x, y.saturating_mul(z), channels)?;
    if count as u64 * voxel.bytes() as u64 > possible {
        return Err(Fault::corrupt("its header promises more voxels than it can hold"));
    }
    let mut data = zeros(count)?;
    let coding = Coding { sample: voxel, little: header.little, scaling };
    let channels = channels as usize;
    numbers::read(&mut source, coding, &Order::planar(shape, channels), &mut data)?;
    let mut volume = Volume::new(shape, channels, data)?;
    let (map, placed) = header.affine();
    affine::check(&map).map_err(Fault::corrupt)?;
    (volume.affine, volume.placed) = (map, placed);
    (volume.voxel, volume.scaling, volume.header) = (voxel, scaling, Some(header.bytes));
    Ok(volume)
}

/// Writes a volume; with the header it was read with, if there is one and the size is still the same. Returns how
/// many values were clipped.
pub(super) fn encode(
    volume: &Volume,
    voxel: VoxelType,
    target: &mut impl Write,
) -> Result<usize, Fault> {
    let mut header = match own_header(volume) {
        Some(header) => header,
        None => new_header(volume)?,
    };
    // Another number type has no use for the old one's scaling.
    let scaling = if voxel == volume.voxel { volume.scaling } else { Scaling::IDENTITY };
    let at = header.places();
    let code = TYPES.iter().find(|(_, t)| *t == voxel).map_or(0, |(code, _)| *code);
    header.put(VoxelType::I16, at.datatype, code as f64);
    header.put(VoxelType::I16, at.datatype + 2, 8.0 * voxel.bytes() as f64);
    if scaling != header.scaling() {
        header.put_float(at.slope, 0, scaling.slope);
        header.put_float(at.slope, 1, scaling.intercept);
    }
    target.write_all(&header.bytes)?;
    let coding = Coding { sample: voxel, little: header.little, scaling };
    let order = Order::planar(volume.shape, volume.channels);
    numbers::write(&volume.data, coding, &order, target)
}

fn own_header(volume: &Volume) -> Option<Header> {
    let header = read_header(&mut volume.header.as_deref()?).ok()?;
    let same =
        header.shape().is_ok_and(|(shape, n)| (shape, n) == (volume.shape, volume.channels as u64));
    (same && header.affine().0 == volume.affine).then_some(header)
}

/// A header of the first version; sizes beyond 32,767 take the second.
fn new_header(volume: &Volume) -> Result<Header, Fault> {
    let axes = [volume.shape[0], volume.shape[1], volume.shape[2], volume.channels];
    let second = axes.iter().any(|n| *n > 32_767);
    let at = if second { &SECOND } else { &FIRST };
    let start = if second { 544 } else { 352 };
    let mut header = Header { bytes: vec![0; start], second, little: true };
    header.put(VoxelType::I32, 0, at.length as f64);
    match second {
        true => header.bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n"),
        false => header.bytes[344..348].copy_from_slice(b"n+1\0"),
    }
    let count = if volume.channels > 1 { 4 } else { 3 };
    let sizes = [count].into_iter().chain(axes).chain([1; 3]);
    for (k, n) in sizes.enumerate() {
        match second {
            true => header.bytes[at.dim + 8 * k..][..8].copy_from_slice(&(n as i64).to_le_bytes()),
            false => header.put(VoxelType::I16, at.dim + 2 * k, n as f64),
        }
    }
    let size = volume.voxel_size();
    for (k, edge) in [1.0, size[0], size[1], size[2], 1.0].into_iter().enumerate() {
        header.put_float(at.pixdim, k, edge);
    }
    match second {
        true => {
            header.bytes[at.offset..at.offset + 8].copy_from_slice(&(start as i64).to_le_bytes())
        }
        false => header.put(VoxelType::F32, at.offset, start as f64),
    }
    header.put_float(at.slope, 0, 1.0);
    header.bytes[at.units] = 2;
    if volume.placed {
        // The place in scanner coordinates.
        match second {
            true => header.put(VoxelType::I32, at.qform + 4, 1.0),
            false => header.put(VoxelType::I16, at.qform + 2, 1.0),
        }
        for (k, value) in volume.affine.iter().flatten().enumerate() {
            header.put_float(at.rows, k, *value);
        }
    }
    Ok(header)
}
