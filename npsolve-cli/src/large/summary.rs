//! A finished blend in blocks, for its user.

use std::fmt::Write as _;

use anyhow::Result;
use poisson_loss::BlockReport;
use serde_json::json;
use signal_io::WriteReport;

use super::advice;
use crate::args::BlendArgs;
use crate::files;
use crate::outcome::{Written, size};
use crate::report::count;

/// Everything there is to tell.
pub struct Summary<'a> {
    pub args: &'a BlendArgs,
    pub names: &'a [String; 2],
    pub sizes: [[usize; 2]; 2],
    pub channels: usize,
    pub offset: [isize; 2],
    pub limit: u64,
    pub report: &'a BlockReport,
    pub written: &'a WriteReport,
    /// Change at which the sweeps ended, in units of the values.
    pub tolerance: f32,
    pub scratch_bytes: u64,
    /// Reading, solving, writing.
    pub seconds: [f64; 3],
    pub warnings: &'a [String],
}

impl Summary<'_> {
    /// For programs.
    pub fn to_json(&self) -> Result<String> {
        let BlockReport { sweeps, change, blocks, coarse_step, length, region_samples, .. } =
            *self.report;
        let [read, solve, write] = self.seconds;
        files::to_json(&json!({
            "solver": "spline-screened-blocks",
            "kind": "image",
            "size": self.sizes[0],
            "channels": self.channels,
            "offset": self.offset,
            "guidance": self.args.solve.guidance.to_string(),
            "region_samples": region_samples,
            "length": length,
            "box_start": self.report.box_start,
            "box_shape": self.report.box_shape,
            "blocks": blocks,
            "coarse_step": coarse_step,
            "sweeps": sweeps,
            "change": change,
            "tolerance": self.tolerance,
            "max_memory_bytes": self.limit,
            "peak_memory_bytes": advice::peak_memory(),
            "scratch_bytes": self.scratch_bytes,
            "clipped_fraction": Written::from(*self.written).clipped_fraction(),
            "seconds": { "read": read, "solve": solve, "write": write },
            "warnings": self.warnings,
        }))
    }

    /// For people.
    pub fn to_text(&self) -> String {
        let [background, patch] = self.names;
        let [b, p] = self.sizes.map(|s| size(&s));
        let ([x, y], report) = (self.offset, self.report);
        let channels = count(self.channels, "channel");
        let mut text =
            format!("Blended {patch} ({p}) into {background} ({b}, {channels}) at {x},{y}.\n");
        let _ = writeln!(
            text,
            "Region {:.0} pixels; guidance {}; screened objective, length {:.1} px.",
            report.region_samples, self.args.solve.guidance, report.length
        );
        let [read, solve, write] = self.seconds;
        let _ = writeln!(
            text,
            "{} of {}, last change {:.1e}; read {read:.2} s, solve {solve:.2} s, write {write:.2} s.",
            count(report.sweeps, "sweep"),
            count(report.blocks, "block"),
            report.change,
        );
        let peak = advice::peak_memory()
            .map_or(String::new(), |peak| format!("{} of memory at most; ", advice::human(peak)));
        let _ = writeln!(
            text,
            "{peak}{} of scratch files, removed.",
            advice::human(self.scratch_bytes)
        );
        let written = Written::from(*self.written);
        let _ = writeln!(
            text,
            "Wrote {} ({} {}); {} of {} samples were clipped to fit.",
            self.args.output.display(),
            written.sample,
            written.format,
            written.clipped,
            written.samples
        );
        text
    }
}
