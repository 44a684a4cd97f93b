//! PNG, JPEG, WebP and GIF through the `image` crate.

use std::io::{Cursor, Write};

use ::image::codecs::{gif, jpeg, png, webp};
use ::image::{ColorType, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError};

use super::quantize::{interleave, to_u8, to_u16};
use super::{jpeg as jpeg_stream, orientation};
use crate::budget::{Budget, check_plausible, with_capacity, zeros};
use crate::error::Fault;
use crate::plan::Plan;
use crate::{Format, Image, SampleType, Transfer};

pub(super) fn decode(format: Format, bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let input = Cursor::new(bytes);
    match format {
        Format::Png => {
            check_png_header(bytes, budget)?;
            let limits = budget.to_image_limits();
            run(png::PngDecoder::with_limits(input, limits).map_err(fault)?, budget)
        }
        Format::Jpeg => {
            if !jpeg_stream::is_complete(bytes) {
                return Err(Fault::corrupt("it ends before the end-of-image marker"));
            }
            let decoder = jpeg::JpegDecoder::new(input).map_err(fault)?;
            // One bit per 8x8 block at least, in the component that has most blocks; others may be
            // subsampled 4x4 and still are three bytes per pixel.
            check_plausible(decoder.total_bytes(), bytes.len(), 8 * 64 * 16 * 3)?;
            run(decoder, budget)
        }
        Format::WebP => run(webp::WebPDecoder::new(input).map_err(fault)?, budget),
        _ => {
            let decoder = gif::GifDecoder::new(input).map_err(fault)?;
            // LZW: at most 4096 pixels of 4 decoded bytes for a code of 9 bits or more.
            check_plausible(decoder.total_bytes(), bytes.len(), 4096 * 4)?;
            run(decoder, budget).map(drop_full_alpha)
        }
    }
}

/// Checks the size in the header before the decoder, which allocates rows, sees it.
fn check_png_header(bytes: &[u8], budget: &Budget) -> Result<(), Fault> {
    if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") || bytes.get(12..16) != Some(b"IHDR") {
        return Err(Fault::corrupt("it does not start with signature and header"));
    }
    let Some(&[w0, w1, w2, w3, h0, h1, h2, h3, depth, kind]) = bytes.get(16..26) else {
        return Err(Fault::cut_short());
    };
    let width = u64::from(u32::from_be_bytes([w0, w1, w2, w3]));
    let height = u64::from(u32::from_be_bytes([h0, h1, h2, h3]));
    let channels = match kind {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1, // Grey, and palettes, which the decoder expands to 3 or 4: checked again later.
    };
    budget.samples(width, height, channels)?;
    let row = width.saturating_mul(channels * u64::from(depth)).div_ceil(8);
    check_plausible(row.saturating_mul(height), bytes.len(), 1032) // The best of deflate.
}

/// The way all decoders go: size, metadata, pixels, orientation.
fn run(mut decoder: impl ImageDecoder, budget: &Budget) -> Result<Image, Fault> {
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let (names, sample): (&[&str], _) = match color {
        ColorType::L8 => (&["Y"], SampleType::U8),
        ColorType::La8 => (&["Y", "A"], SampleType::U8),
        ColorType::Rgb8 => (&["R", "G", "B"], SampleType::U8),
        ColorType::Rgba8 => (&["R", "G", "B", "A"], SampleType::U8),
        ColorType::L16 => (&["Y"], SampleType::U16),
        ColorType::La16 => (&["Y", "A"], SampleType::U16),
        ColorType::Rgb16 => (&["R", "G", "B"], SampleType::U16),
        ColorType::Rgba16 => (&["R", "G", "B", "A"], SampleType::U16),
        other => return Err(Fault::Feature(format!("{other:?} pixels"))),
    };
    let count = budget.samples(width.into(), height.into(), names.len() as u64)?;
    decoder.set_limits(budget.to_image_limits()).map_err(fault)?;
    // Broken metadata is no reason to refuse a picture whose pixels are fine.
    let icc = decoder.icc_profile().unwrap_or(None).filter(|icc| !icc.is_empty());
    let turn = decoder.orientation().unwrap_or(::image::metadata::Orientation::NoTransforms);
    let mut raw = zeros::<u8>(count * if sample == SampleType::U8 { 1 } else { 2 })?;
    decoder.read_image(&mut raw).map_err(fault)?;

    let data = match sample {
        SampleType::U8 => deinterleave(&raw, names.len(), |v| f32::from(*v) / 255.0)?,
        _ => {
            let (pairs, _) = raw.as_chunks::<2>();
            deinterleave(pairs, names.len(), |v| f32::from(u16::from_ne_bytes(*v)) / 65_535.0)?
        }
    };
    let mut image = Image::new(width as usize, height as usize, names, data)?;
    (image.sample, image.transfer, image.icc) = (sample, Transfer::Srgb, icc);
    Ok(orientation::upright(image, turn))
}

/// Channels side by side to planes.
pub(super) fn deinterleave<T>(
    values: &[T],
    channels: usize,
    convert: impl Fn(&T) -> f32,
) -> Result<Vec<f32>, Fault> {
    let mut data = with_capacity(values.len())?;
    for c in 0..channels {
        data.extend(values[c..].iter().step_by(channels).map(&convert));
    }
    Ok(data)
}

/// GIF frames always decode to RGBA, most are opaque.
fn drop_full_alpha(image: Image) -> Image {
    match image.alpha().is_some_and(|a| a.iter().all(|v| *v == 1.0)) {
        true => image.split_alpha().0,
        false => image,
    }
}

/// What the decoders of the `image` crate say.
pub(crate) fn fault(error: ImageError) -> Fault {
    match error {
        ImageError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Fault::cut_short()
        }
        ImageError::Unsupported(e) => Fault::feature(&e),
        other => Fault::corrupt(other.to_string()),
    }
}

pub(super) fn encode(image: &Image, plan: &Plan, w: &mut impl Write) -> Result<usize, Fault> {
    use ExtendedColorType as E;
    let (bytes, clipped) = match plan.sample {
        SampleType::U8 => {
            let q = interleave(image, to_u8);
            (q.values, q.clipped)
        }
        _ => {
            let q = interleave(image, to_u16);
            (q.values.iter().flat_map(|v| v.to_ne_bytes()).collect(), q.clipped)
        }
    };
    let color = match (plan.sample, image.channels().len()) {
        (SampleType::U8, 1) => E::L8,
        (SampleType::U8, 2) => E::La8,
        (SampleType::U8, 3) => E::Rgb8,
        (SampleType::U8, _) => E::Rgba8,
        (_, 1) => E::L16,
        (_, 2) => E::La16,
        (_, 3) => E::Rgb16,
        _ => E::Rgba16,
    };
    match plan.format {
        Format::Png => send(png::PngEncoder::new(w), image, &bytes, color),
        Format::WebP => send(webp::WebPEncoder::new_lossless(w), image, &bytes, color),
        _ => {
            let encoder = jpeg::JpegEncoder::new_with_quality(w, plan.jpeg_quality);
            send(encoder, image, &bytes, color)
        }
    }?;
    Ok(clipped)
}

/// The way all encoders go: profile, then pixels.
fn send(
    mut encoder: impl ImageEncoder,
    image: &Image,
    bytes: &[u8],
    color: ExtendedColorType,
) -> Result<(), Fault> {
    let fault = |e| match e {
        ImageError::IoError(e) => Fault::Io(e),
        other => Fault::Encode(other.to_string()),
    };
    if let Some(icc) = &image.icc {
        encoder.set_icc_profile(icc.clone()).map_err(|e| Fault::Encode(e.to_string()))?;
    }
    let (width, height) = (image.width() as u32, image.height() as u32);
    encoder.write_image(bytes, width, height, color).map_err(fault)
}
