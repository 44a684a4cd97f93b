//! One file per format: bytes to pictures and back. Paths, overwriting and limits are decided outside.

mod exr;
mod hdr;
mod jpeg;
pub(crate) mod npy;
mod orientation;
mod pfm;
pub(crate) mod pnm;
pub(crate) mod quantize;
mod raster;
pub(crate) mod tiff;

use std::io::{Seek, Write};

pub(crate) use self::raster::fault as raster_fault;

use crate::budget::Budget;
use crate::error::Fault;
use crate::plan::Plan;
use crate::{Format, Image};

pub(crate) fn decode(format: Format, bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    match format {
        Format::Png | Format::Jpeg | Format::WebP | Format::Gif => {
            raster::decode(format, bytes, budget)
        }
        Format::Tiff => tiff::decode(bytes, budget),
        Format::Pnm => pnm::decode(bytes, budget),
        Format::Pfm => pfm::decode(bytes, budget),
        Format::Hdr => hdr::decode(bytes, budget),
        Format::Exr => exr::decode(bytes, budget),
        Format::Npy => npy::decode(bytes, budget),
    }
}

/// Writes a prepared picture; returns how many colour samples were clipped.
pub(crate) fn encode(
    image: &Image,
    plan: &Plan,
    writer: &mut (impl Write + Seek),
) -> Result<usize, Fault> {
    match plan.format {
        Format::Png | Format::Jpeg | Format::WebP | Format::Gif => {
            raster::encode(image, plan, writer)
        }
        Format::Tiff => tiff::encode(image, plan, writer),
        Format::Pnm => pnm::encode(image, plan, writer),
        Format::Pfm => pfm::encode(image, writer),
        Format::Hdr => hdr::encode(image, writer),
        Format::Exr => exr::encode(image, plan, writer),
        Format::Npy => npy::encode(image, plan, writer),
    }
}
