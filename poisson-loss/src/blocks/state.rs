//! The change so far, in a file from which a stopped run goes on.

use std::path::Path;

use super::local::Part;
use super::storage::{BlockSink, BlockSource, PlaneFile};
use super::{Boxed, storage_error};
use crate::Result;

/// Bytes before the planes.
const HEADER: usize = 256;
/// First bytes of the file, with a version.
const MAGIC: &[u8; 16] = b"npsolve blocks 1";

/// The change after the first guess, per channel, and how far the sweeps have come. Any change is a
/// good one to go on from, so it matters little where exactly a run was stopped.
pub struct State<const D: usize> {
    file: PlaneFile<D>,
    /// What the problem looks like, to tell another one.
    name: Vec<u8>,
    pub sweep: usize,
    /// Blocks of the sweep that are done.
    pub block: usize,
    /// Largest change of the sweep so far.
    pub change: f32,
}

impl<const D: usize> State<D> {
    /// Takes up the state of the same problem, or makes a new one.
    pub fn open<const C: usize>(path: &Path, boxed: &Boxed<D>) -> Result<Self> {
        let failed = |e| storage_error("the state file", &e);
        let (shape, name) = (boxed.frame.shape, name(boxed, C));
        if let Ok(mut bytes) = head(path)
            && bytes.starts_with(&name)
        {
            let rest = bytes.split_off(name.len());
            let number = |k: usize| {
                u64::from_le_bytes(rest[8 * k..8 * k + 8].try_into().expect("eight bytes"))
            };
            let file =
                PlaneFile::open_for_writing(path, shape, C, HEADER as u64).map_err(failed)?;
            let (sweep, block) = (number(0) as usize, number(1) as usize);
            let change = f32::from_bits(number(2) as u32);
            return Ok(Self { file, name, sweep, block, change });
        }
        let file = PlaneFile::create(path, shape, C, HEADER as u64).map_err(failed)?;
        let mut state = Self { file, name, sweep: 0, block: 0, change: 0.0 };
        state.keep(0, 0, 0.0)?;
        Ok(state)
    }

    /// Notes how far the sweeps have come.
    pub fn keep(&mut self, sweep: usize, block: usize, change: f32) -> Result<()> {
        (self.sweep, self.block, self.change) = (sweep, block, change);
        let mut bytes = self.name.clone();
        for number in [sweep as u64, block as u64, u64::from(change.to_bits())] {
            bytes.extend(number.to_le_bytes());
        }
        self.file.write_header(&bytes).map_err(|e| storage_error("the state file", &e))
    }

    /// The change of one channel on a part of the box.
    pub fn read(&self, channel: usize, part: &Part<D>) -> Result<Vec<f32>> {
        let mut values = vec![0.0; part.len()];
        let read = self.file.read(channel, part.start, part.shape, &mut values);
        read.map_err(|e| storage_error("the state file", &e))?;
        Ok(values)
    }

    /// Adds to the change of one channel on a part.
    pub fn add(&mut self, channel: usize, part: &Part<D>, values: &[f32]) -> Result<()> {
        let mut sum = self.read(channel, part)?;
        sum.iter_mut().zip(values).for_each(|(s, v)| *s += v);
        let written = self.file.write(channel, part.start, part.shape, &sum);
        written.map_err(|e| storage_error("the state file", &e))
    }
}

/// The first bytes of a file that is there.
fn head(path: &Path) -> std::io::Result<Vec<u8>> {
    use std::io::Read;
    let mut bytes = vec![0; HEADER];
    std::fs::File::open(path)?.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// What must agree for a run to go on: channels, box, blocks and weights.
fn name<const D: usize>(boxed: &Boxed<D>, channels: usize) -> Vec<u8> {
    let mut name = MAGIC.to_vec();
    let mut number = |v: u64| name.extend(v.to_le_bytes());
    number(D as u64);
    number(channels as u64);
    boxed.start.iter().chain(&boxed.frame.shape).for_each(|v| number(*v as u64));
    number(boxed.side as u64);
    number(boxed.coarse.map_or(0, |c| c.step as u64));
    number(boxed.measure.to_bits());
    for v in [boxed.length, boxed.keep.unwrap_or(0.0)] {
        number(u64::from(v.to_bits()));
    }
    // Any two signals will differ in these.
    let fold = |hash: u64, v: &f32| hash.wrapping_mul(0x0100_0000_01B3) ^ u64::from(v.to_bits());
    number(boxed.means.iter().fold(0, fold));
    name
}
