//! The change so far, in a file from which a stopped run goes on.

use std::path::Path;

use super::local::Part;
use super::storage::{BlockSink, BlockSource, PlaneFile};
use super::{Boxed, storage_error};
use crate::Result;

/// Bytes before the planes.
const HEADER: usize = 256;
/// First bytes of the file, with a version.
const MAGIC: &[u8; 16] = b"npsolve blocks 2";

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
    /// That of the last finished sweep; infinite before.
    pub last: f32,
}

impl<const D: usize> State<D> {
    /// Takes up the state of the same problem, or makes a new one.
    pub fn open<const C: usize>(path: &Path, boxed: &Boxed<D>, fingerprint: u64) -> Result<Self> {
        let failed = |e| storage_error("the state file", &e);
        let (shape, name) = (boxed.frame.shape, name(boxed, C, fingerprint));
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
            let [change, last] = [2, 3].map(|k| f32::from_bits(number(k) as u32));
            return Ok(Self { file, name, sweep, block, change, last });
        }
        let file = PlaneFile::create(path, shape, C, HEADER as u64).map_err(failed)?;
        let mut state = Self { file, name, sweep: 0, block: 0, change: 0.0, last: f32::INFINITY };
        state.keep(0, 0.0)?;
        Ok(state)
    }

    /// Notes how many blocks of this sweep are done, and their largest change.
    pub fn keep(&mut self, block: usize, change: f32) -> Result<()> {
        (self.block, self.change) = (block, change);
        let mut bytes = self.name.clone();
        let [change, last] = [self.change, self.last].map(|v| u64::from(v.to_bits()));
        for number in [self.sweep as u64, self.block as u64, change, last] {
            bytes.extend(number.to_le_bytes());
        }
        self.file.write_header(&bytes).map_err(|e| storage_error("the state file", &e))
    }

    /// Notes the end of a sweep with this largest change.
    pub fn end_sweep(&mut self, change: f32) -> Result<()> {
        self.sweep += 1;
        self.last = change;
        self.keep(0, 0.0)
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
fn name<const D: usize>(boxed: &Boxed<D>, channels: usize, fingerprint: u64) -> Vec<u8> {
    let mut name = MAGIC.to_vec();
    let mut number = |v: u64| name.extend(v.to_le_bytes());
    number(D as u64);
    number(channels as u64);
    number(fingerprint);
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
