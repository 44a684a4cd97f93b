use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Mutex;

use inr_core::Samples;

/// Planes of values on a lattice, read box by box: a file, a picture in tiles, an array.
pub trait BlockSource<const D: usize>: Sync {
    /// Samples per axis, axis 0 first.
    fn shape(&self) -> [usize; D];

    /// Number of planes.
    fn channels(&self) -> usize;

    /// Copies the box of `shape` samples that begins at `start` out of a plane, axis 0 contiguous.
    /// The box lies inside, and `out` is as long.
    ///
    /// # Errors
    /// Whatever hinders reading.
    fn read(
        &self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        out: &mut [f32],
    ) -> io::Result<()>;
}

/// Planes of values on a lattice, written box by box. Every sample is written once.
pub trait BlockSink<const D: usize> {
    /// Writes a box of one plane, axis 0 contiguous; the counterpart of [`BlockSource::read`].
    ///
    /// # Errors
    /// Whatever hinders writing.
    fn write(
        &mut self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        values: &[f32],
    ) -> io::Result<()>;
}

/// Offsets of the rows of a box in a plane.
fn rows<const D: usize>(
    whole: [usize; D],
    start: [usize; D],
    shape: [usize; D],
) -> impl Iterator<Item = usize> {
    let count: usize = shape[1..].iter().product();
    (0..count).map(move |mut row| {
        let (mut at, mut stride) = (start[0], whole[0]);
        for d in 1..D {
            at += (start[d] + row % shape[d]) * stride;
            row /= shape[d];
            stride *= whole[d];
        }
        at
    })
}

impl<const D: usize, const C: usize> BlockSource<D> for Samples<D, C> {
    fn shape(&self) -> [usize; D] {
        self.domain().shape()
    }

    fn channels(&self) -> usize {
        C
    }

    fn read(
        &self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        out: &mut [f32],
    ) -> io::Result<()> {
        let plane = self.plane(channel);
        let lines = out.chunks_exact_mut(shape[0]);
        for (at, out) in rows(self.domain().shape(), start, shape).zip(lines) {
            out.copy_from_slice(&plane[at..at + shape[0]]);
        }
        Ok(())
    }
}

impl<const D: usize, const C: usize> BlockSink<D> for Samples<D, C> {
    fn write(
        &mut self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        values: &[f32],
    ) -> io::Result<()> {
        let whole = self.domain().shape();
        let plane = self.plane_mut(channel);
        for (at, line) in rows(whole, start, shape).zip(values.chunks_exact(shape[0])) {
            plane[at..at + shape[0]].copy_from_slice(line);
        }
        Ok(())
    }
}

/// A plain file of planes: `f32`, little-endian, one plane after the other, axis 0 contiguous, after
/// an optional header of any kind.
#[derive(Debug)]
pub struct PlaneFile<const D: usize> {
    file: Mutex<File>,
    shape: [usize; D],
    channels: usize,
    /// Bytes before the first plane.
    header: u64,
}

impl<const D: usize> PlaneFile<D> {
    /// A file that is there, for reading; its planes begin after `header` bytes.
    ///
    /// # Errors
    /// That of opening it, and [`io::ErrorKind::InvalidData`] for a file that is too short.
    pub fn open(path: &Path, shape: [usize; D], channels: usize, header: u64) -> io::Result<Self> {
        Self::checked(File::open(path)?, shape, channels, header)
    }

    /// The same for reading and writing.
    ///
    /// # Errors
    /// As [`PlaneFile::open`].
    pub fn open_for_writing(
        path: &Path,
        shape: [usize; D],
        channels: usize,
        header: u64,
    ) -> io::Result<Self> {
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        Self::checked(file, shape, channels, header)
    }

    /// A new file of zeros, or an old one emptied; `header` bytes are left free at its beginning.
    ///
    /// # Errors
    /// That of creating it.
    pub fn create(
        path: &Path,
        shape: [usize; D],
        channels: usize,
        header: u64,
    ) -> io::Result<Self> {
        let options = OpenOptions::new().read(true).write(true).create(true).truncate(true).clone();
        let file = options.open(path)?;
        file.set_len(header + bytes(shape, channels))?;
        Self::checked(file, shape, channels, header)
    }

    fn checked(file: File, shape: [usize; D], channels: usize, header: u64) -> io::Result<Self> {
        let (found, expected) = (file.metadata()?.len(), header + bytes(shape, channels));
        if found < expected {
            let message = format!("the file has {found} bytes, {expected} are needed");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        Ok(Self { file: Mutex::new(file), shape, channels, header })
    }

    /// Visits the runs of a box that are contiguous in the file, with their place in the box.
    fn runs(
        &self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        mut visit: impl FnMut(&mut File, usize, usize) -> io::Result<()>,
    ) -> io::Result<()> {
        let plane: usize = self.shape.iter().product();
        let mut file = self.file.lock().map_err(|_| io::Error::other("a reader panicked"))?;
        // Full rows follow one another.
        let full = D > 1 && shape[0] == self.shape[0];
        let run = if full { shape[0] * shape[1] } else { shape[0] };
        let step = if full { shape[1] } else { 1 };
        for (k, at) in rows(self.shape, start, shape).step_by(step).enumerate() {
            file.seek(SeekFrom::Start(self.header + 4 * (channel * plane + at) as u64))?;
            visit(&mut file, k * run, run)?;
        }
        Ok(())
    }

    /// Writes the bytes before the planes.
    ///
    /// # Errors
    /// That of writing.
    pub(super) fn write_header(&mut self, bytes: &[u8]) -> io::Result<()> {
        let file = self.file.get_mut().map_err(|_| io::Error::other("a reader panicked"))?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(bytes)?;
        file.flush()
    }
}

fn bytes<const D: usize>(shape: [usize; D], channels: usize) -> u64 {
    4 * channels as u64 * shape.iter().map(|n| *n as u64).product::<u64>()
}

impl<const D: usize> BlockSource<D> for PlaneFile<D> {
    fn shape(&self) -> [usize; D] {
        self.shape
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn read(
        &self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        out: &mut [f32],
    ) -> io::Result<()> {
        let mut bytes = Vec::new();
        self.runs(channel, start, shape, |file, at, n| {
            bytes.resize(4 * n, 0);
            file.read_exact(&mut bytes)?;
            for (v, b) in out[at..at + n].iter_mut().zip(bytes.as_chunks::<4>().0) {
                *v = f32::from_le_bytes(*b);
            }
            Ok(())
        })
    }
}

impl<const D: usize> BlockSink<D> for PlaneFile<D> {
    fn write(
        &mut self,
        channel: usize,
        start: [usize; D],
        shape: [usize; D],
        values: &[f32],
    ) -> io::Result<()> {
        let mut bytes = Vec::new();
        self.runs(channel, start, shape, |file, at, n| {
            bytes.clear();
            bytes.extend(values[at..at + n].iter().flat_map(|v| v.to_le_bytes()));
            file.write_all(&bytes)
        })
    }
}
