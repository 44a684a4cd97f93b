//! Copy and paste: no solve at all.

use super::{report, row_starts};
use crate::inputs::{not_finite, sample_patch};
use crate::problem::Support;
use crate::{Blend, Problem, Result};

pub fn solve<const D: usize, const C: usize>(
    problem: &Problem<'_, D, C>,
    support: &Support<D>,
) -> Result<Blend<D, C>> {
    let (start, shape) = (support.start, support.shape);
    problem.background.check_finite().map_err(|e| not_finite("background", e))?;
    let (patch, _) = sample_patch(problem, start, shape)?;
    let mut samples = problem.background.clone();
    let whole = samples.domain().shape();
    for c in 0..C {
        let plane = samples.plane_mut(c);
        for (row, at) in row_starts(start, shape, whole).enumerate() {
            let local = row * shape[0]..(row + 1) * shape[0];
            let (patch, weight) = (&patch[c][local.clone()], &support.weight[local]);
            for ((s, t), m) in plane[at..at + shape[0]].iter_mut().zip(patch).zip(weight) {
                match *m {
                    0.0 => {}
                    1.0 => *s = *t, // Exactly the patch: the line below rounds.
                    m => *s += m * (t - *s),
                }
            }
        }
    }
    Ok(Blend { samples, report: report(support, start, shape) })
}

#[cfg(test)]
mod tests {
    use inr_core::{BoxRegion, Domain, RasterMask, Samples};

    use crate::{Baseline, Guidance, Options, Patch, Problem, solve_baseline};

    #[test]
    fn hard_masks_copy_and_soft_masks_mix() {
        let domain = Domain::unit([5, 4]).unwrap();
        let background = Samples::<2, 2>::from_fn(domain, |x| [x[0], 0.1 * x[1]]);
        let small = Domain::unit([3, 2]).unwrap();
        let patch = Samples::from_fn(small, |x| [10.0 + x[0], -x[1]]);
        let weights = vec![1.0, 0.25, 0.0, 1.0, 1.0, 0.5];
        let mask = RasterMask::new(small, weights.clone()).unwrap();
        let region = inr_core::Translated { region: mask, offset: [1.0, 2.0] };
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [1.0, 2.0] },
            region: &region,
            guidance: Guidance::Patch,
            options: Options::default(),
        };
        let blend = solve_baseline(&problem, Baseline::Paste).unwrap();
        for c in 0..2 {
            for (k, got) in blend.samples.plane(c).iter().enumerate() {
                let i = domain.unflatten(k);
                let s = background.plane(c)[k];
                let inside = (1..4).contains(&i[0]) && i[1] >= 2;
                let at = if inside { (i[0] - 1) + 3 * (i[1] - 2) } else { 0 };
                let m = if inside { weights[at] } else { 0.0 };
                let want = (1.0 - m) * s + m * patch.plane(c)[at];
                // One rounding of values up to 12.
                assert!((got - want).abs() < 2e-6, "{i:?}: {got} against {want}");
            }
        }
    }

    #[test]
    fn a_region_that_covers_everything_is_the_patch() {
        let domain = Domain::unit([6]).unwrap();
        let background = Samples::<1, 1>::from_fn(domain, |x| [x[0]]);
        let patch = Samples::<1, 1>::from_fn(domain, |x| [7.0 - x[0] * x[0]]);
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: [0.0] },
            region: &BoxRegion::new([-1.0], [9.0]).unwrap(),
            guidance: Guidance::Patch,
            options: Options::default(),
        };
        assert_eq!(solve_baseline(&problem, Baseline::Paste).unwrap().samples, patch);
    }
}
