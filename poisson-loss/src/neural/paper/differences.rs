//! The paper's loss on differences of neighbours, with its derivatives: plain loops in f64.

use inr_core::{Domain, Jet, Samples};
use rayon::prelude::*;

use super::super::first_sample;
use super::{ColorTerm, PaperLoss, PaperOptions, PaperWeights, Stencil};
use crate::inputs::{check, sample_patch};
use crate::problem::copy_box;
use crate::{Error, Problem, Result};

/// Forward, backward, centred.
const STENCILS: usize = 3;
/// Samples of one partial sum; fixed, so that sums do not depend on the threads.
const CHUNK: usize = 1 << 12;
/// No gradient is followed at a sample.
const NONE: u32 = u32::MAX;

/// A sample of the region.
struct Cell<const D: usize, const C: usize> {
    /// Its weight in the region, 0..1.
    weight: f32,
    /// The differences to follow, per stencil, axis and channel.
    wanted: [[[f32; C]; D]; STENCILS],
}

/// The loss on a part of the lattice.
pub struct Differences<const D: usize, const C: usize> {
    on: Domain<D>,
    strides: [usize; D],
    /// `h_ref / h_d`: differences become changes per reference pitch.
    scale: [f64; D],
    stencils: [bool; STENCILS],
    cells: Vec<Cell<D, C>>,
    /// Cell of a sample.
    slot: Vec<u32>,
    /// Weight of the colour term at a sample, 0..1.
    outside: Vec<f32>,
    background: Vec<[f32; C]>,
    /// `500 / (N C)` over the number of stencils; `1000 / (N C)`; the colour term's weight in the total.
    factors: [f64; 3],
}

impl<const D: usize, const C: usize> Differences<D, C> {
    pub fn new(
        problem: &Problem<'_, D, C>,
        on: &Domain<D>,
        options: &PaperOptions,
    ) -> Result<Self> {
        let (whole, shape) = (problem.background.domain(), on.shape());
        let (start, support) = (first_sample(whole, on), problem.support()?);
        let holds = |d: usize| {
            start[d] <= support.start[d]
                && support.start[d] + support.shape[d] <= start[d] + shape[d]
                && start[d] + shape[d] <= whole.shape()[d]
        };
        assert!((0..D).all(holds), "{on:?} is no part of {whole:?} that holds the region");
        let region = support.weights_on(start, shape);
        let background = cropped(problem.background, on);
        let planes: Vec<Vec<f32>> =
            (0..C).map(|c| background.iter().map(|v| v[c]).collect()).collect();
        check("background", &planes, shape, start)?;
        let (patch, _) = sample_patch(problem, start, shape)?;
        let patch: Vec<[f32; C]> =
            (0..on.len()).map(|k| std::array::from_fn(|c| patch[c][k])).collect();

        let mut outside: Vec<f32> = region.iter().map(|m| 1.0 - m).collect();
        if options.color == ColorTerm::Boundary {
            let near = neighbours(&region, on, 1, f32::max);
            outside.iter_mut().zip(near).filter(|(_, m)| *m == 0.0).for_each(|(w, _)| *w = 0.0);
        }
        let sum = |w: &[f32]| w.iter().map(|w| f64::from(*w)).sum::<f64>();
        let (inside, measure) = (sum(&region), sum(&outside));
        if measure == 0.0 {
            return Err(Error::NoAnchor);
        }
        let h_ref = on.reference_pitch();
        let stencils = match options.stencil {
            Stencil::Forward => [true, false, false],
            Stencil::Backward => [false, true, false],
            Stencil::Centred => [false, false, true],
            Stencil::All => [true; 3],
        };
        let per_value = 1.0 / (on.len() * C) as f64;
        let used = stencils.iter().filter(|s| **s).count() as f64;
        let color_weight = match options.weights {
            PaperWeights::Released => 0.2,
            // 500 |Omega| / (N C) lambda / |S - Omega|, in units of 1000 / (N C).
            PaperWeights::Lambda(lambda) => 0.5 * f64::from(lambda) * inside / measure,
        };
        let mut this = Self {
            on: *on,
            strides: on.strides(),
            scale: on.pitch().map(|h| f64::from(h_ref / h)),
            stencils,
            cells: Vec::new(),
            slot: vec![NONE; on.len()],
            outside,
            background,
            factors: [500.0 * per_value / used, 1000.0 * per_value, color_weight],
        };
        let eroded = neighbours(&region, on, options.erode, f32::min);
        for k in (0..on.len()).filter(|k| region[*k] > 0.0) {
            this.slot[k] = this.cells.len() as u32;
            let wanted = this.guidance(problem, &patch, k, eroded[k]);
            this.cells.push(Cell { weight: region[k], wanted });
        }
        Ok(this)
    }

    /// The same loss on a smaller part, which counts as a part of this one and not as a picture of its own: equal up to
    /// what the colours beyond it add, if the region keeps two samples' distance from its edges.
    pub fn on_part(
        &self,
        problem: &Problem<'_, D, C>,
        part: &Domain<D>,
        options: &PaperOptions,
    ) -> Result<Self> {
        Ok(Self { factors: self.factors, ..Self::new(problem, part, options)? })
    }

    /// The background on this part.
    pub fn background(&self) -> Samples<D, C> {
        Samples::from_interleaved(self.on, self.background.as_flattened()).expect("its own size")
    }

    /// `grad c_S + share (v - grad c_S)` at a sample, every stencil by itself.
    fn guidance(
        &self,
        problem: &Problem<'_, D, C>,
        patch: &[[f32; C]],
        k: usize,
        share: f32,
    ) -> [[[f32; C]; D]; STENCILS] {
        let index = self.on.unflatten(k);
        let x = self.on.position(index);
        let differences = |values: &[[f32; C]]| -> [[[f64; C]; STENCILS]; D] {
            std::array::from_fn(|d| self.differences(values, k, index[d], d))
        };
        let (s, t) = (differences(&self.background), differences(patch));
        std::array::from_fn(|stencil| {
            let jet = |value: [f32; C], of: &[[[f64; C]; STENCILS]; D]| Jet {
                value,
                grad: std::array::from_fn(|c| std::array::from_fn(|d| of[d][stencil][c] as f32)),
            };
            let (s, t) = (jet(self.background[k], &s), jet(patch[k], &t));
            let v = problem.guidance.evaluate(&x, &s, &t);
            std::array::from_fn(|d| {
                std::array::from_fn(|c| s.grad[c][d] + share * (v[c][d] - s.grad[c][d]))
            })
        })
    }

    /// The three differences at sample `k`, whose index along axis `d` is `i`; zero where they would leave the
    /// signal.
    #[inline(always)]
    fn differences<T: Copy + Into<f64>>(
        &self,
        y: &[[T; C]],
        k: usize,
        i: usize,
        d: usize,
    ) -> [[f64; C]; STENCILS] {
        let (stride, last, scale) = (self.strides[d], self.on.shape()[d] - 1, self.scale[d]);
        let link = |from: usize, to: usize| -> [f64; C] {
            std::array::from_fn(|c| scale * (y[to][c].into() - y[from][c].into()))
        };
        let none = [0.0; C];
        let forward = if i < last { link(k, k + stride) } else { none };
        let backward = if i > 0 { link(k - stride, k) } else { none };
        // One-sided at the ends: there one of the two is zero.
        let half = if i > 0 && i < last { 0.5 } else { 1.0 };
        let centred = std::array::from_fn(|c| half * (forward[c] + backward[c]));
        [forward, backward, centred]
    }

    /// Weighted errors of the differences at a sample, `w (diff - share v)`, and their weighted squares.
    #[inline(always)]
    fn errors<T: Copy + Into<f64>>(
        &self,
        y: &[[T; C]],
        k: usize,
        i: usize,
        d: usize,
        share: f64,
    ) -> Option<([[f64; C]; STENCILS], f64)> {
        let cell = self.cells.get(self.slot[k] as usize)?;
        let weight = f64::from(cell.weight);
        let (mut errors, mut squares) = (self.differences(y, k, i, d), 0.0);
        for stencil in 0..STENCILS {
            let on = if self.stencils[stencil] { weight } else { 0.0 };
            // A difference that would leave the signal is not compared.
            let exists = match stencil {
                0 => i + 1 < self.on.shape()[d],
                1 => i > 0,
                _ => true,
            };
            let on = if exists { on } else { 0.0 };
            for c in 0..C {
                let e = errors[stencil][c] - share * f64::from(cell.wanted[stencil][d][c]);
                squares += on * e * e;
                errors[stencil][c] = on * e;
            }
        }
        Some((errors, squares))
    }

    /// The loss of values at all samples, and in `bar` the total's derivatives with respect to them.
    pub fn evaluate<T: Copy + Into<f64> + Sync>(
        &self,
        y: &[[T; C]],
        bar: &mut [[f64; C]],
    ) -> PaperLoss {
        self.run(y, bar, 1.0)
    }

    /// Derivatives of the quadratic part alone: `A y`, where [`Self::evaluate`] gives `A y - b`.
    pub fn apply(&self, y: &[[f64; C]], bar: &mut [[f64; C]]) {
        self.run(y, bar, 0.0);
    }

    fn run<T: Copy + Into<f64> + Sync>(
        &self,
        y: &[[T; C]],
        bar: &mut [[f64; C]],
        share: f64,
    ) -> PaperLoss {
        let [of_gradient, of_color, weight] = self.factors;
        let sums: Vec<[f64; 2]> = bar
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, bar)| {
                let mut sums = [0.0; 2];
                for (j, bar) in bar.iter_mut().enumerate() {
                    let k = chunk * CHUNK + j;
                    let color = f64::from(self.outside[k]);
                    for c in 0..C {
                        let off = y[k][c].into() - share * f64::from(self.background[k][c]);
                        sums[1] += color * off * off;
                        bar[c] = 2.0 * weight * of_color * color * off;
                    }
                    sums[0] += self.gather(y, k, share, 2.0 * of_gradient, bar);
                }
                sums
            })
            .collect();
        let sum = |k: usize| sums.iter().map(|s| s[k]).sum::<f64>();
        let (gradient, color) = (of_gradient * sum(0), of_color * sum(1));
        PaperLoss { gradient, color, total: gradient + weight * color }
    }

    /// Adds `factor` times what the differences at a sample and at its neighbours say about its value, and returns the
    /// squares of those at the sample itself.
    #[inline(always)]
    fn gather<T: Copy + Into<f64>>(
        &self,
        y: &[[T; C]],
        k: usize,
        share: f64,
        factor: f64,
        bar: &mut [f64; C],
    ) -> f64 {
        let mut squares = 0.0;
        let (mut rest, mut index) = (k, [0; D]);
        for d in 0..D {
            index[d] = rest % self.on.shape()[d];
            rest /= self.on.shape()[d];
        }
        for d in 0..D {
            let (i, stride, last) = (index[d], self.strides[d], self.on.shape()[d] - 1);
            let factor = factor * self.scale[d];
            // Of a centred difference at its own sample only the one-sided one depends on it.
            let own = f64::from(i8::from(i == last) - i8::from(i == 0));
            if let Some((e, s)) = self.errors(y, k, i, d, share) {
                squares += s;
                (0..C).for_each(|c| bar[c] += factor * (e[1][c] - e[0][c] + own * e[2][c]));
            }
            if i > 0
                && let Some((e, _)) = self.errors(y, k - stride, i - 1, d, share)
            {
                let half = if i > 1 { 0.5 } else { 1.0 };
                (0..C).for_each(|c| bar[c] += factor * (e[0][c] + half * e[2][c]));
            }
            if i < last
                && let Some((e, _)) = self.errors(y, k + stride, i + 1, d, share)
            {
                let half = if i + 1 < last { 0.5 } else { 1.0 };
                (0..C).for_each(|c| bar[c] -= factor * (e[1][c] + half * e[2][c]));
            }
        }
        squares
    }
}

/// The samples on a part of their lattice, channels side by side.
pub fn cropped<const D: usize, const C: usize>(
    samples: &Samples<D, C>,
    on: &Domain<D>,
) -> Vec<[f32; C]> {
    let (whole, start) = (samples.domain().shape(), first_sample(samples.domain(), on));
    let lo = start.map(|v| v as isize);
    let planes: Vec<Vec<f32>> =
        (0..C).map(|c| copy_box(samples.plane(c), whole, lo, on.shape(), |_, _| None)).collect();
    (0..on.len()).map(|k| std::array::from_fn(|c| planes[c][k])).collect()
}

/// The least or largest value within `reach` samples along each axis, diagonals included; what lies beyond the part is
/// not looked at.
fn neighbours<const D: usize>(
    values: &[f32],
    on: &Domain<D>,
    reach: usize,
    pick: impl Fn(f32, f32) -> f32,
) -> Vec<f32> {
    let mut out = values.to_vec();
    for d in 0..D {
        let (stride, n, from) = (on.strides()[d], on.shape()[d], out.clone());
        for k in 0..out.len() {
            let i = on.unflatten(k)[d];
            let row = k - i * stride;
            for j in i.saturating_sub(reach)..(i + reach + 1).min(n) {
                out[k] = pick(out[k], from[row + j * stride]);
            }
        }
    }
    out
}
