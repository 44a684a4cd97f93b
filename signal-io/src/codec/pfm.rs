//! Portable float maps: a text header and rows of floats from bottom to top.

use std::io::Write;

use super::pnm::Tokens;
use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::image::usual_names;
use crate::{Image, SampleType, Transfer};

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let channels = match bytes.get(..2) {
        Some(b"PF") => 3,
        Some(b"Pf") => 1,
        _ => return Err(Fault::corrupt("it does not start with PF or Pf")),
    };
    let mut tokens = Tokens::new(&bytes[2..]);
    let (width, height) = (tokens.number()?, tokens.number()?);
    let scale: f32 =
        tokens.word()?.parse().map_err(|_| Fault::corrupt("its scale is no number"))?;
    // The sign is the byte order; the size would only rescale brightness and is ignored, as usual.
    let convert = match scale < 0.0 {
        true => f32::from_le_bytes,
        false => f32::from_be_bytes,
    };
    let count = budget.samples(width, height, channels)?;
    let body = tokens.body()?;
    let (values, _) = body.as_chunks::<4>();
    let values = values.get(..count).ok_or_else(Fault::cut_short)?;
    let (w, h, c) = (width as usize, height as usize, channels as usize);
    let mut data = with_capacity(count)?;
    for k in 0..c {
        for y in (0..h).rev() {
            data.extend((0..w).map(|x| convert(values[(y * w + x) * c + k])));
        }
    }
    let mut image = Image::new(w, h, &usual_names(c), data)?;
    (image.sample, image.transfer) = (SampleType::F32, Transfer::Linear);
    Ok(image)
}

pub(super) fn encode(image: &Image, w: &mut impl Write) -> Result<usize, Fault> {
    let (width, height, channels) = (image.width(), image.height(), image.channels().len());
    let magic = if channels == 1 { "Pf" } else { "PF" };
    write!(w, "{magic}\n{width} {height}\n-1.0\n")?;
    let planes: Vec<&[f32]> = (0..channels).map(|c| image.plane(c)).collect();
    for y in (0..height).rev() {
        for x in 0..width {
            for plane in &planes {
                w.write_all(&plane[y * width + x].to_le_bytes())?;
            }
        }
    }
    Ok(0)
}
