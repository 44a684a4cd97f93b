//! The first guess and the residual it leaves, batch by batch.

use inr_core::Jet;

use super::system::{Class, REACH};
use crate::Result;
use crate::axis::{End, ghost};
use crate::inputs::Inputs;
use crate::operator::cell_points;
use crate::plan::Plan;
use crate::problem::Problem;
use crate::tile::Frame;

/// Coefficients around a piece that the residual of its rows sees.
const SEEN: usize = 2 * REACH as usize + 1;
/// Coefficients read around a batch.
const HALO: usize = SEEN + 3;

/// The signals of one batch as coefficients.
pub struct Batch<'a, const D: usize, const C: usize> {
    problem: &'a Problem<'a, D, C>,
    plan: &'a Plan<D>,
    /// `None` where the batch lies outside the region.
    inputs: Option<Inputs<'a, D, C>>,
    /// The first guess: the pasted patch. Empty outside the region.
    guess: Vec<Vec<f32>>,
    /// Coefficient of the box that the signals begin with.
    first: usize,
}

impl<'a, const D: usize, const C: usize> Batch<'a, D, C> {
    /// Reads `len` coefficients of the box from `first` on.
    pub fn new(
        problem: &'a Problem<'a, D, C>,
        plan: &'a Plan<D>,
        first: usize,
        len: usize,
    ) -> Result<Self> {
        let lo = first.saturating_sub(HALO);
        let hi = (first + len + HALO).min(plan.frame.shape[0]);
        let mut batch = Self { problem, plan, inputs: None, guess: Vec::new(), first: lo };
        if plan.region[lo..hi].iter().any(|m| *m > 0.0) {
            let frame = Frame { shape: [hi - lo; D], ends: plan.frame.ends };
            let inputs = Inputs::new(problem, [plan.start[0] + lo; D], frame)?;
            let pasted = inputs.target.as_ref().unwrap_or(&inputs.difference);
            let free = |i: usize| plan.free.get(i).copied().unwrap_or(true);
            let guess = |d: &Vec<f32>| -> Vec<f32> {
                let guide = &plan.guide()[lo..hi];
                let paste = |(i, (d, g)): (usize, (&f32, &f32))| {
                    if free(lo + i) { g * d } else { 0.0 }
                };
                d.iter().zip(guide).enumerate().map(paste).collect()
            };
            batch.guess = pasted.iter().map(guess).collect();
            batch.inputs = Some(inputs);
        }
        Ok(batch)
    }

    /// The first guess from coefficient `first` of the box on, one slice per channel.
    pub fn first_guess(&self, first: usize, changes: &mut [&mut [f32]]) {
        for (change, guess) in changes.iter_mut().zip(&self.guess) {
            let n = change.len();
            change.copy_from_slice(&guess[first - self.first..][..n]);
        }
    }

    /// Whether the first guess leaves no residual on coefficients `first..end`.
    fn is_quiet(&self, inputs: &Inputs<'_, D, C>, first: usize, end: usize) -> bool {
        let plan = self.plan;
        let around = first.saturating_sub(SEEN + 1)..(end + SEEN + 1).min(plan.frame.shape[0]);
        let all = |values: &[f32], v: f32| {
            values[around.clone()].iter().map(|w| u32::from(*w != v)).sum::<u32>() == 0
        };
        if all(&plan.region, 0.0) {
            return true;
        }
        let keeps_another = plan.keep > 0.0 && inputs.target.is_some();
        let free = plan.free.get(around.clone()).unwrap_or(&[]);
        inputs.linear
            && !keeps_another
            && all(&plan.region, 1.0)
            && all(plan.guide(), 1.0)
            && free.iter().all(|f| *f)
    }

    /// `b - A e_0` on `count` rows from `first` on, zero beyond the line; `None` where it vanishes.
    pub fn residual(&self, first: usize, count: usize) -> Option<Vec<Vec<f64>>> {
        let inputs = self.inputs.as_ref()?;
        let n = self.plan.frame.shape[0];
        if self.is_quiet(inputs, first, (first + count).min(n)) {
            return None;
        }
        let ends = self.plan.frame.ends[0];
        let mut sums = vec![vec![0.0; count + 2 * SEEN]; C];
        self.add_points(inputs, first, count, &mut sums);
        let fold = |sum: &Vec<f64>| -> Vec<f64> {
            let mut rows = sum[SEEN..SEEN + count].to_vec();
            for (k, v) in sum.iter().enumerate() {
                let i = (first + k) as isize - SEEN as isize;
                if i < 0 || i >= n as isize {
                    let row = ghost(i, n, ends).and_then(|i| i.checked_sub(first));
                    if let Some(row) = row.filter(|row| *row < count) {
                        rows[row] += v;
                    }
                }
            }
            for (k, v) in rows.iter_mut().enumerate() {
                let free = first + k < n && self.plan.free.get(first + k).copied().unwrap_or(true);
                *v = if free { *v } else { 0.0 };
            }
            rows
        };
        Some(sums.iter().map(fold).collect())
    }

    /// Adds what all points of the cells around give to each coefficient; entry [`SEEN`] of a sum is
    /// row `first`.
    fn add_points(
        &self,
        inputs: &Inputs<'_, D, C>,
        first: usize,
        count: usize,
        sums: &mut [Vec<f64>],
    ) {
        let plan = self.plan;
        let (n, ends) = (plan.frame.shape[0], plan.frame.ends[0]);
        let around = |values: &Vec<f32>| -> Vec<f64> {
            let at = |k: usize| {
                let i = ghost((first + k) as isize - SEEN as isize, n, ends);
                // Beyond what was read are only entries past the line's end that no row sees.
                let v = i.and_then(|i| values.get(i.checked_sub(self.first)?));
                v.map_or(0.0, |v| f64::from(*v))
            };
            (0..count + 2 * SEEN).map(at).collect()
        };
        let all = |planes: &Vec<Vec<f32>>| planes.iter().map(around).collect::<Vec<_>>();
        let (guess, difference) = (all(&self.guess), all(&inputs.difference));
        let (target, background) = (inputs.target.as_ref().map(all), all(&inputs.background));
        let pasted = target.as_ref().unwrap_or(&difference);
        let root_alpha = f64::from(plan.alpha[0]).sqrt();
        let beyond = |end: End| if end == End::Zero { REACH } else { 0 };
        let cells = (first as isize - REACH).max(-beyond(ends[0]))
            ..((first + count) as isize + REACH).min(n as isize + beyond(ends[1]));
        for (cell, half) in cells.flat_map(|cell| [(cell, 0), (cell, 1)]) {
            let outside = cell == 0 && half == 0 && ends[0] == End::Mirror
                || cell == n as isize - 1 && half == 1 && ends[1] == End::Mirror;
            if outside && n > 1 {
                continue;
            }
            let point = &cell_points()[half];
            let at = (cell + point.first + SEEN as isize - first as isize) as usize;
            let k = cell.clamp(0, n as isize - 1) as usize;
            let (guide, m) = (f64::from(plan.guide()[k]), f64::from(plan.region[k]));
            let dot = |c: &[f64], taps: &[f32; 4]| -> f64 {
                let c = &c[at..at + 4];
                (0..4).map(|k| f64::from(taps[k]) * c[k]).sum()
            };
            let jet = |c: &[f64]| [dot(c, &point.value), dot(c, &point.slope)];
            let mut pull = [0.0; C];
            if guide > 0.0 && inputs.linear {
                pull = std::array::from_fn(|c| root_alpha * dot(&pasted[c], &point.slope));
            } else if guide > 0.0 {
                let x = (plan.start[0] as isize + cell) as f64 - 0.25 + 0.5 * half as f64;
                let jets = |c: usize| (jet(&background[c]), jet(&difference[c]));
                pull = self.pull(inputs, x, jets);
            }
            let class = Class::at(plan, k);
            for (c, sum) in sums.iter_mut().enumerate() {
                let [value, slope] = jet(&guess[c]);
                let apart = if plan.keep > 0.0 && m > 0.0 {
                    f64::from(plan.keep) * m * dot(&difference[c], &point.value)
                } else {
                    0.0
                };
                let of_slope = 0.5 * (guide * root_alpha * pull[c] - class.gamma * slope);
                let of_value = 0.5 * (apart - class.screening * value);
                for (k, sum) in sum[at..at + 4].iter_mut().enumerate() {
                    *sum +=
                        f64::from(point.slope[k]) * of_slope + f64::from(point.value[k]) * of_value;
                }
            }
        }
    }

    /// `v - grad c_S` per channel at continuous sample `x`, from value and slope of the background and
    /// of the difference per channel.
    fn pull(
        &self,
        inputs: &Inputs<'_, D, C>,
        x: f64,
        jets: impl Fn(usize) -> ([f64; 2], [f64; 2]),
    ) -> [f64; C] {
        let domain = self.problem.background.domain();
        let position = f64::from(domain.origin()[0]) + x * f64::from(domain.pitch()[0]);
        let position = [position as f32; D];
        let root_alpha = f64::from(self.plan.alpha[0]).sqrt();
        let (mut s, mut t) = (Jet::<D, C>::ZERO, Jet::<D, C>::ZERO);
        for c in 0..C {
            let ([s_value, s_slope], [d_value, d_slope]) = jets(c);
            s.value[c] = s_value as f32;
            s.grad[c] = [(root_alpha * s_slope) as f32; D];
            t.value[c] = s.value[c] + d_value as f32;
            t.grad[c] = [s.grad[c][0] + (root_alpha * d_slope) as f32; D];
        }
        if let Some(moved) = &inputs.field {
            let mut jet = [Jet::ZERO];
            moved.jets(&mut [position], &mut jet);
            [t] = jet;
            t.grad.iter_mut().for_each(|g| g[0] *= self.plan.h_ref);
        }
        let v = self.problem.guidance.evaluate(&position, &s, &t);
        std::array::from_fn(|c| f64::from(v[c][0]) - f64::from(s.grad[c][0]))
    }
}
