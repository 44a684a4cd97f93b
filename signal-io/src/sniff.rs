//! Which kind of signal a file holds, where its name leaves a choice. Files that cannot be read, or are damaged, are
//! none of these: whoever reads them says what is wrong.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use tiff::decoder::Decoder;

use crate::light_field;
use crate::strip::listing;
use crate::video;

/// Whether a GIF or WebP file has more than one frame.
pub fn is_animation(path: impl AsRef<Path>) -> bool {
    std::fs::read(path).is_ok_and(|bytes| video::frame_count(&bytes).is_some_and(|n| n > 1))
}

/// Whether the pictures of a folder or pattern are named by row and column of a grid with several of each.
pub fn is_view_grid(path: impl AsRef<Path>) -> bool {
    let path = path.as_ref();
    let Some(Ok(files)) = listing::candidates(path) else { return false };
    light_field::grid_of(path, files).is_some_and(|grid| grid.iter().all(|n| *n > 1))
}

/// Whether a TIFF file has several pages, the first two of one size: a volume, not a picture with a preview.
pub fn is_tiff_stack(path: impl AsRef<Path>) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let Ok(mut pages) = Decoder::new(BufReader::new(file)) else { return false };
    let first = pages.dimensions().ok();
    first.is_some()
        && pages.more_images()
        && pages.next_image().is_ok()
        && pages.dimensions().ok() == first
}
