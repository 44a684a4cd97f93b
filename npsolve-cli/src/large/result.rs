//! The result, from the solver's rows into its file.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, anyhow};
use poisson_loss::{BlockSink, BlockSource, PlaneFile};
use signal_io::{PictureInfo, RowWriter, WriteOptions, WriteReport};

use super::input::band_rows;
use crate::files;

/// Takes whole rows from the first to the last, adds the background's alpha, and writes them.
pub struct RowSink {
    path: PathBuf,
    info: PictureInfo,
    options: WriteOptions,
    alpha: Option<PlaneFile<2>>,
    /// Made with the first rows.
    writer: Option<RowWriter>,
    /// Channels of the rows that are still incomplete.
    planes: Vec<f32>,
    error: Option<anyhow::Error>,
    start: Option<Instant>,
}

impl RowSink {
    /// For a picture like this, with an alpha plane from a scratch file.
    pub fn new(
        path: &Path,
        info: PictureInfo,
        options: WriteOptions,
        alpha: Option<PlaneFile<2>>,
    ) -> Self {
        let (path, writer, planes) = (path.to_path_buf(), None, Vec::new());
        Self { path, info, options, alpha, writer, planes, error: None, start: None }
    }

    /// What went wrong while writing, in full.
    pub fn take_error(&mut self) -> Option<anyhow::Error> {
        self.error.take()
    }

    /// Ends the file; also says how many seconds it took.
    pub fn finish(self) -> Result<(f64, WriteReport)> {
        let (writer, start) =
            self.writer.zip(self.start).ok_or_else(|| anyhow!("nothing was written"))?;
        let report = writer.finish().map_err(files::in_our_words)?;
        Ok((start.elapsed().as_secs_f64(), report))
    }

    /// Writes the rows that are complete now, in bands.
    fn flush(&mut self, first: usize, rows: usize) -> Result<()> {
        let (planes, width) = (std::mem::take(&mut self.planes), self.info.width);
        if planes.iter().any(|v| !v.is_finite()) {
            return Err(anyhow!(
                "the blend exceeds the range of 32-bit floats; scale both pictures down"
            ));
        }
        self.start.get_or_insert_with(Instant::now);
        let writer = match &mut self.writer {
            Some(writer) => writer,
            None => {
                let new = RowWriter::create(&self.path, &self.info, &self.options);
                self.writer.insert(new.map_err(files::in_our_words)?)
            }
        };
        let colors = planes.len() / (rows * width);
        for from in (0..rows).step_by(band_rows(&self.info)) {
            let count = band_rows(&self.info).min(rows - from);
            let mut data = Vec::with_capacity(count * width * self.info.channels.len());
            for c in 0..colors {
                data.extend_from_slice(&planes[(c * rows + from) * width..][..count * width]);
            }
            if let Some(alpha) = &self.alpha {
                let begin = data.len();
                data.resize(begin + count * width, 0.0);
                alpha.read(0, [0, first + from], [width, count], &mut data[begin..])?;
            }
            writer.push(&self.info.rows(data)?).map_err(files::in_our_words)?;
        }
        Ok(())
    }
}

impl BlockSink<2> for RowSink {
    fn write(
        &mut self,
        channel: usize,
        start: [usize; 2],
        shape: [usize; 2],
        values: &[f32],
    ) -> io::Result<()> {
        self.planes.extend_from_slice(values);
        if channel + 1 + usize::from(self.alpha.is_some()) < self.info.channels.len() {
            return Ok(());
        }
        self.flush(start[1], shape[1]).map_err(|error| {
            let message = format!("{error:#}");
            self.error = Some(error);
            io::Error::other(message)
        })
    }
}
