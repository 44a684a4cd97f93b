//! Volumes as pictures: one slice, or three at right angles.

use std::path::Path;

use anyhow::{Result, bail};
use signal_io::{Image, SampleType, Transfer, Volume};

use crate::signals::volume;
use crate::values::Slice;

/// Pixels between the views of a sheet.
const GAP: usize = 4;

/// The slice that is asked for, or the three through the middle, from the smallest value (black) to the largest.
pub fn picture(path: &Path, slice: Option<Slice>) -> Result<Image> {
    let volume = volume::read(path)?;
    let shape = volume.shape();
    let mut at = shape.map(|n| n / 2);
    let mut picture = match slice {
        Some(Slice { axis, index }) if index >= shape[axis] => bail!(
            "{} has slices 0 to {} along {}; {index} is not there",
            path.display(),
            shape[axis] - 1,
            ["x", "y", "z"][axis]
        ),
        Some(Slice { axis, index }) => {
            at[axis] = index;
            let [x, y, z] = volume.views(at, window(&volume))?;
            colors([x, y, z][axis].clone())?
        }
        None => sheet(&volume, at, window(&volume))?,
    };
    (picture.sample, picture.transfer) = (SampleType::U8, Transfer::Srgb);
    Ok(picture)
}

/// The three slices through a voxel: across z, y and x; the window's ends become black and white.
pub fn sheet(volume: &Volume, at: [usize; 3], window: [f32; 2]) -> Result<Image> {
    let [x, y, z] = volume.views(at, window)?;
    side_by_side(&[colors(z)?, colors(y)?, colors(x)?])
}

/// What becomes black and white: the range of the values.
pub fn window(volume: &Volume) -> [f32; 2] {
    let [low, high] = volume.range().unwrap_or([0.0, 1.0]);
    [low, if high > low { high } else { low + 1.0 }]
}

/// What a picture can show of the channels: three, or the first one.
fn colors(image: Image) -> Result<Image> {
    let (count, n) = (image.channels().len(), image.pixel_count());
    let names: &[&str] = if count >= 3 { &["R", "G", "B"] } else { &["Y"] };
    Ok(Image::new(
        image.width(),
        image.height(),
        names,
        image.as_planar()[..names.len() * n].to_vec(),
    )?)
}

/// Pictures beside each other on black.
fn side_by_side(parts: &[Image]) -> Result<Image> {
    let width = parts.iter().map(Image::width).sum::<usize>() + (parts.len() - 1) * GAP;
    let height = parts.iter().map(Image::height).max().unwrap_or(1);
    let names = parts[0].channels().to_vec();
    let mut data = vec![0.0; width * height * names.len()];
    let mut left = 0;
    for part in parts {
        for c in 0..names.len() {
            for (y, row) in part.plane(c).chunks(part.width()).enumerate() {
                let at = (c * height + y) * width + left;
                data[at..at + row.len()].copy_from_slice(row);
            }
        }
        left += part.width() + GAP;
    }
    Ok(Image::new(width, height, &names, data)?)
}
