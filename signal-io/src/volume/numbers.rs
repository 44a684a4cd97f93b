//! Streams of numbers in any order of axes to planes of values, and back.

use std::io::{ErrorKind, Read, Write};

use super::voxel_type::{Scaling, VoxelType};
use crate::error::Fault;

/// Bytes converted at once: a multiple of every number's size that stays in the cache.
const BLOCK: usize = 1 << 15;

/// Where the numbers of a file belong: sizes of its axes, the fastest first, and how far apart their
/// neighbours are in the planes.
pub(super) struct Order {
    axes: Vec<(usize, usize)>,
}

/// The axes a volume has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// X, Y or Z.
    Space(usize),
    /// The planes.
    Channel,
}

impl Order {
    /// The given axes, the fastest first; those left out have one sample.
    pub(super) fn new(shape: [usize; 3], channels: usize, axes: &[Axis]) -> Self {
        let [x, y, z] = shape;
        let of = |axis: &Axis| match axis {
            Axis::Space(0) => (x, 1),
            Axis::Space(1) => (y, x),
            Axis::Space(_) => (z, x * y),
            Axis::Channel => (channels, x * y * z),
        };
        Self { axes: axes.iter().map(of).collect() }
    }

    /// Plane after plane, as in memory.
    pub(super) fn planar(shape: [usize; 3], channels: usize) -> Self {
        use Axis::{Channel, Space};
        Self::new(shape, channels, &[Space(0), Space(1), Space(2), Channel])
    }

    /// The channels of a voxel side by side.
    pub(super) fn interleaved(shape: [usize; 3], channels: usize) -> Self {
        use Axis::{Channel, Space};
        Self::new(shape, channels, &[Channel, Space(0), Space(1), Space(2)])
    }

    /// Positions in the planes, in the order of the file.
    fn positions(&self) -> Positions<'_> {
        Positions { axes: &self.axes, index: vec![0; self.axes.len()], at: 0 }
    }

    fn count(&self) -> usize {
        self.axes.iter().map(|(size, _)| size).product()
    }
}

struct Positions<'a> {
    axes: &'a [(usize, usize)],
    index: Vec<usize>,
    at: usize,
}

impl Positions<'_> {
    /// The current position; moves on to the next one.
    fn take(&mut self) -> usize {
        let at = self.at;
        for (index, (size, stride)) in self.index.iter_mut().zip(self.axes) {
            *index += 1;
            self.at += stride;
            if *index < *size {
                break;
            }
            self.at -= *size * stride;
            *index = 0;
        }
        at
    }
}

/// How numbers are stored and what they mean.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coding {
    pub(super) sample: VoxelType,
    pub(super) little: bool,
    pub(super) scaling: Scaling,
}

/// Fills the planes from a source in memory, which must end after the last number.
pub(super) fn read(
    source: &mut impl Read,
    coding: Coding,
    order: &Order,
    data: &mut [f32],
) -> Result<(), Fault> {
    let mut positions = order.positions();
    let mut left = order.count() as u64 * coding.sample.bytes() as u64;
    let mut block = vec![0; left.min(BLOCK as u64) as usize];
    while left > 0 {
        let part = &mut block[..left.min(BLOCK as u64) as usize];
        source.read_exact(part).map_err(damage)?;
        coding.sample.decode(part, coding.little, |number| {
            data[positions.take()] = coding.scaling.to_value(number);
        });
        left -= part.len() as u64;
    }
    expect_end(source)
}

/// The same for numbers written as text.
pub(super) fn read_text(bytes: &[u8], order: &Order, data: &mut [f32]) -> Result<(), Fault> {
    let mut positions = order.positions();
    let text =
        std::str::from_utf8(bytes).map_err(|_| Fault::corrupt("its numbers are not text"))?;
    let mut words = text.split([' ', '\t', '\n', '\r', ',']).filter(|w| !w.is_empty());
    for _ in 0..order.count() {
        let word = words.next().ok_or_else(Fault::cut_short)?;
        let number: f64 = word.parse().map_err(|_| {
            Fault::corrupt(format!(
                "{:?} is not a number",
                word.chars().take(40).collect::<String>()
            ))
        })?;
        data[positions.take()] = number as f32;
    }
    match words.next() {
        None => Ok(()),
        Some(_) => Err(Fault::corrupt("there are more numbers than its header says")),
    }
}

/// Refuses bytes after the data. At the end of a gzip stream this also compares its checksum.
fn expect_end(source: &mut impl Read) -> Result<(), Fault> {
    match source.read(&mut [0]).map_err(damage)? {
        0 => Ok(()),
        _ => Err(Fault::corrupt("there are more bytes than its header says")),
    }
}

/// Sources are bytes in memory, plain or compressed: what fails is their content.
pub(super) fn damage(error: std::io::Error) -> Fault {
    match error.kind() {
        ErrorKind::UnexpectedEof => Fault::cut_short(),
        _ => Fault::corrupt(error.to_string()),
    }
}

/// Writes the planes; returns how many values were clipped.
pub(super) fn write(
    data: &[f32],
    coding: Coding,
    order: &Order,
    target: &mut impl Write,
) -> Result<usize, Fault> {
    let mut positions = order.positions();
    let mut clipped = 0;
    let mut block = Vec::with_capacity(BLOCK + 8);
    for _ in 0..order.count() {
        let number = coding.scaling.to_number(data[positions.take()]);
        let (number, clip) = coding.sample.quantize(number);
        clipped += usize::from(clip);
        coding.sample.encode(number, coding.little, &mut block);
        if block.len() >= BLOCK {
            target.write_all(&block)?;
            block.clear();
        }
    }
    target.write_all(&block)?;
    Ok(clipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_of_axes_round_trips() {
        use Axis::{Channel, Space};
        let (shape, channels) = ([3, 4, 5], 2);
        let data: Vec<f32> = (0..120).map(|v| v as f32).collect();
        for axes in [
            [Space(0), Space(1), Space(2), Channel],
            [Channel, Space(0), Space(1), Space(2)],
            [Space(2), Space(1), Space(0), Channel],
            [Channel, Space(2), Space(0), Space(1)],
        ] {
            let order = Order::new(shape, channels, &axes);
            let scaling = Scaling { slope: 0.5, intercept: -7.0 };
            let coding = Coding { sample: VoxelType::I16, little: false, scaling };
            let mut bytes = Vec::new();
            assert_eq!(write(&data, coding, &order, &mut bytes).unwrap(), 0);
            let mut back = vec![0.0; 120];
            read(&mut bytes.as_slice(), coding, &order, &mut back).unwrap();
            assert_eq!(back, data, "{axes:?}");
        }
        let order = Order::interleaved(shape, channels);
        let coding = Coding { sample: VoxelType::U8, little: true, scaling: Scaling::IDENTITY };
        let mut bytes = Vec::new();
        write(&data, coding, &order, &mut bytes).unwrap();
        assert_eq!(bytes[..4], [0, 60, 1, 61]);
    }

    #[test]
    fn ends_must_match() {
        let order = Order::planar([2, 1, 1], 1);
        let coding = Coding { sample: VoxelType::U16, little: true, scaling: Scaling::IDENTITY };
        let mut data = [0.0; 2];
        for n in [0, 3, 5] {
            let result = read(&mut vec![0; n].as_slice(), coding, &order, &mut data);
            assert!(matches!(result, Err(Fault::Corrupt(_))), "{n}");
        }
        for text in ["1", "1 2 3", "1 x", "1 \u{e9}"] {
            let result = read_text(text.as_bytes(), &order, &mut data);
            assert!(matches!(result, Err(Fault::Corrupt(_))), "{text}");
        }
        read_text(b" 1.5,\n-2e3\n", &order, &mut data).unwrap();
        assert_eq!(data, [1.5, -2000.0]);
    }
}
