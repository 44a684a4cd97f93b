//! Pictures from their files into scratch files of planes, some rows at a time.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use poisson_loss::{BlockSink, PlaneFile};
use signal_io::{Image, PictureInfo, RowReader, Transfer};

use super::scratch::Stop;
use crate::args::{SceneArgs, ValueDomain};
use crate::{files, layers, scene};

/// Values of a band of rows, if a row is not longer.
pub const BAND: usize = 1 << 18;

/// How rows of both pictures become what is blended: equal colour channels in one encoding.
pub struct Conversion {
    gray: bool,
    /// Encodings of background and patch after it.
    transfers: [Transfer; 2],
    /// A picture of one pixel that is like the converted background.
    like: Image,
    names: [String; 2],
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Conversion {
    /// From what both files are; the same rules as for blends in memory.
    pub fn new(infos: &[PictureInfo; 2], args: &SceneArgs, names: &[String; 2]) -> Result<Self> {
        let one = |info: &PictureInfo| {
            let pixel = PictureInfo { width: 1, height: 1, ..info.clone() };
            pixel.rows(vec![0.5; info.channels.len()]).map(|image| image.split_alpha().0)
        };
        let [mut b, mut p] = [one(&infos[0])?, one(&infos[1])?];
        let chosen = layers::choose(b.clone(), p.clone(), &[], names)?;
        if chosen.whole.is_some() || chosen.patch.channels().len() != p.channels().len() {
            bail!(
                "{} and {} have layers, which --max-memory does not have; write those to blend into \
                 files of their own",
                names[0],
                names[1]
            );
        }
        if args.gray {
            (b, p) = (scene::to_gray(&b, &names[0])?, scene::to_gray(&p, &names[1])?);
        }
        let (mut warnings, domain) = (Vec::new(), args.domain.unwrap_or(ValueDomain::Stored));
        scene::match_transfers(&mut b, &mut p, domain, names, &mut warnings);
        let transfers = [b.transfer, p.transfer];
        scene::match_channels(&b, p, names)?;
        let (gray, names) = (args.gray, names.clone());
        Ok(Self { gray, transfers, like: b, names, warnings })
    }

    /// Colour channels to blend.
    pub fn channels(&self) -> usize {
        self.like.channels().len()
    }

    /// What the result is, from what the background is.
    pub fn result(&self, background: &PictureInfo) -> PictureInfo {
        let (width, height) = (background.width, background.height);
        let mut info = PictureInfo { width, height, ..PictureInfo::of(&self.like) };
        info.channels.extend(background.channels.iter().filter(|c| *c == "A").cloned());
        info
    }

    /// Rows of the background (0) or the patch (1).
    fn convert(&self, which: usize, band: &Image) -> Result<Image> {
        let gray = if self.gray { Some(scene::to_gray(band, &self.names[which])?) } else { None };
        let band = gray.as_ref().unwrap_or(band).to_transfer(self.transfers[which]);
        match which {
            0 => Ok(band),
            _ => scene::match_channels(&self.like, band, &self.names),
        }
    }
}

/// A picture in a scratch file: its colours, and its alpha behind them.
pub struct Streamed {
    path: PathBuf,
    /// Width and height.
    pub shape: [usize; 2],
    channels: usize,
    /// Whether it has an alpha plane.
    pub has_alpha: bool,
    /// Least and largest value of the colours.
    pub low: f32,
    /// See above.
    pub high: f32,
    /// Of all values.
    pub hash: u64,
}

impl Streamed {
    /// The colour planes.
    pub fn color_file(&self) -> Result<PlaneFile<2>> {
        open(&self.path, self.shape, self.channels, 0)
    }

    /// The alpha plane, if there is one.
    pub fn alpha_file(&self) -> Result<Option<PlaneFile<2>>> {
        let before = 4 * (self.channels * self.shape[0] * self.shape[1]) as u64;
        self.has_alpha.then(|| open(&self.path, self.shape, 1, before)).transpose()
    }
}

fn open(path: &Path, shape: [usize; 2], channels: usize, before: u64) -> Result<PlaneFile<2>> {
    PlaneFile::open(path, shape, channels, before)
        .with_context(|| format!("cannot read the scratch file {}", path.display()))
}

/// A new scratch file of planes.
pub fn create(path: &Path, shape: [usize; 2], channels: usize) -> Result<PlaneFile<2>> {
    PlaneFile::create(path, shape, channels, 0).with_context(|| {
        format!("cannot make the scratch file {}; check permissions and free space", path.display())
    })
}

/// Appends rows to planes of a scratch file.
pub fn put(
    file: &mut PlaneFile<2>,
    path: &Path,
    c: usize,
    y: usize,
    w: usize,
    values: &[f32],
) -> Result<()> {
    file.write(c, [0, y], [w, values.len() / w], values).with_context(|| {
        format!("cannot write the scratch file {}; check the free space", path.display())
    })
}

/// Rows of a band of a picture this wide.
pub fn band_rows(info: &PictureInfo) -> usize {
    (BAND / (info.width * info.channels.len())).max(1)
}

/// Reads the background (0) or the patch (1) into a scratch file.
pub fn stream(
    mut reader: RowReader,
    which: usize,
    conversion: &Conversion,
    name: &str,
    path: &Path,
    stop: &Stop,
    progress: &mut dyn FnMut(f32),
) -> Result<Streamed> {
    let info = reader.info().clone();
    let (shape, channels) = ([info.width, info.height], conversion.channels());
    let has_alpha = info.channels.iter().any(|c| c == "A");
    let mut file = create(path, shape, channels + usize::from(has_alpha))?;
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    let (mut y, mut hash) = (0, HASH);
    while let Some(band) = reader.read(band_rows(&info)).map_err(files::in_our_words)? {
        stop.check()?;
        check_finite(name, &band, y)?;
        let rows = band.height();
        let (colors, alpha) = band.split_alpha();
        let colors = conversion.convert(which, &colors)?;
        for c in 0..channels {
            put(&mut file, path, c, y, info.width, colors.plane(c))?;
        }
        if let Some(alpha) = alpha {
            put(&mut file, path, channels, y, info.width, &alpha)?;
            hash = hash_values(hash, &alpha);
        }
        for v in colors.as_planar() {
            (low, high) = (low.min(*v), high.max(*v));
        }
        hash = hash_values(hash, colors.as_planar());
        y += rows;
        progress(y as f32 / info.height as f32);
    }
    let path = path.to_path_buf();
    Ok(Streamed { path, shape, channels, has_alpha, low, high, hash })
}

fn check_finite(name: &str, band: &Image, first: usize) -> Result<()> {
    let Some(k) = band.as_planar().iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let (width, n) = (band.width(), band.pixel_count());
    bail!(
        "{name} holds {} at pixel {},{} of channel {}; replace such values first",
        band.as_planar()[k],
        k % n % width,
        first + k % n / width,
        band.channels()[k / n],
    )
}

/// Where a hash begins: FNV-1a, of numbers instead of bytes.
pub const HASH: u64 = 0xCBF2_9CE4_8422_2325;

/// Takes values into a hash.
pub fn hash_values(hash: u64, values: &[f32]) -> u64 {
    values.iter().fold(hash, |hash, v| step(hash, u64::from(v.to_bits())))
}

/// The hash of other hashes and of a text.
pub fn hash_bytes(hashes: [u64; 3], bytes: &[u8]) -> u64 {
    let all = hashes.into_iter().chain(bytes.iter().map(|b| u64::from(*b)));
    all.fold(HASH, step)
}

fn step(hash: u64, value: u64) -> u64 {
    (hash ^ value).wrapping_mul(0x0100_0000_01B3).rotate_left(5)
}
