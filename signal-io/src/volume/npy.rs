//! NumPy arrays (Z, Y, X) and (Z, Y, X, C).

use std::io::Write;

use super::VoxelType;
use super::numbers::{self, Axis, Coding, Order};
use crate::Volume;
use crate::budget::{Budget, zeros};
use crate::codec::npy::{split_header, write_header};
use crate::error::Fault;

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Volume, Fault> {
    let (header, mut body) = split_header(bytes)?;
    let (z, y, x, channels) = match header.shape[..] {
        [z, y, x] => (z, y, x, 1),
        [z, y, x, c] => (z, y, x, c),
        _ => {
            let what = format!("shape {:?} (a volume is (Z, Y, X) or (Z, Y, X, C))", header.shape);
            return Err(Fault::Feature(what));
        }
    };
    let (sample, little) = number_type(&header.descr)?;
    let count = budget.samples(x.saturating_mul(y), z, channels)?;
    if body.len() as u64 != (count as u64).saturating_mul(sample.bytes() as u64) {
        let n = body.len();
        return Err(Fault::corrupt(format!("{count} numbers of type {sample} in {n} bytes")));
    }
    let shape = [x, y, z].map(|n| n as usize);
    let order = match header.fortran_order {
        false => Order::interleaved(shape, channels as usize),
        true => {
            let axes = [Axis::Space(2), Axis::Space(1), Axis::Space(0), Axis::Channel];
            Order::new(shape, channels as usize, &axes)
        }
    };
    let mut data = zeros(count)?;
    let scaling = super::Scaling::IDENTITY;
    numbers::read(&mut body, Coding { sample, little, scaling }, &order, &mut data)?;
    let mut volume = Volume::new(shape, channels as usize, data)?;
    volume.voxel_type = sample;
    volume.length_unit = super::LengthUnit::Unknown;
    Ok(volume)
}

/// The number type and whether it is little-endian.
fn number_type(descr: &str) -> Result<(VoxelType, bool), Fault> {
    let unknown = || {
        let what =
            format!("numbers of type {descr:?} (u1, i1, u2, i2, u4, i4, f4 and f8 are read)");
        Fault::Feature(what)
    };
    let (little, kind) = match descr.split_at_checked(1).ok_or_else(unknown)? {
        ("<" | "|", kind) => (true, kind),
        (">", kind) => (false, kind),
        _ => return Err(unknown()),
    };
    let sample = match kind {
        "u1" | "b1" => VoxelType::U8,
        "i1" => VoxelType::I8,
        "u2" => VoxelType::U16,
        "i2" => VoxelType::I16,
        "u4" => VoxelType::U32,
        "i4" => VoxelType::I32,
        "f4" => VoxelType::F32,
        "f8" => VoxelType::F64,
        _ => return Err(unknown()),
    };
    Ok((sample, little))
}

pub(super) fn encode(volume: &Volume, coding: Coding, w: &mut impl Write) -> Result<usize, Fault> {
    let descr = match coding.sample {
        VoxelType::U8 => "|u1",
        VoxelType::I8 => "|i1",
        VoxelType::U16 => "<u2",
        VoxelType::I16 => "<i2",
        VoxelType::U32 => "<u4",
        VoxelType::I32 => "<i4",
        VoxelType::F32 => "<f4",
        VoxelType::F64 => "<f8",
    };
    let ([x, y, z], channels) = (volume.shape(), volume.channels());
    let shape = [z, y, x, channels];
    write_header(descr, if channels == 1 { &shape[..3] } else { &shape }, w)?;
    numbers::write(volume.as_planar(), coding, &Order::interleaved(volume.shape(), channels), w)
}
