//! Kinds of guidance: what the result follows, and what its gradient becomes.

use anyhow::Result;
use inr_core::{Field, Jet, Region, Samples, Spline};
use poisson_loss::{Baseline, Guidance, Options, PaperOptions, Strongest, solve_baseline};

use super::panel::{self, Tile};
use super::setting::{Setting, crop};
use super::solvers::{self, Bench};
use super::table::{Column, Format, Table};
use super::{Made, Meter};

/// Gradients are shown this many times larger: a step of 1/5 per pixel is white.
const GAIN: f32 = 5.0;
/// Pixels shown around the region.
const MARGIN: usize = 16;

fn guidances() -> [(&'static str, Guidance<2, 3>); 5] {
    [
        ("patch", Guidance::Patch),
        ("strongest", Guidance::Strongest(Strongest::Joint)),
        ("strongest:component", Guidance::Strongest(Strongest::PerComponent)),
        ("sum", Guidance::SUM),
        ("mix:0.5,0.5", Guidance::Mix { mu: 0.5, phi: 0.5 }),
    ]
}

/// Makes the figure with the screened objective's exact solutions.
pub fn make(setting: &Setting, meter: &mut Meter) -> Result<Made> {
    let region = setting.region();
    let (start, size) = setting.surroundings(MARGIN);
    let tile = |label: &str, caption: String, samples: &Samples<2, 3>| {
        Tile::new(label, caption, &crop(samples, start, size)?)
    };
    let problem = setting.problem(&region, Guidance::Patch, Options::default());
    let pasted = solve_baseline(&problem, Baseline::Paste)?.samples;
    let background = &setting.background;
    let mut inputs = vec![tile("background", String::new(), background)?];
    inputs.push(tile("pasted", String::new(), &pasted)?);
    inputs.push(tile("|gradient| of background", String::new(), &steepness(background))?);
    inputs.push(tile("|gradient| of pasted", String::new(), &steepness(&pasted))?);
    let (mut rows, mut results) = (Vec::new(), Vec::new());
    let (mut followed, mut reached) = (Vec::new(), Vec::new());
    meter.expect(guidances().len() as f32);
    for (name, guidance) in guidances() {
        let v = followed_steepness(setting, &guidance);
        let problem = setting.problem(&region, guidance, Options::default());
        let bench = Bench::new(problem, PaperOptions::default())?;
        let mut ours = bench.ours()?;
        ours.label = name.to_owned();
        results.push(tile(name, ours.caption(), &ours.samples)?);
        followed.push(tile("|v|", String::new(), &v)?);
        reached.push(tile("|gradient|", String::new(), &steepness(&ours.samples))?);
        rows.push([name.into()].into_iter().chain(ours.cells()).collect());
        meter.finish(1.0);
    }
    let pictures = [
        ("inputs".to_owned(), inputs),
        ("results: screened objective, exact".to_owned(), results),
        (format!("the gradient to follow, x {GAIN}"), followed),
        (format!("gradient of the result, x {GAIN}"), reached),
    ];
    let mut columns = vec![Column { key: "guidance", head: "guidance", format: Format::Text }];
    columns.extend(solvers::columns());
    let mut notes: Vec<String> = solvers::OPERATORS.map(str::to_owned).into();
    notes.push(
        "screened objective, exact; each row is measured against its own guidance".to_owned(),
    );
    notes.push("strongest: one decision per point by the norm over channels and axes".to_owned());
    let title = format!("Kinds of guidance on {}", setting.name);
    let picture = panel::draw(&title, &pictures)?;
    Ok(Made { table: Table { title, notes, columns, rows }, picture })
}

/// The norm over axes of the gradient of a spline through samples, per channel, for the eye.
fn steepness(samples: &Samples<2, 3>) -> Samples<2, 3> {
    let (spline, domain) = (Spline::interpolate(samples), *samples.domain());
    let slopes = [[1, 0], [0, 1]].map(|order| spline.eval_lattice(&domain, order));
    let mut out = Samples::zeros(domain);
    for (k, v) in out.as_planar_mut().iter_mut().enumerate() {
        let [x, y] = slopes.each_ref().map(|s| s.as_planar()[k]);
        *v = GAIN * x.hypot(y);
    }
    out
}

/// The same of the gradient to follow: the guidance inside, the background's gradient outside.
fn followed_steepness(setting: &Setting, guidance: &Guidance<2, 3>) -> Samples<2, 3> {
    let domain = *setting.background.domain();
    let (background, patch) =
        (Spline::interpolate(&setting.background), Spline::interpolate(&setting.patch));
    let x: Vec<[f32; 2]> =
        (0..domain.len()).map(|k| domain.position(domain.unflatten(k))).collect();
    let moved: Vec<[f32; 2]> =
        x.iter().map(|x| std::array::from_fn(|d| x[d] - setting.offset[d])).collect();
    let jets = |field: &Spline<2, 3>, x: &[[f32; 2]]| {
        let mut jets = vec![Jet::ZERO; x.len()];
        field.eval_jet(x, &mut jets);
        jets
    };
    let (s, t) = (jets(&background, &x), jets(&patch, &moved));
    let region = setting.region();
    let mut out = Samples::zeros(domain);
    for k in 0..x.len() {
        let m = region.weight(&x[k]);
        let v = guidance.evaluate(&x[k], &s[k], &t[k]);
        for c in 0..3 {
            let of = |d: usize| s[k].grad[c][d] + m * (v[c][d] - s[k].grad[c][d]);
            out.plane_mut(c)[k] = GAIN * of(0).hypot(of(1));
        }
    }
    out
}
