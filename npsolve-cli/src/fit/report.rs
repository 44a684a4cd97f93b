//! What a fit tells its user: JSON and a few plain lines.

use serde::Serialize;

use crate::report::count;

/// `--json`: numbers that are not finite appear as null.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Kind of the network.
    pub field: &'static str,
    /// Trained numbers.
    pub parameters: usize,
    /// Steps in all.
    pub steps: u64,
    /// Seconds of training in all.
    pub seconds: f64,
    /// PSNR in dB over all samples.
    pub psnr: f64,
    /// Whether `--target-psnr` was reached; null without one.
    pub target_reached: Option<bool>,
    /// Size of the file.
    pub bytes: usize,
    /// Whether the fit is over.
    pub finished: bool,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// What the lines say besides the numbers.
pub struct Surroundings {
    /// The signal.
    pub signal: String,
    /// Its size.
    pub size: String,
    /// What its samples are called.
    pub noun: &'static str,
    /// Its channels.
    pub channels: usize,
    /// Its number type, and what its numbers take in that type.
    pub samples: (&'static str, usize),
    /// The network in words.
    pub network: String,
    /// The field's file.
    pub file: String,
}

impl Report {
    /// The lines.
    pub fn to_text(&self, about: &Surroundings) -> String {
        let (sample, of_samples) = about.samples;
        let went_on = if self.finished { "" } else { ", unfinished: go on with --resume" };
        format!(
            "Fitted {} ({} {}, {}) with a {} field of {} numbers:\n{}.\n\
             {} in {:.2} s: PSNR {:.2} dB{went_on}.\n\
             Wrote {}: {}; the signal's {sample} samples are {}.\n",
            about.signal,
            about.size,
            about.noun,
            count(about.channels, "channel"),
            self.field,
            self.parameters,
            about.network,
            count(self.steps as usize, "step"),
            self.seconds,
            self.psnr,
            about.file,
            size(self.bytes),
            size(of_samples),
        )
    }
}

/// A number of bytes with a unit.
pub fn size(bytes: usize) -> String {
    match bytes {
        0..10_000 => count(bytes, "byte"),
        10_000..1_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.2} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}
