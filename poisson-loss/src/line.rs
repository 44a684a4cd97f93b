//! One dimension: the spline system has seven diagonals and is solved directly, in pieces.
//!
//! The first guess pastes the patch, as in [`assembly`](crate::assembly), so that for linear guidance
//! most pieces have no residual. Three coefficients separate a piece from the next; what each
//! interior gives to the separators is eliminated, the separators are solved in order, and the
//! interiors follow from them. Pieces of the same weights everywhere share one factorisation. The
//! signals are read batch by batch: of the whole line there is only the result.
//!
//! Sums are in f64. In one dimension an error of the right-hand side is integrated twice, so that
//! f32 sums, harmless in higher dimensions, would be heard after a few hundred samples.

mod load;
mod separators;
mod system;

use inr_core::Spline;
use inr_core::cpu::{Kernel, dispatch};
use rayon::prelude::*;

use crate::Result;
use crate::axis::ghost;
use crate::plan::Plan;
use crate::problem::{Patch, Problem, aligned_shift};
use load::Batch;
use separators::Separators;
use system::{Class, Ends, PIECE, SEPARATOR, System};

/// Pieces of one task, whose signals are read at once.
const BATCH: usize = 64;
/// Different weights for which a factorisation is shared; pieces of further ones have their own.
const MOST_CLASSES: usize = 16;

/// One piece after its interior is eliminated.
struct Piece<const C: usize> {
    ends: Ends,
    /// Right-hand side of its separators and of the next piece's, per channel.
    own: [[f64; SEPARATOR]; C],
    next: [[f64; SEPARATOR]; C],
}

/// The change of the background's coefficients, one plane per channel, and the relative residual
/// of the separators' system. Linear time.
///
/// # Panics
/// If the problem has another dimension.
pub fn solve<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    plan: &Plan<D>,
) -> Result<(Vec<Vec<f32>>, f64)> {
    assert_eq!(D, 1, "pieces of a line are for one dimension");
    let mut problem = problem.clone();
    let mut spline = None;
    if let Patch::Samples { samples, offset } = problem.patch
        && aligned_shift(problem.background.domain(), samples.domain(), &offset).is_none()
    {
        samples.check_finite().map_err(|e| crate::inputs::not_finite("patch", e))?;
        let field = &*spline.insert(Spline::interpolate(samples));
        problem.patch = Patch::Field { field, offset };
    }
    let n = plan.frame.shape[0];
    let pieces = n.div_ceil(PIECE);
    let classes: Vec<Option<Class>> =
        (0..pieces).into_par_iter().map(|k| Class::of_piece(plan, k)).collect();
    let mut known: Vec<Class> = Vec::new();
    for class in classes.iter().flatten() {
        if !known.contains(class) && known.len() < MOST_CLASSES {
            known.push(*class);
        }
    }
    let shared: Vec<System> = known.par_iter().map(System::uniform).collect();
    let system_of = |piece: usize| -> Option<&System> {
        classes[piece].and_then(|class| known.iter().position(|k| *k == class)).map(|k| &shared[k])
    };
    let mut changes = vec![vec![0.0f32; n]; C];
    let eliminated: Vec<Result<Vec<Piece<C>>>> = batches(&mut changes)
        .into_par_iter()
        .enumerate()
        .map(|(batch, mut changes)| {
            let signals = Batch::new(&problem, plan, batch * BATCH * PIECE, changes[0].len())?;
            let pieces = changes[0].len().div_ceil(PIECE);
            let piece = |k: usize| {
                let changes = changes.iter_mut().map(|c| piece_of(c, k)).collect();
                let own;
                let system = match system_of(batch * BATCH + k) {
                    Some(shared) => shared,
                    None => {
                        own = System::of_piece(plan, batch * BATCH + k);
                        &own
                    }
                };
                eliminate(system, &signals, batch * BATCH + k, changes)
            };
            Ok((0..pieces).map(piece).collect())
        })
        .collect();
    let mut all: Vec<Piece<C>> = Vec::with_capacity(pieces);
    for batch in eliminated {
        all.extend(batch?);
    }
    let separators = Separators::new(all.iter().map(|p| p.ends).collect());
    let mut worst = 0.0f64;
    let mut values: Vec<Vec<[f64; SEPARATOR]>> = Vec::with_capacity(C);
    for c in 0..C {
        let mut b: Vec<[f64; SEPARATOR]> = all.iter().map(|p| p.own[c]).collect();
        for k in 1..pieces {
            (0..SEPARATOR).for_each(|i| b[k][i] += all[k - 1].next[c][i]);
        }
        worst = worst.max(separators.solve(&mut b));
        values.push(b);
    }
    drop((all, separators));
    batches(&mut changes).into_par_iter().enumerate().for_each(|(batch, mut changes)| {
        for k in 0..changes[0].len().div_ceil(PIECE) {
            let piece = batch * BATCH + k;
            let own;
            let system = match system_of(piece) {
                Some(shared) => shared,
                None => {
                    own = System::of_piece(plan, piece);
                    &own
                }
            };
            for (change, values) in changes.iter_mut().zip(&values) {
                let next = values.get(piece + 1).copied().unwrap_or_default();
                let change = piece_of(change, k);
                dispatch(Answer { system, left: values[piece], right: next, change });
            }
        }
    });
    Ok((changes, worst))
}

/// The channels' values of every batch.
fn batches(changes: &mut [Vec<f32>]) -> Vec<Vec<&mut [f32]>> {
    let mut batches: Vec<Vec<&mut [f32]>> = Vec::new();
    for plane in changes {
        for (k, part) in plane.chunks_mut(BATCH * PIECE).enumerate() {
            batches.resize_with(batches.len().max(k + 1), Vec::new);
            batches[k].push(part);
        }
    }
    batches
}

/// The values of piece `k` of a batch.
fn piece_of(batch: &mut [f32], k: usize) -> &mut [f32] {
    let end = ((k + 1) * PIECE).min(batch.len());
    &mut batch[k * PIECE..end]
}

/// Solves one piece's interior with its separators at zero, on top of the first guess.
fn eliminate<const D: usize, const C: usize>(
    system: &System,
    batch: &Batch<'_, D, C>,
    piece: usize,
    mut changes: Vec<&mut [f32]>,
) -> Piece<C> {
    let zero = [[0.0; SEPARATOR]; C];
    let mut eliminated = Piece { ends: system.ends, own: zero, next: zero };
    batch.first_guess(piece * PIECE, &mut changes);
    let Some(residual) = batch.residual(piece * PIECE, PIECE) else { return eliminated };
    for (c, mut r) in residual.into_iter().enumerate() {
        let (own, inside) = r.split_at_mut(SEPARATOR);
        system.solve(inside);
        let (left, right) = (system.seen_from_left(inside), system.seen_from_right(inside));
        eliminated.own[c] = std::array::from_fn(|i| own[i] - left[i]);
        eliminated.next[c] = right.map(|v| -v);
        for (change, x) in changes[c].iter_mut().skip(SEPARATOR).zip(inside) {
            *change = (f64::from(*change) + *x) as f32;
        }
    }
    eliminated
}

/// Adds what the separators' values make of one piece.
struct Answer<'a> {
    system: &'a System,
    left: [f64; SEPARATOR],
    right: [f64; SEPARATOR],
    change: &'a mut [f32],
}

impl Kernel for Answer<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let separators = SEPARATOR.min(self.change.len());
        let (own, inside) = self.change.split_at_mut(separators);
        for (change, v) in own.iter_mut().zip(self.left) {
            *change = (f64::from(*change) + v) as f32;
        }
        let n = inside.len();
        let [a, b, c, d, e, f] = self.system.response.each_ref().map(|r| &r[..n]);
        let (a, b, c) = (&a[..n], &b[..n], &c[..n]);
        let (d, e, f) = (&d[..n], &e[..n], &f[..n]);
        let ([u, v, w], [x, y, z]) = (self.left, self.right);
        for i in 0..n {
            let of_left = u * a[i] + v * b[i] + w * c[i];
            let of_right = x * d[i] + y * e[i] + z * f[i];
            inside[i] = (f64::from(inside[i]) + (of_left + of_right)) as f32;
        }
    }
}

/// Adds the spline with these coefficients, at its knots, to a line that begins with the box.
pub fn add_nodal<const D: usize>(plan: &Plan<D>, change: &[f32], line: &mut [f32]) {
    let (n, ends) = (change.len(), plan.frame.ends[0]);
    let len = BATCH * PIECE;
    line[..n].par_chunks_mut(len).enumerate().for_each(|(batch, out)| {
        let first = batch * len;
        let at = |i: isize| ghost(i, n, ends).map_or(0.0, |i| change[i]);
        let mut before = at(first as isize - 1);
        let last = out.len() - 1;
        for (i, v) in out.iter_mut().enumerate() {
            let after = if i < last { change[first + i + 1] } else { at((first + i) as isize + 1) };
            *v += (before + after) / 6.0 + change[first + i] * (4.0 / 6.0);
            before = change[first + i];
        }
    });
}

#[cfg(test)]
mod tests;
