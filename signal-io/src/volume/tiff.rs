//! TIFF with one page per z, or pages of channels in the order of ImageJ: channels faster than z.

use std::io::{Cursor, Seek, Write};

use ::tiff::decoder::ifd::Value;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::encoder::{Rational, TiffEncoder, TiffKind, TiffValue, colortype};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};

use super::nifti::bad_place;
use super::numbers::Coding;
use super::{LengthUnit, VoxelType};
use crate::Volume;
use crate::budget::{Budget, check_plausible, zeros};
use crate::codec::tiff::{SMALL_TIFF_BYTES, fault};
use crate::error::Fault;

/// Parts of a length unit that resolutions are counted in.
const PARTS: f64 = 1e6;

type Bytes<'a> = Cursor<&'a [u8]>;

/// What all pages have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Page {
    width: u32,
    height: u32,
    channels: u16,
    bits: u8,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Volume, Fault> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(fault)?;
    let notes = Notes::read(&mut decoder);
    let (page, pages) = look_through(bytes, budget)?;
    let (channels, z) = match (page.channels, notes.channels) {
        (1, n) if n > 1 && pages.is_multiple_of(n) => (n, pages / n),
        (n, _) => (u64::from(n), pages),
    };
    let (w, h) = (page.width as usize, page.height as usize);
    let plane = w * h;
    let shape = [w, h, z as usize];
    let mut data = zeros(plane * z as usize * channels as usize)?;
    let mut raw = DecodingResult::U8(Vec::new());
    let mut sample = VoxelType::U8;
    let mut limits = Limits::default();
    limits.decoding_buffer_size =
        usize::try_from(budget.limit().saturating_mul(2)).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let mut decoder = decoder.with_limits(limits);
    for number in 0..pages as usize {
        if number > 0 {
            decoder.next_image().map_err(fault)?;
        }
        let layout = decoder.read_image_to_buffer(&mut raw).map_err(fault)?;
        let side_by_side = if layout.planes > 1 { 1 } else { usize::from(page.channels) };
        // The slice of one channel that a value of this page belongs to.
        let place = |k: usize| match page.channels {
            1 => {
                let (c, z_at) = (number % channels as usize, number / channels as usize);
                (c * shape[2] + z_at) * plane + k
            }
            _ => {
                let (c, at) = match side_by_side {
                    1 => (k / plane, k % plane),
                    n => (k % n, k / n),
                };
                (c * shape[2] + number) * plane + at
            }
        };
        sample = spread(&raw, page.bits, plane * usize::from(page.channels), |k, value| {
            data[place(k)] = value;
        })?;
    }
    let volume = Volume::new(shape, channels as usize, data)?;
    let mut volume = volume.with_voxel_size(notes.size).map_err(bad_place)?;
    (volume.voxel_type, volume.length_unit) = (sample, notes.unit);
    Ok(volume)
}

/// The page that all pages are like, and their number, if they are like it and may be decoded.
fn look_through(bytes: &[u8], budget: &Budget) -> Result<(Page, u64), Fault> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(fault)?;
    let (mut first, mut pages, mut bare) = (None, 0u64, true);
    loop {
        let (width, height) = decoder.dimensions().map_err(fault)?;
        let (channels, bits) = match decoder.colortype().map_err(fault)? {
            ColorType::Gray(bits) => (1, bits),
            ColorType::GrayA(bits) => (2, bits),
            ColorType::RGB(bits) => (3, bits),
            ColorType::RGBA(bits) => (4, bits),
            ColorType::Multiband { bit_depth, num_samples } => (num_samples, bit_depth),
            other => return Err(Fault::Feature(format!("{other:?} voxels"))),
        };
        let page = Page { width, height, channels, bits };
        let first = first.get_or_insert(page);
        if *first != page {
            return Err(Fault::Feature(format!("pages that differ: {first:?} and {page:?}")));
        }
        bare &=
            decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(fault)?.unwrap_or(1) == 1;
        pages += 1;
        let plane = u64::from(width) * u64::from(height);
        let count = budget.samples(plane, pages, channels.into())?;
        let raw = (count as u64).saturating_mul(u64::from(bits)) / 8;
        // 4096: LZW at its best; deflate stays at 1032.
        check_plausible(raw, bytes.len(), if bare { 1 } else { 4096 })?;
        if !decoder.more_images() {
            return Ok((page, pages));
        }
        decoder.next_image().map_err(fault)?;
    }
}

/// Hands out the values of a page one after the other; returns their type.
fn spread(
    raw: &DecodingResult,
    bits: u8,
    count: usize,
    mut put: impl FnMut(usize, f32),
) -> Result<VoxelType, Fault> {
    macro_rules! numbers {
        ($values:expr, $sample:ident, $convert:expr) => {{
            if usize::from(bits) != 8 * VoxelType::$sample.bytes() {
                return Err(Fault::Feature(format!("{bits}-bit numbers")));
            }
            if $values.len() < count {
                return Err(Fault::cut_short());
            }
            $values.iter().take(count).enumerate().for_each(|(k, v)| put(k, $convert(*v)));
            VoxelType::$sample
        }};
    }
    Ok(match raw {
        DecodingResult::U8(v) => numbers!(v, U8, f32::from),
        DecodingResult::I8(v) => numbers!(v, I8, f32::from),
        DecodingResult::U16(v) => numbers!(v, U16, f32::from),
        DecodingResult::I16(v) => numbers!(v, I16, f32::from),
        DecodingResult::U32(v) => numbers!(v, U32, |v| v as f32),
        DecodingResult::I32(v) => numbers!(v, I32, |v| v as f32),
        DecodingResult::F32(v) => numbers!(v, F32, |v| v),
        DecodingResult::F64(v) => numbers!(v, F64, |v| v as f32),
        _ => return Err(Fault::Feature(format!("{bits}-bit numbers"))),
    })
}

/// What the description of ImageJ says; other programs leave no trustworthy sizes.
struct Notes {
    channels: u64,
    size: [f64; 3],
    unit: LengthUnit,
}

impl Notes {
    fn read(decoder: &mut Decoder<Bytes<'_>>) -> Self {
        let text = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
        let known = text.starts_with("ImageJ=");
        let entry = |key: &str| {
            let mut lines = text.lines().filter(|_| known).filter_map(|line| line.split_once('='));
            lines.find(|(k, _)| *k == key).map(|(_, value)| value.trim())
        };
        let unit = LengthUnit::from_symbol(entry("unit").unwrap_or_default());
        let mut edge = |tag| match decoder.get_tag(tag) {
            Ok(Value::Rational(n, d)) if known && n > 0 && d > 0 => f64::from(d) / f64::from(n),
            _ => 1.0,
        };
        let (x, y) = (edge(Tag::XResolution), edge(Tag::YResolution));
        let z = entry("spacing").and_then(|v| v.parse().ok()).unwrap_or(1.0);
        Self {
            channels: entry("channels").and_then(|v| v.parse().ok()).unwrap_or(1),
            size: [x, y, z].map(|size| size * unit.millimetres()),
            unit,
        }
    }
}

/// Writes without compression, which every reader understands. Only sizes of voxels are kept of the
/// volume's place, and only if ImageJ's counting can express them.
pub(super) fn encode(
    volume: &Volume,
    coding: Coding,
    w: &mut (impl Write + Seek),
) -> Result<usize, Fault> {
    let bytes = volume.as_planar().len() as u64 * coding.sample.bytes() as u64;
    // A page table has some 200 bytes.
    let tables = (volume.shape()[2] * volume.channels()) as u64 * 256;
    let result = if bytes + tables < SMALL_TIFF_BYTES {
        TiffEncoder::new(w).and_then(|mut t| encode_with(volume, coding, &mut t))
    } else {
        TiffEncoder::new_big(w).and_then(|mut t| encode_with(volume, coding, &mut t))
    };
    result.map_err(|e| match e {
        TiffError::IoError(e) => Fault::Io(e),
        other => Fault::Encode(other.to_string()),
    })
}

fn encode_with<W: Write + Seek, K: TiffKind>(
    volume: &Volume,
    coding: Coding,
    tiff: &mut TiffEncoder<W, K>,
) -> Result<usize, TiffError> {
    use colortype as c;
    match coding.sample {
        VoxelType::U8 => put::<c::Gray8, _, _>(volume, coding, tiff, |v| v as u8),
        VoxelType::I8 => put::<c::GrayI8, _, _>(volume, coding, tiff, |v| v as i8),
        VoxelType::U16 => put::<c::Gray16, _, _>(volume, coding, tiff, |v| v as u16),
        VoxelType::I16 => put::<c::GrayI16, _, _>(volume, coding, tiff, |v| v as i16),
        VoxelType::U32 => put::<c::Gray32, _, _>(volume, coding, tiff, |v| v as u32),
        VoxelType::I32 => put::<c::GrayI32, _, _>(volume, coding, tiff, |v| v as i32),
        VoxelType::F32 => put::<c::Gray32Float, _, _>(volume, coding, tiff, |v| v as f32),
        VoxelType::F64 => put::<c::Gray64Float, _, _>(volume, coding, tiff, |v| v),
    }
}

fn put<C: colortype::ColorType, W: Write + Seek, K: TiffKind>(
    volume: &Volume,
    coding: Coding,
    tiff: &mut TiffEncoder<W, K>,
    convert: impl Fn(f64) -> C::Inner,
) -> Result<usize, TiffError>
where
    [C::Inner]: TiffValue,
{
    let ([x, y, z], channels) = (volume.shape(), volume.channels());
    let side = |n: usize| u32::try_from(n).map_err(|_| TiffError::IntSizeError);
    let mut clipped = 0;
    let mut page = Vec::with_capacity(x * y);
    for number in 0..z * channels {
        let start = x * y * (number % channels * z + number / channels);
        page.clear();
        page.extend(volume.as_planar()[start..start + x * y].iter().map(|value| {
            let (number, clip) = coding.sample.quantize(coding.scaling.to_number(*value));
            clipped += usize::from(clip);
            convert(number)
        }));
        let mut image = tiff.new_image::<C>(side(x)?, side(y)?)?;
        if number == 0 {
            describe(volume, &mut image)?;
        }
        image.write_data(&page)?;
    }
    Ok(clipped)
}

/// Sizes in the manner of ImageJ: pixels per unit as tags, the rest as text.
fn describe<W: Write + Seek, C: colortype::ColorType, K: TiffKind>(
    volume: &Volume,
    image: &mut ::tiff::encoder::ImageEncoder<'_, W, C, K>,
) -> Result<(), TiffError> {
    let (z, channels) = (volume.shape()[2], volume.channels());
    let unit = volume.length_unit;
    let size = volume.voxel_size().map(|s| s / unit.millimetres());
    let mut text =
        format!("ImageJ=1.53t\nimages={}\nchannels={channels}\nslices={z}\n", z * channels);
    if !unit.symbol().is_empty() {
        text += &format!("unit={}\n", unit.symbol());
    }
    text += &format!("spacing={}\nloop=false\n", size[2]);
    image.encoder().write_tag(Tag::ImageDescription, text.as_str())?;
    let resolution = |size: f64| {
        let d = (size * PARTS).round();
        (1.0..=f64::from(u32::MAX))
            .contains(&d)
            .then_some(Rational { n: PARTS as u32, d: d as u32 })
    };
    if let (Some(x), Some(y)) = (resolution(size[0]), resolution(size[1])) {
        image.x_resolution(x);
        image.y_resolution(y);
    }
    Ok(())
}
