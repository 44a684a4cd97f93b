//! The region's weights without a picture of them in memory.

use std::io;

use anyhow::{Result, bail};
use poisson_loss::{BlockSource, PlaneFile};
use signal_io::{Image, ReadOptions, RowReader};

use super::input::{HASH, Streamed, band_rows, create, hash_bytes, hash_values, put};
use super::scratch::{Scratch, Stop};
use crate::args::BlendArgs;
use crate::shapes::{self, InSamples};
use crate::{files, mask};

/// Weights on the patch's lattice.
pub struct Weights {
    shape: [usize; 2],
    source: Source,
    /// Of the weights, or of what they are made from.
    pub hash: u64,
    /// What the user should know.
    pub warning: Option<String>,
}

enum Source {
    /// A plane of a scratch file.
    File(PlaneFile<2>),
    /// One within a shape.
    Shape(Box<dyn Fn([usize; 2]) -> bool + Send + Sync>),
    /// One everywhere.
    All,
}

impl Weights {
    /// From `--region`, `--mask` or the patch's alpha, else all of the patch.
    pub fn open(
        args: &BlendArgs,
        patch: &Streamed,
        name: &str,
        options: &ReadOptions,
        scratch: &mut Scratch,
        stop: &Stop,
    ) -> Result<Self> {
        let (shape, warning) = (patch.shape, None);
        if let Some(region) = &args.scene.region {
            let source = Source::Shape(shapes::inside(region, &InSamples)?);
            let hash = hash_bytes([HASH; 3], format!("{region:?}").as_bytes());
            return Ok(Self { shape, source, hash, warning });
        }
        if let Some(path) = &args.scene.mask {
            return Self::read(path, patch, options, scratch, stop);
        }
        let Some(mut alpha) = patch.alpha_file()? else {
            return Ok(Self { shape, source: Source::All, hash: HASH, warning });
        };
        check_all(&mut alpha, shape, &format!("the alpha of {name}"), stop)?;
        // The patch's hash has its alpha in it.
        Ok(Self { shape, source: Source::File(alpha), hash: HASH, warning })
    }

    fn read(
        path: &std::path::Path,
        patch: &Streamed,
        options: &ReadOptions,
        scratch: &mut Scratch,
        stop: &Stop,
    ) -> Result<Self> {
        let (name, shape) = (path.display().to_string(), patch.shape);
        let what = format!("the mask {name}");
        let open = || RowReader::open(path, options).map_err(files::in_our_words);
        let mut reader = open()?;
        let info = reader.info().clone();
        mask::check_size([info.width, info.height], shape, &name)?;
        let has_alpha = info.channels.iter().any(|c| c == "A");
        let by_alpha = has_alpha && is_transparent(&mut open()?, stop)?;
        let target = scratch.make("mask");
        let mut file = create(&target, shape, 1)?;
        let (mut y, mut hash, mut faint, mut empty) = (0, HASH, 0, true);
        while let Some(band) = reader.read(band_rows(&info)).map_err(files::in_our_words)? {
            stop.check()?;
            let weights = weights_of(band, by_alpha, &name)?;
            mask::check_range(&weights, shape[0], y, &what)?;
            faint += weights.iter().filter(|w| mask::is_faint(**w)).count();
            empty &= weights.iter().all(|w| *w == 0.0);
            hash = hash_values(hash, &weights);
            put(&mut file, &target, 0, y, shape[0], &weights)?;
            y += weights.len() / shape[0];
        }
        if empty {
            bail!(mask::empty(&what));
        }
        let warning = mask::faint_warning(faint, shape[0] * shape[1], &name);
        Ok(Self { shape, source: Source::File(file), hash, warning })
    }
}

fn weights_of(band: Image, by_alpha: bool, name: &str) -> Result<Vec<f32>> {
    let (colors, alpha) = band.split_alpha();
    match alpha.filter(|_| by_alpha) {
        Some(alpha) => Ok(alpha),
        None => mask::weights_of(&colors, name),
    }
}

/// Whether any pixel is not opaque.
fn is_transparent(reader: &mut RowReader, stop: &Stop) -> Result<bool> {
    let rows = band_rows(reader.info());
    while let Some(band) = reader.read(rows).map_err(files::in_our_words)? {
        stop.check()?;
        if band.alpha().is_some_and(|alpha| alpha.iter().any(|a| *a != 1.0)) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The checks of a mask, for a plane that is in a file already.
fn check_all(file: &mut PlaneFile<2>, [w, h]: [usize; 2], what: &str, stop: &Stop) -> Result<()> {
    let (mut empty, mut row) = (true, vec![0.0; w]);
    for y in 0..h {
        stop.check()?;
        file.read(0, [0, y], [w, 1], &mut row)?;
        mask::check_range(&row, w, y, what)?;
        empty &= row.iter().all(|a| *a == 0.0);
    }
    if empty {
        bail!(mask::empty(what));
    }
    Ok(())
}

impl BlockSource<2> for Weights {
    fn shape(&self) -> [usize; 2] {
        self.shape
    }

    fn channels(&self) -> usize {
        1
    }

    fn read(
        &self,
        channel: usize,
        start: [usize; 2],
        shape: [usize; 2],
        out: &mut [f32],
    ) -> io::Result<()> {
        match &self.source {
            Source::File(file) => file.read(channel, start, shape, out)?,
            Source::All => out.fill(1.0),
            Source::Shape(inside) => {
                for (y, row) in out.chunks_exact_mut(shape[0]).enumerate() {
                    for (x, v) in row.iter_mut().enumerate() {
                        *v = f32::from(u8::from(inside([start[0] + x, start[1] + y])));
                    }
                }
            }
        }
        Ok(())
    }
}
