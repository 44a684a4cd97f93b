//! The metadata of a checkpoint: records without const generics, and their texts.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::container::Container;
use crate::{Architecture, Domain, Error, Frame, Output, Result, Unit};

/// What `format` says in all checkpoints.
const FORMAT: &str = "npsolve-field";

/// The newest version of the format that this crate reads, and the one it writes.
pub(super) const VERSION: u64 = 1;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct DomainRecord {
    pub shape: Vec<usize>,
    pub pitch: Vec<f32>,
    pub origin: Vec<f32>,
    pub unit: UnitRecord,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum UnitRecord {
    Sample,
    Second,
    Millimetre,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct FrameRecord {
    center: Vec<f32>,
    half: Vec<f32>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct OutputRecord {
    offset: Vec<f32>,
    scale: Vec<f32>,
}

/// All metadata of a checkpoint.
pub(super) struct Header {
    pub architecture: Architecture,
    pub domain: DomainRecord,
    pub frame: FrameRecord,
    pub output: OutputRecord,
    pub range: [f32; 2],
    pub notes: BTreeMap<String, String>,
    pub training: Option<Value>,
}

impl Header {
    /// The texts, one per key.
    pub fn to_texts(&self) -> BTreeMap<String, String> {
        let mut texts = BTreeMap::from([
            ("format".into(), FORMAT.into()),
            ("version".into(), VERSION.to_string()),
            ("architecture".into(), text(&self.architecture)),
            ("domain".into(), text(&self.domain)),
            ("frame".into(), text(&self.frame)),
            ("output".into(), text(&self.output)),
            ("range".into(), text(&self.range)),
            ("notes".into(), text(&self.notes)),
        ]);
        texts.extend(self.training.as_ref().map(|state| ("training".into(), state.to_string())));
        texts
    }

    /// The metadata of a file, complete and in range.
    pub fn read(file: &Container<'_>) -> Result<Self> {
        if file.text("format") != Some(FORMAT) {
            return Err(Error::ForeignTensors { missing: format!("format = {FORMAT}") });
        }
        // First of all: a newer version may mean something else by the other entries.
        match parse(file, "version")? {
            VERSION => {}
            found if found > VERSION => {
                return Err(Error::CheckpointVersion { found, supported: VERSION });
            }
            found => return Err(entry("version", format!("there is no version {found}"))),
        }
        let header = Self {
            architecture: parse(file, "architecture")?,
            domain: parse(file, "domain")?,
            frame: parse(file, "frame")?,
            output: parse(file, "output")?,
            range: parse(file, "range")?,
            notes: parse(file, "notes")?,
            training: file.text("training").map(|_| parse(file, "training")).transpose()?,
        };
        header.check()?;
        Ok(header)
    }

    /// Coordinates and channels.
    pub fn dimensions(&self) -> [usize; 2] {
        [self.domain.shape.len(), self.output.offset.len()]
    }

    /// Checks that all parts have as many axes and channels as the others, and every number.
    pub fn check(&self) -> Result<()> {
        let [d, c] = self.dimensions();
        self.domain.check()?;
        if self.frame.center.len() != d || self.frame.half.len() != d {
            return Err(entry("frame", format!("the domain has {d} axes")));
        }
        self.frame.check()?;
        if c == 0 || self.output.scale.len() != c {
            return Err(entry("output", "as many offsets as scales, at least one".into()));
        }
        self.output.check()?;
        all_finite("an end of the range of values", &self.range)?;
        let [low, high] = self.range;
        if low > high {
            let (what, rule) = ("the lower end of the range of values", "at most the upper end");
            return Err(Error::Parameter { what, rule, value: low });
        }
        self.architecture.check(d)
    }
}

impl DomainRecord {
    pub fn of<const D: usize>(domain: &Domain<D>) -> Self {
        Self {
            shape: domain.shape().to_vec(),
            pitch: domain.pitch().to_vec(),
            origin: domain.origin().to_vec(),
            unit: match domain.unit_of_length() {
                Unit::Sample => UnitRecord::Sample,
                Unit::Second => UnitRecord::Second,
                Unit::Millimetre => UnitRecord::Millimetre,
            },
        }
    }

    /// For `D` axes; the record was checked.
    pub fn to_domain<const D: usize>(&self) -> Result<Domain<D>> {
        let (shape, unit) = (std::array::from_fn(|d| self.shape[d]), self.unit.into());
        Domain::new(shape, array(&self.pitch), array(&self.origin), unit)
    }

    fn check(&self) -> Result<()> {
        let d = self.shape.len();
        if d == 0 || self.pitch.len() != d || self.origin.len() != d {
            return Err(entry("domain", "one pitch and origin per axis, at least one axis".into()));
        }
        if let Some(axis) = self.shape.iter().position(|n| *n == 0) {
            return Err(Error::EmptyAxis { axis });
        }
        if let Some(axis) = self.pitch.iter().position(|h| !(*h > 0.0 && h.is_finite())) {
            return Err(Error::Pitch { axis, value: self.pitch[axis] });
        }
        all_finite("the origin of a domain", &self.origin)
    }
}

impl From<UnitRecord> for Unit {
    fn from(unit: UnitRecord) -> Self {
        match unit {
            UnitRecord::Sample => Self::Sample,
            UnitRecord::Second => Self::Second,
            UnitRecord::Millimetre => Self::Millimetre,
        }
    }
}

impl FrameRecord {
    pub fn of<const D: usize>(frame: &Frame<D>) -> Self {
        Self { center: frame.center.to_vec(), half: frame.half.to_vec() }
    }

    /// For `D` axes; the record was checked.
    pub fn to_frame<const D: usize>(&self) -> Frame<D> {
        Frame { center: array(&self.center), half: array(&self.half) }
    }

    pub fn check(&self) -> Result<()> {
        all_finite("the centre of a frame", &self.center)?;
        match self.half.iter().find(|h| !(**h > 0.0 && h.is_finite())) {
            Some(value) => {
                let (what, rule) = ("half the length of a frame", "positive and finite");
                Err(Error::Parameter { what, rule, value: *value })
            }
            None => Ok(()),
        }
    }
}

impl OutputRecord {
    pub fn of<const C: usize>(output: &Output<C>) -> Self {
        Self { offset: output.offset.to_vec(), scale: output.scale.to_vec() }
    }

    /// For `C` channels; the record was checked.
    pub fn to_output<const C: usize>(&self) -> Output<C> {
        Output { offset: array(&self.offset), scale: array(&self.scale) }
    }

    pub fn check(&self) -> Result<()> {
        all_finite("the offset of an output", &self.offset)?;
        all_finite("the scale of an output", &self.scale)
    }
}

fn array<const N: usize>(values: &[f32]) -> [f32; N] {
    std::array::from_fn(|i| values[i])
}

fn all_finite(what: &'static str, values: &[f32]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(value) => Err(Error::Parameter { what, rule: "finite", value: *value }),
        None => Ok(()),
    }
}

fn entry(key: &str, reason: String) -> Error {
    Error::CheckpointEntry { entry: key.into(), reason }
}

/// JSON by way of a [`Value`]: there every `f32` becomes an `f64`, of which enough digits are written that
/// any reader gets the same `f32` back, even one that parses to the last bit but one.
fn text(record: &impl Serialize) -> String {
    serde_json::to_value(record).expect("records have texts as keys").to_string()
}

fn parse<T: DeserializeOwned>(file: &Container<'_>, key: &str) -> Result<T> {
    let text = file.text(key).ok_or_else(|| entry(key, "it is missing".into()))?;
    serde_json::from_str(text).map_err(|e| entry(key, e.to_string()))
}
