//! One block of the problem in memory: its signals, and the residual of its equations.

use std::io;

use inr_core::{BoxRegion, Domain, Samples, mirror};

use super::storage::BlockSource;
use super::{BlockProblem, Boxed, storage_error};
use crate::Result;
use crate::assembly::Initial;
use crate::axis::End;
use crate::operator::SplineOperator;
use crate::plan::Plan;
use crate::problem::{Patch, Problem, copy_box, put_box};
use crate::tile::Frame;

/// Samples around a block after which its signals are not felt: the reach of the prefilter, of the
/// operator, and of the guidance.
pub const HALO: usize = 24;

/// A box of samples within the solved box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part<const D: usize> {
    pub start: [usize; D],
    pub shape: [usize; D],
}

impl<const D: usize> Part<D> {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Widened on all sides, within a box of `whole` samples.
    pub fn widened(&self, by: usize, whole: [usize; D]) -> Self {
        let start = self.start.map(|v| v.saturating_sub(by));
        let end = |d: usize| (self.start[d] + self.shape[d] + by).min(whole[d]);
        Self { start, shape: std::array::from_fn(|d| end(d) - start[d]) }
    }

    /// Where this part begins in a wider one.
    pub fn within(&self, wider: &Self) -> [usize; D] {
        std::array::from_fn(|d| self.start[d] - wider.start[d])
    }

    /// The frame of a part of a framed box: cut sides are zero.
    pub fn frame(&self, whole: &Frame<D>) -> Frame<D> {
        let ends = std::array::from_fn(|d| {
            let lower = if self.start[d] > 0 { End::Zero } else { whole.ends[d][0] };
            let cut = self.start[d] + self.shape[d] < whole.shape[d];
            [lower, if cut { End::Zero } else { whole.ends[d][1] }]
        });
        Frame { shape: self.shape, ends }
    }

    /// This part of an array over a wider one.
    pub fn cut(&self, values: &[f32], wider: &Self) -> Vec<f32> {
        let lo = self.within(wider).map(|v| v as isize);
        copy_box(values, wider.shape, lo, self.shape, |_, _| None)
    }
}

/// The weights of a part, and what of the patch is pasted there.
pub struct Local<const D: usize> {
    pub part: Part<D>,
    pub plan: Plan<D>,
    /// First guess and residual; `None` away from the region.
    initial: Option<Initial<D>>,
}

/// Reads the background on a part of the solved box.
pub fn read_background<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    part: &Part<D>,
) -> Result<Samples<D, C>> {
    let start = std::array::from_fn(|d| boxed.start[d] + part.start[d]);
    let mut samples = Samples::zeros(Domain::unit(part.shape)?);
    for c in 0..C {
        let read = problem.background.read(c, start, part.shape, samples.plane_mut(c));
        read.map_err(|e| storage_error("the background", &e))?;
    }
    Ok(samples)
}

/// Reads a box of the patch's lattice, given in the background's samples; `outside` as in [`copy_box`].
pub fn read_moved<const D: usize>(
    source: &dyn BlockSource<D>,
    channel: usize,
    offset: [isize; D],
    start: [usize; D],
    shape: [usize; D],
    mirrored: bool,
) -> io::Result<Vec<f32>> {
    let whole = source.shape();
    let lo: [isize; D] = std::array::from_fn(|d| start[d] as isize - offset[d]);
    // What lies beyond a border mirrors what is as deep inside.
    let from: [usize; D] = std::array::from_fn(|d| {
        let n = whole[d] as isize;
        let past = if mirrored { (lo[d] + shape[d] as isize - n + 1).max(0) } else { 0 };
        lo[d].min(n - 1 - past).clamp(0, n - 1) as usize
    });
    let to: [usize; D] = std::array::from_fn(|d| {
        let before = if mirrored { (-lo[d] + 1).max(0) } else { 0 };
        let end = (lo[d] + shape[d] as isize).max(before);
        (end.max(from[d] as isize + 1) as usize).min(whole[d])
    });
    let read: [usize; D] = std::array::from_fn(|d| to[d] - from[d]);
    let mut values = vec![0.0; read.iter().product()];
    source.read(channel, from, read, &mut values)?;
    let relative = std::array::from_fn(|d| lo[d] - from[d] as isize);
    Ok(copy_box(&values, read, relative, shape, |i, d| {
        let at = mirror(i + from[d] as isize, whole[d]).checked_sub(from[d])?;
        (mirrored && at < read[d]).then_some(at)
    }))
}

/// Reads the region's weights on a part.
pub fn read_region<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    part: &Part<D>,
) -> Result<Vec<f32>> {
    let start = std::array::from_fn(|d| boxed.start[d] + part.start[d]);
    let read = read_moved(problem.mask, 0, problem.offset, start, part.shape, false);
    let weights = read.map_err(|e| storage_error("the mask", &e))?;
    match weights.iter().find(|w| !(0.0..=1.0).contains(*w)) {
        None => Ok(weights),
        Some(value) => Err(crate::Error::Parameter {
            name: "a region weight",
            rule: "between 0 and 1",
            value: f64::from(*value),
        }),
    }
}

/// Reads the patch on a part, mirrored beyond its own border.
pub fn read_patch<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    part: &Part<D>,
) -> Result<Samples<D, C>> {
    let start = std::array::from_fn(|d| boxed.start[d] + part.start[d]);
    let mut data = Vec::with_capacity(C * part.len());
    for c in 0..C {
        let read = read_moved(problem.patch, c, problem.offset, start, part.shape, true);
        data.extend(read.map_err(|e| storage_error("the patch", &e))?);
    }
    Ok(Samples::from_planar(Domain::unit(part.shape)?, data)?)
}

impl<const D: usize> Local<D> {
    /// Loads a part; it should be wider by [`HALO`] than what is made of it.
    pub fn load<const C: usize>(
        problem: &BlockProblem<'_, D, C>,
        boxed: &Boxed<D>,
        part: Part<D>,
    ) -> Result<Self> {
        let region = read_region(problem, boxed, &part)?;
        let empty = region.iter().all(|m| *m == 0.0);
        let plan = Plan::of_block(part.frame(&boxed.frame), region, boxed.length, boxed.keep);
        if empty {
            return Ok(Self { part, plan, initial: None });
        }
        let background = read_background(problem, boxed, &part)?;
        let patch = read_patch(problem, boxed, &part)?;
        // The weights are in the plan; the problem's own region is not asked.
        let region = BoxRegion::new([0.0; D], [1.0; D])?;
        let here = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [0.0; D] },
            region: &region,
            guidance: problem.guidance.clone(),
            options: problem.options,
        };
        let means = std::array::from_fn::<f32, C, _>(|c| boxed.means[c]);
        let initial = Initial::centred(&here, &plan, Some(means))?;
        Ok(Self { part, plan, initial: Some(initial) })
    }

    /// The operator on the part.
    pub fn operator(&self) -> SplineOperator<D> {
        SplineOperator {
            frame: self.plan.frame,
            alpha: self.plan.alpha,
            screening: self.plan.screening(),
            gamma: Vec::new(),
        }
    }

    /// `b - A (e_0 + f)` of one channel on the part, right [`HALO`] samples from its cut sides; `f` is the
    /// change after the first guess.
    pub fn residual(&self, operator: &SplineOperator<D>, channel: usize, f: &[f32]) -> Vec<f32> {
        let mut r = vec![0.0; f.len()];
        if f.iter().any(|v| *v != 0.0) {
            operator.apply(f, &mut r);
            r.iter_mut().for_each(|r| *r = -*r);
        }
        if let Some(Initial { start, frame, residual, .. }) = &self.initial {
            put_box(&residual[channel], frame.shape, *start, self.part.shape, &mut r, |r, v| {
                *r += v
            });
        }
        r
    }

    /// `e_0 + f` of one channel.
    pub fn total(&self, channel: usize, mut f: Vec<f32>) -> Vec<f32> {
        if let Some(Initial { start, frame, change, .. }) = &self.initial {
            put_box(&change[channel], frame.shape, *start, self.part.shape, &mut f, |f, e| *f += e);
        }
        f
    }
}
