//! The first guess and its residual: what the problem's signals turn into for the solver.
//!
//! The unknown is the change of the background in spline coefficients, `e = c - c_S`. The first
//! guess pastes: `e_0 = guide * d`. For guidance that is linear in the signals `v - grad c_S` is
//! itself the gradient of a spline `d`, so the residual vanishes wherever the region is deep.

use inr_core::Jet;
use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::Result;
use crate::axis::End;
use crate::inputs::Inputs;
use crate::operator::{REACH, Scratch, SplineOperator, Weighted, cell_points, gather4, scatter4};
use crate::plan::Plan;
use crate::problem::{Problem, copy_box};
use crate::tile::{Beyond, Frame, Tile};

/// Samples around the region whose coefficients the residual can see.
const SKIRT: usize = 5;

/// First guess and residual on a box around the region; both vanish outside it.
pub struct Initial<const D: usize> {
    /// First background sample of the box.
    pub start: [usize; D],
    pub frame: Frame<D>,
    /// The change `e_0`, one plane per channel.
    pub change: Vec<Vec<f32>>,
    /// `b - A e_0`, one plane per channel.
    pub residual: Vec<Vec<f32>>,
}

impl<const D: usize> Initial<D> {
    pub fn new<const C: usize>(problem: &Problem<'_, D, C>, plan: &Plan<D>) -> Result<Self> {
        Self::centred(problem, plan, None)
    }

    /// With given means of the jump at the edge in place of its own: those of a larger problem.
    pub fn centred<const C: usize>(
        problem: &Problem<'_, D, C>,
        plan: &Plan<D>,
        means: Option<[f32; C]>,
    ) -> Result<Self> {
        let (start, frame) = skirted(problem, plan);
        let inputs = Inputs::new(problem, start, frame)?;
        let here = |values: &[f32]| -> Vec<f32> {
            let lo = std::array::from_fn(|d| start[d] as isize - plan.start[d] as isize);
            copy_box(values, plan.frame.shape, lo, frame.shape, |_, _| None)
        };
        let weights = Weights { guide: here(plan.guide()), region: here(&plan.region) };
        let operator = SplineOperator {
            frame,
            alpha: plan.alpha,
            screening: here(&plan.screening()),
            gamma: if plan.gamma.is_empty() { Vec::new() } else { here(&plan.gamma) },
        };
        let pasted = inputs.target.as_ref().unwrap_or(&inputs.difference);
        let edge = edge_samples(&weights.region, &frame);
        let mut change: Vec<Vec<f32>> = pasted
            .iter()
            .enumerate()
            .map(|(c, d)| {
                // Only the gradient matters inside, so the jump at the edge may be centred.
                let mean = match means {
                    Some(means) => means[c],
                    None if plan.keep == 0.0 => mean_at(d, &edge),
                    None => 0.0,
                };
                d.par_iter().zip(&weights.guide).map(|(d, g)| g * (d - mean)).collect()
            })
            .collect();
        if !plan.free.is_empty() {
            let free: Vec<f32> = plan.free.iter().map(|f| f32::from(*f)).collect();
            let free = here(&free);
            change.iter_mut().for_each(|e| e.iter_mut().zip(&free).for_each(|(e, f)| *e *= f));
        }
        let assembly = Assembly {
            problem,
            plan,
            start,
            frame,
            inputs: &inputs,
            weights: &weights,
            operator: &operator,
        };
        let residual = assembly.residual(&change);
        Ok(Self { start, frame, change, residual })
    }
}

/// The region's box with a skirt, cut at the signal's border.
pub(crate) fn skirted<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
) -> ([usize; D], Frame<D>) {
    let shape = problem.background.domain().shape();
    let lo: [usize; D] = std::array::from_fn(|d| plan.support.start[d].saturating_sub(SKIRT));
    let hi: [usize; D] = std::array::from_fn(|d| {
        (plan.support.start[d] + plan.support.shape[d] + SKIRT).min(shape[d])
    });
    let ends = std::array::from_fn(|d| {
        [lo[d] > 0, hi[d] < shape[d]].map(|cut| if cut { End::Zero } else { End::Mirror })
    });
    (lo, Frame { shape: std::array::from_fn(|d| hi[d] - lo[d]), ends })
}

/// The region's samples that have an axis neighbour outside, once per such neighbour.
pub(crate) fn edge_samples<const D: usize>(region: &[f32], frame: &Frame<D>) -> Vec<usize> {
    let n0 = frame.shape[0];
    let mut strides = [1; D];
    for d in 1..D {
        strides[d] = strides[d - 1] * frame.shape[d - 1];
    }
    // Neighbours that wrap round a row's end are compared as well: at a cut side both are outside.
    let edges_of = |row: usize| -> Vec<usize> {
        let mut edges = Vec::new();
        let line = &region[row * n0..][..n0];
        for stride in strides {
            // Almost all rows have no edge.
            let same = |other: &[f32]| {
                line.iter().zip(other).map(|(a, b)| u32::from(a != b)).sum::<u32>() == 0
            };
            if (row * n0).checked_sub(stride).is_some_and(|at| same(&region[at..][..n0])) {
                continue;
            }
            for k in (row * n0).max(stride)..(row + 1) * n0 {
                if (region[k] > 0.0) != (region[k - stride] > 0.0) {
                    edges.push(if region[k] > 0.0 { k } else { k - stride });
                }
            }
        }
        edges
    };
    (0..region.len() / n0).into_par_iter().flat_map_iter(edges_of).collect()
}

/// Mean of some of the values; 0 of none.
pub(crate) fn mean_at(values: &[f32], samples: &[usize]) -> f32 {
    let sum: f64 = samples.iter().map(|k| f64::from(values[*k])).sum();
    (sum / samples.len().max(1) as f64) as f32
}

struct Weights {
    guide: Vec<f32>,
    region: Vec<f32>,
}

struct Assembly<'a, const D: usize, const C: usize> {
    problem: &'a Problem<'a, D, C>,
    plan: &'a Plan<D>,
    start: [usize; D],
    frame: Frame<D>,
    inputs: &'a Inputs<'a, D, C>,
    weights: &'a Weights,
    operator: &'a SplineOperator<D>,
}

/// Buffers of one thread.
#[derive(Default)]
struct Buffers {
    scratch: Scratch,
    guide: Vec<f32>,
    region: Vec<f32>,
    planes: Vec<Vec<f32>>,
    sums: Vec<Vec<f32>>,
}

impl<const D: usize, const C: usize> Assembly<'_, D, C> {
    /// `b - A e`, one plane per channel.
    fn residual(&self, change: &[Vec<f32>]) -> Vec<Vec<f32>> {
        let slab_len = self.frame.slab_len();
        let mut planes = vec![vec![0.0f32; self.frame.len()]; C];
        let mut slabs: Vec<Vec<&mut [f32]>> = Vec::new();
        for plane in &mut planes {
            for (slab, piece) in plane.chunks_mut(slab_len).enumerate() {
                slabs.resize_with(slabs.len().max(slab + 1), Vec::new);
                slabs[slab].push(piece);
            }
        }
        slabs.into_par_iter().enumerate().for_each_init(
            Buffers::default,
            |buffers, (slab, mut out)| {
                for (tile, at) in self.frame.small_tiles(slab, REACH) {
                    if self.load_weights(&tile, buffers) {
                        self.residual_tile(&tile, change, buffers, &mut out, at);
                    }
                }
            },
        );
        planes
    }

    /// All channels of the residual on one tile, which begins at `at` in the slab.
    fn residual_tile(
        &self,
        tile: &Tile<D>,
        change: &[Vec<f32>],
        buffers: &mut Buffers,
        out: &mut [&mut [f32]],
        at: usize,
    ) {
        buffers.sums.resize_with(C, Vec::new);
        for sum in &mut buffers.sums {
            sum.clear();
            sum.resize(tile.len(), 0.0);
        }
        if self.inputs.linear {
            (0..C).for_each(|c| self.add_linear_guidance(tile, c, buffers));
        } else {
            self.add_guidance(tile, buffers);
        }
        for c in 0..C {
            self.finish_tile(tile, c, &change[c], buffers, &mut out[c][at..]);
        }
    }

    /// Loads the weights of a tile; returns whether it can have a residual at all.
    fn load_weights(&self, tile: &Tile<D>, buffers: &mut Buffers) -> bool {
        let needed = match (tile.uniform(&self.weights.guide), tile.uniform(&self.weights.region)) {
            (Some(0.0), Some(0.0)) => false,
            (Some(1.0), Some(1.0))
                if self.inputs.linear
                    && self.plan.gamma.is_empty()
                    && self.plan.free.is_empty() =>
            {
                // Deep inside the first guess is exact, unless another field's colours are kept.
                self.plan.keep > 0.0 && self.inputs.target.is_some()
            }
            _ => true,
        };
        if needed {
            tile.load(&self.weights.guide, Beyond::Edge, &mut buffers.guide);
            tile.load(&self.weights.region, Beyond::Edge, &mut buffers.region);
        }
        needed
    }

    /// Adds the colour term to the guidance in `sums[c]`, takes `A e` off, and stores it.
    fn finish_tile(
        &self,
        tile: &Tile<D>,
        c: usize,
        change: &[f32],
        buffers: &mut Buffers,
        out: &mut [f32],
    ) {
        let Buffers { scratch, region, sums, planes, .. } = buffers;
        if planes.is_empty() {
            planes.push(Vec::new());
        }
        if self.plan.keep > 0.0 {
            tile.load(&self.inputs.difference[c], Beyond::Zero, &mut planes[0]);
            weighted(tile, None, self.plan.keep, &planes[0], region, scratch, &mut sums[c]);
        }
        tile.load(change, Beyond::Zero, &mut planes[0]);
        self.operator.apply_tile(tile, &planes[0], scratch);
        for (s, a) in sums[c].iter_mut().zip(&scratch.output) {
            *s -= a;
        }
        tile.store(&sums[c], out);
    }

    /// `sum_d alpha_d B_d^T guide B_d target` of one channel, into `sums[c]`.
    fn add_linear_guidance(&self, tile: &Tile<D>, c: usize, buffers: &mut Buffers) {
        let target = self.inputs.target.as_ref().unwrap_or(&self.inputs.difference);
        let Buffers { scratch, guide, sums, planes, .. } = buffers;
        if planes.is_empty() {
            planes.push(Vec::new());
        }
        tile.load(&target[c], Beyond::Zero, &mut planes[0]);
        for d in 0..D {
            weighted(tile, Some(d), self.plan.alpha[d], &planes[0], guide, scratch, &mut sums[c]);
        }
    }

    /// `sum_d B_d^T guide (v_d - grad_d c_S)` with the guidance evaluated point by point.
    fn add_guidance(&self, tile: &Tile<D>, buffers: &mut Buffers) {
        let n = tile.len();
        let Buffers { scratch, guide, sums, planes, .. } = buffers;
        // Planes: coefficients of S and T - S per channel, then value and slopes of both.
        let (source, jets) = (2 * C, 2 * C * (D + 1));
        planes.resize_with(source + jets, Vec::new);
        let (source, jets) = planes.split_at_mut(source);
        for c in 0..C {
            tile.load(&self.inputs.background[c], Beyond::Zero, &mut source[c]);
            tile.load(&self.inputs.difference[c], Beyond::Zero, &mut source[C + c]);
        }
        let values = self.problem.guidance.needs_values();
        let root_alpha = self.plan.alpha.map(f32::sqrt);
        for half in 0..1usize << D {
            for (k, coefficients) in source.iter().enumerate() {
                for slope in 0..=D {
                    let dst = &mut jets[k * (D + 1) + slope];
                    dst.resize(n, 0.0);
                    if slope < D || values {
                        let slope_axis = (slope < D).then_some(slope);
                        dispatch(AtPoint {
                            tile,
                            half,
                            slope_axis,
                            c: coefficients,
                            stack: &mut scratch.stack,
                            dst,
                        });
                    }
                }
            }
            self.evaluate_points(tile, half, guide, jets, root_alpha);
            for c in 0..C {
                for d in 0..D {
                    let src = &jets[c * (D + 1) + d];
                    dispatch(FromPoint {
                        tile,
                        half,
                        slope_axis: d,
                        src,
                        stack: &mut scratch.stack,
                        dst: &mut sums[c],
                    });
                }
            }
        }
    }

    /// Replaces the background's slopes by `2^-D guide (v - grad c_S)` for one point of every cell.
    fn evaluate_points(
        &self,
        tile: &Tile<D>,
        half: usize,
        guide: &[f32],
        jets: &mut [Vec<f32>],
        root_alpha: [f32; D],
    ) {
        let domain = self.problem.background.domain();
        let active: Vec<usize> = (0..guide.len()).filter(|k| guide[*k] > 0.0).collect();
        let position = |k: usize| -> [f32; D] {
            let mut rest = k;
            std::array::from_fn(|d| {
                let i = (self.start[d] + tile.start[d] + rest % tile.extent(d)) as f64
                    - tile.halo as f64;
                rest /= tile.extent(d);
                let quarter = if half >> d & 1 == 0 { -0.25 } else { 0.25 };
                (f64::from(domain.origin()[d]) + (i + quarter) * f64::from(domain.pitch()[d]))
                    as f32
            })
        };
        let mut elsewhere = Vec::new();
        if let Some(moved) = &self.inputs.field {
            let mut x: Vec<[f32; D]> = active.iter().map(|k| position(*k)).collect();
            elsewhere = vec![Jet::ZERO; x.len()];
            moved.jets(&mut x, &mut elsewhere);
            for jet in &mut elsewhere {
                (0..C).for_each(|c| (0..D).for_each(|d| jet.grad[c][d] *= self.plan.h_ref));
            }
        }
        for plane in jets.iter_mut() {
            for (v, g) in plane.iter_mut().zip(guide) {
                *v = if *g > 0.0 { *v } else { 0.0 };
            }
        }
        let custom = self.problem.guidance.needs_values();
        for (order, &k) in active.iter().enumerate() {
            let (mut s, mut t) = (Jet::<D, C>::ZERO, Jet::<D, C>::ZERO);
            for c in 0..C {
                let (of_s, of_d) = (c * (D + 1), (C + c) * (D + 1));
                s.value[c] = jets[of_s + D][k];
                t.value[c] = s.value[c] + jets[of_d + D][k];
                for d in 0..D {
                    s.grad[c][d] = root_alpha[d] * jets[of_s + d][k];
                    t.grad[c][d] = s.grad[c][d] + root_alpha[d] * jets[of_d + d][k];
                }
            }
            if !elsewhere.is_empty() {
                t = elsewhere[order];
            }
            let x = if custom { position(k) } else { [0.0; D] };
            let v = self.problem.guidance.evaluate(&x, &s, &t);
            let weight = guide[k] * 0.5f32.powi(D as i32);
            for c in 0..C {
                for d in 0..D {
                    jets[c * (D + 1) + d][k] = weight * root_alpha[d] * (v[c][d] - s.grad[c][d]);
                }
            }
        }
    }
}

/// `sum += scale * B^T weight B c`.
fn weighted<const D: usize>(
    tile: &Tile<D>,
    slope_axis: Option<usize>,
    scale: f32,
    c: &[f32],
    weight: &[f32],
    scratch: &mut Scratch,
    sum: &mut Vec<f32>,
) {
    scratch.weight.clear();
    scratch.weight.extend_from_slice(weight);
    std::mem::swap(&mut scratch.output, sum);
    dispatch(Weighted { tile, slope_axis, scale, c, scratch });
    std::mem::swap(&mut scratch.output, sum);
}

/// Evaluates a spline, or its slope along one axis, at one of the points of every cell.
struct AtPoint<'a, const D: usize> {
    tile: &'a Tile<D>,
    half: usize,
    slope_axis: Option<usize>,
    c: &'a [f32],
    stack: &'a mut Vec<Vec<f32>>,
    dst: &'a mut [f32],
}

impl<const D: usize> Kernel for AtPoint<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (points, strides) = (cell_points(), self.tile.strides());
        self.stack.resize_with(2 * D + 2, Vec::new);
        for d in (0..D).rev() {
            let point = &points[self.half >> d & 1];
            let taps = if self.slope_axis == Some(d) { point.slope } else { point.value };
            let (head, tail) = self.stack.split_at_mut(d + 1);
            let src = if d + 1 == D { self.c } else { &tail[0][..] };
            if d == 0 {
                gather4(self.dst, src, point.first, strides[d], taps);
            } else {
                head[d].resize(self.c.len(), 0.0);
                gather4(&mut head[d], src, point.first, strides[d], taps);
            }
        }
    }
}

/// The adjoint of [`AtPoint`] for slopes, added to `dst`.
struct FromPoint<'a, const D: usize> {
    tile: &'a Tile<D>,
    half: usize,
    slope_axis: usize,
    src: &'a [f32],
    stack: &'a mut Vec<Vec<f32>>,
    dst: &'a mut [f32],
}

impl<const D: usize> Kernel for FromPoint<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (points, strides) = (cell_points(), self.tile.strides());
        self.stack.resize_with(2 * D + 2, Vec::new);
        for d in 0..D {
            let point = &points[self.half >> d & 1];
            let taps = if self.slope_axis == d { point.slope } else { point.value };
            let (head, tail) = self.stack.split_at_mut(d);
            let src = if d == 0 { self.src } else { &head[d - 1][..] };
            if d + 1 == D {
                scatter4(self.dst, src, point.first, strides[d], taps, true);
            } else {
                tail[0].resize(self.src.len(), 0.0);
                scatter4(&mut tail[0], src, point.first, strides[d], taps, false);
            }
        }
    }
}
