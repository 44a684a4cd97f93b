//! The interpolating prefilter of the cubic B-spline: from samples to coefficients and back.
//!
//! Along every axis `samples = P coefficients` with `P = [1 4 1] / 6` and whole-sample mirror
//! extension. The inverse is a causal and an anticausal one-pole recursion (Unser, Aldroubi and
//! Eden 1993). Both directions start [`WARM_UP`] samples outside the piece they produce, so that
//! pieces are independent of one another.

use rayon::prelude::*;

/// The pole of the inverse of `[1 4 1] / 6`: `sqrt(3) - 2`.
const POLE: f32 = -0.267_949_2;

/// Samples run through before a piece begins: `|POLE|^16 = 7e-10`, far below f32 rounding.
const WARM_UP: usize = 16;

/// Lines, or samples side by side, that one recursion carries at once.
const LANES: usize = 32;

/// Samples along the filtered axis in one piece of an axis that is not contiguous.
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
    let task = shape[0] * LANES;
    if in_other {
        let lines = data.par_chunks_mut(task).zip(other.par_chunks(task));
        lines.for_each_init(Vec::new, |b, (dst, src)| {
            dst.copy_from_slice(src);
            filter_lines(shape[0], dst, b);
        });
    } else {
        data.par_chunks_mut(task)
            .for_each_init(Vec::new, |b, lines| filter_lines(shape[0], lines, b));
    }
}

/// Filters an axis of `n` samples with stride `inner`, from `src` into `dst`.
fn filter_axis(n: usize, inner: usize, src: &[f32], dst: &mut [f32]) {
    dst.par_chunks_mut(n * inner).zip(src.par_chunks(n * inner)).for_each(|(dst, src)| {
        dst.par_chunks_mut(PIECE * inner).enumerate().for_each_init(Vec::new, |b, (k, piece)| {
            filter_piece(n, inner, k * PIECE, src, piece, b);
        });
    });
}

/// Filters up to [`LANES`] contiguous lines of length `n` side by side, in place.
fn filter_lines(n: usize, lines: &mut [f32], block: &mut Vec<[f32; LANES]>) {
    if n == 1 {
        return;
    }
    block.clear();
    block.resize(n + 2 * WARM_UP, [0.0; LANES]);
    for (lane, line) in lines.chunks_exact(n).enumerate() {
        for (row, v) in block[WARM_UP..].iter_mut().zip(line) {
            row[lane] = *v;
        }
    }
    for k in 0..WARM_UP {
        block[k] = block[WARM_UP + mirror(k as isize - WARM_UP as isize, n)];
        block[n + WARM_UP + k] = block[WARM_UP + mirror((n + k) as isize, n)];
    }
    recurse(block);
    for (lane, line) in lines.chunks_exact_mut(n).enumerate() {
        for (row, v) in block[WARM_UP..].iter().zip(line) {
            *v = row[lane];
        }
    }
}

/// Filters samples `start..` of an axis with stride `inner` into `piece`.
fn filter_piece(
    n: usize,
    inner: usize,
    start: usize,
    src: &[f32],
    piece: &mut [f32],
    block: &mut Vec<[f32; LANES]>,
) {
    let len = piece.len() / inner;
    block.resize(len + 2 * WARM_UP, [0.0; LANES]);
    for left in (0..inner).step_by(LANES) {
        let width = LANES.min(inner - left);
        for (k, row) in block.iter_mut().enumerate() {
            let i = mirror((start + k) as isize - WARM_UP as isize, n);
            copy_row(&src[i * inner + left..][..width], &mut row[..width]);
        }
        recurse(block);
        for (k, row) in block[WARM_UP..WARM_UP + len].iter().enumerate() {
            copy_row(&row[..width], &mut piece[k * inner + left..][..width]);
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
fn recurse(block: &mut [[f32; LANES]]) {
    let last = block.len() - 1;
    for k in 0..=last {
        let before = if k == 0 { [0.0; LANES] } else { block[k - 1] };
        for lane in 0..LANES {
            block[k][lane] = 6.0 * block[k][lane] + POLE * before[lane];
        }
    }
    // The anticausal start for a signal that is zero beyond the block; any start decays anyway.
    for lane in 0..LANES {
        block[last][lane] *= -POLE;
    }
    for k in (0..last).rev() {
        let after = block[k + 1];
        for lane in 0..LANES {
            block[k][lane] = POLE * (after[lane] - block[k][lane]);
        }
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
