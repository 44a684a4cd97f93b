//! The system of all separators: block tridiagonal, solved in order.

use super::system::{Block, Ends, SEPARATOR};

type Three = [f64; SEPARATOR];

/// The separators' values for one right-hand side (an entry per piece: what its own and the
/// previous piece give), and the squared norms of the residual and of the right-hand side.
pub struct Separators {
    /// Inverse of the pivot block of every piece.
    inverse: Vec<Block>,
    /// `ends` of every piece, in order.
    ends: Vec<Ends>,
}

impl Separators {
    pub fn new(ends: Vec<Ends>) -> Self {
        let mut inverse: Vec<Block> = Vec::with_capacity(ends.len());
        for (k, own) in ends.iter().enumerate() {
            let mut pivot = own.left;
            if k > 0 {
                let before = &ends[k - 1];
                let carried = product(&inverse[k - 1], &before.across);
                for i in 0..SEPARATOR {
                    for j in 0..SEPARATOR {
                        let through: f64 =
                            (0..SEPARATOR).map(|m| before.across[m][i] * carried[m][j]).sum();
                        pivot[i][j] += before.right[i][j] - through;
                    }
                }
            }
            inverse.push(inverted(&pivot));
        }
        Self { inverse, ends }
    }

    /// Solves in place; returns the relative residual.
    pub fn solve(&self, b: &mut [Three]) -> f64 {
        let rhs = b.to_vec();
        for k in 1..b.len() {
            let carried = times(&self.inverse[k - 1], &b[k - 1]);
            for i in 0..SEPARATOR {
                b[k][i] -=
                    (0..SEPARATOR).map(|m| self.ends[k - 1].across[m][i] * carried[m]).sum::<f64>();
            }
        }
        for k in (0..b.len()).rev() {
            if k + 1 < b.len() {
                let next = times(&self.ends[k].across, &b[k + 1]);
                (0..SEPARATOR).for_each(|i| b[k][i] -= next[i]);
            }
            b[k] = times(&self.inverse[k], &b[k]);
        }
        self.residual(&rhs, b)
    }

    fn residual(&self, rhs: &[Three], x: &[Three]) -> f64 {
        let (mut start, mut end) = (0.0f64, 0.0f64);
        for k in 0..x.len() {
            let mut r = rhs[k];
            let own = times(&self.ends[k].left, &x[k]);
            (0..SEPARATOR).for_each(|i| r[i] -= own[i]);
            if k + 1 < x.len() {
                let next = times(&self.ends[k].across, &x[k + 1]);
                (0..SEPARATOR).for_each(|i| r[i] -= next[i]);
            }
            if k > 0 {
                let Ends { across, right, .. } = &self.ends[k - 1];
                let shared = times(right, &x[k]);
                for i in 0..SEPARATOR {
                    let back: f64 = (0..SEPARATOR).map(|m| across[m][i] * x[k - 1][m]).sum();
                    r[i] -= shared[i] + back;
                }
            }
            start += rhs[k].iter().map(|v| v * v).sum::<f64>();
            end += r.iter().map(|v| v * v).sum::<f64>();
        }
        if start > 0.0 { (end / start).sqrt() } else { 0.0 }
    }
}

fn times(a: &Block, x: &Three) -> Three {
    std::array::from_fn(|i| (0..SEPARATOR).map(|j| a[i][j] * x[j]).sum())
}

fn product(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..SEPARATOR).map(|m| a[i][m] * b[m][j]).sum())
    })
}

/// The inverse of a symmetric positive definite block, by its Cholesky factor.
fn inverted(a: &Block) -> Block {
    let mut l = [[0.0f64; SEPARATOR]; SEPARATOR];
    for j in 0..SEPARATOR {
        for i in j..SEPARATOR {
            let dot: f64 = (0..j).map(|m| l[i][m] * l[j][m]).sum();
            let v = 0.5 * (a[i][j] + a[j][i]) - dot;
            // 1e-300: as for the pivots of the interior.
            l[i][j] = if i == j { v.max(1e-300).sqrt() } else { v / l[j][j] };
        }
    }
    let mut inverse = [[0.0; SEPARATOR]; SEPARATOR];
    for column in 0..SEPARATOR {
        let mut x = [0.0f64; SEPARATOR];
        for i in 0..SEPARATOR {
            let known: f64 = (0..i).map(|m| l[i][m] * x[m]).sum();
            x[i] = (f64::from(u8::from(i == column)) - known) / l[i][i];
        }
        for i in (0..SEPARATOR).rev() {
            let known: f64 = (i + 1..SEPARATOR).map(|m| l[m][i] * x[m]).sum();
            x[i] = (x[i] - known) / l[i][i];
        }
        (0..SEPARATOR).for_each(|i| inverse[i][column] = x[i]);
    }
    inverse
}
