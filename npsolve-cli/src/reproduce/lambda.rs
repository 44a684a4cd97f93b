//! The weight of the colour term: the paper's objective from 0.1 to 100, exact and as a network, and the screened
//! objective's length beside it.

use anyhow::Result;
use poisson_loss::{Guidance, Objective, Options, PaperOptions, PaperWeights};

use crate::args::ReproduceArgs;

use super::panel::{self, Tile};
use super::setting::Setting;
use super::solvers::{self, Bench, Scored};
use super::table::{Cell, Column, Format, Table};
use super::{Made, Meter};

const LAMBDAS: [f32; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 100.0];
/// In pixels: as many as lambdas, so that rows have one length.
const LENGTHS: [f32; 6] = [16.0, 8.0, 4.0, 2.0, 1.0, 0.5];
/// Pixels kept around the region.
const MARGIN: usize = 24;

/// Makes the figure, with the patch's gradients as guidance.
pub fn make(setting: &Setting, args: &ReproduceArgs, meter: &mut Meter) -> Result<Made> {
    let (start, size) = setting.surroundings(MARGIN);
    let setting = setting.cropped(start, size)?;
    let region = setting.region();
    let pixels = setting.background.domain().len() as f32;
    meter.expect(LAMBDAS.len() as f32 * pixels * args.steps() as f32);
    let mut rows: [Vec<Scored>; 3] = Default::default();
    for lambda in LAMBDAS {
        let paper = PaperOptions {
            steps: args.steps(),
            weights: PaperWeights::Lambda(lambda),
            ..PaperOptions::default()
        };
        let problem = setting.problem(&region, Guidance::Patch, Options::default());
        let bench = Bench::new(problem, paper)?;
        let mut exact = bench.paper_spline(lambda)?;
        exact.label = format!("exact, lambda {lambda}");
        rows[0].push(exact);
        rows[1].push(bench.diner(&format!("DINER, lambda {lambda}"), meter)?);
    }
    for length in LENGTHS {
        let objective = Objective::Screened { length: Some(length), keep: None };
        let options = Options::with_objective(objective);
        let problem = setting.problem(&region, Guidance::Patch, options);
        let mut ours = Bench::new(problem, PaperOptions::default())?.ours()?;
        ours.label = format!("screened, length {length}");
        rows[2].push(ours);
    }
    let heads = [
        "paper: exact among splines",
        "paper: DINER on pixel differences",
        "screened: exact among splines, lengths in pixels",
    ];
    let mut pictures = Vec::new();
    for (head, row) in heads.iter().zip(&rows) {
        let tile = |s: &Scored| Tile::new(&s.label, s.caption(), &s.samples);
        pictures.push(((*head).to_owned(), row.iter().map(tile).collect::<Result<_>>()?));
    }
    let mut columns = vec![Column { key: "solver", head: "solver", format: Format::Text }];
    columns.extend(solvers::columns());
    let table_row = |s: &Scored| -> Vec<Cell> {
        [s.label.as_str().into()].into_iter().chain(s.cells()).collect()
    };
    let [w, h] = size;
    let mut notes: Vec<String> = solvers::OPERATORS.map(str::to_owned).into();
    notes.push(format!(
        "guidance: the patch's gradients; {w} x {h} pixels around the region; DINER {} steps; the loss of a row \
         and its excess are for its own lambda (released weights in the last rows)",
        args.steps()
    ));
    let title = format!("The weight of the colour term on {}", setting.name);
    let picture = panel::draw(&title, &pictures)?;
    let rows = rows.iter().flatten().map(table_row).collect();
    Ok(Made { table: Table { title, notes, columns, rows }, picture })
}
