//! Volumes as NumPy arrays with axes (Z, Y, X) or (Z, Y, X, C), numbers as they are.

use std::io::Write;

use super::Volume;
use super::numbers::{self, Axis, Coding, Order};
use super::voxel_type::{Scaling, VoxelType};
use crate::budget::{Budget, zeros};
use crate::codec::npy;
use crate::error::Fault;

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Volume, Fault> {
    let (header, mut body) = npy::split_header(bytes)?;
    let (shape, channels) = match header.shape[..] {
        [z, y, x] => ([x, y, z], 1),
        [z, y, x, c] => ([x, y, z], c),
        _ => {
            let what = format!("shape {:?} (a volume is (Z, Y, X) or (Z, Y, X, C))", header.shape);
            return Err(Fault::Feature(what));
        }
    };
    let (little, voxel) = number_type(&header.descr)?;
    let [x, y, z] = shape;
    let count = budget.samples(x, y.saturating_mul(z), channels)?;
    if body.len() as u64 != count as u64 * voxel.bytes() as u64 {
        return Err(Fault::cut_short());
    }
    let (shape, channels) = (shape.map(|n| n as usize), channels as usize);
    let order = match header.fortran_order {
        false => Order::interleaved(shape, channels),
        true => {
            let axes = [Axis::Space(2), Axis::Space(1), Axis::Space(0), Axis::Channel];
            Order::new(shape, channels, &axes)
        }
    };
    let mut data = zeros(count)?;
    let coding = Coding { sample: voxel, little, scaling: Scaling::IDENTITY };
    numbers::read(&mut body, coding, &order, &mut data)?;
    let mut volume = Volume::new(shape, channels, data)?;
    volume.voxel = voxel;
    Ok(volume)
}

/// Byte order and type of a NumPy description such as `<u2`.
fn number_type(descr: &str) -> Result<(bool, VoxelType), Fault> {
    let known = [
        ("u1", VoxelType::U8),
        ("i1", VoxelType::I8),
        ("u2", VoxelType::U16),
        ("i2", VoxelType::I16),
        ("u4", VoxelType::U32),
        ("i4", VoxelType::I32),
        ("f4", VoxelType::F32),
        ("f8", VoxelType::F64),
    ];
    let find = |name: &str| known.iter().find(|(n, _)| *n == name).map(|(_, voxel)| *voxel);
    match (descr.get(..1), descr.get(1..).and_then(find)) {
        (Some("<" | "|" | "="), Some(voxel)) => Ok((true, voxel)),
        (Some(">"), Some(voxel)) => Ok((false, voxel)),
        _ => Err(Fault::Feature(format!("numbers of type {descr:?}"))),
    }
}

pub(super) fn encode(
    volume: &Volume,
    voxel: VoxelType,
    target: &mut impl Write,
) -> Result<usize, Fault> {
    let kind = match voxel {
        VoxelType::U8 => "|u1",
        VoxelType::I8 => "|i1",
        VoxelType::U16 => "<u2",
        VoxelType::I16 => "<i2",
        VoxelType::U32 => "<u4",
        VoxelType::I32 => "<i4",
        VoxelType::F32 => "<f4",
        VoxelType::F64 => "<f8",
    };
    let [x, y, z] = volume.shape;
    let shape = if volume.channels > 1 { vec![z, y, x, volume.channels] } else { vec![z, y, x] };
    npy::write_header(kind, &shape, target)?;
    let coding = Coding { sample: voxel, little: true, scaling: Scaling::IDENTITY };
    numbers::write(&volume.data, coding, &Order::interleaved(volume.shape, volume.channels), target)
}
