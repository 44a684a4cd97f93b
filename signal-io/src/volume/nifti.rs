//! NIfTI-1 and NIfTI-2 with header and data in one file, plain or gzip.

mod header;

use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;

use self::header::{Header, word};
use super::affine::{self, Affine};
use super::numbers::{self, Coding, Order};
use super::{LengthUnit, Scaling, VoxelType};
use crate::Volume;
use crate::budget::{Budget, check_plausible, zeros};
use crate::error::Fault;

/// What deflate can do at best: 1032 zeros in a byte.
pub(super) const DEFLATE_RATIO: u64 = 1032;

/// More than any extension is long that has been seen; the bytes before the data may be compressed.
const MAX_EXTENSIONS: u64 = 64 << 20;

/// The code of a vector in every voxel, its components along the fifth axis.
const INTENT_VECTOR: i64 = 1007;

/// What a volume from NIfTI carries back to NIfTI.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Extra {
    header: Header,
    /// The map that the header means: while it is the volume's, the header's fields stay as they are.
    affine: Affine,
    /// Code and content of the header's extensions, for example XML.
    extensions: Vec<(u32, Vec<u8>)>,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Volume, Fault> {
    let compressed = bytes.starts_with(&[0x1f, 0x8b]);
    let mut source: Box<dyn Read> =
        if compressed { Box::new(MultiGzDecoder::new(bytes)) } else { Box::new(bytes) };
    let mut head = [0; 4];
    source.read_exact(&mut head).map_err(numbers::damage)?;
    let (second, little) = Header::kind(&head)?;
    let size = Header::bytes(second);
    let mut block = vec![0; size];
    block[..4].copy_from_slice(&head);
    source.read_exact(&mut block[4..]).map_err(numbers::damage)?;
    let header = Header::parse(&block, second, little)?;

    let (shape, outer) = sizes(&header)?;
    let (sample, components) = number_type(header.datatype)?;
    let channels = outer.saturating_mul(components);
    let [x, y, z] = shape;
    let count = budget.samples(x.saturating_mul(y), z, channels)?;
    let promised = (count as u64).saturating_mul(sample.bytes() as u64);
    match compressed {
        true => check_plausible(promised, bytes.len(), DEFLATE_RATIO)?,
        false if promised > bytes.len() as u64 => return Err(Fault::cut_short()),
        false => {}
    }

    let extensions = read_extensions(&mut source, &header, size, little)?;
    let (unit, affine) = geometry(&header);
    let shape = shape.map(|n| n as usize);
    let order = match components {
        1 => Order::planar(shape, channels as usize),
        // Colours lie side by side, and no other axes are read with them.
        _ if outer == 1 => Order::interleaved(shape, channels as usize),
        _ => return Err(Fault::Feature("a series of colour volumes".to_owned())),
    };
    let scaling = scaling(&header)?;
    let mut data = zeros(count)?;
    numbers::read(&mut source, Coding { sample, little, scaling }, &order, &mut data)?;

    let volume = Volume::new(shape, channels as usize, data)?;
    let mut volume = volume.with_affine(affine).map_err(bad_place)?;
    (volume.voxel_type, volume.scaling, volume.length_unit) = (sample, scaling, unit);
    volume.description = String::from_utf8_lossy(&header.descrip).into_owned();
    volume.kept.oriented = header.sform_code > 0 || header.qform_code > 0;
    volume.kept.nifti = Some(Box::new(Extra { header, affine, extensions }));
    Ok(volume)
}

/// A map that the volume refuses is a fault of its file.
pub(super) fn bad_place(error: crate::Error) -> Fault {
    Fault::corrupt(error.to_string())
}

/// Voxels along x, y and z, and the product of all other axes.
fn sizes(header: &Header) -> Result<([u64; 3], u64), Fault> {
    let axes = header.dim[0];
    if !(1..=7).contains(&axes) {
        return Err(Fault::corrupt(format!("{axes} axes")));
    }
    let size = |d: usize| match header.dim[d] {
        _ if d as i64 > axes => Ok(1),
        n if n < 0 => Err(Fault::corrupt(format!("{n} samples along axis {d}"))),
        n => Ok(n as u64),
    };
    let mut outer = 1u64;
    for d in 4..8 {
        outer = outer.saturating_mul(size(d)?);
    }
    Ok(([size(1)?, size(2)?, size(3)?], outer))
}

/// The number type and how many of these numbers a voxel has.
fn number_type(code: i64) -> Result<(VoxelType, u64), Fault> {
    Ok(match code {
        2 => (VoxelType::U8, 1),
        4 => (VoxelType::I16, 1),
        8 => (VoxelType::I32, 1),
        16 => (VoxelType::F32, 1),
        64 => (VoxelType::F64, 1),
        128 => (VoxelType::U8, 3),
        256 => (VoxelType::I8, 1),
        512 => (VoxelType::U16, 1),
        768 => (VoxelType::U32, 1),
        2304 => (VoxelType::U8, 4),
        other => return Err(Fault::Feature(format!("numbers of type {other}"))),
    })
}

fn type_code(sample: VoxelType) -> i64 {
    match sample {
        VoxelType::U8 => 2,
        VoxelType::I16 => 4,
        VoxelType::I32 => 8,
        VoxelType::F32 => 16,
        VoxelType::F64 => 64,
        VoxelType::I8 => 256,
        VoxelType::U16 => 512,
        VoxelType::U32 => 768,
    }
}

/// A slope of 0 means that there is no scaling; other programs write NaN for that.
fn scaling(header: &Header) -> Result<Scaling, Fault> {
    let (slope, intercept) = (header.slope, header.intercept);
    if slope == 0.0 || slope.is_nan() {
        return Ok(Scaling::IDENTITY);
    }
    let scaling = Scaling { slope, intercept };
    match scaling.is_valid() {
        true => Ok(scaling),
        false => Err(Fault::corrupt(format!("a scaling by {slope} and {intercept}"))),
    }
}

/// The unit of lengths and the map to millimetres: the affine where there is one, else the rotation,
/// else the voxel sizes alone.
fn geometry(header: &Header) -> (LengthUnit, Affine) {
    let unit = match header.units & 7 {
        1 => LengthUnit::Metre,
        2 => LengthUnit::Millimetre,
        3 => LengthUnit::Micrometre,
        _ => LengthUnit::Unknown,
    };
    let map = match (header.sform_code > 0, header.qform_code > 0) {
        (true, _) => header.rows,
        (false, true) => rotation(header),
        (false, false) => affine::diagonal(voxel_size(header)),
    };
    (unit, map.map(|row| row.map(|v| v * unit.millimetres())))
}

/// Unset sizes count as 1, signs of sizes mean nothing.
fn voxel_size(header: &Header) -> [f64; 3] {
    std::array::from_fn(|d| match header.pixdim[d + 1].abs() {
        0.0 => 1.0,
        size => size,
    })
}

/// Method 2 of the standard: a unit quaternion, a reflection of the third axis, and an offset.
fn rotation(header: &Header) -> Affine {
    let [b, c, d, offset @ ..] = header.quaternion;
    let squared = b * b + c * c + d * d;
    // Rounded to f32, the three may be longer than 1: then the rotation is by 180 degrees.
    let (a, [b, c, d]) = match squared < 1.0 {
        true => ((1.0 - squared).sqrt(), [b, c, d]),
        false => (0.0, [b, c, d].map(|v| v / squared.sqrt())),
    };
    let rows = [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
        [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
        [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
    ];
    let mut size = voxel_size(header);
    if header.pixdim[0] < 0.0 {
        size[2] = -size[2];
    }
    std::array::from_fn(|r| {
        std::array::from_fn(|c| if c == 3 { offset[r] } else { rows[r][c] * size[c] })
    })
}

/// Reads up to the first number and returns the extensions found on the way.
fn read_extensions(
    source: &mut impl Read,
    header: &Header,
    size: usize,
    little: bool,
) -> Result<Vec<(u32, Vec<u8>)>, Fault> {
    // Some programs leave the field empty: right after the header and its flag for extensions.
    let offset = if header.vox_offset == 0.0 { size as f64 + 4.0 } else { header.vox_offset };
    if !(offset >= size as f64 && offset.fract() == 0.0) {
        return Err(Fault::corrupt(format!("its data begin at byte {offset}")));
    }
    let length = offset as u64 - size as u64;
    if length > MAX_EXTENSIONS {
        return Err(Fault::Feature(format!("{length} bytes between header and data")));
    }
    let mut block = Vec::new();
    source.take(length).read_to_end(&mut block).map_err(numbers::damage)?;
    if block.len() as u64 != length {
        return Err(Fault::cut_short());
    }
    let mut extensions = Vec::new();
    let mut rest = match block.split_at_checked(4) {
        Some(([flag, ..], rest)) if *flag != 0 => rest,
        _ => return Ok(extensions),
    };
    // What is no extension is padding.
    while rest.len() >= 8 {
        let length = word(&rest[..4], little) as usize;
        if !(8..=rest.len()).contains(&length) {
            break;
        }
        extensions.push((word(&rest[4..8], little) as u32, rest[8..length].to_vec()));
        rest = &rest[length..];
    }
    Ok(extensions)
}

/// Whether a volume is written as NIfTI-2.
pub(super) fn is_second(volume: &Volume, wanted: bool) -> bool {
    let was = volume.kept.nifti.as_ref().is_some_and(|extra| extra.header.second);
    wanted || was || volume.shape().iter().any(|n| *n > i16::MAX as usize)
}

pub(super) fn encode(
    volume: &Volume,
    coding: Coding,
    second: bool,
    compress: bool,
    w: &mut impl Write,
) -> Result<usize, Fault> {
    if !compress {
        return encode_plain(volume, coding, second, w);
    }
    let mut gzip = GzEncoder::new(w, Compression::default());
    let clipped = encode_plain(volume, coding, second, &mut gzip)?;
    gzip.finish()?;
    Ok(clipped)
}

fn encode_plain(
    volume: &Volume,
    coding: Coding,
    second: bool,
    w: &mut impl Write,
) -> Result<usize, Fault> {
    let header = new_header(volume, coding, is_second(volume, second));
    let mut block = vec![0; 4];
    for (code, content) in volume.kept.nifti.iter().flat_map(|extra| &extra.extensions) {
        block[0] = 1;
        let length = (content.len() + 8).next_multiple_of(16);
        block.extend((length as u32).to_le_bytes());
        block.extend(code.to_le_bytes());
        block.extend(content);
        block.resize(block.len() + length - 8 - content.len(), 0);
    }
    // The data shall begin at a multiple of 16.
    let size = Header::bytes(header.second);
    block.resize((size + block.len()).next_multiple_of(16) - size, 0);
    w.write_all(&header.to_bytes(size + block.len(), 8 * coding.sample.bytes()))?;
    w.write_all(&block)?;
    numbers::write(volume.as_planar(), coding, &Order::planar(volume.shape(), volume.channels()), w)
}

fn new_header(volume: &Volume, coding: Coding, second: bool) -> Header {
    let extra = volume.kept.nifti.as_deref();
    let mut header = extra.map(|e| e.header.clone()).unwrap_or_default();
    header.second = second;
    let [x, y, z] = volume.shape().map(|n| n as i64);
    let channels = volume.channels() as i64;
    let is_series = sizes(&header).is_ok_and(|(_, outer)| outer == channels as u64);
    let dim = match channels {
        _ if is_series => {
            // Axes that the header leaves out have one sample.
            let known = header.dim[0];
            let size = |d: usize| if d as i64 <= known { header.dim[d] } else { 1 };
            [known.max(3), x, y, z, size(4), size(5), size(6), size(7)]
        }
        1 => [3, x, y, z, 1, 1, 1, 1],
        _ => {
            header.intent_code = INTENT_VECTOR;
            [5, x, y, z, 1, channels, 1, 1]
        }
    };
    header.dim = dim;
    header.datatype = type_code(coding.sample);
    (header.slope, header.intercept) = (coding.scaling.slope, coding.scaling.intercept);
    // 79 bytes and a zero, but no part of a character.
    let text = &volume.description;
    let end = (0..=text.len().min(79)).rev().find(|end| text.is_char_boundary(*end));
    header.descrip = text.as_bytes()[..end.unwrap_or(0)].to_vec();
    if extra
        .is_none_or(|e| e.affine != volume.affine || geometry(&e.header).0 != volume.length_unit)
    {
        set_geometry(&mut header, volume);
    }
    header
}

/// The volume's place as an affine; the rotation, which cannot hold every map, is left empty.
fn set_geometry(header: &mut Header, volume: &Volume) {
    let unit = volume.length_unit;
    let code = match unit {
        LengthUnit::Unknown => 0,
        LengthUnit::Metre => 1,
        LengthUnit::Millimetre => 2,
        LengthUnit::Micrometre => 3,
    };
    header.units = header.units & !7 | code;
    header.rows = volume.affine.map(|row| row.map(|v| v / unit.millimetres()));
    let size = volume.voxel_size().map(|s| s / unit.millimetres());
    header.pixdim[0] = 1.0;
    header.pixdim[1..4].copy_from_slice(&size);
    for value in &mut header.pixdim[4..] {
        *value = if *value == 0.0 { 1.0 } else { *value };
    }
    header.quaternion = [0.0; 6];
    header.qform_code = 0;
    // Code 1: some scanner. Without any code a reader would see the sizes only.
    let plain = volume.affine == affine::diagonal(volume.voxel_size()) && !volume.kept.oriented;
    header.sform_code = if plain { 0 } else { header.sform_code.max(1) };
}
