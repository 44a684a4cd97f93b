//! Rows of PNG.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::image::metadata::Orientation;
use ::png::{BitDepth, ColorType, Decoder, DecodingError, Limits, Reader, Transformations};

use super::{Opened, PictureInfo, Rows, spread};
use crate::error::Fault;
use crate::{SampleType, Transfer};

/// Most bytes for metadata and for the decoder's rows; the widest row of eight bytes a pixel has 16 GiB.
const DECODER_BYTES: usize = 256 << 20;

struct PngRows {
    reader: Reader<BufReader<File>>,
    channels: usize,
    size: usize,
}

pub(super) fn open(path: &Path) -> Result<Opened, Fault> {
    let input = BufReader::with_capacity(1 << 18, File::open(path)?);
    let mut decoder = Decoder::new_with_limits(input, Limits { bytes: DECODER_BYTES });
    decoder.set_transformations(Transformations::EXPAND);
    let reader = decoder.read_info().map_err(fault)?;
    let info = reader.info();
    if info.interlaced {
        return Ok(Opened::Whole("its rows are interlaced"));
    }
    if info.animation_control.is_some() {
        return Ok(Opened::Whole("it is animated"));
    }
    let turned = info.exif_metadata.as_ref().and_then(|exif| Orientation::from_exif_chunk(exif));
    if turned.is_some_and(|turn| turn != Orientation::NoTransforms) {
        return Ok(Opened::Whole("EXIF turns it"));
    }
    let (color, depth) = reader.output_color_type();
    let (names, (sample, size)): (&[&str], _) = match (color, depth) {
        (ColorType::Grayscale, d) => (&["Y"], number(d)?),
        (ColorType::GrayscaleAlpha, d) => (&["Y", "A"], number(d)?),
        (ColorType::Rgb, d) => (&["R", "G", "B"], number(d)?),
        (ColorType::Rgba, d) => (&["R", "G", "B", "A"], number(d)?),
        (ColorType::Indexed, _) => return Err(Fault::Feature("a palette".to_owned())),
    };
    let picture = PictureInfo {
        width: info.width as usize,
        height: info.height as usize,
        channels: names.iter().map(|n| (*n).to_owned()).collect(),
        sample,
        transfer: Transfer::Srgb,
        icc: info.icc_profile.as_ref().map(|icc| icc.to_vec()).filter(|icc| !icc.is_empty()),
    };
    let rows = PngRows { reader, channels: names.len(), size };
    Ok(Opened::Rows(picture, Box::new(rows)))
}

fn number(depth: BitDepth) -> Result<(SampleType, usize), Fault> {
    match depth {
        BitDepth::Eight => Ok((SampleType::U8, 1)),
        BitDepth::Sixteen => Ok((SampleType::U16, 2)),
        other => Err(Fault::Feature(format!("{other:?} bits after expansion"))),
    }
}

impl Rows for PngRows {
    fn read(&mut self, rows: usize, out: &mut [f32]) -> Result<(), Fault> {
        for row in 0..rows {
            let line = self.reader.next_row().map_err(fault)?.ok_or_else(Fault::cut_short)?;
            let (place, channels) = ([row, rows], self.channels);
            match self.size {
                1 => spread(line.data(), 1, |b| f32::from(b[0]) / 255.0, place, out, channels),
                _ => {
                    let convert = |b: &[u8]| f32::from(u16::from_be_bytes([b[0], b[1]])) / 65_535.0;
                    spread(line.data(), 2, convert, place, out, channels);
                }
            }
        }
        Ok(())
    }
}

fn fault(error: DecodingError) -> Fault {
    match error {
        DecodingError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Fault::cut_short()
        }
        DecodingError::IoError(e) => Fault::Io(e),
        DecodingError::LimitsExceeded => {
            Fault::Feature(format!("rows or metadata of more than {DECODER_BYTES} bytes"))
        }
        other => Fault::corrupt(other.to_string()),
    }
}
