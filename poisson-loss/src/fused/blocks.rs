//! Where the screening is uniform: per tile, and per block of a row in two dimensions.

use rayon::prelude::*;

use crate::operator::REACH;
use crate::tile::{Beyond, Frame, Tile, uniform_value};

/// Coefficients of one block.
pub const BLOCK: usize = 16;
/// How far the cells lie that a coefficient sees.
const CELLS: usize = 2;

/// What the passes know of one tile's screening.
pub struct Class {
    /// The screening, if it is the same on the tile and the widest halo of any pass.
    pub uniform: Option<f32>,
    /// Two dimensions, tile not uniform: per row of the core and per block of it the screening of
    /// all cells that the block sees, or NaN where they differ.
    pub blocks: Vec<f32>,
    /// One bit per block for every row of the tile with its halo [`REACH`]: set where a block
    /// within [`CELLS`] rows is mixed, so that the cells of this row are needed there.
    pub needed: Vec<u32>,
}

impl Class {
    /// `tile` has the widest halo.
    pub fn new<const D: usize>(tile: &Tile<D>, screening: &[f32], buffer: &mut Vec<f32>) -> Self {
        let uniform = tile.uniform(screening);
        let mut class = Self { uniform, blocks: Vec::new(), needed: Vec::new() };
        if D == 2 && uniform.is_none() {
            tile.load(screening, Beyond::Edge, buffer);
            class.find_blocks(tile, buffer);
        }
        class
    }

    fn find_blocks<const D: usize>(&mut self, tile: &Tile<D>, cells: &[f32]) {
        let (e0, halo, rows) = (tile.extent(0), tile.halo, tile.core[D - 1]);
        let blocks = tile.core[0].div_ceil(BLOCK);
        assert!(blocks <= u32::BITS as usize, "tiles are narrow");
        let one_row = |row: usize, block: usize| {
            let from = row * e0 + halo + block * BLOCK - CELLS;
            let to = (from + BLOCK + 2 * CELLS).min((row + 1) * e0);
            uniform_value(&cells[from..to]).unwrap_or(f32::NAN)
        };
        let of_rows: Vec<f32> = (halo - CELLS..halo + rows + CELLS)
            .flat_map(|row| (0..blocks).map(move |block| one_row(row, block)))
            .collect();
        self.needed = vec![0; rows + 2 * REACH];
        for row in 0..rows {
            for block in 0..blocks {
                let value = |k: usize| of_rows[(row + k) * blocks + block];
                let same = (1..=2 * CELLS).all(|k| value(k) == value(0));
                self.blocks.push(if same { value(0) } else { f32::NAN });
                if !same {
                    for around in row + REACH - CELLS..=row + REACH + CELLS {
                        self.needed[around] |= 1 << block;
                    }
                }
            }
        }
    }
}

/// Tiles and classes of every slab of a frame.
pub fn classify<const D: usize>(
    frame: Frame<D>,
    screening: &[f32],
    halo: usize,
) -> Vec<Vec<Class>> {
    let slabs = frame.len().div_ceil(frame.slab_len());
    let of_slab = |buffer: &mut Vec<f32>, slab: usize| {
        frame.tiles(slab, halo).iter().map(|tile| Class::new(tile, screening, buffer)).collect()
    };
    (0..slabs).into_par_iter().map_init(Vec::new, of_slab).collect()
}
