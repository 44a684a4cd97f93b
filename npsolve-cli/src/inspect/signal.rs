//! What is in sound, volumes, videos and light fields.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use serde_json::{Map, Value, json};
use signal_io::{LightFieldReadOptions, ReadOptions, Timing};

use super::{Channel, channel_of};
use crate::files::in_our_words;
use crate::kind::SignalKind;
use crate::outcome::size;
use crate::report::count;
use crate::signals::volume::{has_place, read as read_volume};

/// A signal that is not a picture, described.
#[derive(Debug, Serialize)]
pub struct SignalDescription {
    file: String,
    kind: &'static str,
    /// Samples per axis, x first.
    size: Vec<usize>,
    channels: Vec<Channel>,
    sample_type: &'static str,
    #[serde(flatten)]
    details: Map<String, Value>,
    #[serde(skip)]
    samples: &'static str,
}

/// Reads and describes a file of this kind.
pub fn describe(path: &Path, kind: SignalKind) -> Result<SignalDescription> {
    let options = ReadOptions::default();
    let mut details = Map::new();
    let mut say = |key: &str, value: Value| {
        details.insert(key.to_owned(), value);
    };
    let names = |n: usize| (0..n).map(|c| format!("{}", c + 1)).collect::<Vec<_>>();
    let (shape, names, values, sample_type) = match kind {
        SignalKind::Image => {
            let image = signal_io::read_image(path, &options).map_err(in_our_words)?;
            let shape = vec![image.width(), image.height()];
            (shape, image.channels().to_vec(), image.as_planar().to_vec(), image.sample.name())
        }
        SignalKind::Video => {
            let video = signal_io::read_video(path, &options).map_err(in_our_words)?;
            let (sample, names) = (video.sample().name(), video.channels().to_vec());
            if let Timing::Rate { frames, seconds } = video.timing.to_rate() {
                say("frames_per_second", json!(f64::from(frames) / f64::from(seconds)));
            }
            (video.shape().to_vec(), names, video.into_strip().into_planar(), sample)
        }
        SignalKind::Lightfield => {
            let options = LightFieldReadOptions::default();
            let field = signal_io::read_light_field(path, &options).map_err(in_our_words)?;
            let (sample, names) = (field.sample().name(), field.channels().to_vec());
            (field.shape().to_vec(), names, field.into_strip().into_planar(), sample)
        }
        SignalKind::Audio => {
            let audio = signal_io::read_audio(path, &options).map_err(in_our_words)?;
            say("sampling_rate_hz", json!(audio.rate_hz()));
            say("seconds", json!(audio.seconds()));
            say("loudness_lufs", json!(audio.loudness()));
            let names = names(audio.channels());
            (vec![audio.frames()], names, audio.as_planar().to_vec(), audio.sample.name())
        }
        SignalKind::Volume => {
            let volume = read_volume(path)?;
            say("voxel_size_mm", json!(volume.voxel_size()));
            say("affine", json!(has_place(&volume).then(|| volume.affine())));
            say("unit_in_file", json!(Some(volume.length_unit.symbol()).filter(|u| !u.is_empty())));
            say("description", json!(Some(&volume.description).filter(|d| !d.is_empty())));
            let names = names(volume.channels());
            (volume.shape().to_vec(), names, volume.as_planar().to_vec(), volume.voxel_type.name())
        }
    };
    let n: usize = shape.iter().product();
    let channels = names
        .into_iter()
        .zip(values.chunks(n))
        .map(|(name, plane)| channel_of(name, plane))
        .collect();
    let file = path.display().to_string();
    let samples = kind.samples();
    Ok(SignalDescription {
        file,
        kind: kind.name(),
        size: shape,
        channels,
        sample_type,
        details,
        samples,
    })
}

impl SignalDescription {
    /// A few lines.
    pub fn to_text(&self) -> String {
        let mut text = format!(
            "{}: {}, {} {}, {}, {}",
            self.file,
            self.kind,
            size(&self.size),
            self.samples,
            count(self.channels.len(), "channel"),
            self.sample_type
        );
        for (key, value) in self.details.iter().filter(|(_, v)| !v.is_null()) {
            let _ = write!(text, "; {} {value}", key.replace('_', " "));
        }
        text.push('\n');
        self.channels.iter().for_each(|c| text += &c.to_text());
        text
    }
}
