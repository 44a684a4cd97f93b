//! Networks of sound, volumes, videos and light fields: a checkpoint stands for the signal it was fitted to.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, anyhow, bail};
use inr_core::{Description, Domain};

use super::Signal;
use crate::channels::{Axes, ChannelJob, Channels, with_channels};
use crate::kind::SignalKind;
use crate::{field_file, files, neural};

/// What a checkpoint says about its signal.
pub type Notes = BTreeMap<String, String>;

/// Key of the kind of signal.
const SIGNAL: &str = "signal";

/// The notes with the kind of signal among them.
pub fn notes_of(kind: SignalKind, mut notes: Notes) -> Notes {
    notes.insert(SIGNAL.to_owned(), kind.name().to_owned());
    notes
}

/// The kind of signal that a network is about; checkpoints of other origin are taken by their dimension.
pub fn kind(about: &Description) -> SignalKind {
    let said = about.notes.get(SIGNAL).map(String::as_str);
    let kinds = [SignalKind::Audio, SignalKind::Volume, SignalKind::Video, SignalKind::Lightfield];
    let usual = match about.dimensions {
        1 => SignalKind::Audio,
        3 => SignalKind::Volume,
        4 => SignalKind::Lightfield,
        _ => SignalKind::Image,
    };
    kinds.into_iter().find(|k| said == Some(k.name())).unwrap_or(usual)
}

/// The signal of a checkpoint, sampled on a lattice that is made of its own.
pub fn read<S: Signal<D>, const D: usize>(
    path: &Path,
    lattice: impl Fn(&Domain<D>) -> Result<Domain<D>>,
) -> Result<S>
where
    Axes<D>: Channels,
{
    let bytes = files::read_bytes(path)?;
    let about = field_file::describe(path, &bytes)?;
    if about.dimensions != D {
        bail!(
            "{} is a field over {} coordinates, this kind of signal has {D}: see npsolve inspect",
            path.display(),
            about.dimensions
        );
    }
    let job = Sampled { path, bytes: &bytes, lattice: &lattice };
    let (domain, values) = with_channels::<D, _>(about.channels, job)
        .ok_or_else(|| anyhow!("{} has {} channels", path.display(), about.channels))??;
    S::from_values(&about.notes, domain, about.channels, values)
}

struct Sampled<'a, const D: usize> {
    path: &'a Path,
    bytes: &'a [u8],
    lattice: &'a dyn Fn(&Domain<D>) -> Result<Domain<D>>,
}

impl<const D: usize> ChannelJob for Sampled<'_, D> {
    type Output = Result<(Domain<D>, Vec<f32>)>;

    fn run<const C: usize>(self) -> Self::Output {
        let checkpoint = field_file::checkpoint::<D, C>(self.path, self.bytes)?;
        let lattice = (self.lattice)(&checkpoint.domain)?;
        Ok((lattice, neural::sampled(&checkpoint.network, &lattice)))
    }
}
