use super::{Simd, SimdKernel, dispatch_simd};

/// Numbers that are summed side by side before they are added up.
const LANES: usize = 16;

/// `y = h w^T` for few columns: `h` has rows of `stride` (a multiple of 16), `w` has `outputs` rows of
/// `stride`, `y` gets rows of `outputs`.
///
/// # Panics
/// If the lengths do not match.
pub(crate) fn thin_product(h: &[f32], w: &[f32], stride: usize, outputs: usize, y: &mut [f32]) {
    let rows = h.len() / stride;
    assert!(stride % LANES == 0 && h.len() == rows * stride, "{} in rows of {stride}", h.len());
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
        let rows = self.h.chunks_exact(self.stride).zip(self.y.chunks_exact_mut(self.outputs));
        for (h, y) in rows {
            for (y, w) in y.iter_mut().zip(self.w.chunks_exact(self.stride)) {
                let mut sums = [0.0f32; LANES];
                for (h, w) in h.chunks_exact(LANES).zip(w.chunks_exact(LANES)) {
                    for l in 0..LANES {
                        sums[l] = S::fma(h[l], w[l], sums[l]);
                    }
                }
                *y = total(sums);
            }
        }
    }
}

/// The sum in the order of a tree.
#[inline(always)]
fn total(v: [f32; LANES]) -> f32 {
    let mut eight = [0.0; 8];
    (0..8).for_each(|l| eight[l] = v[l] + v[l + 8]);
    let mut four = [0.0; 4];
    (0..4).for_each(|l| four[l] = eight[l] + eight[l + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_products_match_the_definition() {
        let numbers =
            |n: usize| (0..n).map(|i| ((i * 37) % 211) as f32 / 105.0 - 1.0).collect::<Vec<_>>();
        for (rows, stride, outputs) in [(1, 16, 1), (7, 48, 3), (5, 64, 4), (0, 16, 2)] {
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
        }
    }
}
