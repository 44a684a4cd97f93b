//! The safetensors format: a header in JSON, then the numbers of all tensors without gaps.

use std::collections::BTreeMap;

use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use serde_json::{Map, Value, json};

use crate::network::Tensor;
use crate::{Error, Result};

/// Bytes of the header's length at the beginning of a file.
const PREFIX: usize = 8;

/// The longest header that readers of the format accept, in bytes.
const LONGEST_HEADER: usize = 100_000_000;

/// A tensor to write: its name in the file, its place in a buffer, and the buffer.
pub(super) struct Entry<'a> {
    pub name: String,
    pub tensor: &'a Tensor,
    pub flat: &'a [f32],
}

/// A file with these tensors in this order.
///
/// The header is written here and not by the `safetensors` crate, because that one keeps metadata in a
/// hash map: the same checkpoint would be other bytes each time.
pub(super) fn write(metadata: BTreeMap<String, String>, entries: &[Entry<'_>]) -> Result<Vec<u8>> {
    let mut header = Map::new();
    header.insert("__metadata__".into(), json!(metadata));
    let mut end = 0;
    for Entry { name, tensor, .. } in entries {
        let begin = end;
        end += tensor.len() * size_of::<f32>();
        let shape = tensor.shape.clone();
        let info = TensorInfo { dtype: Dtype::F32, shape, data_offsets: (begin, end) };
        header.insert(name.clone(), json!(info));
    }
    let mut header = Value::Object(header).to_string().into_bytes();
    // Readers may map the file into memory; so the numbers begin at a multiple of their size.
    header.resize(header.len().next_multiple_of(PREFIX), b' ');
    if header.len() > LONGEST_HEADER {
        let reason = format!("{} bytes of text, {LONGEST_HEADER} fit", header.len());
        return Err(Error::CheckpointEntry { entry: "__metadata__".into(), reason });
    }
    let mut bytes = Vec::with_capacity(PREFIX + header.len() + end);
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header);
    for Entry { tensor, flat, .. } in entries {
        tensor.values(flat).for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    Ok(bytes)
}

/// A file whose header was read and found to fit its length.
pub(super) struct Container<'a> {
    metadata: Metadata,
    data: &'a [u8],
}

impl<'a> Container<'a> {
    pub fn read(bytes: &'a [u8]) -> Result<Self> {
        let bad = |reason: String| Error::NotSafetensors { reason };
        let short = || bad(format!("it ends after {} bytes, within its header", bytes.len()));
        let (prefix, rest) = bytes.split_first_chunk::<PREFIX>().ok_or_else(short)?;
        let length = u64::from_le_bytes(*prefix);
        if length > LONGEST_HEADER as u64 {
            return Err(bad(format!("a header of {length} bytes")));
        }
        let (header, data) = rest.split_at_checked(length as usize).ok_or_else(short)?;
        let metadata: Metadata =
            serde_json::from_slice(header).map_err(|e| bad(format!("its header: {e}")))?;
        // `SafeTensors::deserialize` adds to this length before it compares, which can overflow.
        if metadata.data_len() != data.len() {
            let (expected, found) = (metadata.data_len(), data.len());
            return Err(bad(format!("{found} bytes of numbers instead of {expected}")));
        }
        Ok(Self { metadata, data })
    }

    /// A text of the metadata.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.metadata.metadata().as_ref()?.get(key).map(String::as_str)
    }

    /// Names and shapes in the order of the file.
    pub fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        let names = self.metadata.offset_keys().into_iter();
        names.filter_map(|name| Some((name.clone(), self.shape(&name)?.to_vec()))).collect()
    }

    /// The shape of a tensor, if there is one of that name.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        Some(&self.metadata.info(name)?.shape)
    }

    /// Fails if there is no tensor of that name and shape.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<()> {
        match self.shape(name) {
            None => Err(Error::TensorMissing { name: name.into() }),
            Some(found) if found != shape => {
                let (expected, found) = (shape.to_vec(), found.to_vec());
                Err(Error::TensorShape { name: name.into(), expected, found })
            }
            Some(_) => Ok(()),
        }
    }

    /// The numbers of a tensor, row by row. Half and double precision are converted; what `f32` cannot
    /// hold is an error, as is everything that is not finite.
    pub fn values(&self, name: &str) -> Result<Vec<f32>> {
        let missing = || Error::TensorMissing { name: name.into() };
        let info = self.metadata.info(name).ok_or_else(missing)?;
        let bytes = &self.data[info.data_offsets.0..info.data_offsets.1];
        let values: Vec<f32> = match info.dtype {
            Dtype::F32 => numbers(bytes, f32::from_le_bytes),
            Dtype::F64 => numbers(bytes, |b| f64::from_le_bytes(b) as f32),
            Dtype::F16 => numbers(bytes, |b| half(u16::from_le_bytes(b))),
            // The upper half of an f32.
            Dtype::BF16 => numbers(bytes, |[a, b]| f32::from_le_bytes([0, 0, a, b])),
            other => {
                return Err(Error::TensorType { name: name.into(), found: format!("{other:?}") });
            }
        };
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::TensorValues { name: name.into(), rule: "finite" });
        }
        Ok(values)
    }

    /// The numbers of a tensor that must be `f32`, so that what was written comes back bit for bit.
    pub fn exact_values(&self, name: &str) -> Result<Vec<f32>> {
        match self.metadata.info(name) {
            Some(info) if info.dtype != Dtype::F32 => {
                Err(Error::TensorType { name: name.into(), found: format!("{:?}", info.dtype) })
            }
            _ => self.values(name),
        }
    }
}

/// Numbers of `N` bytes each.
fn numbers<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|b| number(*b)).collect()
}

/// A number of 16 bits, IEEE 754 binary16: every one is an `f32` as well.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from((bits >> 10) & 31), f32::from(bits & 1023));
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2f32.powi(exponent - 25),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// IEEE 754-2019, table 3.5 and section 3.4: ends of the ranges, and a third.
    #[test]
    fn half_precision_has_the_values_of_the_standard() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x0001, 2f32.powi(-24)),
            (0x03ff, 1023.0 / 1024.0 * 2f32.powi(-14)),
            (0x0400, 2f32.powi(-14)),
            (0x3555, 0.333_251_95),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(half(bits), value, "{bits:#06x}");
        }
        assert_eq!(half(0x8000).to_bits(), (-0.0f32).to_bits());
        assert!(half(0x7e00).is_nan());
        assert!((0..0x7c00).all(|b| half(b) < half(b + 1)));
    }

    /// Sizes that add up to 2^64: a sum in the reader that wraps would leave the file.
    #[test]
    fn sizes_beyond_the_range_of_numbers_are_an_error() {
        let step = (1u64 << 61) - 8;
        let mut header = Map::new();
        for k in 0..8 {
            let range = [k * step, (k + 1) * step];
            header.insert(
                format!("t{k}"),
                json!({"dtype": "U8", "shape": [step], "data_offsets": range}),
            );
        }
        let header = Value::Object(header).to_string();
        for padding in [0, 1, 40, 56, 64, 72] {
            let mut bytes = (header.len() as u64 + padding).to_le_bytes().to_vec();
            bytes.extend(header.bytes());
            bytes.extend(std::iter::repeat_n(b' ', padding as usize));
            assert!(matches!(Container::read(&bytes), Err(Error::NotSafetensors { .. })));
        }
    }
}
