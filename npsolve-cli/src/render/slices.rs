//! Volumes as pictures: one slice, or three at right angles.

use std::path::Path;

use anyhow::{Result, bail};
use signal_io::{Image, ReadOptions};

use crate::files::in_our_words;
use crate::values::Slice;

/// The slice that is asked for, or the three through the middle, from the smallest value (black) to the largest.
pub fn picture(path: &Path, slice: Option<Slice>) -> Result<Image> {
    let volume = signal_io::read_volume(path, &ReadOptions::default()).map_err(in_our_words)?;
    let [low, high] = volume.range().unwrap_or([0.0, 1.0]);
    let window = [low, if high > low { high } else { low + 1.0 }];
    let shape = volume.shape();
    match slice {
        Some(Slice { axis, index }) if index >= shape[axis] => bail!(
            "{} has slices 0 to {} along {}; {index} is not there",
            path.display(),
            shape[axis] - 1,
            ["x", "y", "z"][axis]
        ),
        Some(Slice { axis, index }) => Ok(volume.slice(axis, index, window)?),
        None => Ok(volume.views(shape.map(|n| n / 2), window)?),
    }
}
