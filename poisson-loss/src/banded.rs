//! One dimension: the spline system has seven diagonals and is solved directly.
//!
//! Everything is summed in f64. In one dimension an error of the right-hand side is integrated
//! twice, so that f32 sums, harmless in higher dimensions, would be heard after a few hundred
//! samples.

use inr_core::Jet;

use crate::Result;
use crate::assembly::skirted;
use crate::axis::{End, ghost};
use crate::inputs::Inputs;
use crate::operator::{CellPoint, cell_points};
use crate::plan::Plan;
use crate::problem::Problem;

/// Diagonals at and above the main one.
const BAND: usize = 4;

/// The change of the background's coefficients, one plane per channel, and the relative residual
/// of the linear system in f64. Linear time.
///
/// # Panics
/// If the problem has another dimension.
pub fn solve<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
) -> Result<(Vec<Vec<f32>>, f64)> {
    assert_eq!(D, 1, "the banded solver is for one dimension");
    let mut upper = matrix(plan);
    fix(plan, &mut upper);
    let factor = cholesky(&upper);
    let mut worst = 0.0f64;
    let mut changes = Vec::with_capacity(C);
    for mut b in right_hand_sides(problem, plan)? {
        for (b, free) in b.iter_mut().zip(&plan.free) {
            *b = if *free { *b } else { 0.0 };
        }
        let x = substitute(&factor, &b);
        let squared = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        let (start, end) = (squared(&b), squared(&residual(&upper, &b, &x)));
        worst = worst.max(if start > 0.0 { (end / start).sqrt() } else { 0.0 });
        changes.push(x.iter().map(|v| *v as f32).collect());
    }
    Ok((changes, worst))
}

/// Calls `visit(cell, point, coefficients)` for every quadrature point of the frame: the cell's
/// weights, the point in it, and the four coefficients it sees (`None` where the change is zero).
fn for_points(
    n: usize,
    ends: [End; 2],
    mut visit: impl FnMut(usize, usize, &CellPoint, [Option<usize>; 4]),
) {
    let points = cell_points();
    // Cells beyond a Zero end still lie under the outermost basis functions.
    let beyond = |end: End| if end == End::Zero { 2 } else { 0 };
    for cell in -beyond(ends[0])..n as isize + beyond(ends[1]) {
        for (half, point) in points.iter().enumerate() {
            let outside = cell == 0 && half == 0 && ends[0] == End::Mirror
                || cell == n as isize - 1 && half == 1 && ends[1] == End::Mirror;
            if outside && n > 1 {
                continue;
            }
            let at = std::array::from_fn(|k| ghost(cell + point.first + k as isize, n, ends));
            visit(cell.clamp(0, n as isize - 1) as usize, half, point, at);
        }
    }
}

/// The upper diagonals `A[i][i + k]`.
fn matrix<const D: usize>(plan: &Plan<D>) -> Vec<[f64; BAND]> {
    let screening = plan.screening();
    let mut upper = vec![[0.0f64; BAND]; plan.frame.shape[0]];
    for_points(plan.frame.shape[0], plan.frame.ends[0], |cell, _, point, at| {
        let gamma = f64::from(plan.gamma.get(cell).copied().unwrap_or(1.0) * plan.alpha[0]);
        let s = f64::from(screening[cell]);
        for (k, i) in at.iter().enumerate() {
            for (l, j) in at.iter().enumerate() {
                let (Some(i), Some(j)) = (*i, *j) else { continue };
                if j >= i {
                    let slopes = f64::from(point.slope[k]) * f64::from(point.slope[l]);
                    let values = f64::from(point.value[k]) * f64::from(point.value[l]);
                    upper[i][j - i] += 0.5 * (gamma * slopes + s * values);
                }
            }
        }
    });
    upper
}

/// Cuts the coefficients that may not change out of the system.
fn fix<const D: usize>(plan: &Plan<D>, upper: &mut [[f64; BAND]]) {
    for i in 0..plan.free.len() {
        for k in 1..BAND.min(upper.len() - i) {
            if !(plan.free[i] && plan.free[i + k]) {
                upper[i][k] = 0.0;
            }
        }
        upper[i][0] = if plan.free[i] { upper[i][0] } else { 1.0 };
    }
}

/// `sum over points of guide phi' (v - c_S') + keep m phi (c_T - c_S)`, per channel.
fn right_hand_sides<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
) -> Result<Vec<Vec<f64>>> {
    let (start, frame) = skirted(problem, plan);
    let inputs = Inputs::new(problem, start, frame)?;
    let place = start[0] - plan.start[0];
    let (root_alpha, n) = (f64::from(plan.alpha[0]).sqrt(), plan.frame.shape[0]);
    let mut sums = vec![vec![0.0f64; n]; C];
    for_points(frame.shape[0], frame.ends[0], |cell, half, point, at| {
        let (guide, m) = (plan.guide()[place + cell], plan.region[place + cell]);
        if guide == 0.0 && m == 0.0 {
            return;
        }
        let at_point = |c: &[f32], taps: &[f32; 4]| -> f64 {
            let tap = |k: usize| at[k].map_or(0.0, |i| f64::from(taps[k]) * f64::from(c[i]));
            (0..4).map(tap).sum()
        };
        let pull = if inputs.linear {
            let target = inputs.target.as_ref().unwrap_or(&inputs.difference);
            std::array::from_fn(|c| root_alpha * at_point(&target[c], &point.slope))
        } else {
            let quarter = if half == 0 { -0.25 } else { 0.25 };
            let x = (start[0] + cell) as f64 + quarter;
            pull_at(
                problem,
                plan,
                &inputs,
                x,
                |c| at_point(c, &point.value),
                |c| at_point(c, &point.slope),
            )
        };
        for c in 0..C {
            let apart = f64::from(plan.keep * m) * at_point(&inputs.difference[c], &point.value);
            let pull = f64::from(guide) * root_alpha * pull[c];
            for (k, i) in at.iter().enumerate() {
                if let Some(i) = i {
                    let term = f64::from(point.slope[k]) * pull + f64::from(point.value[k]) * apart;
                    sums[c][place + i] += 0.5 * term;
                }
            }
        }
    });
    Ok(sums)
}

/// `v - grad c_S` per channel at continuous sample `x`, for guidance evaluated point by point.
fn pull_at<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
    inputs: &Inputs<'_, D, C>,
    x: f64,
    value: impl Fn(&[f32]) -> f64,
    slope: impl Fn(&[f32]) -> f64,
) -> [f64; C] {
    let domain = problem.background.domain();
    let position = [(f64::from(domain.origin()[0]) + x * f64::from(domain.pitch()[0])) as f32; D];
    let root_alpha = f64::from(plan.alpha[0]).sqrt();
    let (mut s, mut t) = (Jet::<D, C>::ZERO, Jet::<D, C>::ZERO);
    for c in 0..C {
        s.value[c] = value(&inputs.background[c]) as f32;
        s.grad[c] = [(root_alpha * slope(&inputs.background[c])) as f32; D];
        t.value[c] = s.value[c] + value(&inputs.difference[c]) as f32;
        t.grad[c] = [s.grad[c][0] + (root_alpha * slope(&inputs.difference[c])) as f32; D];
    }
    if let Some(moved) = &inputs.field {
        let mut jet = [Jet::ZERO];
        moved.jets(&mut [position], &mut jet);
        [t] = jet;
        t.grad.iter_mut().for_each(|g| g[0] *= plan.h_ref);
    }
    let v = problem.guidance.evaluate(&position, &s, &t);
    std::array::from_fn(|c| f64::from(v[c][0]) - f64::from(s.grad[c][0]))
}

/// `L[i + k][i]` of the Cholesky factorisation.
fn cholesky(upper: &[[f64; BAND]]) -> Vec<[f64; BAND]> {
    let n = upper.len();
    let mut l = vec![[0.0f64; BAND]; n];
    for i in 0..n {
        for k in 0..BAND.min(n - i) {
            let dot: f64 =
                (1..BAND - k).filter(|m| *m <= i).map(|m| l[i - m][m] * l[i - m][m + k]).sum();
            let v = upper[i][k] - dot;
            // 1e-300: an equation without any weight leaves its unknown at zero.
            l[i][k] = if k == 0 { v.max(1e-300).sqrt() } else { v / l[i][0] };
        }
    }
    l
}

/// Forward and backward substitution.
fn substitute(factor: &[[f64; BAND]], b: &[f64]) -> Vec<f64> {
    let (n, mut x) = (b.len(), b.to_vec());
    for i in 0..n {
        let known: f64 = (1..BAND.min(i + 1)).map(|k| factor[i - k][k] * x[i - k]).sum();
        x[i] = (x[i] - known) / factor[i][0];
    }
    for i in (0..n).rev() {
        let known: f64 = (1..BAND.min(n - i)).map(|k| factor[i][k] * x[i + k]).sum();
        x[i] = (x[i] - known) / factor[i][0];
    }
    x
}

fn residual(upper: &[[f64; BAND]], b: &[f64], x: &[f64]) -> Vec<f64> {
    let mut r = b.to_vec();
    for i in 0..x.len() {
        r[i] -= upper[i][0] * x[i];
        for k in 1..BAND.min(x.len() - i) {
            r[i] -= upper[i][k] * x[i + k];
            r[i + k] -= upper[i][k] * x[i];
        }
    }
    r
}
