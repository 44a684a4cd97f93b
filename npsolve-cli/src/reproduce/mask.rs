//! How tightly the mask fits the object: classical editing against the screened objective.

use anyhow::Result;
use inr_core::{RasterMask, Samples};
use poisson_loss::{Guidance, Options, PaperOptions};

use super::panel::{self, Tile};
use super::setting::{Setting, crop};
use super::solvers::{self, Bench};
use super::table::{Cell, Column, Format, Table};
use super::{Made, Meter};

/// Change of the mask as a share of its inradius: eroded, as it is, dilated.
const CHANGES: [f32; 5] = [-0.3, -0.15, 0.0, 0.15, 0.3];
/// Pixels shown around the largest mask.
const MARGIN: usize = 8;

/// Makes the figure, with the patch's gradients as guidance.
pub fn make(setting: &Setting, meter: &mut Meter) -> Result<Made> {
    let inradius = setting.mask.inradius(true);
    let mut variants = vec![("rectangle".to_owned(), rectangle(&setting.mask, 0.3 * inradius)?)];
    for change in CHANGES {
        let pixels = (change * inradius).round();
        let label = match pixels {
            0.0 => "the mask".to_owned(),
            p if p < 0.0 => format!("eroded by {}", -p),
            p => format!("dilated by {p}"),
        };
        if let Some(mask) = grown(&setting.mask, pixels)? {
            variants.push((label, mask));
        }
    }
    let with = |mask: &RasterMask<2>| Setting { mask: mask.clone(), ..setting.clone() };
    let (start, size) = with(&variants[0].1).surroundings(MARGIN);
    meter.expect(variants.len() as f32);
    let (mut masks, mut pie, mut ours) = (Vec::new(), Vec::new(), Vec::new());
    let mut rows = Vec::new();
    for (label, mask) in &variants {
        let setting = with(mask);
        let region = setting.region();
        let problem = setting.problem(&region, Guidance::Patch, Options::default());
        let bench = Bench::new(problem, PaperOptions::default())?;
        masks.push(Tile::new(label, String::new(), &crop(&overlay(&setting), start, size)?)?);
        for (scored, tiles) in [(bench.pie()?, &mut pie), (bench.ours()?, &mut ours)] {
            let shown = crop(&scored.samples, start, size)?;
            tiles.push(Tile::new(&scored.label, scored.caption(), &shown)?);
            let names: [Cell; 3] =
                [label.as_str().into(), setting.measure().into(), scored.label.as_str().into()];
            rows.push(names.into_iter().chain(scored.cells()).collect());
        }
        meter.finish(1.0);
    }
    let pictures = [
        ("region".to_owned(), masks),
        ("classical Poisson editing".to_owned(), pie),
        ("screened objective, exact".to_owned(), ours),
    ];
    let mut columns = vec![
        Column { key: "mask", head: "mask", format: Format::Text },
        Column { key: "region_pixels", head: "pixels", format: Format::Fixed(0) },
        Column { key: "solver", head: "solver", format: Format::Text },
    ];
    columns.extend(solvers::columns());
    let mut notes: Vec<String> = solvers::OPERATORS.map(str::to_owned).into();
    notes.push(
        "guidance: the patch's gradients; masks are cut off at the patch's border".to_owned(),
    );
    let title = format!("How tightly the mask fits, on {}", setting.name);
    let picture = panel::draw(&title, &pictures)?;
    Ok(Made { table: Table { title, notes, columns, rows }, picture })
}

/// All samples within `pixels` of the mask, or at least as deep inside for a negative number; none if nothing is left.
fn grown(mask: &RasterMask<2>, pixels: f32) -> Result<Option<RasterMask<2>>> {
    if pixels == 0.0 {
        return Ok(Some(mask.clone()));
    }
    // Cells' edges lie half a pixel from their centres.
    let inside = |d: &f32| f32::from(u8::from(*d < pixels));
    let weights: Vec<f32> = mask.signed_distances().iter().map(inside).collect();
    if weights.iter().all(|w| *w == 0.0) {
        return Ok(None);
    }
    Ok(Some(RasterMask::new(*mask.domain(), weights)?))
}

/// The mask's bounding box with a margin.
fn rectangle(mask: &RasterMask<2>, margin: f32) -> Result<RasterMask<2>> {
    let domain = *mask.domain();
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for k in (0..domain.len()).filter(|k| mask.is_inside(*k)) {
        let at = domain.unflatten(k).map(|i| i as f32);
        (0..2).for_each(|d| (low[d], high[d]) = (low[d].min(at[d]), high[d].max(at[d])));
    }
    let weight = |k: usize| {
        let at = domain.unflatten(k).map(|i| i as f32);
        let inside = (0..2).all(|d| at[d] >= low[d] - margin && at[d] <= high[d] + margin);
        f32::from(u8::from(inside))
    };
    Ok(RasterMask::new(domain, (0..domain.len()).map(weight).collect())?)
}

/// The background with the patch in the region and a red veil over the rest of the patch.
fn overlay(setting: &Setting) -> Samples<2, 3> {
    let (domain, region) = (*setting.background.domain(), setting.region());
    let patch = setting.patch.domain();
    let mut out = setting.background.clone();
    for k in 0..domain.len() {
        let x = domain.position(domain.unflatten(k));
        let at: [f32; 2] = std::array::from_fn(|d| (x[d] - setting.offset[d]).round());
        if (0..2).any(|d| at[d] < 0.0 || at[d] >= patch.shape()[d] as f32) {
            continue;
        }
        let from = at[0] as usize + at[1] as usize * patch.shape()[0];
        let inside = inr_core::Region::weight(&region, &x) >= 0.5;
        for c in 0..3 {
            let value = setting.patch.plane(c)[from];
            let veil = if c == 0 { 0.5 + 0.5 * value } else { 0.5 * value };
            out.plane_mut(c)[k] = if inside { value } else { veil };
        }
    }
    out
}
