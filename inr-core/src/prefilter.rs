//! The interpolating prefilter of the cubic B-spline: from samples to coefficients and back.
//!
//! Along every axis `samples = P coefficients` with `P = [1 4 1] / 6` and whole-sample mirror
//! extension. The inverse is a causal and an anticausal one-pole recursion (Unser, Aldroubi and
//! Eden 1993). Both directions start [`WARM_UP`] samples outside the piece they produce, so that
//! pieces are independent of one another.

use rayon::prelude::*;

use crate::cpu::{Kernel, dispatch};

/// The pole of the inverse of `[1 4 1] / 6`: `sqrt(3) - 2`.
const POLE: f32 = -0.267_949_2;

/// Samples run through before a piece begins: `|POLE|^16 = 7e-10`, far below f32 rounding.
const WARM_UP: usize = 16;

/// Samples side by side that one recursion along an outer axis carries at once.
const LANES: usize = 32;

/// Lines that one recursion along the contiguous axis carries at once.
const LINES: usize = 16;

/// Samples along the filtered axis in one piece.
const PIECE: usize = 128;

/// Mirrors an index into `0..n`, whole-sample symmetric about both ends: period `2 (n - 1)`.
#[inline(always)]
pub fn mirror(i: isize, n: usize) -> usize {
    let n = n as isize;
    if i >= 0 && i < n {
        return i as usize;
    }
    if n == 1 {
        return 0;
    }
    let period = 2 * (n - 1);
    let i = i.rem_euclid(period);
    (if i < n { i } else { period - i }) as usize
}

/// Turns samples on a lattice (axis 0 contiguous) into cubic B-spline coefficients, in place.
///
/// Linear time; takes a second buffer of the same length. The relative error is a few f32
/// roundings.
///
/// # Panics
/// If `data.len()` is not the product of `shape`.
pub fn prefilter(shape: &[usize], data: &mut [f32]) {
    assert_eq!(data.len(), shape.iter().product::<usize>(), "buffer against shape {shape:?}");
    // Axes beyond the first go back and forth between two buffers; the first, whose lines are
    // contiguous, is done last and always ends in `data`.
    let mut other = vec![0.0; if shape[1..].iter().any(|n| *n > 1) { data.len() } else { 0 }];
    let (mut inner, mut in_other) = (shape[0], false);
    for &n in &shape[1..] {
        if n > 1 {
            let (src, dst) =
                if in_other { (&other[..], &mut *data) } else { (&*data, &mut other[..]) };
            filter_axis(n, inner, src, dst);
            in_other = !in_other;
        }
        inner *= n;
    }
    if shape[0] > 1 {
        if !in_other {
            other = data.to_vec();
        }
        filter_first_axis(shape[0], &other, data);
    } else if in_other {
        data.copy_from_slice(&other);
    }
}

/// Filters contiguous lines of `n` samples from `src` into `dst`.
fn filter_first_axis(n: usize, src: &[f32], dst: &mut [f32]) {
    let lines = dst.par_chunks_mut(n * LINES).zip(src.par_chunks(n * LINES));
    lines.for_each_init(
        || vec![[0.0f32; LINES]; PIECE + 2 * WARM_UP],
        |block, (dst, src)| {
            for start in (0..n).step_by(PIECE) {
                dispatch(LinesPiece { n, start, len: PIECE.min(n - start), src, dst, block });
            }
        },
    );
}

/// One piece of up to [`LINES`] neighbouring lines, transposed so that the recursion runs down
/// the lines side by side; the block stays in the first-level cache.
struct LinesPiece<'a> {
    n: usize,
    start: usize,
    len: usize,
    src: &'a [f32],
    dst: &'a mut [f32],
    block: &'a mut [[f32; LINES]],
}

impl Kernel for LinesPiece<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { n, start, len, src, dst, block } = self;
        let block = &mut block[..len + 2 * WARM_UP];
        for (lane, line) in src.chunks_exact(n).enumerate() {
            for (k, row) in block.iter_mut().enumerate() {
                let i = (start + k) as isize - WARM_UP as isize;
                row[lane] = match line.get(i as usize) {
                    Some(v) => *v,
                    None => line[mirror(i, n)],
                };
            }
        }
        recurse(block);
        for (lane, line) in dst.chunks_exact_mut(n).enumerate() {
            for (v, row) in line[start..start + len].iter_mut().zip(&block[WARM_UP..]) {
                *v = row[lane];
            }
        }
    }
}

/// Filters an axis of `n` samples with stride `inner`, from `src` into `dst`.
fn filter_axis(n: usize, inner: usize, src: &[f32], dst: &mut [f32]) {
    dst.par_chunks_mut(n * inner).zip(src.par_chunks(n * inner)).for_each(|(dst, src)| {
        dst.par_chunks_mut(PIECE * inner).enumerate().for_each_init(Vec::new, |b, (k, piece)| {
            dispatch(Piece { n, inner, start: k * PIECE, src, dst: piece, block: b });
        });
    });
}

/// Samples `start..` of an axis with stride `inner`.
struct Piece<'a> {
    n: usize,
    inner: usize,
    start: usize,
    src: &'a [f32],
    dst: &'a mut [f32],
    block: &'a mut Vec<[f32; LANES]>,
}

impl Kernel for Piece<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { n, inner, start, src, dst, block } = self;
        let len = dst.len() / inner;
        block.resize(len + 2 * WARM_UP, [0.0; LANES]);
        for left in (0..inner).step_by(LANES) {
            let width = LANES.min(inner - left);
            for (k, row) in block.iter_mut().enumerate() {
                let i = mirror((start + k) as isize - WARM_UP as isize, n);
                copy_row(&src[i * inner + left..][..width], &mut row[..width]);
            }
            recurse(block);
            for (k, row) in block[WARM_UP..WARM_UP + len].iter().enumerate() {
                copy_row(&row[..width], &mut dst[k * inner + left..][..width]);
            }
        }
    }
}

/// Copies up to [`LANES`] values; a full row without a call.
#[inline(always)]
fn copy_row(src: &[f32], dst: &mut [f32]) {
    match (<&[f32; LANES]>::try_from(src), <&mut [f32; LANES]>::try_from(&mut *dst)) {
        (Ok(src), Ok(dst)) => *dst = *src,
        _ => dst.copy_from_slice(src),
    }
}

/// Both recursions along the rows of a block that begins and ends with its warm-up.
#[inline(always)]
fn recurse<const N: usize>(block: &mut [[f32; N]]) {
    let mut state = [0.0; N];
    for row in block.iter_mut() {
        for lane in 0..N {
            state[lane] = 6.0 * row[lane] + POLE * state[lane];
        }
        *row = state;
    }
    // Any start of the anticausal recursion decays within the warm-up.
    let mut state = [0.0; N];
    for row in block.iter_mut().rev() {
        for lane in 0..N {
            state[lane] = POLE * (state[lane] - row[lane]);
        }
        *row = state;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few roundings of values up to 2, times the filter's gain of 3 per axis.
    const TOLERANCE: f32 = 2e-6;

    fn apply_p(shape: &[usize], data: &[f32]) -> Vec<f64> {
        let mut data: Vec<f64> = data.iter().map(|v| f64::from(*v)).collect();
        let mut inner = 1;
        for &n in shape {
            let old = data.clone();
            for (k, v) in data.iter_mut().enumerate() {
                let i = (k / inner % n) as isize;
                let at = |j: isize| old[k - i as usize * inner + mirror(j, n) * inner];
                *v = (at(i - 1) + 4.0 * at(i) + at(i + 1)) / 6.0;
            }
            inner *= n;
        }
        data
    }

    fn check(shape: &[usize]) {
        let n: usize = shape.iter().product();
        let samples: Vec<f32> = (0..n).map(|k| ((k * 7919 % 1009) as f32 / 504.5) - 1.0).collect();
        let mut c = samples.clone();
        prefilter(shape, &mut c);
        for (got, want) in apply_p(shape, &c).iter().zip(&samples) {
            assert!(
                (got - f64::from(*want)).abs() < f64::from(TOLERANCE),
                "{shape:?}: {got} {want}"
            );
        }
    }

    #[test]
    fn coefficients_reproduce_the_samples() {
        for shape in
            [&[1][..], &[2], &[5], &[300], &[1, 9], &[40, 1], &[33, 150], &[3, 5, 2], &[2, 2, 2, 3]]
        {
            check(shape);
        }
    }

    #[test]
    fn mirror_is_whole_sample_symmetric() {
        let got: Vec<usize> = (-5..9).map(|i| mirror(i, 4)).collect();
        assert_eq!(got, [1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!(mirror(-3, 1), 0);
    }
}
