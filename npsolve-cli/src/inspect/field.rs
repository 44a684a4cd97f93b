//! What is in the file of a field.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use inr_core::{Architecture, Unit};
use serde::Serialize;

use crate::fit::{FINISHED, RECIPE, bytes_in_words};
use crate::picture_kind::{ICC, PictureKind};
use crate::report::count;
use crate::{field_file, field_words, files};

/// A field, described.
#[derive(Debug, Serialize)]
pub struct FieldDescription {
    file: String,
    /// The kind of the network.
    field: &'static str,
    /// The network in words.
    network: String,
    architecture: Architecture,
    parameters: usize,
    bytes: usize,
    version: u64,
    /// Samples of the signal per axis, x first.
    shape: Vec<usize>,
    pitch: Vec<f32>,
    origin: Vec<f32>,
    unit: &'static str,
    channels: Vec<String>,
    /// Lowest and highest value of the signal.
    range: [f32; 2],
    /// What the file says about the signal; the colour profile counts as its bytes.
    notes: BTreeMap<String, String>,
    icc_bytes: Option<usize>,
    finished: bool,
    /// Where an unfinished training is.
    step: Option<u64>,
    /// Where it would end.
    steps: Option<u64>,
}

/// Describes the field in a file.
pub fn describe(path: &Path) -> Result<FieldDescription> {
    let bytes = files::read_bytes(path)?;
    let mut about = field_file::describe(path, &bytes)?;
    let kind = PictureKind::from_notes(&about.notes, about.channels);
    about.notes.remove(ICC);
    let state = about.training.unwrap_or_default();
    Ok(FieldDescription {
        file: path.display().to_string(),
        field: field_words::kind(&about.architecture),
        network: field_words::sentence(&about.architecture),
        parameters: about.parameters,
        bytes: bytes.len(),
        version: about.version,
        shape: about.shape,
        pitch: about.pitch,
        origin: about.origin,
        unit: unit_name(about.unit),
        channels: kind.channels,
        range: about.range,
        notes: about.notes,
        icc_bytes: kind.icc.map(|icc| icc.len()),
        finished: state.is_null() || state[FINISHED] == true,
        step: state["steps"].as_u64(),
        steps: state[RECIPE]["steps"].as_u64(),
        architecture: about.architecture,
    })
}

fn unit_name(unit: Unit) -> &'static str {
    match unit {
        Unit::Sample => "sample",
        Unit::Second => "second",
        Unit::Millimetre => "millimetre",
    }
}

impl FieldDescription {
    /// A few lines.
    pub fn to_text(&self) -> String {
        let joined = |values: &[f32], between: &str| {
            values.iter().map(f32::to_string).collect::<Vec<_>>().join(between)
        };
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        let mut text = format!(
            "{}: {} field over {} samples, {} ({}), {} to {}\n  {}\n  {} numbers, {}; {}\n",
            self.file,
            self.field,
            shape.join(" x "),
            count(self.channels.len(), "channel"),
            self.channels.join(", "),
            self.range[0],
            self.range[1],
            self.network,
            self.parameters,
            bytes_in_words(self.bytes),
            self.state(),
        );
        if self.pitch.iter().any(|h| *h != 1.0) || self.origin.iter().any(|o| *o != 0.0) {
            let (pitch, origin) = (joined(&self.pitch, " x "), joined(&self.origin, ", "));
            let _ = writeln!(text, "  pitch {pitch}, first sample at {origin}, in {}s", self.unit);
        }
        for (key, value) in self.notes.iter().filter(|(key, _)| *key != "channels") {
            let _ = writeln!(text, "  {key}: {value}");
        }
        if let Some(bytes) = self.icc_bytes {
            let _ = writeln!(text, "  colour profile of {}", count(bytes, "byte"));
        }
        text
    }

    fn state(&self) -> String {
        match (self.finished, self.step, self.steps) {
            (true, Some(step), _) => format!("finished after step {step}, with its training"),
            (true, None, _) => "finished".to_owned(),
            (false, Some(step), Some(steps)) => format!("unfinished: step {step} of {steps}"),
            (false, Some(step), None) => format!("unfinished: step {step}"),
            (false, None, _) => "unfinished".to_owned(),
        }
    }
}
