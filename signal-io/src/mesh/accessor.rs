//! Numbers in buffers: glTF's accessors and buffer views.

use serde::Deserialize;

use crate::budget::with_capacity;
use crate::error::Fault;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    component_type: u32,
    pub(super) count: u64,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde::de::IgnoredAny>,
    #[serde(default)]
    normalized: bool,
}

/// What positions and indices may be made of, by the numbers the format gives them.
const BYTE: u32 = 5121;
const SHORT: u32 = 5123;
const INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// The elements of an accessor: bytes and the distance between their beginnings.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
    count: usize,
}

impl<'a> Elements<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        let (bytes, size) = (self.bytes, self.size);
        (0..self.count).map(move |k| &bytes[k * self.stride..][..size])
    }
}

fn beyond(what: &str, index: usize, count: usize) -> Fault {
    Fault::corrupt(format!("it refers to {what} {index} of {count}"))
}

/// Elements of `size` bytes, all of which are there.
fn elements<'a>(
    accessor: &Accessor,
    views: &[View],
    buffers: &'a [Vec<u8>],
    size: usize,
) -> Result<Elements<'a>, Fault> {
    if accessor.sparse.is_some() {
        return Err(Fault::Feature("sparse accessors".to_owned()));
    }
    let index = accessor.buffer_view;
    let index = index.ok_or_else(|| Fault::Feature("accessors without data".to_owned()))?;
    let view = views.get(index).ok_or_else(|| beyond("buffer view", index, views.len()))?;
    let buffer = buffers.get(view.buffer);
    let buffer = buffer.ok_or_else(|| beyond("buffer", view.buffer, buffers.len()))?;

    let short = || Fault::corrupt("an accessor reaches beyond its buffer");
    let end = view.byte_offset.checked_add(view.byte_length).ok_or_else(short)?;
    let in_view = buffer.get(view.byte_offset as usize..).ok_or_else(short)?;
    if end > buffer.len() as u64 || accessor.byte_offset > view.byte_length {
        return Err(short());
    }
    let bytes = &in_view[accessor.byte_offset as usize..view.byte_length as usize];
    let stride = view.byte_stride.unwrap_or(size as u64);
    if stride < size as u64 {
        return Err(Fault::corrupt(format!("elements of {size} bytes every {stride} bytes")));
    }
    let needed = match accessor.count {
        0 => Some(0),
        n => (n - 1).checked_mul(stride).and_then(|v| v.checked_add(size as u64)),
    };
    match needed.is_some_and(|n| n <= bytes.len() as u64) {
        true => {
            Ok(Elements { bytes, stride: stride as usize, size, count: accessor.count as usize })
        }
        false => Err(short()),
    }
}

/// An accessor of three floats.
pub(super) fn positions(
    accessor: &Accessor,
    views: &[View],
    buffers: &[Vec<u8>],
) -> Result<Vec<[f32; 3]>, Fault> {
    if accessor.component_type != FLOAT || accessor.kind != "VEC3" || accessor.normalized {
        return Err(Fault::Feature(format!(
            "positions of type {} {}",
            accessor.kind, accessor.component_type
        )));
    }
    let elements = elements(accessor, views, buffers, 12)?;
    let mut out = with_capacity(elements.count)?;
    for bytes in elements.iter() {
        let number = |k: usize| f32::from_le_bytes(std::array::from_fn(|i| bytes[4 * k + i]));
        let position = [number(0), number(1), number(2)];
        if position.iter().any(|v| !v.is_finite()) {
            return Err(Fault::corrupt(format!("a vertex at {position:?}")));
        }
        out.push(position);
    }
    Ok(out)
}

/// An accessor of single integers.
pub(super) fn indices(
    accessor: &Accessor,
    views: &[View],
    buffers: &[Vec<u8>],
) -> Result<Vec<u32>, Fault> {
    let size = match (accessor.component_type, accessor.kind.as_str()) {
        (BYTE, "SCALAR") => 1,
        (SHORT, "SCALAR") => 2,
        (INT, "SCALAR") => 4,
        (number, kind) => return Err(Fault::corrupt(format!("indices of type {kind} {number}"))),
    };
    let elements = elements(accessor, views, buffers, size)?;
    let mut out = with_capacity(elements.count)?;
    out.extend(
        elements
            .iter()
            .map(|bytes| bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))),
    );
    Ok(out)
}
