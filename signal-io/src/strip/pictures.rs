//! Files of one size and kind into one strip.

use std::path::{Path, PathBuf};

use super::{adopt, difference};
use crate::budget::{Budget, zeros};
use crate::{Error, Image, ReadOptions, Result, read_image};

/// Reads pictures into one strip, in the order given. `path` stands for all of them in messages
/// about the whole.
///
/// The first one says size, channels and what the numbers mean; memory for all is taken after it has
/// been read and the sum been checked against the limit.
///
/// # Errors
/// Those of [`read_image`], and [`Error::Mismatch`] with the first file that is not like the first.
pub(crate) fn read(path: &Path, files: &[PathBuf], options: &ReadOptions) -> Result<Image> {
    let named = |fault: crate::error::Fault| fault.at(path, "picture sequence", "read");
    let Some((head, tail)) = files.split_first() else {
        return Err(Error::Empty { path: path.to_path_buf() });
    };
    let first = read_image(head, options)?;
    let (channels, n) = (first.channels().len(), first.pixel_count());
    let rows = (first.height() as u64).saturating_mul(files.len() as u64);
    let count = Budget::new(options.limit_bytes)
        .samples(first.width() as u64, rows, channels as u64)
        .map_err(named)?;
    let mut data = zeros::<f32>(count).map_err(named)?;
    let mut place = |k: usize, image: &Image| {
        for c in 0..channels {
            data[(c * files.len() + k) * n..][..n].copy_from_slice(image.plane(c));
        }
    };
    place(0, &first);
    for (k, file) in tail.iter().enumerate() {
        let image = read_image(file, options)?;
        if let Some(what) = difference(&image, &first) {
            return Err(Error::Mismatch { path: file.clone(), first: head.clone(), what });
        }
        place(k + 1, &image);
    }
    let height = first.height() * files.len();
    let mut strip = Image::new(first.width(), height, first.channels(), data)?;
    adopt(&mut strip, &first);
    Ok(strip)
}
