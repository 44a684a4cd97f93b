//! Bands of rows into a file.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter, Info, StreamWriter};

use super::{PictureInfo, tiff};
use crate::atomic::Replacement;
use crate::codec::npy::write_header;
use crate::codec::quantize::{interleave, to_f16, to_u8, to_u16};
use crate::error::Fault;
use crate::format::extension;
use crate::plan::{Plan, check_size};
use crate::write::writable_format;
use crate::{Error, Format, Image, Result, SampleType, WriteOptions, WriteReport};

/// Writes a picture from top to bottom, a band of rows at a time; it is there completely or not at all.
///
/// Number type, encoding, channels and the count of clipped samples are those of
/// [`write_image`](crate::write_image). PNG, TIFF (uncompressed), npy and PFM are written so.
pub struct RowWriter {
    path: PathBuf,
    plan: Plan,
    info: PictureInfo,
    sink: Sink,
    output: Output,
    replacement: Replacement,
    /// Rows written.
    row: usize,
    clipped: usize,
}

/// How bands become bytes.
enum Sink {
    Png(Box<StreamWriter<'static, Output>>),
    /// Rows one after the other.
    Down,
    /// Rows from bottom to top, behind a header of this length.
    Up(u64),
}

impl RowWriter {
    /// Makes the file, under another name in the same folder until [`RowWriter::finish`].
    ///
    /// # Errors
    /// Those of [`write_image`](crate::write_image), and [`Error::NotByRows`] for other formats.
    pub fn create(
        path: impl AsRef<Path>,
        info: &PictureInfo,
        options: &WriteOptions,
    ) -> Result<Self> {
        let path = path.as_ref();
        let plan = plan_of(path, info, options)?;
        let (replacement, file) = Replacement::start(path, options.force)?;
        let mut output = Output(Arc::new(Mutex::new(BufWriter::with_capacity(1 << 18, file))));
        let sink =
            begin(info, &plan, &mut output).map_err(|f| f.at(path, plan.format.name(), "write"))?;
        let (path, info) = (path.to_path_buf(), info.clone());
        Ok(Self { path, plan, info, sink, output, replacement, row: 0, clipped: 0 })
    }

    /// Whether a picture like this can be written so: call it before a long job.
    ///
    /// # Errors
    /// Those of [`RowWriter::create`] that can be known before.
    pub fn check(path: impl AsRef<Path>, info: &PictureInfo, options: &WriteOptions) -> Result<()> {
        let path = path.as_ref();
        crate::check_target(path, options.force)?;
        plan_of(path, info, options).map(|_| ())
    }

    /// The number type in the file.
    pub fn sample(&self) -> SampleType {
        self.plan.sample
    }

    /// Appends rows.
    ///
    /// # Errors
    /// [`Error::Shape`] for a band of other width or channels or one row too many, and [`Error::Io`].
    pub fn push(&mut self, band: &Image) -> Result<()> {
        let (info, rows) = (&self.info, band.height());
        let same = band.width() == info.width && band.channels() == info.channels;
        if !same || self.row + rows > info.height {
            let what = format!(
                "{} x {rows} samples of {:?} behind row {} of {} x {} samples of {:?}",
                band.width(),
                band.channels(),
                self.row,
                info.width,
                info.height,
                info.channels
            );
            return Err(Error::Shape { what });
        }
        let written =
            self.put(band).map_err(|f| f.at(&self.path, self.plan.format.name(), "write"));
        self.row += rows;
        self.clipped += written?;
        Ok(())
    }

    fn put(&mut self, band: &Image) -> std::result::Result<usize, Fault> {
        let band = self.plan.prepare(band)?;
        let big_endian = matches!(self.sink, Sink::Png(_));
        let (bytes, clipped) = to_bytes(&band, self.plan.sample, big_endian);
        match &mut self.sink {
            Sink::Png(stream) => stream.write_all(&bytes)?,
            Sink::Down => self.output.write_all(&bytes)?,
            Sink::Up(header) => {
                let row_bytes = bytes.len() / band.height();
                let below = self.info.height - self.row - band.height();
                let place = *header + (below * row_bytes) as u64;
                self.output.get().seek(SeekFrom::Start(place))?;
                for row in bytes.chunks_exact(row_bytes).rev() {
                    self.output.write_all(row)?;
                }
            }
        }
        Ok(clipped)
    }

    /// Ends the file and gives it its name.
    ///
    /// # Errors
    /// [`Error::Shape`] where rows are missing, [`Error::Exists`] and [`Error::Io`].
    pub fn finish(self) -> Result<WriteReport> {
        let Self { path, plan, info, sink, output, replacement, row, clipped } = self;
        if row != info.height {
            let what = format!("{row} rows of a picture of {}", info.height);
            return Err(Error::Shape { what });
        }
        let fail = |fault: Fault| fault.at(&path, plan.format.name(), "write");
        if let Sink::Png(stream) = sink {
            stream.finish().map_err(|e| fail(fault(e)))?;
        }
        let inner = Arc::into_inner(output.0).expect("the stream is gone");
        let writer = inner.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        let file = writer.into_inner().map_err(|e| fail(Fault::Io(e.into_error())))?;
        replacement.finish(file)?;
        let Plan { format, sample, transfer, .. } = plan;
        let colors = info.channels.iter().filter(|c| *c != "A").count();
        let samples = colors * info.width * info.height;
        Ok(WriteReport { format, sample, transfer, samples, clipped })
    }
}

fn plan_of(path: &Path, info: &PictureInfo, options: &WriteOptions) -> Result<Plan> {
    let format = writable_format(path)?;
    if !matches!(format, Format::Png | Format::Tiff | Format::Npy | Format::Pfm) {
        let what = format!("{} is encoded as a whole", format.name());
        return Err(Error::NotByRows { path: path.to_path_buf(), what, action: "written" });
    }
    let one = info.rows(vec![0.0; info.width * info.channels.len()])?;
    Plan::new(format, &extension(path), &one, options)
        .and_then(|plan| check_size(format, info.width, info.height).map(|()| plan))
        .map_err(|f| f.at(path, format.name(), "write"))
}

/// Writes what stands before the rows.
fn begin(info: &PictureInfo, plan: &Plan, output: &mut Output) -> std::result::Result<Sink, Fault> {
    let (width, height, channels) = (info.width, info.height, info.channels.len());
    Ok(match plan.format {
        Format::Png => Sink::Png(Box::new(png_stream(info, plan, output).map_err(fault)?)),
        Format::Npy => {
            let descr = match plan.sample {
                SampleType::U8 => "|u1",
                SampleType::U16 => "<u2",
                SampleType::F16 => "<f2",
                SampleType::F32 => "<f4",
            };
            let shape = [height, width, channels];
            write_header(descr, &shape[..if channels == 1 { 2 } else { 3 }], output)?;
            Sink::Down
        }
        Format::Pfm => {
            let magic = if channels == 1 { "Pf" } else { "PF" };
            let header = format!("{magic}\n{width} {height}\n-1.0\n");
            output.write_all(header.as_bytes())?;
            Sink::Up(header.len() as u64)
        }
        _ => {
            output.write_all(&tiff::head(info, plan.sample))?;
            Sink::Down
        }
    })
}

fn png_stream(
    info: &PictureInfo,
    plan: &Plan,
    output: &Output,
) -> std::result::Result<StreamWriter<'static, Output>, EncodingError> {
    let mut head = Info::with_size(info.width as u32, info.height as u32);
    head.icc_profile = info.icc.clone().map(Into::into);
    let mut encoder = Encoder::with_info(output.clone(), head)?;
    encoder.set_color(match info.channels.len() {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        _ => ColorType::Rgba,
    });
    let eight = plan.sample == SampleType::U8;
    encoder.set_depth(if eight { BitDepth::Eight } else { BitDepth::Sixteen });
    // As pictures in memory are written.
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    encoder.write_header()?.into_stream_writer_with_size(1 << 16)
}

fn fault(error: EncodingError) -> Fault {
    match error {
        EncodingError::IoError(e) => Fault::Io(e),
        other => Fault::Encode(other.to_string()),
    }
}

/// The numbers of a band as they stand in the file, and how many were clipped.
fn to_bytes(band: &Image, sample: SampleType, big_endian: bool) -> (Vec<u8>, usize) {
    macro_rules! bytes {
        ($convert:expr) => {{
            let q = interleave(band, $convert);
            (q.values.iter().flat_map(|v| v.to_le_bytes()).collect(), q.clipped)
        }};
    }
    match sample {
        SampleType::U8 => {
            let q = interleave(band, to_u8);
            (q.values, q.clipped)
        }
        SampleType::U16 if big_endian => bytes!(|v| {
            let (value, clipped) = to_u16(v);
            (value.swap_bytes(), clipped)
        }),
        SampleType::U16 => bytes!(to_u16),
        SampleType::F16 => bytes!(to_f16),
        SampleType::F32 => bytes!(crate::codec::quantize::to_f32),
    }
}

/// The file, which the PNG encoder wants to own and which has to be synced after it is gone.
#[derive(Clone)]
struct Output(Arc<Mutex<BufWriter<File>>>);

impl Output {
    fn get(&self) -> MutexGuard<'_, BufWriter<File>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.get().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.get().flush()
    }
}
