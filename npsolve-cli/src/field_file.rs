//! Fields in files: checkpoints, and pictures that stand for their splines.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Result, anyhow, bail};
use inr_core::{Checkpoint, Description, Domain, Error};
use signal_io::{Format, Image};

use crate::channels::{self, ChannelJob, with_channels};
use crate::files;
use crate::neural;
use crate::picture_kind::PictureKind;

/// What the name of a field's file ends with.
pub const EXTENSION: &str = "safetensors";

/// A field over pictures, not yet typed by its channels.
pub enum FieldFile {
    /// A picture, whose field is the spline through its samples.
    Picture(Image),
    /// A checkpoint of two coordinates and a number of channels that can be worked with.
    Network {
        /// The whole file.
        bytes: Vec<u8>,
        /// What its header says.
        about: Box<Description>,
    },
}

impl FieldFile {
    /// Reads a file and checks that its field is one over pictures.
    pub fn read(path: &Path) -> Result<Self> {
        if !is_network(path) {
            return files::read(path).map(Self::Picture);
        }
        let bytes = files::read_bytes(path)?;
        let about = describe(path, &bytes)?;
        let (d, c) = (about.dimensions, about.channels);
        if d != 2 {
            let lattice: Vec<String> = about.shape.iter().map(usize::to_string).collect();
            bail!(
                "{} is a field over {d} coordinates, with {} samples; pictures are made of fields \
                 over 2: see npsolve inspect",
                path.display(),
                lattice.join(" x ")
            );
        }
        if c > channels::MOST {
            let most = channels::MOST;
            bail!("{} has {c} channels; choose a field with 1 to {most}", path.display());
        }
        Ok(Self::Network { bytes, about: Box::new(about) })
    }

    /// What its pictures are like.
    pub fn picture_kind(&self) -> PictureKind {
        match self {
            Self::Picture(image) => PictureKind::of(image),
            Self::Network { about, .. } => PictureKind::from_notes(&about.notes, about.channels),
        }
    }

    /// The file of a network.
    pub fn network_bytes(&self) -> Option<Vec<u8>> {
        match self {
            Self::Picture(_) => None,
            Self::Network { bytes, .. } => Some(bytes.clone()),
        }
    }

    /// The picture, or a network's on its own lattice.
    pub fn into_picture(self, path: &Path) -> Result<Image> {
        let kind = self.picture_kind();
        match self {
            Self::Picture(image) => Ok(image),
            Self::Network { bytes, about } => {
                let job = Sampled { path, bytes: &bytes };
                let planes = with_channels::<2, _>(about.channels, job)
                    .ok_or_else(|| anyhow!("{} has no channels", path.display()))??;
                kind.picture([about.shape[0], about.shape[1]], planes)
            }
        }
    }

    /// The lattice of its signal.
    pub fn domain(&self) -> Result<Domain<2>> {
        match self {
            Self::Picture(image) => Ok(image.domain()),
            Self::Network { about: a, .. } => {
                let pair = |v: &[f32]| [v[0], v[1]];
                let (shape, unit) = ([a.shape[0], a.shape[1]], a.unit);
                Ok(Domain::new(shape, pair(&a.pitch), pair(&a.origin), unit)?)
            }
        }
    }
}

struct Sampled<'a> {
    path: &'a Path,
    bytes: &'a [u8],
}

impl ChannelJob for Sampled<'_> {
    type Output = Result<Vec<f32>>;

    fn run<const C: usize>(self) -> Self::Output {
        let checkpoint = checkpoint::<2, C>(self.path, self.bytes)?;
        Ok(neural::sampled(&checkpoint.network, &checkpoint.domain))
    }
}

/// Whether a name is that of a network's file.
pub fn is_network_name(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(EXTENSION))
}

/// Whether a file holds a network rather than a picture: by its content, else by its name.
pub fn is_network(path: &Path) -> bool {
    let mut head = Vec::new();
    if let Ok(file) = File::open(path) {
        // What cannot be read fails later, with a message.
        let _ = file.take(16).read_to_end(&mut head);
    }
    // A safetensors file begins with the length of its header, below 100 MB, which is JSON.
    match head[..] {
        _ if Format::from_content(&head).is_some() => false,
        [_, _, _, 0..6, 0, 0, 0, 0, b'{', ..] => true,
        _ => path.extension().is_some_and(|e| e.eq_ignore_ascii_case(EXTENSION)),
    }
}

/// What a checkpoint holds.
pub fn describe(path: &Path, bytes: &[u8]) -> Result<Description> {
    Description::from_bytes(bytes).map_err(|e| in_our_words(path, e))
}

/// A checkpoint with its types.
pub fn checkpoint<const D: usize, const C: usize>(
    path: &Path,
    bytes: &[u8],
) -> Result<Checkpoint<D, C>> {
    Checkpoint::from_bytes(bytes).map_err(|e| in_our_words(path, e))
}

/// The library does not know the file's name, nor where such files come from.
fn in_our_words(path: &Path, error: Error) -> anyhow::Error {
    let file = path.display();
    match error {
        Error::NotSafetensors { reason } => anyhow!(
            "{file} is no field, or was cut off ({reason}); make it again with npsolve fit, or copy it again"
        ),
        Error::ForeignTensors { .. } => {
            anyhow!("{file} holds tensors of another program; fields are what npsolve fit writes")
        }
        Error::CheckpointVersion { found, supported } => anyhow!(
            "{file} was written by a newer npsolve (version {found}, here up to {supported}); update npsolve"
        ),
        other => {
            anyhow!("{file} is damaged: {other}; make it again with npsolve fit, or copy it again")
        }
    }
}
