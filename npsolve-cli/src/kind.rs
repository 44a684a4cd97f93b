//! Which kind of signal a file holds.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use clap::ValueEnum;

use crate::{field_file, files, signals};

/// `--kind`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SignalKind {
    /// A picture: two dimensions.
    Image,
    /// Sound: one dimension.
    Audio,
    /// A volume, such as a scan: three dimensions.
    Volume,
    /// A video: two dimensions and time.
    Video,
    /// A light field: pictures from a grid of cameras, four dimensions.
    Lightfield,
}

impl SignalKind {
    /// The word of the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Audio => "audio",
            Self::Volume => "volume",
            Self::Video => "video",
            Self::Lightfield => "lightfield",
        }
    }

    /// What its samples are called.
    pub fn samples(self) -> &'static str {
        match self {
            Self::Image => "pixels",
            Self::Audio => "samples",
            Self::Volume => "voxels",
            Self::Video | Self::Lightfield => "pixels of all pictures",
        }
    }

    /// The unit of its lengths.
    pub fn length_unit(self) -> &'static str {
        match self {
            Self::Audio => "samples",
            Self::Volume => "mm",
            Self::Image | Self::Video | Self::Lightfield => "px",
        }
    }

    /// With an article, for messages.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Image => "a picture",
            Self::Audio => "sound",
            Self::Volume => "a volume",
            Self::Video => "a video",
            Self::Lightfield => "a light field",
        }
    }
}

/// The kind of a file, by its name and where that leaves a choice by its first bytes. Files that cannot be read are
/// pictures: whoever reads them says what is wrong.
pub fn of(path: &Path) -> SignalKind {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if field_file::is_network_name(path) {
        let about = files::read_bytes(path).and_then(|bytes| field_file::describe(path, &bytes));
        return about.map_or(SignalKind::Image, |about| signals::field::kind(&about));
    }
    let ends = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e));
    if path.is_dir() || name.contains('%') || name.contains('*') {
        return if signal_io::is_view_grid(path) {
            SignalKind::Lightfield
        } else {
            SignalKind::Video
        };
    }
    if ends(&[".wav", ".flac", ".ogg", ".oga", ".mp3"]) {
        SignalKind::Audio
    } else if ends(&[".nii", ".nii.gz", ".nrrd", ".nhdr", ".json"])
        || (ends(&[".tif", ".tiff"]) && signal_io::is_tiff_stack(path))
    {
        SignalKind::Volume
    } else if ends(&[".y4m"]) || (ends(&[".gif", ".webp"]) && signal_io::is_animation(path)) {
        SignalKind::Video
    } else if ends(&[".npy"]) {
        of_array(path)
    } else {
        SignalKind::Image
    }
}

/// Arrays of three axes are pictures up to so many channels, and volumes beyond.
const MOST_CHANNELS: usize = 16;

/// By the axes of an array: (Y, X) and (Y, X, C) are pictures, (V, U, Y, X, C) light fields, what is between volumes.
fn of_array(path: &Path) -> SignalKind {
    let mut head = vec![0; 256];
    let Ok(read) = File::open(path).and_then(|mut f| f.read(&mut head)) else {
        return SignalKind::Image;
    };
    let text = String::from_utf8_lossy(&head[..read]).into_owned();
    let axes: Vec<usize> = text
        .split_once("'shape': (")
        .and_then(|(_, rest)| rest.split_once(')'))
        .map(|(shape, _)| shape.split(',').filter_map(|n| n.trim().parse().ok()).collect())
        .unwrap_or_default();
    match axes[..] {
        [_, _, _, _, _] => SignalKind::Lightfield,
        [_, _, _, _] => SignalKind::Volume,
        [_, _, channels] if channels > MOST_CHANNELS => SignalKind::Volume,
        _ => SignalKind::Image,
    }
}
