use super::{Simd, SimdKernel, dispatch_simd};

/// What a [`Product`] is added to.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Start<'a> {
    /// Nothing.
    Zero,
    /// What the result holds already.
    Result,
    /// The same row everywhere: a bias.
    Row(&'a [f32]),
}

/// A small dense matrix product, `c = start + a b`, in f32.
///
/// `b` and `c` are row-major with a multiple of 16 columns. Entry (i, k) of `a`
/// is at `i * a_row + k * a_step`, so that a transposed matrix is one with its strides exchanged.
/// One sum runs over `k` in order, so the result does not depend on how the rows are blocked.
pub(crate) struct Product<'a> {
    /// Rows of `a` and `c`, columns of `b` and `c`, and the length of each sum.
    pub shape: [usize; 3],
    pub a: &'a [f32],
    pub a_row: usize,
    pub a_step: usize,
    pub b: &'a [f32],
    pub b_row: usize,
    pub c: &'a mut [f32],
    pub c_row: usize,
    pub start: Start<'a>,
}

/// Computes it.
///
/// # Panics
/// If a slice is shorter than its shape asks for.
#[inline]
pub(crate) fn product(p: &mut Product<'_>) {
    let [rows, columns, depth] = p.shape;
    if rows == 0 || columns == 0 {
        return;
    }
    assert!(columns % 16 == 0, "{columns} columns are not whole vectors");
    assert!(depth == 0 || (rows - 1) * p.a_row + (depth - 1) * p.a_step < p.a.len());
    assert!(depth == 0 || (depth - 1) * p.b_row + columns <= p.b.len());
    assert!((rows - 1) * p.c_row + columns <= p.c.len() && (rows == 1 || p.c_row >= columns));
    if let Start::Row(row) = p.start {
        assert!(row.len() >= columns);
    }
    dispatch_simd(p);
}

impl SimdKernel for &mut Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let columns = self.shape[1];
        let mut j = 0;
        // SAFETY: `product` has checked that every row of every matrix lies within its slice, and
        // a strip never reaches beyond `columns`; `S` is the unit this kernel was compiled for.
        unsafe {
            while j < columns {
                let left = ((columns - j) / S::LANES).min(S::VECTORS);
                j += S::LANES
                    * match left {
                        1 => strip::<S, 1>(self, j),
                        2 => strip::<S, 2>(self, j),
                        3 => strip::<S, 3>(self, j),
                        _ => strip::<S, 4>(self, j),
                    };
            }
        }
    }
}

/// `V` vectors of columns from column `j` on, all rows; returns `V`.
///
/// # Safety
/// As in [`product`].
#[inline(always)]
unsafe fn strip<S: Simd, const V: usize>(p: &mut Product<'_>, j: usize) -> usize {
    let rows = p.shape[0];
    let mut i = 0;
    // SAFETY: blocks end at `rows`.
    unsafe {
        while i < rows {
            let left = rows - i;
            // The numbers of `Simd::ROWS` and what remains after them.
            i += match left.min(S::ROWS[V - 1]) {
                14.. => block::<S, 14, V>(p, i, j),
                12.. => block::<S, 12, V>(p, i, j),
                10.. => block::<S, 10, V>(p, i, j),
                8.. => block::<S, 8, V>(p, i, j),
                6.. => block::<S, 6, V>(p, i, j),
                4.. => block::<S, 4, V>(p, i, j),
                3 => block::<S, 3, V>(p, i, j),
                2 => block::<S, 2, V>(p, i, j),
                _ => block::<S, 1, V>(p, i, j),
            };
        }
    }
    V
}

/// `M` rows and `V` vectors of columns, held in registers over the whole sum; returns `M`.
///
/// # Safety
/// As in [`product`].
#[inline(always)]
unsafe fn block<S: Simd, const M: usize, const V: usize>(
    p: &mut Product<'_>,
    i: usize,
    j: usize,
) -> usize {
    if V > S::VECTORS || M > S::ROWS[V - 1] {
        // Never called; keeps the compiler from making it.
        return M;
    }
    // SAFETY: the caller vouches for the bounds.
    unsafe {
        let c = p.c.as_mut_ptr().add(i * p.c_row + j);
        let mut sums = [[S::splat(0.0); V]; M];
        match p.start {
            Start::Zero => {}
            Start::Result => {
                for m in 0..M {
                    for v in 0..V {
                        sums[m][v] = S::load(c.add(m * p.c_row + v * S::LANES));
                    }
                }
            }
            Start::Row(row) => {
                for v in 0..V {
                    let bias = S::load(row.as_ptr().add(j + v * S::LANES));
                    for m in 0..M {
                        sums[m][v] = bias;
                    }
                }
            }
        }
        let (mut a, mut b) = (p.a.as_ptr().wrapping_add(i * p.a_row), p.b.as_ptr().wrapping_add(j));
        for _ in 0..p.shape[2] {
            let mut columns = [S::splat(0.0); V];
            for v in 0..V {
                columns[v] = S::load(b.add(v * S::LANES));
            }
            for m in 0..M {
                let x = S::splat(*a.add(m * p.a_row));
                for v in 0..V {
                    sums[m][v] = S::mul_add(x, columns[v], sums[m][v]);
                }
            }
            (a, b) = (a.wrapping_add(p.a_step), b.wrapping_add(p.b_row));
        }
        for m in 0..M {
            for v in 0..V {
                S::store(c.add(m * p.c_row + v * S::LANES), sums[m][v]);
            }
        }
    }
    M
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of 70 products of numbers below 1: observed 2e-6.
    const TOLERANCE: f64 = 1e-5;

    fn numbers(n: usize, seed: u64) -> Vec<f32> {
        (0..n as u64).map(|i| ((i * 37 + seed * 101) % 211) as f32 / 105.0 - 1.0).collect()
    }

    #[test]
    fn every_shape_matches_the_definition() {
        for (rows, columns, depth) in
            [(1, 16, 1), (7, 64, 2), (37, 48, 33), (14, 32, 70), (23, 80, 5), (3, 16, 0)]
        {
            for transposed in [false, true] {
                let (a, b) = (numbers(rows * depth, 1), numbers(columns * depth, 2));
                let (a_row, a_step) = if transposed { (1, rows) } else { (depth, 1) };
                let (bias, before) = (numbers(columns, 3), numbers(rows * columns, 4));
                for start in [Start::Zero, Start::Result, Start::Row(&bias)] {
                    let mut c = before.clone();
                    product(&mut Product {
                        shape: [rows, columns, depth],
                        a: &a,
                        a_row,
                        a_step,
                        b: &b,
                        b_row: columns,
                        c: &mut c,
                        c_row: columns,
                        start,
                    });
                    for i in 0..rows {
                        for j in 0..columns {
                            let first = match start {
                                Start::Zero => 0.0,
                                Start::Result => before[i * columns + j],
                                Start::Row(row) => row[j],
                            };
                            let want = (0..depth).fold(f64::from(first), |sum, k| {
                                let x = f64::from(a[i * a_row + k * a_step]);
                                sum + x * f64::from(b[k * columns + j])
                            });
                            let error = (f64::from(c[i * columns + j]) - want).abs();
                            assert!(error < TOLERANCE, "({i}, {j}) of {rows}x{columns}: {error}");
                        }
                    }
                }
            }
        }
    }
}
