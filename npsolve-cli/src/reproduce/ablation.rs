//! The paper's ablation, the colour term at the boundary alone, and other variants of its solver.

use anyhow::Result;
use poisson_loss::{
    ColorTerm, Guidance, Options, PaperOptions, PaperSignals, PaperStart, Stencil, Strongest,
};

use crate::args::ReproduceArgs;

use super::panel::{self, Tile};
use super::setting::Setting;
use super::solvers::{self, Bench, Scored};
use super::table::{Cell, Column, Format, Table};
use super::{Made, Meter};

/// Every variant differs from the released configuration in one point.
fn variants(released: PaperOptions) -> Vec<(&'static str, PaperOptions)> {
    let fits = released.steps;
    let boundary = PaperOptions { color: ColorTerm::Boundary, ..released };
    let background = PaperStart::Background { steps: fits };
    vec![
        ("released", released),
        ("colour at boundary", boundary),
        ("colour at boundary, from S", PaperOptions { start: background, ..boundary }),
        ("from S", PaperOptions { start: background, ..released }),
        (
            "S and T as DINER",
            PaperOptions { signals: PaperSignals::Fitted { steps: fits }, ..released },
        ),
        ("no decay", PaperOptions { decay: 0.0, ..released }),
        ("no decay, rate x 4", PaperOptions { decay: 0.0, rate: 4.0 * released.rate, ..released }),
        ("forward differences", PaperOptions { stencil: Stencil::Forward, ..released }),
        ("backward differences", PaperOptions { stencil: Stencil::Backward, ..released }),
        ("centred differences", PaperOptions { stencil: Stencil::Centred, ..released }),
        ("no erosion", PaperOptions { erode: 0, ..released }),
    ]
}

/// Makes the figure.
pub fn make(setting: &Setting, args: &ReproduceArgs, meter: &mut Meter) -> Result<Made> {
    let released = PaperOptions { steps: args.steps(), ..PaperOptions::default() };
    let variants = variants(released);
    let pixels = setting.background.domain().len() as f32;
    meter.expect(variants.len() as f32 * pixels * released.steps as f32);
    let region = setting.region();
    let guidance = Guidance::Strongest(Strongest::PerComponent);
    let mut all: Vec<Scored> = Vec::new();
    for (label, options) in variants {
        let problem = setting.problem(&region, guidance.clone(), Options::default());
        all.push(Bench::new(problem, options)?.diner(label, meter)?);
    }
    let caption = |s: &Scored| format!("PSNR outside {:.1} dB", s.metrics.psnr_outside);
    let mut pictures = Vec::new();
    for row in all.chunks(4) {
        let tile = |s: &Scored| Tile::new(&s.label, caption(s), &s.samples);
        pictures.push((String::new(), row.iter().map(tile).collect::<Result<_>>()?));
    }
    let mut columns = vec![Column { key: "variant", head: "variant", format: Format::Text }];
    columns.extend(solvers::columns());
    let row = |s: &Scored| -> Vec<Cell> {
        [s.label.as_str().into()].into_iter().chain(s.cells()).collect()
    };
    let [w, h] = setting.background.domain().shape();
    let mut notes: Vec<String> = solvers::OPERATORS.map(str::to_owned).into();
    notes.push(format!(
        "guidance strongest:component; {w} x {h} pixels; {} steps; the loss of a row and its excess are those of its \
         own variant: colour at the boundary counts there alone, PSNR and m2 always everywhere outside",
        released.steps
    ));
    let title = format!("Variants of the released solver on {}", setting.name);
    let picture = panel::draw(&title, &pictures)?;
    Ok(Made {
        table: Table { title, notes, columns, rows: all.iter().map(row).collect() },
        picture,
    })
}
