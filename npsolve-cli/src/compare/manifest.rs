//! `npsolve compare --manifest`: many scenes, one line each.

pub mod entry;

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use signal_io::WriteOptions;

use crate::args::{CompareArgs, SceneArgs};
use crate::channels::{Axes, Channels};
use crate::values::GuidanceName;
use crate::{console, files};

use self::entry::Entry;
use super::methods::Case;
use super::subject::Subject;
use super::table::{Line, Table, to_csv};
use super::{Shown, TABLE_CSV, Visitor, sheet};

/// Runs all scenes. Bad ones are reported, the others go on, and the command fails at the end.
pub fn run(path: &Path, args: &CompareArgs, quiet: bool) -> Result<()> {
    let scenes = entry::read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut all =
        Run { args, folder, tables: Vec::new(), failures: 0, print: !quiet && !args.json };
    all.check_targets()?;
    all.say(&header())?;
    for (k, (dimensions, value)) in scenes.into_iter().enumerate() {
        match serde_json::from_value::<Entry>(value) {
            Ok(entry) => all.scene(dimensions, &entry)?,
            Err(e) => all.fail(&anyhow!("scene {} of {}: {e}", k + 1, path.display())),
        }
    }
    all.finish()
}

struct Run<'a> {
    args: &'a CompareArgs,
    folder: &'a Path,
    tables: Vec<Table>,
    failures: usize,
    print: bool,
}

impl Run<'_> {
    fn check_targets(&self) -> Result<()> {
        let Some(output) = &self.args.output else { return Ok(()) };
        files::make_folder(output)?;
        files::check_text(&output.join(TABLE_CSV), self.args.force)
    }

    fn say(&self, text: &str) -> Result<()> {
        if self.print { console::print(text) } else { Ok(()) }
    }

    fn fail(&mut self, error: &anyhow::Error) {
        self.failures += 1;
        console::error(&format!("{error:#}"));
    }

    /// Every region with every guidance.
    fn scene(&mut self, dimensions: usize, entry: &Entry) -> Result<()> {
        for (region, place) in entry.scenes(self.folder, &self.args.scene) {
            for guidance in self.guidances(entry) {
                let name = format!("{}-{region}", entry.name);
                let done = guidance.and_then(|g| self.case(dimensions, entry, &name, &place, g));
                match done {
                    Ok(table) => {
                        self.say(&one_line(&name, &table))?;
                        self.tables.push(table);
                    }
                    Err(error) => self.fail(&error.context(name)),
                }
            }
        }
        Ok(())
    }

    fn guidances(&self, entry: &Entry) -> Vec<Result<GuidanceName>> {
        if entry.guidance.is_empty() {
            return vec![Ok(self.args.solve.guidance)];
        }
        let parse =
            |name: &String| GuidanceName::from_manifest(name).map_err(|e| anyhow!("{name}: {e}"));
        entry.guidance.iter().map(parse).collect()
    }

    fn case(
        &self,
        dimensions: usize,
        entry: &Entry,
        name: &str,
        place: &SceneArgs,
        guidance: GuidanceName,
    ) -> Result<Table> {
        let file = format!("{name}-{guidance}.png").replace([':', ',', '/', '\\'], "-");
        let target = self.args.output.as_ref().map(|folder| folder.join(file));
        if let Some(target) = &target {
            files::check_picture(target, self.args.force)?;
        }
        let [background, patch] = [&entry.background, &entry.patch].map(|p| self.folder.join(p));
        let subject = Subject {
            kind: Entry::kind(dimensions),
            background: &background,
            patch: &patch,
            scene: place,
            args: self.args,
        };
        subject.open(OfMany { name, guidance, target, force: self.args.force })
    }

    fn finish(self) -> Result<()> {
        let tables: Vec<&Table> = self.tables.iter().collect();
        let csv = to_csv(&tables);
        if let Some(output) = &self.args.output {
            files::write_text(&output.join(TABLE_CSV), &csv, self.args.force)?;
        }
        if let Some(path) = &self.args.csv {
            files::write_text(path, &csv, self.args.force)?;
        }
        if self.args.json {
            console::print(&files::to_json(&self.tables)?)?;
        }
        self.say(&summary(&self.tables))?;
        match self.failures {
            0 => Ok(()),
            n => bail!("{n} of {} cases failed; see the messages above", n + self.tables.len()),
        }
    }
}

/// A comparison among others.
struct OfMany<'a> {
    name: &'a str,
    guidance: GuidanceName,
    /// Of its sheet.
    target: Option<PathBuf>,
    force: bool,
}

impl Visitor for OfMany<'_> {
    type Output = Table;

    fn visit<const D: usize>(self, mut case: Case<'_, D>, shown: &dyn Shown) -> Result<Table>
    where
        Axes<D>: Channels,
    {
        case.name = self.name.to_owned();
        case.guidance = self.guidance;
        let rows = case.run(&mut |_| {})?;
        if let Some(target) = &self.target {
            let options = WriteOptions { force: self.force, ..WriteOptions::default() };
            let sheet = sheet::draw(&case, &rows, &|planes| shown.around(planes))?;
            files::write(target, &sheet, &options)?;
        }
        Ok(Table::new(&case, &rows, shown.unit()))
    }
}

/// Methods whose seams are in the line of a case.
const SHOWN: [(&str, &str); 4] = [
    ("screened (ours)", "ours"),
    ("PIE on links", "PIE"),
    ("paper, spline", "paper"),
    ("copy and paste", "paste"),
];

fn header() -> String {
    let names: String = SHOWN.iter().map(|(_, short)| format!("{short:>8}")).collect();
    format!(
        "seam RMS times 255 per unit of length, all in the screened spline operator; strongest by \
         the norm over channels and axes\n{:<24}{:<12}{:>8}{:>9}{names}{:>10}\n",
        "case", "guidance", "samples", "seconds", "not 0..1"
    )
}

fn one_line(name: &str, table: &Table) -> String {
    let line = |label: &str| table.lines().iter().find(|l| l.solver == label);
    let ours = line(SHOWN[0].0);
    let number =
        |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    let seams: String = SHOWN
        .iter()
        .map(|(label, _)| format!("{:>8}", number(line(label).and_then(|l| l.seam_rms_levels), 2)))
        .collect();
    format!(
        "{name:<24}{:<12}{:>8.0}{:>9}{seams}{:>9}%\n",
        table.guidance(),
        table.region_samples(),
        number(ours.and_then(|l| l.seconds), 3),
        number(ours.and_then(|l| l.outside_unit_range).map(|v| 100.0 * v), 1),
    )
}

/// Per method: mean time and geometric means of the ratios to ours.
fn summary(tables: &[Table]) -> String {
    let mut text = format!(
        "\n{:<20}{:>6}{:>10}{:>12}{:>17}\n",
        "solver", "cases", "seconds", "seam/ours", "objective/ours"
    );
    let Some(first) = tables.first() else { return "\nNo case was compared.\n".to_owned() };
    for label in first.lines().iter().map(|l| &l.solver) {
        let pairs: Vec<(&Line, &Line)> = tables
            .iter()
            .filter_map(|t| {
                let find = |name: &str| t.lines().iter().find(|l| l.solver == name);
                find(label).filter(|l| l.error.is_none()).zip(find(SHOWN[0].0))
            })
            .collect();
        let seconds: Vec<f64> = pairs.iter().filter_map(|(l, _)| l.seconds).collect();
        let ratio = |of: fn(&Line) -> Option<f64>| {
            let logs: Vec<f64> = pairs
                .iter()
                .filter_map(|(l, ours)| Some((of(l)? / of(ours)?).ln()))
                .filter(|v| v.is_finite())
                .collect();
            mean(&logs).map_or("-".to_owned(), |m| format!("{:.3}", m.exp()))
        };
        text += &format!(
            "{label:<20}{:>6}{:>10}{:>12}{:>17}\n",
            pairs.len(),
            mean(&seconds).map_or("-".to_owned(), |m| format!("{m:.3}")),
            ratio(|l| l.seam_rms_levels),
            ratio(|l| l.objective),
        );
    }
    text + "(geometric means over the cases; below 1 is better than ours)\n"
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
