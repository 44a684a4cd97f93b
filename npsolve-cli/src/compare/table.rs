//! The numbers of a comparison as text, CSV and JSON.

use std::fmt::Write as _;

use poisson_loss::{Metrics, Objective, Strongest};
use serde::Serialize;

use crate::values::GuidanceName;

use super::methods::{Case, Row};

/// Seams are told in 8-bit grey levels.
const LEVELS: f64 = 255.0;

/// All rows of one case, with what is needed to read them.
#[derive(Debug, Serialize)]
pub struct Table {
    case: String,
    background: String,
    patch: String,
    offset: Vec<f32>,
    region_samples: f64,
    guidance: String,
    strongest_rule: Option<&'static str>,
    objective: String,
    operator: &'static str,
    rows: Vec<Line>,
    warnings: Vec<String>,
}

/// One method's numbers; those that do not exist are null.
#[derive(Debug, Serialize)]
pub struct Line {
    /// The method.
    pub solver: String,
    /// Time of the solver.
    pub seconds: Option<f64>,
    iterations: Option<usize>,
    /// Relative, of the solver's equations.
    pub residual: Option<f64>,
    m1: Option<f64>,
    m2: Option<f64>,
    m1_paper: Option<f64>,
    m2_paper: Option<f64>,
    /// The screened functional.
    pub objective: Option<f64>,
    excess_energy: Option<f64>,
    /// In grey levels of 255.
    pub seam_rms_levels: Option<f64>,
    seam_max_levels: Option<f64>,
    psnr_outside: Option<f64>,
    /// Share of the region's samples outside `[0, 1]`.
    pub outside_unit_range: Option<f64>,
    rmse_to_exact: Option<f64>,
    pde_inside: Option<f64>,
    pde_outside: Option<f64>,
    /// Why the method failed.
    pub error: Option<String>,
}

const OPERATOR: &str = "cubic splines through the samples; integrals by the midpoint rule with 2 \
    points per knot interval and axis; float, unclipped";

impl Table {
    /// Collects the rows of a case.
    pub fn new<const D: usize>(case: &Case<'_, D>, rows: &[Row], unit: &'static str) -> Self {
        let reports = || rows.iter().filter_map(|r| r.report.as_ref());
        let mut warnings = case.warnings.clone();
        for warning in reports().flat_map(|r| &r.warnings) {
            if !warnings.contains(warning) {
                warnings.push(warning.clone());
            }
        }
        let given = match case.options.objective {
            Objective::Screened { length, .. } => length,
            _ => None,
        };
        let screened = rows.iter().find(|r| r.method.slug == "screened");
        let length = given.or(screened.and_then(|r| r.report.as_ref()?.length));
        Self {
            case: case.name.clone(),
            background: case.setup.names[0].clone(),
            patch: case.setup.names[1].clone(),
            offset: case.setup.offset.to_vec(),
            region_samples: reports().map(|r| r.region_samples).fold(0.0, f64::max),
            guidance: case.guidance.to_string(),
            strongest_rule: match case.guidance {
                GuidanceName::Strongest(rule) => Some(rule_name(rule)),
                _ => None,
            },
            objective: match length {
                Some(length) => format!("screened, length {length:.2} {unit}"),
                None => "screened".to_owned(),
            },
            operator: OPERATOR,
            rows: rows.iter().map(Line::new).collect(),
            warnings,
        }
    }

    /// The rows.
    pub fn lines(&self) -> &[Line] {
        &self.rows
    }

    /// What the user should know.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Name of the guidance.
    pub fn guidance(&self) -> &str {
        &self.guidance
    }

    /// Measure of the region in samples.
    pub fn region_samples(&self) -> f64 {
        self.region_samples
    }

    /// A header that says what was measured how, and one line per method.
    pub fn to_text(&self) -> String {
        let at: Vec<String> = self.offset.iter().map(f32::to_string).collect();
        let mut text = format!(
            "{} into {} at {}: {:.0} samples\n",
            self.patch,
            self.background,
            at.join(","),
            self.region_samples
        );
        let rule = self.strongest_rule.map_or(String::new(), |r| format!(" ({r})"));
        let _ = writeln!(text, "guidance  {}{rule}", self.guidance);
        let _ = writeln!(text, "measured  in one operator for all rows: {}", self.operator);
        let _ = writeln!(text, "objective {}; excess against its exact minimum", self.objective);
        text += "seam      |grad c - v| near the region's edge, times 255 (grey levels) per unit of length\n\n";
        let _ = writeln!(
            text,
            "{:<20}{:>8}{:>5}{:>10}{:>10}{:>10}{:>10}{:>11}{:>10}{:>8}{:>8}{:>9}{:>9}",
            "solver",
            "seconds",
            "it",
            "m1",
            "m2",
            "m1 paper",
            "m2 paper",
            "objective",
            "excess",
            "seam",
            "max",
            "PSNR out",
            "not 0..1"
        );
        self.rows.iter().for_each(|line| text += &line.to_text());
        text
    }
}

fn rule_name(rule: Strongest) -> &'static str {
    match rule {
        Strongest::Joint => "one decision per point, by the norm over channels and axes",
        Strongest::PerChannel => "one decision per point and channel",
        Strongest::PerComponent => "one decision per point, channel and axis",
    }
}

impl Line {
    fn new(row: &Row) -> Self {
        let finite = |f: fn(&Metrics) -> f64| row.metrics.as_ref().map(f).filter(|v| v.is_finite());
        Self {
            solver: row.method.label.clone(),
            seconds: row.seconds,
            iterations: row.report.as_ref().map(|r| r.iterations),
            residual: row.report.as_ref().map(|r| r.residual),
            m1: finite(|m| m.m1),
            m2: finite(|m| m.m2),
            m1_paper: finite(|m| m.m1_paper),
            m2_paper: finite(|m| m.m2_paper),
            objective: finite(|m| m.objective),
            excess_energy: finite(|m| m.excess_energy.unwrap_or(f64::NAN)),
            seam_rms_levels: finite(|m| m.seam_rms * LEVELS),
            seam_max_levels: finite(|m| m.seam_max * LEVELS),
            psnr_outside: finite(|m| m.psnr_outside),
            outside_unit_range: finite(|m| m.outside_unit_range),
            rmse_to_exact: finite(|m| m.rmse_to_exact.unwrap_or(f64::NAN)),
            pde_inside: finite(|m| m.pde_inside),
            pde_outside: finite(|m| m.pde_outside),
            error: row.error.clone(),
        }
    }

    fn to_text(&self) -> String {
        let name: String = self.solver.chars().take(19).collect();
        if let Some(error) = &self.error {
            return format!("{name:<20}failed: {error}\n");
        }
        let number =
            |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        let power = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2e}"));
        let iterations = self.iterations.map_or("-".to_owned(), |n| n.to_string());
        let psnr = self.psnr_outside.map_or("exact".to_owned(), |v| format!("{v:.1}"));
        let share = self.outside_unit_range.map(|v| 100.0 * v);
        format!(
            "{name:<20}{:>8}{iterations:>5}{:>10}{:>10}{:>10}{:>10}{:>11}{:>10}{:>8}{:>8}{psnr:>9}{:>8}%\n",
            number(self.seconds, 3),
            power(self.m1),
            power(self.m2),
            power(self.m1_paper),
            power(self.m2_paper),
            self.objective.map_or("-".to_owned(), |v| format!("{v:.3e}")),
            power(self.excess_energy),
            number(self.seam_rms_levels, 2),
            number(self.seam_max_levels, 1),
            number(share, 1),
        )
    }

    fn to_csv(&self) -> String {
        let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        let numbers = [
            self.seconds,
            self.iterations.map(|n| n as f64),
            self.m1,
            self.m2,
            self.m1_paper,
            self.m2_paper,
            self.objective,
            self.excess_energy,
            self.seam_rms_levels,
            self.seam_max_levels,
            self.psnr_outside,
            self.outside_unit_range,
            self.rmse_to_exact,
            self.pde_inside,
            self.pde_outside,
        ];
        numbers.map(number).join(",")
    }
}

/// All tables as one CSV file with a header; numbers that do not exist are empty.
pub fn to_csv(tables: &[&Table]) -> String {
    let mut text =
        "case,background,patch,guidance,solver,seconds,iterations,m1,m2,m1_paper,m2_paper,\
        objective,excess_energy,seam_rms_levels,seam_max_levels,psnr_outside,outside_unit_range,\
        rmse_to_exact,pde_inside,pde_outside,error\n"
            .to_owned();
    for table in tables {
        for line in &table.rows {
            let names =
                [&table.case, &table.background, &table.patch, &table.guidance, &line.solver];
            let names = names.map(|n| quoted(n)).join(",");
            let error = line.error.as_deref().map_or(String::new(), quoted);
            let _ = writeln!(text, "{names},{},{error}", line.to_csv());
        }
    }
    text
}

fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}
