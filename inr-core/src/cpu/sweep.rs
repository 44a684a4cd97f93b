use super::{Simd, SimdKernel, dispatch_simd};

/// `t_d = g z_d` for every plane `d` of `z`: the tangents after units with slopes `g`.
///
/// # Panics
/// If lengths do not match, or planes are not whole vectors of 16.
pub(crate) fn tangents(t: &mut [f32], g: &[f32], z: &[f32]) {
    check(g.len(), z.len());
    assert_eq!(t.len(), z.len(), "as many tangents before as after");
    dispatch_simd(Tangents { t, g, z });
}

/// One layer's part of the reverse sweep, in place: `bar` holds the cotangents of the units' outputs (a plane of
/// values, then one per tangent) and gets those of their weighted sums.
///
/// With the slopes `g = f'(u)` and curvatures `s = f''(u)`: `bar_u = g bar_h + s sum_d bar_t_d z_d`,
/// `bar_z_d = g bar_t_d`. `curvature` gives `s` as a factor times a plane; none where it is zero.
///
/// # Panics
/// If lengths do not match, or planes are not whole vectors of 16.
pub(crate) fn sweep(bar: &mut [f32], g: &[f32], z: &[f32], curvature: Option<(f32, &[f32])>) {
    check(g.len(), z.len());
    assert_eq!(bar.len(), g.len() + z.len(), "cotangents of values and tangents");
    assert!(curvature.is_none_or(|(_, s)| s.len() == g.len()));
    dispatch_simd(Sweep { bar, g, z, curvature });
}

fn check(plane: usize, planes: usize) {
    assert!(
        plane.is_multiple_of(16) && planes.is_multiple_of(plane.max(1)),
        "{planes} in planes of {plane}"
    );
}

struct Tangents<'a> {
    t: &'a mut [f32],
    g: &'a [f32],
    z: &'a [f32],
}

impl SimdKernel for Tangents<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let n = self.g.len();
        if n == 0 {
            return;
        }
        // Plane by plane: three streams, which the prefetcher follows; all planes at once was slower.
        for (t, z) in self.t.chunks_exact_mut(n).zip(self.z.chunks_exact(n)) {
            let (t, g, z) = (&mut t[..n], &self.g[..n], &z[..n]);
            (0..n).for_each(|i| t[i] = g[i] * z[i]);
        }
    }
}

struct Sweep<'a> {
    bar: &'a mut [f32],
    g: &'a [f32],
    z: &'a [f32],
    curvature: Option<(f32, &'a [f32])>,
}

impl SimdKernel for Sweep<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let n = self.g.len();
        let (bar, z) = (self.bar.as_mut_ptr(), self.z.as_ptr());
        let (factor, s) = self.curvature.unwrap_or((0.0, self.g));
        for i in (0..n).step_by(S::LANES) {
            // SAFETY: planes are `n` long, whole vectors, one more in `bar` than in `z`; `S` is the unit this
            // kernel was compiled for.
            unsafe {
                let g = S::load(self.g.as_ptr().add(i));
                let s = S::mul(S::splat(factor), S::load(s.as_ptr().add(i)));
                let mut value = S::mul(g, S::load(bar.add(i)));
                for at in (i..self.z.len()).step_by(n) {
                    let t = S::load(bar.add(n + at));
                    value = S::mul_add(s, S::mul(t, S::load(z.add(at))), value);
                    S::store(bar.add(n + at), S::mul(g, t));
                }
                S::store(bar.add(i), value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_follow_their_formulas() {
        let numbers = |n: usize, k: usize| {
            (0..n).map(|i| ((i * 37 + k) % 211) as f32 / 105.0 - 1.0).collect::<Vec<_>>()
        };
        for (n, tangent_planes) in [(16, 0), (48, 1), (32, 3), (0, 0)] {
            let (g, z, s) = (numbers(n, 1), numbers(n * tangent_planes, 2), numbers(n, 3));
            let mut t = z.clone();
            tangents(&mut t, &g, &z);
            for curvature in [None, Some((-2.5, &s[..]))] {
                let before = numbers(n * (1 + tangent_planes), 4);
                let mut bar = before.clone();
                sweep(&mut bar, &g, &z, curvature);
                for i in 0..n {
                    let mut value = g[i] * before[i];
                    for d in 0..tangent_planes {
                        let at = d * n + i;
                        assert_eq!(t[at], g[i] * z[at]);
                        assert_eq!(bar[n + at], g[i] * before[n + at]);
                        value += curvature.map_or(0.0, |(f, s)| f * s[i]) * before[n + at] * z[at];
                    }
                    // A few products of numbers below 3.
                    assert!((bar[i] - value).abs() < 1e-5);
                }
            }
        }
    }
}
