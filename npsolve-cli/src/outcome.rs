//! A finished blend of any kind of signal, and how its user is told.

use std::fmt::Write as _;

use anyhow::Result;
use signal_io::WriteReport;

use crate::args::{BlendArgs, ObjectiveName};
use crate::kind::SignalKind;
use crate::report::{BlendReport, Context, Extras, NetworkReport, Seconds, count};
use crate::solve::{Settings, Solution};
use crate::value_domain::Mapping;
use crate::{console, files, neural};

/// A finished blend.
pub struct Outcome<'a> {
    /// The command line.
    pub args: &'a BlendArgs,
    /// What was blended.
    pub kind: SignalKind,
    /// Both files.
    pub names: &'a [String; 2],
    /// Sizes of background and patch, x first.
    pub sizes: [Vec<usize>; 2],
    /// Colour channels.
    pub channels: usize,
    /// Where the patch's first sample went, in samples.
    pub place: Vec<f64>,
    /// In which values.
    pub domain: Mapping,
    /// How.
    pub settings: &'a Settings,
    /// What came out.
    pub solution: &'a Solution,
    /// What became of it in its file; none for networks.
    pub written: Option<Written>,
    /// The training, and the size of the file, if the result is a network.
    pub network: Option<NetworkReport>,
    /// See above.
    pub bytes: Option<usize>,
    /// Everything the user should know.
    pub warnings: Vec<String>,
    /// Time spent.
    pub seconds: Seconds,
    /// Measures of this kind of signal.
    pub extras: Extras,
    /// The most important of them as lines of text.
    pub remarks: String,
}

/// What a written file holds.
#[derive(Debug, Clone, Copy)]
pub struct Written {
    /// Name of the number type.
    pub sample: &'static str,
    /// Name of the format.
    pub format: &'static str,
    /// Numbers written.
    pub samples: usize,
    /// How many of them did not fit the number type.
    pub clipped: usize,
}

impl From<WriteReport> for Written {
    fn from(report: WriteReport) -> Self {
        let WriteReport { samples, clipped, .. } = report;
        Self { sample: report.sample.name(), format: report.format.name(), samples, clipped }
    }
}

impl Written {
    /// Share of the numbers that did not fit.
    pub fn clipped_fraction(&self) -> f64 {
        self.clipped as f64 / self.samples.max(1) as f64
    }
}

impl Outcome<'_> {
    /// Prints and writes what is asked for.
    pub fn tell(&self, quiet: bool) -> Result<()> {
        if let Some(report) = self.report() {
            let json = files::to_json(&report)?;
            if let Some(path) = &self.args.metrics {
                files::write_text(path, &json, self.args.force)?;
            }
            if self.args.json {
                console::print(&json)?;
            }
        }
        if !quiet {
            console::warn(&self.warnings);
        }
        if !quiet && !self.args.json {
            console::print(&self.summary())?;
        }
        Ok(())
    }

    fn report(&self) -> Option<BlendReport> {
        let field = self.network.as_ref().map_or("spline", |n| &n.field);
        let context = Context {
            solver: format!("{field}-{}", self.objective()),
            guidance: self.settings.guidance.to_string(),
            seconds: self.seconds,
            clipped_fraction: self.written.as_ref().map_or(0.0, Written::clipped_fraction),
            warnings: &self.warnings,
            kind: self.kind.name(),
            domain: self.domain.name(),
            size: self.sizes[0].clone(),
            channels: self.channels,
            offset: self.place.clone(),
            network: self.network.clone(),
            extras: self.extras.clone(),
        };
        let metrics = self.solution.metrics.as_ref()?;
        Some(BlendReport::new(metrics, &self.solution.report, context))
    }

    fn objective(&self) -> &'static str {
        match self.args.objective {
            ObjectiveName::Screened => "screened",
            ObjectiveName::Paper => "paper",
            ObjectiveName::Dirichlet => "dirichlet",
        }
    }

    fn summary(&self) -> String {
        let report = &self.solution.report;
        let [background, patch] = self.names;
        let (b, p) = (size(&self.sizes[0]), size(&self.sizes[1]));
        let place: Vec<String> = self.place.iter().map(f64::to_string).collect();
        let mut text = format!(
            "Blended {patch} ({p}) into {background} ({b}, {}) at {}.\n",
            count(self.channels, "channel"),
            place.join(",")
        );
        let unit = self.kind.length_unit();
        let length = report.length.map_or(String::new(), |l| format!(", length {l:.1} {unit}"));
        let domain = match self.domain {
            Mapping::Identity => String::new(),
            other => format!(" of {} values", other.name()),
        };
        let (region, guidance) = (report.region_samples, self.settings.guidance);
        let _ = writeln!(
            text,
            "Region {region:.0} {}; guidance {guidance}{domain}; {} objective{length}.",
            self.kind.samples(),
            self.objective()
        );
        let Seconds { read, solve, write } = self.seconds;
        let _ = writeln!(
            text,
            "{}, residual {:.1e}; read {read:.2} s, solve {solve:.2} s, write {write:.2} s.",
            count(report.iterations, "iteration"),
            report.residual
        );
        text += &self.remarks;
        if let Some(network) = &self.network {
            text += &neural::summary(network, &self.args.output, self.bytes);
        }
        if let Some(written) = &self.written {
            let _ = writeln!(
                text,
                "Wrote {} ({} {}); {} of {} samples were clipped to fit.",
                self.args.output.display(),
                written.sample,
                written.format,
                written.clipped,
                written.samples
            );
        }
        text
    }
}

/// "640 x 480"
pub fn size(shape: &[usize]) -> String {
    shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ")
}
