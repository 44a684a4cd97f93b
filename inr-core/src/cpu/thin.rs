use super::{Simd, SimdKernel, dispatch_simd};

/// `y = h w^T` for few columns: `h` has rows of `stride` (a multiple of 16), `w` has `outputs` rows of
/// `stride`, `y` gets rows of `outputs`.
///
/// # Panics
/// If the lengths do not match.
pub(crate) fn thin_product(h: &[f32], w: &[f32], stride: usize, outputs: usize, y: &mut [f32]) {
    let rows = h.len() / stride;
    assert!(
        stride.is_multiple_of(16) && h.len() == rows * stride,
        "{} in rows of {stride}",
        h.len()
    );
    assert!(w.len() == outputs * stride && y.len() == rows * outputs);
    dispatch_simd(Thin { h, w, stride, outputs, y });
}

struct Thin<'a> {
    h: &'a [f32],
    w: &'a [f32],
    stride: usize,
    outputs: usize,
    y: &'a mut [f32],
}

impl SimdKernel for Thin<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { h, w, stride, outputs, y } = self;
        for (h, y) in h.chunks_exact(stride).zip(y.chunks_exact_mut(outputs)) {
            for (w, y) in w.chunks(4 * stride).zip(y.chunks_mut(4)) {
                // SAFETY: rows are `stride` long, whole vectors; `w` has a row for each element of `y`; `S`
                // is the unit this kernel was compiled for.
                unsafe {
                    match y.len() {
                        1 => dots::<S, 1>(h, w, y),
                        2 => dots::<S, 2>(h, w, y),
                        3 => dots::<S, 3>(h, w, y),
                        _ => dots::<S, 4>(h, w, y),
                    }
                }
            }
        }
    }
}

/// The products of one row of `h` with `N` rows of `w`.
///
/// # Safety
/// `w` must hold `N` rows as long as `h`, which must be whole vectors; `y` must hold `N` numbers.
#[inline(always)]
unsafe fn dots<S: Simd, const N: usize>(h: &[f32], w: &[f32], y: &mut [f32]) {
    // SAFETY: the caller vouches for the lengths.
    unsafe {
        let mut sums = [S::splat(0.0); N];
        for k in (0..h.len()).step_by(S::LANES) {
            let x = S::load(h.as_ptr().add(k));
            for n in 0..N {
                let w = S::load(w.as_ptr().add(n * h.len() + k));
                sums[n] = S::mul_add(x, w, sums[n]);
            }
        }
        for n in 0..N {
            *y.as_mut_ptr().add(n) = S::sum(sums[n]);
        }
    }
}

/// Adds every row of `rows` to `sum`, whose length is a multiple of 16.
///
/// # Panics
/// If the lengths do not match.
pub(crate) fn add_rows(rows: &[f32], sum: &mut [f32]) {
    assert!(sum.len().is_multiple_of(16) && rows.len().is_multiple_of(sum.len().max(1)));
    dispatch_simd(AddRows { rows, sum });
}

struct AddRows<'a> {
    rows: &'a [f32],
    sum: &'a mut [f32],
}

impl SimdKernel for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let (rows, stride) = (self.rows, self.sum.len());
        for j in (0..stride).step_by(S::LANES) {
            // SAFETY: rows and their sum are `stride` long, whole vectors; `S` is the unit this kernel was
            // compiled for.
            unsafe {
                let one = S::splat(1.0);
                let mut sum = S::load(self.sum.as_ptr().add(j));
                for at in (j..rows.len()).step_by(stride) {
                    sum = S::mul_add(one, S::load(rows.as_ptr().add(at)), sum);
                }
                S::store(self.sum.as_mut_ptr().add(j), sum);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_products_match_the_definition() {
        let numbers =
            |n: usize| (0..n).map(|i| ((i * 37) % 211) as f32 / 105.0 - 1.0).collect::<Vec<_>>();
        for (rows, stride, outputs) in [(1, 16, 1), (7, 48, 3), (5, 64, 4), (3, 32, 7), (0, 16, 2)]
        {
            let (h, w) = (numbers(rows * stride), numbers(outputs * stride));
            let mut y = vec![9.0; rows * outputs];
            thin_product(&h, &w, stride, outputs, &mut y);
            for (i, y) in y.iter().enumerate() {
                let (row, c) = (i / outputs * stride, i % outputs * stride);
                let want: f64 =
                    (0..stride).map(|k| f64::from(h[row + k]) * f64::from(w[c + k])).sum();
                // Sums of 64 products below 1: observed 1e-6.
                assert!((f64::from(*y) - want).abs() < 1e-5);
            }
            let mut sum = vec![1.0; stride];
            add_rows(&h, &mut sum);
            for (j, sum) in sum.iter().enumerate() {
                let want: f64 = 1.0 + (0..rows).map(|i| f64::from(h[i * stride + j])).sum::<f64>();
                assert!((f64::from(*sum) - want).abs() < 1e-5);
            }
        }
    }
}
