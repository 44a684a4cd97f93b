//! Composited animation frames as they come from GIF and WebP: 8 bits, four channels side by side.

use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::{Image, SampleType, Transfer};

/// Frames of one canvas, collected before it is known whether any of them is transparent.
pub(super) struct Frames {
    width: usize,
    height: usize,
    bytes: Vec<u8>,
}

impl Frames {
    /// Room for `count` frames, after the smallest video they can become has been checked.
    pub(super) fn new(
        width: u32,
        height: u32,
        count: usize,
        budget: &Budget,
    ) -> Result<Self, Fault> {
        let rows = u64::from(height).saturating_mul(count as u64);
        budget.samples(width.into(), rows, 3)?;
        let (width, height) = (width as usize, height as usize);
        Ok(Self { width, height, bytes: with_capacity(width * height * count * 4)? })
    }

    /// Adds a frame of red, green, blue and alpha.
    pub(super) fn push(&mut self, rgba: &[u8]) {
        assert_eq!(rgba.len(), self.width * self.height * 4, "bytes of a frame");
        self.bytes.extend_from_slice(rgba);
    }

    /// One below the other; alpha is dropped where everything is opaque.
    pub(super) fn into_strip(self, budget: &Budget) -> Result<Image, Fault> {
        let (pixels, _) = self.bytes.as_chunks::<4>();
        let opaque = pixels.iter().all(|p| p[3] == 255);
        let names = &["R", "G", "B", "A"][..if opaque { 3 } else { 4 }];
        let rows = pixels.len() / self.width;
        let count = budget.samples(self.width as u64, rows as u64, names.len() as u64)?;
        let mut data = with_capacity(count)?;
        for c in 0..names.len() {
            data.extend(pixels.iter().map(|p| f32::from(p[c]) / 255.0));
        }
        let mut strip = Image::new(self.width, rows, names, data)?;
        (strip.sample, strip.transfer) = (SampleType::U8, Transfer::Srgb);
        Ok(strip)
    }
}

/// A frame as bytes, grey as three equal channels, and how many colour values were clipped.
pub(super) fn to_bytes(frame: &Image) -> Result<(Vec<u8>, usize), Fault> {
    use crate::codec::quantize::{interleave, to_u8};
    let q = interleave(&frame.to_rgb()?, to_u8);
    // Three equal channels are counted as one.
    Ok((q.values, q.clipped * frame.color_count() / 3))
}
