//! Blends that do not fit into memory.
//!
//! The unknown is the change of the background after the first guess, in spline coefficients, and it
//! lives in a file. A sweep begins with a coarse correction for the whole region: the residual of all
//! equations, restricted to splines with knots at every 4th sample or fewer, is solved for in memory.
//! Then overlapping blocks are solved one after the other, each exactly, with what surrounds it as
//! it is: that removes what the coarse splines cannot hold, and never raises the objective. Where
//! nothing is left to do a block is passed over.

mod coarse;
mod local;
mod state;
mod storage;
mod survey;
mod transfer;

use std::path::Path;

pub use storage::{BlockSink, BlockSource, PlaneFile};

use crate::axis::End;
use crate::engine::Engine;
use crate::exact::add_nodal;
use crate::plan::Plan;
use crate::problem::put_box;
use crate::tile::Frame;
use crate::{Error, Guidance, Options, Result};
use coarse::Correction;
use local::{HALO, Local, Part, read_background};
use state::State;
use transfer::Coarse;

/// Samples by which a block reaches over its neighbours. Errors of the wavelengths that the coarse
/// correction leaves fade within a few of its steps.
const OVERLAP: usize = 48;
/// Iterations of a block stop when its residual has fallen by this: a sweep does not gain more.
const BLOCK_TOLERANCE: f32 = 1e-3;
/// The same of the coarse correction.
const COARSE_TOLERANCE: f32 = 1e-4;

/// A blend whose signals are read block by block. Lattices have unit pitch; lengths are in samples.
#[derive(Clone)]
pub struct BlockProblem<'a, const D: usize, const C: usize> {
    /// The signal that stays outside the region, `C` planes.
    pub background: &'a dyn BlockSource<D>,
    /// The signal that gives its gradients, `C` planes.
    pub patch: &'a dyn BlockSource<D>,
    /// The region's weights in `[0, 1]`, one plane on the patch's lattice.
    pub mask: &'a dyn BlockSource<D>,
    /// Background sample of the patch's first sample. What lies outside the background is cut off.
    pub offset: [isize; D],
    /// The gradient to follow inside.
    pub guidance: Guidance<D, C>,
    /// Functional and lengths: a screened objective without ramp, band and feather. `tolerance` decides,
    /// as in memory, how far around the region the change is followed.
    pub options: Options,
}

/// How a blend in blocks is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockOptions {
    /// Most memory to take, in bytes, beside what the sources and the sink hold themselves.
    pub max_memory: u64,
    /// Sweeps end when none changes a value by more than this, in units of the signal.
    pub tolerance: f32,
    /// Give up after this many sweeps.
    pub max_sweeps: usize,
    /// Give the result to the sink in whole rows from the first to the last (slabs across the last axis), all
    /// channels of a slab before the next one: for files that are written from top to bottom.
    pub whole_rows: bool,
    /// A number that tells this problem from others of its shape: a stopped run is taken up only where it agrees.
    pub fingerprint: u64,
}

impl Default for BlockOptions {
    /// 4 GiB; 1e-5, which is 1/400 of a step of 8 bits; 40 sweeps; the result block by block.
    fn default() -> Self {
        let (whole_rows, fingerprint) = (false, 0);
        Self { max_memory: 4 << 30, tolerance: 1e-5, max_sweeps: 40, whole_rows, fingerprint }
    }
}

impl BlockOptions {
    /// The least [`BlockOptions::max_memory`] for a background of this shape with so many channels, wherever the
    /// region lies.
    pub fn least_memory<const D: usize>(&self, shape: [usize; D], channels: usize) -> u64 {
        survey::least_memory(channels, shape, self.whole_rows)
    }
}

/// What a blend in blocks is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockStage {
    /// The residual for the coarse correction, block by block.
    Correction,
    /// One block after the other.
    Blocks,
    /// The result goes to the sink.
    Result,
}

/// Where a blend in blocks is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockProgress {
    /// What is being done.
    pub stage: BlockStage,
    /// Sweeps done before this one.
    pub sweep: usize,
    /// Blocks of this stage that are done.
    pub block: usize,
    /// All blocks of it.
    pub blocks: usize,
    /// Largest change of a value in the last finished sweep; infinite in the first one.
    pub change: f32,
}

/// What a blend in blocks did.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockReport {
    /// Sweeps done.
    pub sweeps: usize,
    /// Largest change of a value in the last one.
    pub change: f32,
    /// Blocks of a sweep.
    pub blocks: usize,
    /// Fine samples per coarse one; 0 where one block was enough.
    pub coarse_step: usize,
    /// First background sample of the solved box.
    pub box_start: Vec<usize>,
    /// Samples of the solved box per axis.
    pub box_shape: Vec<usize>,
    /// The coupling length in use, in samples.
    pub length: f32,
    /// Sum of the region's weights: its size in samples.
    pub region_samples: f64,
}

/// The part of the background that is solved for, and what its parts share.
pub(crate) struct Boxed<const D: usize> {
    start: [usize; D],
    frame: Frame<D>,
    length: f32,
    keep: Option<f32>,
    /// Sum of the region's weights.
    measure: f64,
    /// Mean of patch minus background at the region's edge, per channel.
    means: Vec<f32>,
    /// Side of the blocks, without overlap.
    side: usize,
    /// Rows of the slabs that the result is written in; 0 where it is written in blocks.
    slab: usize,
    /// Coarse lattice; `None` where the box is one block.
    coarse: Option<Coarse<D>>,
}

pub(crate) fn storage_error(what: &'static str, error: &std::io::Error) -> Error {
    Error::Storage { what, reason: error.to_string() }
}

/// Blends signals that need not fit into memory; the result goes to `sink`, all samples of all planes.
///
/// The same blend as that of [`solve`](crate::solve) to a few times the options' tolerance, if the coupling
/// length is given; the default length is measured on a mask of reduced resolution, to about 1 %.
/// `state` is a file of 4 bytes per channel and sample of the region and its surroundings. It is made
/// anew, or, if it is there from a run of the same problem that was stopped, taken up; at the end it is
/// removed. `progress` is called after every block, and stops the run by returning `false`.
///
/// The result has the same bits for any number of threads, but not for any `max_memory`.
///
/// # Errors
/// [`Error::Storage`] from sources, sink and state file, [`Error::Memory`], [`Error::Stopped`],
/// [`Error::NotConverged`] and every way in which the problem can be wrong.
pub fn solve_in_blocks<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    options: &BlockOptions,
    state: &Path,
    sink: &mut dyn BlockSink<D>,
    progress: &mut dyn FnMut(&BlockProgress) -> bool,
) -> Result<BlockReport> {
    let boxed = survey::survey(problem, options)?;
    let blocks = boxed.blocks();
    let mut file = State::open::<C>(state, &boxed, options.fingerprint)?;
    while file.last > options.tolerance {
        let (sweep, change) = (file.sweep, file.last);
        if sweep >= options.max_sweeps {
            let residual = f64::from(change);
            return Err(Error::NotConverged { iterations: sweep, residual });
        }
        let mut tell = |stage, block| {
            let at = BlockProgress { stage, sweep, block, blocks: blocks.len(), change };
            if progress(&at) { Ok(()) } else { Err(Error::Stopped) }
        };
        let mut largest = file.change;
        if file.block == 0
            && let Some(coarse) = &boxed.coarse
        {
            let mut tell = |block| tell(BlockStage::Correction, block);
            let correction = Correction::solve(problem, &boxed, coarse, &blocks, &file, &mut tell)?;
            largest = correction.add(&boxed, &blocks, &mut file)?;
        }
        for block in file.block..blocks.len() {
            largest = largest.max(relax(problem, &boxed, &blocks[block], &mut file)?);
            file.keep(block + 1, largest)?;
            tell(BlockStage::Blocks, block + 1)?;
        }
        file.end_sweep(if boxed.coarse.is_none() { 0.0 } else { largest })?;
    }
    let (sweeps, change) = (file.sweep, file.last);
    write(problem, &boxed, &file, sink, &mut |block, blocks| {
        let stage = BlockStage::Result;
        let at = BlockProgress { stage, sweep: sweeps, block, blocks, change };
        if progress(&at) { Ok(()) } else { Err(Error::Stopped) }
    })?;
    drop(file);
    std::fs::remove_file(state).map_err(|e| storage_error("the state file", &e))?;
    Ok(BlockReport {
        sweeps,
        change,
        blocks: blocks.len(),
        coarse_step: boxed.coarse.map_or(0, |c| c.step),
        box_start: boxed.start.to_vec(),
        box_shape: boxed.frame.shape.to_vec(),
        length: boxed.length,
        region_samples: boxed.measure,
    })
}

impl<const D: usize> Boxed<D> {
    /// A box of background samples, for reading them.
    fn bare(start: [usize; D], shape: [usize; D]) -> Self {
        let frame = Frame { shape, ends: [[End::Mirror; 2]; D] };
        let (length, keep, measure) = (1.0, None, 0.0);
        Self {
            start,
            frame,
            length,
            keep,
            measure,
            means: Vec::new(),
            side: 0,
            slab: 0,
            coarse: None,
        }
    }

    /// The blocks, without overlap, axis 0 fastest.
    fn blocks(&self) -> Vec<Part<D>> {
        parts(self.frame.shape, [self.side; D])
    }

    /// The plan of a part whose weights are cut out of a wider one.
    fn plan_of(&self, part: &Part<D>, wider: &Local<D>) -> Plan<D> {
        let region = part.cut(&wider.plan.region, &wider.part);
        Plan::of_block(part.frame(&self.frame), region, self.length, self.keep)
    }
}

/// Cuts a box into equal parts of at most `sides` samples, axis 0 fastest.
fn parts<const D: usize>(shape: [usize; D], sides: [usize; D]) -> Vec<Part<D>> {
    let counts: [usize; D] = std::array::from_fn(|d| shape[d].div_ceil(sides[d]));
    let part = |mut k: usize| {
        let (mut start, mut end) = ([0; D], [0; D]);
        for d in 0..D {
            let i = k % counts[d];
            k /= counts[d];
            (start[d], end[d]) = (i * shape[d] / counts[d], (i + 1) * shape[d] / counts[d]);
        }
        Part { start, shape: std::array::from_fn(|d| end[d] - start[d]) }
    };
    (0..counts.iter().product()).map(part).collect()
}

/// Solves one block with what surrounds it as it is; returns the largest change.
fn relax<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    core: &Part<D>,
    file: &mut State<D>,
) -> Result<f32> {
    let whole = boxed.frame.shape;
    let block = core.widened(OVERLAP, whole);
    let wide = block.widened(HALO, whole);
    let local = Local::load(problem, boxed, wide)?;
    let operator = local.operator();
    let plan = boxed.plan_of(&block, &local);
    let engine = Engine::new(&plan);
    let single = boxed.coarse.is_none();
    let tolerance = if single { problem.options.tolerance } else { BLOCK_TOLERANCE };
    let options = Options { tolerance, ..problem.options };
    let mut largest = 0.0f32;
    for c in 0..C {
        let r = local.residual(&operator, c, &file.read(c, &wide)?);
        let (x, convergence) = engine.solve(block.cut(&r, &wide), &options, &mut |_, _| {});
        if !convergence.converged {
            let (iterations, residual) = (convergence.iterations, convergence.residual);
            return Err(Error::NotConverged { iterations, residual });
        }
        if convergence.iterations > 0 {
            largest = x.iter().fold(largest, |a, v| a.max(v.abs()));
            file.add(c, &block, &x)?;
        }
    }
    Ok(largest)
}

/// Writes the blend: what the change makes of the background in the box, and the background elsewhere.
fn write<const D: usize, const C: usize>(
    problem: &BlockProblem<'_, D, C>,
    boxed: &Boxed<D>,
    file: &State<D>,
    sink: &mut dyn BlockSink<D>,
    done: &mut dyn FnMut(usize, usize) -> Result<()>,
) -> Result<()> {
    let shape = problem.background.shape();
    let whole = Boxed::bare([0; D], shape);
    let parts = match boxed.slab {
        0 => parts(shape, [boxed.side; D]),
        slab => parts(shape, std::array::from_fn(|d| if d + 1 < D { shape[d] } else { slab })),
    };
    for (k, part) in parts.iter().enumerate() {
        let mut samples = read_background(problem, &whole, part)?;
        // Where the part meets the box, in the box's samples.
        let lo: [usize; D] = std::array::from_fn(|d| part.start[d].max(boxed.start[d]));
        let hi: [usize; D] = std::array::from_fn(|d| {
            (part.start[d] + part.shape[d]).min(boxed.start[d] + boxed.frame.shape[d])
        });
        if (0..D).all(|d| lo[d] < hi[d]) {
            let core = Part {
                start: std::array::from_fn(|d| lo[d] - boxed.start[d]),
                shape: std::array::from_fn(|d| hi[d] - lo[d]),
            };
            let wide = core.widened(HALO, boxed.frame.shape);
            let local = Local::load(problem, boxed, wide)?;
            let place = std::array::from_fn(|d| lo[d] - part.start[d]);
            for c in 0..C {
                let change = local.total(c, file.read(c, &wide)?);
                let mut nodal = vec![0.0; wide.len()];
                add_nodal(&local.plan, &change, &mut nodal, wide.shape);
                let nodal = core.cut(&nodal, &wide);
                let plane = samples.plane_mut(c);
                put_box(&nodal, core.shape, place, part.shape, plane, |v, e| *v += e);
            }
        }
        for c in 0..C {
            let written = sink.write(c, part.start, part.shape, samples.plane(c));
            written.map_err(|e| storage_error("the result", &e))?;
        }
        done(k + 1, parts.len())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
