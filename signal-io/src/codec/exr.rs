//! OpenEXR: any set of channels of any layers, half, float or unsigned integer.

mod dwa;

use std::io::{Cursor, Seek, Write};
use std::panic::AssertUnwindSafe;

use ::exr::image::write::WritableImage;
use ::exr::meta::MetaData;
use ::exr::meta::header::Header;
use ::exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image as ExrImage, ReadChannels,
    ReadLayers, Text, read,
};

use super::quantize::to_f16;
use crate::budget::{Budget, check_plausible, with_capacity};
use crate::error::Fault;
use crate::plan::Plan;
use crate::{Image, SampleType, Transfer};

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    // Altered data can make version 1.74 of the exr crate panic (B44: an overflowing subtraction in
    // builds that check for it). In its own threads that would end the process, so decoding stays
    // on this one, where a panic can be turned into an error.
    let decoding = || decode_unguarded(bytes, budget);
    std::panic::catch_unwind(AssertUnwindSafe(decoding))
        .unwrap_or_else(|_| Err(Fault::corrupt("the decoder gave up on its data")))
}

fn decode_unguarded(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let meta = MetaData::read_from_buffered(bytes, false).map_err(fault)?;
    for header in &meta.headers {
        check_header(header, bytes.len(), budget)?;
    }
    check_sum(&meta.headers, budget)?;
    dwa::check_chunks(bytes, &meta).map_err(fault)?;
    let layers = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(fault)?
        .layer_data;
    let size = layers.first().ok_or(Fault::Empty)?.size;
    let several = layers.len() > 1;
    let mut channels = Vec::new();
    for layer in layers.into_iter().filter(|layer| layer.size == size) {
        let name = layer.attributes.layer_name.filter(|_| several).map(|name| name.to_string());
        for channel in layer.channel_data.list {
            channels.push((full_name(name.as_deref(), &channel.name.to_string()), channel));
        }
    }
    channels.sort_by_cached_key(|(name, _)| sort_key(name));
    if let Some(twice) = channels.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(Fault::corrupt(format!("it has two channels {:?}", twice[0].0)));
    }
    let (width, height) = (size.width(), size.height());
    let count = budget.samples(width as u64, height as u64, channels.len() as u64)?;
    let names: Vec<String> = channels.iter().map(|(name, _)| name.clone()).collect();
    let half = channels.iter().all(|(_, c)| matches!(c.sample_data, FlatSamples::F16(_)));
    let mut data = with_capacity(count)?;
    for (_, channel) in channels {
        match channel.sample_data {
            FlatSamples::F16(v) => data.extend(v.iter().map(|v| v.to_f32())),
            FlatSamples::F32(v) => data.extend(v),
            FlatSamples::U32(v) => data.extend(v.iter().map(|v| *v as f32)),
        }
    }
    let mut image = Image::new(width, height, &names, data)?;
    image.sample = if half { SampleType::F16 } else { SampleType::F32 };
    image.transfer = Transfer::Linear;
    Ok(image)
}

/// The name of a channel in a file of several layers: that of its layer before it, unless it is there
/// already, as some writers put it.
fn full_name(layer: Option<&str>, channel: &str) -> String {
    match layer.filter(|layer| !layer.is_empty()) {
        Some(layer) if channel.strip_prefix(layer).is_none_or(|rest| !rest.starts_with('.')) => {
            format!("{layer}.{channel}")
        }
        _ => channel.to_owned(),
    }
}

/// Refuses layers that fit one by one but not together; those of another size are decoded, too.
fn check_sum(headers: &[Header], budget: &Budget) -> Result<(), Fault> {
    let samples = |h: &Header| h.layer_size.area() as u64 * h.channels.list.len() as u64;
    let needed = headers.iter().map(samples).fold(0, u64::saturating_add).saturating_mul(4);
    match needed > budget.limit() {
        true => Err(Fault::TooLarge { needed, limit: budget.limit() }),
        false => Ok(()),
    }
}

/// Refuses, before anything is decoded, what cannot or may not be.
fn check_header(header: &Header, file_bytes: usize, budget: &Budget) -> Result<(), Fault> {
    if header.deep {
        return Err(Fault::Feature("deep data".to_owned()));
    }
    let channels = &header.channels.list;
    if channels.iter().any(|c| (c.sampling.x(), c.sampling.y()) != (1, 1)) {
        return Err(Fault::Feature("subsampled channels".to_owned()));
    }
    let size = header.layer_size;
    budget.samples(size.width() as u64, size.height() as u64, channels.len() as u64)?;
    // Each chunk has an entry of 8 bytes in the offset table and a header of 8 bytes at least.
    if (header.chunk_count as u64).saturating_mul(16) > file_bytes as u64 {
        let chunks = header.chunk_count;
        return Err(Fault::corrupt(format!("{chunks} chunks do not fit into {file_bytes} bytes")));
    }
    check_plausible(decoded_bytes(header), file_bytes, best_ratio(header.compression))
}

/// Bytes of all samples of a layer, after its size was checked.
fn decoded_bytes(header: &Header) -> u64 {
    let samples = header.layer_size.area() as u64;
    header.channels.list.iter().map(|c| samples * c.sample_type.bytes_per_sample() as u64).sum()
}

/// Bytes that one stored byte can stand for, at most; generous where the method has no clear bound.
fn best_ratio(compression: Compression) -> u64 {
    match compression {
        Compression::Uncompressed => 1,
        Compression::RLE => 64,                     // 128 equal bytes in 2.
        Compression::B44 | Compression::B44A => 11, // 16 halves in 3 bytes.
        Compression::ZIP1 | Compression::ZIP16 => 1032, // The best of deflate.
        _ => 4096,
    }
}

/// Files list channels by alphabet (A B G R). People want R G B, then the rest, then alpha; the same
/// inside every layer (`diffuse.R`).
fn sort_key(name: &str) -> (String, usize, String) {
    let (layer, channel) = name.rsplit_once('.').unwrap_or(("", name));
    let known = ["R", "G", "B", "Y"].iter().position(|c| *c == channel);
    let rank = if channel == "A" { 5 } else { known.unwrap_or(4) };
    (layer.to_owned(), rank, channel.to_owned())
}

fn fault(error: ::exr::error::Error) -> Fault {
    use ::exr::error::Error;
    match error {
        Error::NotSupported(what) => Fault::Feature(what.into_owned()),
        Error::Io(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Fault::cut_short(),
        other => Fault::corrupt(other.to_string()),
    }
}

/// Writes one layer in scan lines with ZIP compression, which loses nothing. Layers are in the names of
/// its channels, which every reader understands.
pub(super) fn encode(
    image: &Image,
    plan: &Plan,
    w: &mut (impl Write + Seek),
) -> Result<usize, Fault> {
    let mut clipped = 0;
    let mut list = Vec::new();
    for (c, name) in image.channels().iter().enumerate() {
        let text = Text::new_or_none(name).filter(|_| name.len() <= 255).ok_or_else(|| {
            let what = format!("a channel named {name:?}");
            Fault::cannot_hold(what, "choose Latin names of at most 255 letters")
        })?;
        let plane = image.plane(c);
        let samples = match plan.sample {
            SampleType::F16 => {
                let (halves, clips): (Vec<_>, Vec<_>) = plane.iter().map(|v| to_f16(*v)).unzip();
                if name != "A" {
                    clipped += clips.iter().filter(|c| **c).count();
                }
                FlatSamples::F16(halves)
            }
            _ => FlatSamples::F32(plane.to_vec()),
        };
        list.push(AnyChannel::new(text, samples));
    }
    let size = (image.width(), image.height());
    let channels = AnyChannels::sort(list.into());
    ExrImage::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, channels)
        .write()
        .to_buffered(w)
        .map_err(|e| match e {
            ::exr::error::Error::Io(e) => Fault::Io(e),
            other => Fault::Encode(other.to_string()),
        })?;
    Ok(clipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_named_once() {
        assert_eq!(full_name(Some("diffuse"), "R"), "diffuse.R");
        assert_eq!(full_name(Some("diffuse"), "diffuse.R"), "diffuse.R");
        assert_eq!(full_name(Some("diffuse"), "diffuse2.R"), "diffuse.diffuse2.R");
        assert_eq!(full_name(Some("left.diffuse"), "R"), "left.diffuse.R");
        assert_eq!(full_name(Some(""), "R"), "R");
        assert_eq!(full_name(None, "Z"), "Z");
    }

    #[test]
    fn channels_come_in_the_usual_order() {
        let mut names = vec!["A", "B", "G", "R", "Z", "diffuse.A", "diffuse.B", "diffuse.R"];
        names.sort_by_cached_key(|n| sort_key(n));
        assert_eq!(names, ["R", "G", "B", "Z", "A", "diffuse.R", "diffuse.B", "diffuse.A"]);
    }
}
