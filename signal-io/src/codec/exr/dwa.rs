use std::io::Cursor;

use ::exr::block::chunk::{Chunk, CompressedBlock};
use ::exr::error::{Error, Result};
use ::exr::meta::MetaData;
use ::exr::meta::header::Header;
use ::exr::prelude::Compression;

use super::decoded_bytes;

/// Refuses DWA chunks whose sections would be larger than the whole picture: version 1.74 of the exr
/// crate allocates for the sizes in the chunk as they are, and a failing allocation ends the program.
pub(super) fn check_chunks(bytes: &[u8], meta: &MetaData) -> Result<()> {
    let is_dwa = |h: &Header| matches!(h.compression, Compression::DWAA(_) | Compression::DWAB(_));
    if !meta.headers.iter().any(is_dwa) {
        return Ok(());
    }
    for chunk in ::exr::block::read(Cursor::new(bytes), false)?.all_chunks(false)? {
        let chunk = chunk?;
        match meta.headers.get(chunk.layer_index) {
            Some(header) if is_dwa(header) => check_chunk(&chunk, header)?,
            _ => {}
        }
    }
    Ok(())
}

fn check_chunk(chunk: &Chunk, header: &Header) -> Result<()> {
    let data = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()), // Deep data was refused before.
    };
    // What would not get smaller is stored as it is, without counters.
    let place = header.get_block_data_indices(&chunk.compressed_block)?;
    let pixels = header.get_absolute_block_pixel_coordinates(place)?.size.area();
    if data.len() == pixels * header.channels.bytes_per_pixel {
        return Ok(());
    }
    // Eleven counters of 8 bytes. Number 1, 6 and 7 count decoded bytes, 8 and 9 coefficients of two
    // bytes; these fill blocks of 8 x 8, hence the megabyte for pictures smaller than a block.
    let counters = data.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b));
    let most = decoded_bytes(header).saturating_mul(4).saturating_add(1 << 20);
    let excess = |(k, count): (usize, u64)| matches!(k, 1 | 6..=9) && count > most;
    match counters.take(11).enumerate().any(excess) {
        true => Err(Error::Invalid("a DWA chunk promises more than the whole picture".into())),
        false => Ok(()),
    }
}
