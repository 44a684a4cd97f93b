//! What must be known of all signals before any block is solved: region, box, length, sizes.

use inr_core::Domain;

use super::local::{HALO, Part, read_background, read_patch, read_region};
use super::transfer::Coarse;
use super::{BlockOptions, BlockProblem, Boxed, OVERLAP, parts};
use crate::assembly::{edge_samples, mean_at};
use crate::axis::End;
use crate::plan::{default_length, margin, solved_box};
use crate::problem::Support;
use crate::tile::Frame;
use crate::{Error, Guidance, Objective, Result};

/// Samples per axis of the mask on which the default length is measured.
const MEASURED: usize = 1024;
/// Samples per axis of what is read at once.
const READ: usize = 1024;
/// Least side of a block: below it overlaps would be most of the work.
const LEAST_SIDE: usize = 64;
/// Least rows of a slab of the result, beside a halo of three times as many.
const LEAST_SLAB: usize = 16;
/// Least number of fine samples per coarse one. Every second sample would cost a quarter of a blend.
const LEAST_STEP: usize = 4;
/// Share of the memory for a block, and for the coarse lattice; the rest is for what is read and written.
const SHARES: (f64, f64) = (0.7, 0.25);

/// Bytes per sample of a block with its halo: signals, coefficients, first guess and residual per channel,
/// weights, and the vectors of one solve. Measured with three channels: 116.
fn block_bytes(channels: usize) -> f64 {
    70.0 + 20.0 * channels as f64
}

/// The same of the coarse lattice, where there are no signals.
fn coarse_bytes(channels: usize) -> f64 {
    100.0 + 8.0 * channels as f64
}

/// The lengths of the objective, if it is one that blocks can solve.
fn lengths<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
) -> Result<(Option<f32>, Option<f32>)> {
    let options = &problem.options;
    options.validate()?;
    let refused = |name| Error::Parameter { name, rule: "off for a blend in blocks", value: 1.0 };
    match options.objective {
        _ if options.ramp => Err(refused("ramp")),
        _ if options.band => Err(refused("band")),
        _ if options.feather > 0.0 => Err(refused("feather")),
        Objective::Screened { length, keep } => Ok((length, keep)),
        Objective::Paper { .. } => Err(refused("the paper's objective")),
        Objective::Dirichlet => Err(refused("the Dirichlet objective")),
    }
}

/// Looks at all weights, and at both signals along the region's edge.
pub fn survey<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    options: &BlockOptions,
) -> Result<Boxed<D>> {
    let (length, keep) = lengths(problem)?;
    let sources = [
        ("background", problem.background, C),
        ("patch", problem.patch, C),
        ("mask", problem.mask, 1),
    ];
    for (what, source, channels) in sources {
        if source.channels() != channels {
            let reason = format!("{} channels, {channels} are needed", source.channels());
            return Err(Error::Storage { what, reason });
        }
    }
    if problem.mask.shape() != problem.patch.shape() {
        let (expected, found) = (problem.patch.shape().to_vec(), problem.mask.shape().to_vec());
        return Err(Error::Shape { expected, found });
    }
    let domain = Domain::<D>::unit(problem.background.shape())?;
    let (support, default) = region(problem, &domain)?;
    if support.measure >= domain.len() as f64 && keep.is_none() {
        return Err(Error::NoAnchor);
    }
    let length = length.unwrap_or(default);
    let (start, frame) =
        solved_box(&domain, &support, margin(&domain, &problem.options, Some(length)));
    let mut boxed = Boxed {
        start,
        frame,
        length,
        keep,
        measure: support.measure,
        means: vec![0.0; C],
        side: 0,
        slab: 0,
        coarse: None,
    };
    sizes::<D, C>(&mut boxed, domain.shape(), options)?;
    if keep.is_none() {
        boxed.means = means(problem, &boxed, &support)?;
    }
    Ok(boxed)
}

/// Bytes that blocks of this side take.
fn bytes_of<const D: usize>(side: usize, channels: usize, shape: [usize; D]) -> f64 {
    let wide = shape.map(|n| (side + 2 * (OVERLAP + HALO)).min(n) as f64);
    wide.iter().product::<f64>() * block_bytes(channels) / SHARES.0
}

/// Bytes that a slab of so many rows takes.
fn slab_bytes<const D: usize>(rows: usize, channels: usize, shape: [usize; D]) -> f64 {
    let row: f64 = shape[..D - 1].iter().map(|n| *n as f64).product();
    row * (rows + 2 * HALO).min(shape[D - 1]) as f64 * block_bytes(channels) / SHARES.0
}

/// The least memory for a background of this shape.
pub fn least_memory<const D: usize>(channels: usize, shape: [usize; D], whole_rows: bool) -> u64 {
    let blocks = bytes_of(LEAST_SIDE, channels, shape);
    let rows = if whole_rows { slab_bytes(LEAST_SLAB, channels, shape) } else { 0.0 };
    blocks.max(rows).ceil() as u64
}

/// The largest number from `least` to `most` for which `fits` holds; it does for the least.
fn largest(least: usize, most: usize, fits: impl Fn(usize) -> bool) -> usize {
    if fits(most) {
        return most;
    }
    let (mut good, mut too_large) = (least, most);
    while too_large - good > 1 {
        let middle = good.midpoint(too_large);
        *(if fits(middle) { &mut good } else { &mut too_large }) = middle;
    }
    good
}

/// Side of the blocks, rows of the slabs, and the coarse lattice.
fn sizes<const D: usize, const C: usize>(
    boxed: &mut Boxed<D>,
    whole: [usize; D],
    options: &BlockOptions,
) -> Result<()> {
    let (given, shape) = (options.max_memory as f64, boxed.frame.shape);
    let needed = least_memory(C, shape, false).max(match options.whole_rows {
        true => least_memory(C, whole, true),
        false => 0,
    });
    if needed > options.max_memory {
        return Err(Error::Memory { needed, given: options.max_memory });
    }
    if options.whole_rows {
        let rows = whole[D - 1];
        boxed.slab =
            largest(LEAST_SLAB.min(rows), rows, |rows| slab_bytes(rows, C, whole) <= given);
    }
    let longest = *shape.iter().max().expect("a dimension at least");
    boxed.side =
        largest(LEAST_SIDE.min(longest), longest, |side| bytes_of(side, C, shape) <= given);
    if boxed.side == longest {
        return Ok(());
    }
    let mut step = LEAST_STEP;
    let lattice = |step: usize| Coarse::new(boxed.frame, step);
    while lattice(step).frame.len() as f64 * coarse_bytes(C) / SHARES.1 > given {
        step *= 2;
    }
    boxed.coarse = Some(lattice(step));
    Ok(())
}

/// The region's bounds and measure, and the default length, from a mask of reduced resolution.
fn region<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    domain: &Domain<D>,
) -> Result<(Support<D>, f32)> {
    let (whole, patch) = (domain.shape(), problem.patch.shape());
    let lo: [usize; D] = std::array::from_fn(|d| problem.offset[d].max(0) as usize);
    let shape: [usize; D] = std::array::from_fn(|d| {
        let end = (problem.offset[d] + patch[d] as isize).clamp(0, whole[d] as isize) as usize;
        end.saturating_sub(lo[d])
    });
    if shape.contains(&0) {
        return Err(Error::EmptyRegion);
    }
    let factor = shape.iter().map(|n| n.div_ceil(MEASURED)).max().unwrap_or(1);
    let small: [usize; D] = std::array::from_fn(|d| whole[d].div_ceil(factor));
    let reduced = Domain::new(small, [factor as f32; D], [0.0; D], domain.unit_of_length())?;
    // Counts of samples and sums of weights around the patch alone.
    let first: [usize; D] = lo.map(|v| v / factor);
    let extent: [usize; D] =
        std::array::from_fn(|d| (lo[d] + shape[d]).div_ceil(factor) - first[d]);
    let mut sums = vec![0.0f32; extent.iter().product()];
    let (mut low, mut high, mut measure) = (whole, [0; D], 0.0f64);
    let around = Boxed::bare(lo, shape);
    for part in parts(shape, [READ; D]) {
        let weights = read_region(problem, &around, &part)?;
        for (k, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let (mut rest, mut at, mut stride) = (k, 0, 1);
            for d in 0..D {
                let i = lo[d] + part.start[d] + rest % part.shape[d];
                rest /= part.shape[d];
                (low[d], high[d]) = (low[d].min(i), high[d].max(i + 1));
                at += (i / factor - first[d]) * stride;
                stride *= extent[d];
            }
            measure += f64::from(*w);
            sums[at] += w;
        }
    }
    if measure == 0.0 {
        return Err(Error::EmptyRegion);
    }
    let cell = (factor as f32).powi(D as i32);
    let mut coarse = Support {
        start: first,
        shape: extent,
        weight: sums.into_iter().map(|s| s / cell).collect(),
        measure: 0.0,
        warnings: Vec::new(),
    };
    let default = default_length(&reduced, &coarse, 1.0);
    coarse.weight = Vec::new();
    let support =
        Support { start: low, shape: std::array::from_fn(|d| high[d] - low[d]), measure, ..coarse };
    Ok((support, default))
}

/// Mean of what is pasted at the region's edge, per channel. Any number would do: a good one makes
/// the first change small.
fn means<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    support: &Support<D>,
) -> Result<Vec<f32>> {
    let (mut sums, mut count) = (vec![0.0f64; C], 0usize);
    let (of_background, of_patch) = match problem.guidance {
        Guidance::Mix { mu, phi } => (mu - 1.0, phi),
        _ => (-1.0, 1.0),
    };
    let from: [usize; D] = std::array::from_fn(|d| support.start[d] - boxed.start[d]);
    for part in parts(support.shape, [READ; D]) {
        let start = std::array::from_fn(|d| from[d] + part.start[d]);
        let part = Part { start, shape: part.shape }.widened(1, boxed.frame.shape);
        let region = read_region(problem, boxed, &part)?;
        let frame = Frame { shape: part.shape, ends: [[End::Zero; 2]; D] };
        let edge = edge_samples(&region, &frame);
        if edge.is_empty() {
            continue;
        }
        let background = read_background(problem, boxed, &part)?;
        let patch = read_patch(problem, boxed, &part)?;
        count += edge.len();
        for c in 0..C {
            let (s, t) = (mean_at(background.plane(c), &edge), mean_at(patch.plane(c), &edge));
            sums[c] += edge.len() as f64 * f64::from(of_background * s + of_patch * t);
        }
    }
    Ok(sums.into_iter().map(|s| (s / count.max(1) as f64) as f32).collect())
}
