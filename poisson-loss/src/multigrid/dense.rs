//! The coarsest level, solved directly.

use super::Level;

/// A small level's Cholesky factor, in f64.
pub struct Dense {
    n: usize,
    lower: Vec<f64>,
    volume: Vec<f64>,
}

impl Dense {
    pub fn factor<const D: usize>(level: &Level<D>) -> Self {
        let (n, n0) = (level.len(), level.axes[0].len());
        let volume: Vec<f64> = (0..n)
            .map(|k| f64::from(level.volume_row(k / n0)) * f64::from(level.axes[0].volume[k % n0]))
            .collect();
        let (mut unit, mut column, mut a) = (vec![0.0f32; n], vec![0.0f32; n], vec![0.0f64; n * n]);
        for j in 0..n {
            unit.fill(0.0);
            unit[j] = 1.0;
            level.apply(&unit, &mut column);
            for i in 0..n {
                a[i * n + j] = volume[i] * f64::from(column[i]);
            }
        }
        for j in 0..n {
            let pivot = a[j * n + j] - (0..j).map(|k| a[j * n + k].powi(2)).sum::<f64>();
            // Without any screening the constant is free: a tiny pivot then leaves it at zero.
            let pivot = if pivot > 1e-7 * a[j * n + j] { pivot.sqrt() } else { f64::INFINITY };
            a[j * n + j] = pivot;
            for i in j + 1..n {
                let off = 0.5 * (a[i * n + j] + a[j * n + i]);
                let dot: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
                a[i * n + j] = (off - dot) / pivot;
            }
        }
        Self { n, lower: a, volume }
    }

    pub fn solve(&self, f: &[f32], u: &mut [f32]) {
        let n = self.n;
        let mut x: Vec<f64> = (0..n).map(|i| self.volume[i] * f64::from(f[i])).collect();
        for i in 0..n {
            let dot: f64 = (0..i).map(|k| self.lower[i * n + k] * x[k]).sum();
            x[i] = (x[i] - dot) / self.lower[i * n + i];
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| self.lower[k * n + i] * x[k]).sum();
            x[i] = (x[i] - dot) / self.lower[i * n + i];
        }
        for i in 0..n {
            u[i] = x[i] as f32;
        }
    }
}
