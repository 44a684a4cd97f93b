//! `npsolve compare --manifest`: many scenes, one line each.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use serde::Deserialize;
use signal_io::WriteOptions;

use crate::args::{CompareArgs, SceneArgs};
use crate::scene::Scene;
use crate::values::GuidanceName;
use crate::{console, files};

use super::methods::Case;
use super::table::{Line, Table, to_csv};
use super::{TABLE_CSV, sheet};

/// The part of the file that is used. Scenes are read one by one, so that a bad one spoils only itself.
#[derive(Deserialize)]
struct Manifest {
    blend_2d: Vec<serde_json::Value>,
}

/// One scene of a manifest; paths are relative to the file.
#[derive(Deserialize)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// The picture to paste into.
    pub background: PathBuf,
    /// The picture to paste.
    pub patch: PathBuf,
    /// Without masks the patch's alpha, or the whole patch, is the region.
    #[serde(default)]
    pub masks: BTreeMap<String, PathBuf>,
    /// Where the patch's first pixel goes.
    pub offset: [f32; 2],
    /// Without names the guidance of the command line.
    #[serde(default)]
    guidance: Vec<String>,
}

/// The folder that paths are relative to, and the scenes, not yet looked at.
pub fn read(path: &Path) -> Result<(&Path, Vec<serde_json::Value>)> {
    let text = fs::read_to_string(path)
        .with_context(|| format!("cannot read {}; check the path", path.display()))?;
    let manifest: Manifest = serde_json::from_str(&text).with_context(|| {
        format!("{} is not a list of scenes; it needs a JSON list \"blend_2d\"", path.display())
    })?;
    Ok((path.parent().unwrap_or(Path::new("")), manifest.blend_2d))
}

/// Runs all scenes. Bad ones are reported, the others go on, and the command fails at the end.
pub fn run(path: &Path, args: &CompareArgs, quiet: bool) -> Result<()> {
    let (folder, scenes) = read(path)?;
    let mut all =
        Run { args, folder, tables: Vec::new(), failures: 0, print: !quiet && !args.json };
    all.check_targets()?;
    all.say(&header())?;
    for (k, value) in scenes.into_iter().enumerate() {
        match serde_json::from_value::<Entry>(value) {
            Ok(entry) => all.scene(&entry)?,
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

    /// Every mask with every guidance.
    fn scene(&mut self, entry: &Entry) -> Result<()> {
        let mut masks: Vec<(&str, Option<PathBuf>)> = Vec::new();
        for (name, path) in &entry.masks {
            masks.push((name, Some(self.folder.join(path))));
        }
        if masks.is_empty() {
            masks.push(("all", None));
        }
        for (mask_name, mask) in masks {
            for guidance in self.guidances(entry) {
                let name = format!("{}-{mask_name}", entry.name);
                let done =
                    guidance.and_then(|guidance| self.case(entry, &name, mask.clone(), guidance));
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
        entry: &Entry,
        name: &str,
        mask: Option<PathBuf>,
        guidance: GuidanceName,
    ) -> Result<Table> {
        let [background, patch] = [&entry.background, &entry.patch].map(|p| self.folder.join(p));
        let place = SceneArgs { mask, at: Some(entry.offset.into()), ..self.args.scene.clone() };
        let scene = Scene::read(&background, &patch, &place)?;
        let mut case = Case::new(name.to_owned(), scene, self.args)?;
        case.guidance = guidance;
        let file = format!("{name}-{guidance}.png").replace([':', ',', '/', '\\'], "-");
        let target = self.args.output.as_ref().map(|folder| folder.join(file));
        if let Some(target) = &target {
            files::check_picture(target, self.args.force)?;
        }
        let rows = case.run(&mut |_| {})?;
        if let Some(target) = &target {
            let options = WriteOptions { force: self.args.force, ..WriteOptions::default() };
            files::write(target, &sheet::draw(&case, &rows)?, &options)?;
        }
        Ok(Table::new(&case, &rows))
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
        "seam RMS in grey levels of 255 per pixel, all in the screened spline operator; strongest by \
         the norm over channels and axes\n{:<24}{:<12}{:>8}{:>9}{names}{:>10}\n",
        "case", "guidance", "pixels", "seconds", "not 0..1"
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
