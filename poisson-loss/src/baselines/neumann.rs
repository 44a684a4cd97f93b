//! The whole signal from its gradient alone, through cosine transforms.

use std::f64::consts::PI;

use rayon::prelude::*;
use rustdct::DctPlanner;

use super::stage::Stage;
use super::{report, row_starts};
use crate::inputs::not_finite;
use crate::problem::Support;
use crate::{Blend, Error, Problem, Result};

/// Lines that one task transposes: 8 f64 are one cache line of the source.
const BLOCK: usize = 8;
/// Samples of one partial sum; fixed, so that sums do not depend on the threads.
const CHUNK: usize = 1 << 14;

pub fn solve<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    support: &Support<D>,
) -> Result<Blend<D, C>> {
    let domain = problem.background.domain();
    let (shape, n) = (domain.shape(), domain.len());
    let outside = n as f64 - support.measure;
    if outside <= 0.0 {
        return Err(Error::NoAnchor);
    }
    problem.background.check_finite().map_err(|e| not_finite("background", e))?;
    let stage = Stage::new(problem, support)?;
    let transform = Transform::new(shape, stage.alpha);
    let mut report = report(support, [0; D], shape);
    report.iterations = 1;
    let mut samples = problem.background.clone();
    let place = |local: &[f32], plane: &mut [f64]| {
        let n0 = stage.frame.shape[0];
        let starts = row_starts(stage.start, stage.frame.shape, shape);
        for (at, row) in starts.zip(local.chunks_exact(n0)) {
            plane[at..at + n0].iter_mut().zip(row).for_each(|(p, v)| *p = f64::from(*v));
        }
    };
    let (mut rhs, mut region) = (vec![0.0f64; n], vec![0.0f64; n]);
    place(&stage.region, &mut region);
    for (c, divergence) in stage.divergence(|a, b| 0.5 * (a + b)).iter().enumerate() {
        rhs.fill(0.0);
        place(divergence, &mut rhs);
        let change = transform.invert(rhs.clone());
        report.residual = report.residual.max(transform.residual(&change, &rhs));
        let mean = sum(n, |k| (1.0 - region[k]) * change[k]) / outside;
        samples
            .plane_mut(c)
            .par_iter_mut()
            .zip(&change)
            .for_each(|(s, e)| *s = (f64::from(*s) + e - mean) as f32);
    }
    Ok(Blend { samples, report })
}

/// The Laplacian on links with free borders, which cosines diagonalise.
struct Transform<const D: usize> {
    shape: [usize; D],
    alpha: [f64; D],
}

impl<const D: usize> Transform<D> {
    fn new(shape: [usize; D], alpha: [f32; D]) -> Self {
        Self { shape, alpha: alpha.map(f64::from) }
    }

    /// The solution of `A u = f` without a constant part; the constant part of `f` is dropped.
    ///
    /// Along an axis with `n` samples the DCT-II has eigenvalues `2 - 2 cos(pi k / n)`, and the
    /// DCT-III is its inverse up to `n / 2`.
    fn invert(&self, f: Vec<f64>) -> Vec<f64> {
        let mut u = self.along_all_axes(f, Direction::Forward);
        let eigenvalues: [Vec<f64>; D] = std::array::from_fn(|d| {
            let n = self.shape[d];
            // 4 sin^2 keeps the digits that 2 - 2 cos cancels at low frequencies.
            (0..n)
                .map(|k| 4.0 * self.alpha[d] * (0.5 * PI * k as f64 / n as f64).sin().powi(2))
                .collect()
        });
        let scale: f64 = self.shape.iter().map(|n| 2.0 / *n as f64).product();
        let n0 = self.shape[0];
        u.par_chunks_mut(n0).enumerate().for_each(|(mut row, u)| {
            let mut outer = 0.0;
            for d in 1..D {
                outer += eigenvalues[d][row % self.shape[d]];
                row /= self.shape[d];
            }
            for (u, e) in u.iter_mut().zip(&eigenvalues[0]) {
                // Only the constant has eigenvalue 0.
                *u = if outer + e > 0.0 { *u * scale / (outer + e) } else { 0.0 };
            }
        });
        self.along_all_axes(u, Direction::Backward)
    }

    /// Transforms every axis: axis 0 lies contiguous, and each pass brings the next one there.
    fn along_all_axes(&self, mut data: Vec<f64>, direction: Direction) -> Vec<f64> {
        let mut planner = DctPlanner::new();
        let mut other = vec![0.0; data.len()];
        for d in 0..D {
            let n = self.shape[d];
            let plan = planner.plan_dct2(n);
            data.par_chunks_mut(n).for_each_init(
                || vec![0.0; plan.get_scratch_len()],
                |scratch, line| match direction {
                    Direction::Forward => plan.process_dct2_with_scratch(line, scratch),
                    Direction::Backward => plan.process_dct3_with_scratch(line, scratch),
                },
            );
            if D > 1 {
                transpose(&data, n, &mut other);
                std::mem::swap(&mut data, &mut other);
            }
        }
        data
    }

    /// `|f - A u| / |f|`, and 0 for `f = 0`.
    fn residual(&self, u: &[f64], f: &[f64]) -> f64 {
        let strides: [usize; D] = std::array::from_fn(|d| self.shape[..d].iter().product());
        let squared = sum(u.len(), |k| {
            let mut r = f[k];
            for d in 0..D {
                let i = k / strides[d] % self.shape[d];
                if i > 0 {
                    r -= self.alpha[d] * (u[k] - u[k - strides[d]]);
                }
                if i + 1 < self.shape[d] {
                    r -= self.alpha[d] * (u[k] - u[k + strides[d]]);
                }
            }
            r * r
        });
        let whole = sum(f.len(), |k| f[k] * f[k]);
        if whole > 0.0 { (squared / whole).sqrt() } else { 0.0 }
    }
}

#[derive(Clone, Copy)]
enum Direction {
    Forward,
    Backward,
}

/// Turns rows of length `n` into columns: the first axis becomes the last.
fn transpose(src: &[f64], n: usize, dst: &mut [f64]) {
    let rows = src.len() / n;
    dst.par_chunks_mut(BLOCK * rows).enumerate().for_each(|(block, dst)| {
        let lines = dst.len() / rows;
        for row in 0..rows {
            let src = &src[row * n + block * BLOCK..][..lines];
            src.iter().enumerate().for_each(|(line, v)| dst[line * rows + row] = *v);
        }
    });
}

/// A sum over `0..n` in a fixed order.
fn sum(n: usize, term: impl Fn(usize) -> f64 + Sync) -> f64 {
    let partial: Vec<f64> = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|k| (k * CHUNK..((k + 1) * CHUNK).min(n)).map(&term).sum())
        .collect();
    partial.iter().sum()
}
