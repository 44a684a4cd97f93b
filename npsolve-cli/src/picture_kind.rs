//! What a picture is besides its numbers, and how a field's file says so in its notes.

use std::collections::BTreeMap;

use anyhow::Result;
use signal_io::{Image, SampleType, Transfer};

const CHANNELS: &str = "channels";
const ENCODING: &str = "encoding";
const SAMPLE: &str = "sample_type";
/// The colour profile in hexadecimal digits.
pub const ICC: &str = "icc_profile";

/// Names of the channels, number type, encoding and colour profile of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureKind {
    /// Names of the channels, alpha included.
    pub channels: Vec<String>,
    /// The number type it is written as.
    pub sample: SampleType,
    /// How its values relate to light.
    pub transfer: Transfer,
    /// Its colour profile.
    pub icc: Option<Vec<u8>>,
}

impl PictureKind {
    /// The kind of a picture.
    pub fn of(image: &Image) -> Self {
        Self {
            channels: image.channels().to_vec(),
            sample: image.sample,
            transfer: image.transfer,
            icc: image.icc.clone(),
        }
    }

    /// A picture of this kind with other numbers.
    pub fn picture(&self, [width, height]: [usize; 2], data: Vec<f32>) -> Result<Image> {
        let mut image = Image::new(width, height, &self.channels, data)?;
        (image.sample, image.transfer) = (self.sample, self.transfer);
        image.icc = self.icc.clone();
        Ok(image)
    }

    /// The notes in a field's file.
    pub fn to_notes(&self) -> BTreeMap<String, String> {
        let names = serde_json::Value::from(self.channels.clone()).to_string();
        let mut notes = BTreeMap::from([
            (CHANNELS.to_owned(), names),
            (ENCODING.to_owned(), encoding_name(self.transfer).to_owned()),
            (SAMPLE.to_owned(), sample_name(self.sample).to_owned()),
        ]);
        notes.extend(self.icc.as_ref().map(|icc| (ICC.to_owned(), to_hex(icc))));
        notes
    }

    /// The kind that notes tell of, for this many channels. Files of other origin may lack notes or have
    /// others: channels get the usual names then, values are floats, and nothing is said about light.
    pub fn from_notes(notes: &BTreeMap<String, String>, channels: usize) -> Self {
        let names = notes.get(CHANNELS).and_then(|n| serde_json::from_str(n).ok());
        let is = |key: &str, value: &str| notes.get(key).is_some_and(|v| v == value);
        let samples = [SampleType::U8, SampleType::U16, SampleType::F16, SampleType::F32];
        let transfers = [Transfer::Srgb, Transfer::Linear, Transfer::Unspecified];
        Self {
            channels: names
                .filter(|n: &Vec<String>| is_usable(n, channels))
                .unwrap_or_else(|| usual_names(channels)),
            sample: samples
                .into_iter()
                .find(|s| is(SAMPLE, sample_name(*s)))
                .unwrap_or(SampleType::F32),
            transfer: transfers
                .into_iter()
                .find(|t| is(ENCODING, encoding_name(*t)))
                .unwrap_or(Transfer::Unspecified),
            icc: notes.get(ICC).and_then(|digits| from_hex(digits)),
        }
    }
}

/// One name per channel, none empty or repeated.
fn is_usable(names: &[String], channels: usize) -> bool {
    let fresh = |(k, name): (usize, &String)| !name.is_empty() && !names[..k].contains(name);
    names.len() == channels && names.iter().enumerate().all(fresh)
}

fn usual_names(count: usize) -> Vec<String> {
    match count {
        1 => vec!["Y".to_owned()],
        3 | 4 => ["R", "G", "B", "A"][..count].iter().map(|c| (*c).to_owned()).collect(),
        _ => (0..count).map(|c| format!("C{c}")).collect(),
    }
}

fn encoding_name(transfer: Transfer) -> &'static str {
    match transfer {
        Transfer::Srgb => "srgb",
        Transfer::Linear => "linear",
        Transfer::Unspecified => "unspecified",
    }
}

fn sample_name(sample: SampleType) -> &'static str {
    match sample {
        SampleType::U8 => "u8",
        SampleType::U16 => "u16",
        SampleType::F16 => "f16",
        SampleType::F32 => "f32",
    }
}

fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn from_hex(digits: &str) -> Option<Vec<u8>> {
    let pair = |p: &[u8]| u8::from_str_radix(std::str::from_utf8(p).ok()?, 16).ok();
    digits.len().is_multiple_of(2).then(|| digits.as_bytes().chunks(2).map(pair).collect())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_tell_the_kind() {
        let kind = PictureKind {
            channels: ["R", "a, \"b\"", "A"].map(str::to_owned).to_vec(),
            sample: SampleType::F16,
            transfer: Transfer::Linear,
            icc: Some(vec![0, 255, 17]),
        };
        assert_eq!(PictureKind::from_notes(&kind.to_notes(), 3), kind);
        assert_eq!(kind.to_notes()[ICC], "00ff11");
    }

    #[test]
    fn other_notes_give_the_usual_kind() {
        let empty = PictureKind::from_notes(&BTreeMap::new(), 2);
        assert_eq!((empty.channels, empty.sample), (usual_names(2), SampleType::F32));
        for names in ["R, G, B", r#"["R","R","B"]"#, r#"["R"]"#, r#"["R","","B"]"#] {
            let notes = [(CHANNELS.to_owned(), names.to_owned()), (ICC.to_owned(), "0g".into())];
            let kind = PictureKind::from_notes(&notes.into(), 3);
            assert_eq!((kind.channels, kind.icc), (usual_names(3), None), "{names}");
        }
    }
}
