use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cpu::{Kernel, dispatch};

/// How parameters are drawn towards zero.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", content = "weight", rename_all = "kebab-case")]
pub enum Decay {
    /// They are not.
    #[default]
    None,
    /// `weight * parameter` is added to the gradient: what Adam's `weight_decay` means in PyTorch.
    Coupled(f32),
    /// `rate * weight * parameter` is taken off at each step. Source: Loshchilov and Hutter 2019, algorithm 2.
    Decoupled(f32),
}

/// The optimiser Adam: its constants and its moments.
///
/// Source: Kingma and Ba 2015, algorithm 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    /// Decay of the first moment, 0..1.
    pub beta1: f32,
    /// Decay of the second moment, 0..1.
    pub beta2: f32,
    /// Added to the root of the second moment; keeps the step finite where a parameter never had a gradient.
    pub epsilon: f32,
    /// How parameters are drawn towards zero.
    pub decay: Decay,
    /// Steps taken.
    pub steps: u64,
    /// Means of the gradient and of its square, one per parameter, not yet corrected for their start at zero.
    pub moments: [Vec<f32>; 2],
}

/// Parameters per task.
const CHUNK: usize = 1 << 14;

impl Adam {
    /// An optimiser for `len` parameters that has not taken a step.
    pub fn new(len: usize, beta1: f32, beta2: f32, epsilon: f32, decay: Decay) -> Self {
        Self { beta1, beta2, epsilon, decay, steps: 0, moments: [vec![0.0; len], vec![0.0; len]] }
    }

    /// Takes one step: `rates` are the ends of groups of parameters, in order, each with its learning rate.
    ///
    /// Linear in the parameters; the same bits for any number of threads.
    ///
    /// # Panics
    /// If the lengths differ or the groups do not end with the parameters.
    pub fn step(&mut self, params: &mut [f32], gradient: &[f32], rates: &[(usize, f32)]) {
        let n = params.len();
        assert!(gradient.len() == n && self.moments.iter().all(|m| m.len() == n));
        assert_eq!(rates.last().map(|r| r.0), Some(n), "groups end with the parameters");
        self.steps += 1;
        // The corrections of both moments, eq. in algorithm 1; i32 is enough, both are 1 long before.
        let power = |beta: f32| 1.0 - f64::from(beta).powi(self.steps.min(1 << 30) as i32);
        let (first, second) = (power(self.beta1), power(self.beta2));
        let mut begin = 0;
        for (end, rate) in rates.iter().copied() {
            let group = begin..end;
            begin = end;
            let constants = Constants {
                beta1: self.beta1,
                beta2: self.beta2,
                epsilon: self.epsilon,
                step: (f64::from(rate) / first) as f32,
                correction: (1.0 / second) as f32,
                coupled: if let Decay::Coupled(w) = self.decay { w } else { 0.0 },
                kept: if let Decay::Decoupled(w) = self.decay { 1.0 - rate * w } else { 1.0 },
            };
            let [m, v] = &mut self.moments;
            params[group.clone()]
                .par_chunks_mut(CHUNK)
                .zip(gradient[group.clone()].par_chunks(CHUNK))
                .zip(m[group.clone()].par_chunks_mut(CHUNK).zip(v[group].par_chunks_mut(CHUNK)))
                .for_each(|((params, gradient), (m, v))| {
                    dispatch(Step { constants, params, gradient, m, v });
                });
        }
    }
}

#[derive(Clone, Copy)]
struct Constants {
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    step: f32,
    correction: f32,
    coupled: f32,
    kept: f32,
}

struct Step<'a> {
    constants: Constants,
    params: &'a mut [f32],
    gradient: &'a [f32],
    m: &'a mut [f32],
    v: &'a mut [f32],
}

impl Kernel for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (n, c) = (self.params.len(), self.constants);
        let (params, gradient) = (&mut self.params[..n], &self.gradient[..n]);
        let (m, v) = (&mut self.m[..n], &mut self.v[..n]);
        for i in 0..n {
            let g = gradient[i] + c.coupled * params[i];
            m[i] = c.beta1 * m[i] + (1.0 - c.beta1) * g;
            v[i] = c.beta2 * v[i] + (1.0 - c.beta2) * (g * g);
            let step = c.step * m[i] / ((v[i] * c.correction).sqrt() + c.epsilon);
            params[i] = c.kept * params[i] - step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The algorithm as printed, in f64.
    fn plain(decay: Decay, rates: [f64; 2], gradients: &[[f64; 2]]) -> [f64; 2] {
        let (b1, b2, eps) = (0.9f64, 0.99f64, 1e-8f64);
        let (mut p, mut m, mut v) = ([1.0, -2.0], [0.0; 2], [0.0; 2]);
        for (t, g) in gradients.iter().enumerate() {
            for i in 0..2 {
                let mut g = g[i];
                match decay {
                    Decay::Coupled(w) => g += f64::from(w) * p[i],
                    Decay::Decoupled(w) => p[i] -= rates[i] * f64::from(w) * p[i],
                    Decay::None => {}
                }
                m[i] = b1 * m[i] + (1.0 - b1) * g;
                v[i] = b2 * v[i] + (1.0 - b2) * g * g;
                let t = t as i32 + 1;
                let (mh, vh) = (m[i] / (1.0 - b1.powi(t)), v[i] / (1.0 - b2.powi(t)));
                p[i] -= rates[i] * mh / (vh.sqrt() + eps);
            }
        }
        p
    }

    #[test]
    fn steps_follow_the_algorithm() {
        let gradients: Vec<[f64; 2]> =
            (0..50).map(|t| [(t as f64).sin() + 0.2, 3.0 * (0.3 * t as f64).cos()]).collect();
        for decay in [Decay::None, Decay::Coupled(0.1), Decay::Decoupled(0.1)] {
            let mut adam = Adam::new(2, 0.9, 0.99, 1e-8, decay);
            let mut params = [1.0f32, -2.0];
            for g in &gradients {
                adam.step(&mut params, &g.map(|g| g as f32), &[(1, 1e-2), (2, 3e-2)]);
            }
            let want = plain(decay, [1e-2, 3e-2], &gradients);
            for i in 0..2 {
                // 50 steps of f32 rounding.
                assert!(
                    (f64::from(params[i]) - want[i]).abs() < 1e-5,
                    "{decay:?} {params:?} {want:?}"
                );
            }
        }
    }
}
