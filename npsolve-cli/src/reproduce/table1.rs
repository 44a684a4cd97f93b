//! The paper's table 1: every solver on five scenes with two kinds of guidance.

use anyhow::{Context, Result};
use poisson_loss::{Guidance, Options, PaperOptions, Strongest};

use crate::args::ReproduceArgs;

use super::panel::{self, Tile};
use super::setting::{Setting, crop};
use super::solvers::{self, Bench, Scored};
use super::table::{Cell, Column, Format, Table};
use super::{Made, Meter};

/// Pixels shown around the region.
const MARGIN: usize = 16;

/// The two columns of the paper's table.
fn guidances() -> [(&'static str, Guidance<2, 3>); 2] {
    [("strongest:component", Guidance::Strongest(Strongest::PerComponent)), ("sum", Guidance::SUM)]
}

/// Makes the table.
pub fn make(settings: &[Setting], args: &ReproduceArgs, meter: &mut Meter) -> Result<Made> {
    let paper = PaperOptions { steps: args.steps(), ..PaperOptions::default() };
    let unit = |s: &Setting| s.background.domain().len() as f32 * paper.steps as f32;
    meter.expect(2.0 * settings.iter().map(unit).sum::<f32>());
    let mut rows = Vec::new();
    let mut pictures = Vec::new();
    for setting in settings {
        for (name, guidance) in guidances() {
            let scored = case(setting, guidance, paper, meter)
                .with_context(|| format!("{} with {name}", setting.name))?;
            let (start, size) = setting.surroundings(MARGIN);
            let mut tiles = Vec::new();
            for s in &scored {
                let shown = crop(&s.samples, start, size)?;
                tiles.push(Tile::new(&s.label, s.caption(), &shown)?);
                let mut row: Vec<Cell> =
                    vec![setting.name.as_str().into(), name.into(), s.label.as_str().into()];
                row.extend(s.cells());
                rows.push(row);
            }
            pictures.push((format!("{}, {name}", setting.name), tiles));
        }
    }
    let mut columns: Vec<Column> =
        [("scene", "scene"), ("guidance", "guidance"), ("solver", "solver")]
            .map(|(key, head)| Column { key, head, format: Format::Text })
            .into();
    columns.extend(solvers::columns());
    let mut notes: Vec<String> = solvers::OPERATORS.map(str::to_owned).into();
    notes.push(
        "strongest:component: the larger derivative by magnitude, per sample, channel and axis (and stencil)".to_owned(),
    );
    notes.push(format!(
        "the paper's solver: DINER in the released configuration, {} steps, on the whole picture; its \
         objective among splines: lambda 0.4 |S-Omega|/|Omega|, what the released weights amount to",
        paper.steps
    ));
    let title = "Table 1 of Wu et al. 2024, on stand-in scenes".to_owned();
    let picture = panel::draw(&title, &pictures)?;
    Ok(Made { table: Table { title, notes, columns, rows }, picture })
}

/// All solvers on one problem.
fn case(
    setting: &Setting,
    guidance: Guidance<2, 3>,
    paper: PaperOptions,
    meter: &mut Meter,
) -> Result<Vec<Scored>> {
    let region = setting.region();
    let problem = setting.problem(&region, guidance, Options::default());
    let bench = Bench::new(problem, paper)?;
    Ok(vec![
        bench.pie()?,
        bench.diner("paper (DINER)", meter)?,
        bench.least()?,
        bench.paper_spline(solvers::released_lambda(setting)?)?,
        bench.ours()?,
        bench.grid()?,
    ])
}
