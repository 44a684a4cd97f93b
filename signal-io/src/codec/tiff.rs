//! TIFF: grey and RGB with and without alpha, 1 to 16 bits and floats; strips, tiles and planes.

use std::io::{Cursor, Read, Seek, Write};

use ::image::metadata::Orientation;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::encoder::{TiffEncoder, TiffKind, TiffValue, colortype};
use ::tiff::tags::{ExtraSamples, Tag};
use ::tiff::{ColorType, TiffError};

use super::orientation;
use super::quantize::{interleave, to_f32, to_u8, to_u16};
use super::raster::deinterleave;
use crate::budget::{Budget, check_plausible, with_capacity};
use crate::error::Fault;
use crate::image::usual_names;
use crate::plan::Plan;
use crate::{Image, SampleType, Transfer};

/// Files above this size need 64-bit offsets; 32 MiB are left for header, profile and strip table.
pub(crate) const SMALL_TIFF_BYTES: u64 = (4 << 30) - (32 << 20);

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(fault)?;
    let (width, height) = decoder.dimensions().map_err(fault)?;
    let (names, bits) = channel_names(&mut decoder)?;
    let channels = names.len();
    let count = budget.samples(width.into(), height.into(), channels as u64)?;
    let raw_bytes = (count as u64).saturating_mul(u64::from(bits)) / 8;
    let bare = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(fault)?.unwrap_or(1) == 1;
    // 4096: LZW at its best; deflate stays at 1032.
    check_plausible(raw_bytes, bytes.len(), if bare { 1 } else { 4096 })?;

    let turn = match decoder.find_tag_unsigned::<u16>(Tag::Orientation) {
        Ok(Some(value)) => Orientation::from_exif(value.min(255) as u8),
        _ => None,
    };
    let icc = decoder.get_tag_u8_vec(Tag::IccProfile).ok().filter(|icc| !icc.is_empty());
    let mut limits = Limits::default();
    limits.decoding_buffer_size =
        usize::try_from(budget.limit().saturating_mul(2)).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let mut decoder = decoder.with_limits(limits);
    let mut raw = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut raw).map_err(fault)?;

    let (w, h) = (width as usize, height as usize);
    let planes = layout.planes > 1;
    let (data, sample) = to_planar(raw, w, h, channels, bits, planes)?;
    if data.len() != count {
        return Err(Fault::Feature(format!("{} samples for {count}", data.len())));
    }
    let mut image = Image::new(w, h, &names, data)?;
    image.transfer = if sample.is_float() { Transfer::Unspecified } else { Transfer::Srgb };
    (image.sample, image.icc) = (sample, icc);
    Ok(orientation::upright(image, turn.unwrap_or(Orientation::NoTransforms)))
}

/// Names of the channels and bits per sample.
pub(crate) fn channel_names<R: Read + Seek>(
    decoder: &mut Decoder<R>,
) -> Result<(Vec<String>, u8), Fault> {
    let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).ok().flatten();
    let first_extra = extra.and_then(|e| e.first().copied());
    let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect();
    Ok(match decoder.colortype().map_err(fault)? {
        ColorType::Gray(bits) => (usual_names(1), bits),
        ColorType::GrayA(bits) => (names(&["Y", "A"]), bits),
        ColorType::RGB(bits) => (usual_names(3), bits),
        ColorType::RGBA(bits) => (usual_names(4), bits),
        // Grey with one extra sample that is said to be alpha (1: multiplied in, 2: not).
        ColorType::Multiband { bit_depth, num_samples: 2 }
            if matches!(first_extra, Some(1 | 2)) =>
        {
            (names(&["Y", "A"]), bit_depth)
        }
        ColorType::Multiband { bit_depth, num_samples } => {
            ((0..num_samples).map(|c| format!("C{c}")).collect(), bit_depth)
        }
        other => return Err(Fault::Feature(format!("{other:?} pixels"))),
    })
}

pub(crate) fn to_planar(
    raw: DecodingResult,
    w: usize,
    h: usize,
    channels: usize,
    bits: u8,
    planes: bool,
) -> Result<(Vec<f32>, SampleType), Fault> {
    // Separate planes come in the order that is wanted here already.
    let channels = if planes { 1 } else { channels };
    Ok(match raw {
        DecodingResult::U8(v) if bits == 8 => {
            (deinterleave(&v, channels, |v| f32::from(*v) / 255.0)?, SampleType::U8)
        }
        DecodingResult::U8(v) if channels == 1 && matches!(bits, 1 | 2 | 4) => {
            (unpack_bits(&v, w, h, bits)?, SampleType::U8)
        }
        DecodingResult::U16(v) if bits == 16 => {
            (deinterleave(&v, channels, |v| f32::from(*v) / 65_535.0)?, SampleType::U16)
        }
        DecodingResult::F16(v) => (deinterleave(&v, channels, |v| v.to_f32())?, SampleType::F16),
        DecodingResult::F32(v) => (deinterleave(&v, channels, |v| *v)?, SampleType::F32),
        DecodingResult::F64(v) => (deinterleave(&v, channels, |v| *v as f32)?, SampleType::F32),
        _ => return Err(Fault::Feature(format!("{bits}-bit integers"))),
    })
}

/// Samples of less than a byte, rows padded to bytes.
fn unpack_bits(packed: &[u8], w: usize, h: usize, bits: u8) -> Result<Vec<f32>, Fault> {
    let bits = usize::from(bits);
    let max = ((1u32 << bits) - 1) as u8;
    let row = (w * bits).div_ceil(8);
    let mut out = with_capacity(w * h)?;
    for line in packed.chunks_exact(row) {
        let value = |x: usize| line[x * bits / 8] >> (8 - bits - x * bits % 8) & max;
        out.extend((0..w).map(|x| f32::from(value(x)) / f32::from(max)));
    }
    Ok(out)
}

pub(crate) fn fault(error: TiffError) -> Fault {
    match error {
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Fault::cut_short()
        }
        TiffError::UnsupportedError(e) => Fault::feature(&e),
        other => Fault::corrupt(other.to_string()),
    }
}

/// Writes without compression, which every reader understands, in strips of about a megabyte.
pub(super) fn encode(
    image: &Image,
    plan: &Plan,
    w: &mut (impl Write + Seek),
) -> Result<usize, Fault> {
    let bytes_per_sample = match plan.sample {
        SampleType::U8 => 1,
        SampleType::U16 => 2,
        _ => 4,
    };
    let result = if image.as_planar().len() as u64 * bytes_per_sample < SMALL_TIFF_BYTES {
        TiffEncoder::new(w).and_then(|mut t| encode_with(image, plan, &mut t))
    } else {
        TiffEncoder::new_big(w).and_then(|mut t| encode_with(image, plan, &mut t))
    };
    result.map_err(|e| match e {
        TiffError::IoError(e) => Fault::Io(e),
        other => Fault::Encode(other.to_string()),
    })
}

fn encode_with<W: Write + Seek, K: TiffKind>(
    image: &Image,
    plan: &Plan,
    tiff: &mut TiffEncoder<W, K>,
) -> Result<usize, TiffError> {
    use colortype::{Gray8, Gray16, Gray32Float, RGB8, RGB16, RGB32Float};
    let gray = image.color_count() == 1;
    match (plan.sample, gray) {
        (SampleType::U8, true) => put::<Gray8, _, _>(image, tiff, to_u8),
        (SampleType::U8, false) => put::<RGB8, _, _>(image, tiff, to_u8),
        (SampleType::U16, true) => put::<Gray16, _, _>(image, tiff, to_u16),
        (SampleType::U16, false) => put::<RGB16, _, _>(image, tiff, to_u16),
        (_, true) => put::<Gray32Float, _, _>(image, tiff, to_f32),
        (_, false) => put::<RGB32Float, _, _>(image, tiff, to_f32),
    }
}

fn put<C: colortype::ColorType, W: Write + Seek, K: TiffKind>(
    image: &Image,
    tiff: &mut TiffEncoder<W, K>,
    convert: impl Fn(f32) -> (C::Inner, bool),
) -> Result<usize, TiffError>
where
    [C::Inner]: TiffValue,
{
    let mut out = tiff.new_image::<C>(image.width() as u32, image.height() as u32)?;
    if image.alpha().is_some() {
        out.extra_samples(&[ExtraSamples::UnassociatedAlpha])?;
    }
    if let Some(icc) = &image.icc {
        out.encoder().write_tag(Tag::IccProfile, icc.as_slice())?;
    }
    let q = interleave(image, convert);
    out.write_data(&q.values)?;
    Ok(q.clipped)
}
