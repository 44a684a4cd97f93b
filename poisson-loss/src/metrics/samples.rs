//! Sums over samples: distances between results, and the range of values.

use inr_core::Samples;
use rayon::prelude::*;

use super::mean;
use super::scene::Scene;
use crate::Problem;

pub struct OnSamples {
    pub to_exact: Option<f64>,
    pub inside: Option<f64>,
    pub psnr_outside: f64,
    pub outside_unit_range: f64,
}

/// Everything that differs lies in the scene's box.
pub fn compare<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    problem: &Problem<'_, D, C>,
    result: &Samples<D, C>,
    exact: Option<&Samples<D, C>>,
) -> OnSamples {
    let (plan, channels) = (&scene.plan, C as f64);
    let difference = |a: f32, b: f32| (f64::from(a) - f64::from(b)).powi(2);
    let squares = |k: usize, other: &Samples<D, C>| -> f64 {
        (0..C).map(|c| difference(result.plane(c)[k], other.plane(c)[k])).sum()
    };
    let in_range = |k: usize| (0..C).all(|c| (0.0..=1.0).contains(&result.plane(c)[k]));
    let [outside, clipped] = sum(scene, |k, m| {
        [(1.0 - m) * squares(k, problem.background), if in_range(k) { 0.0 } else { m }]
    });
    let to_exact = exact.map(|exact| sum(scene, |k, m| [squares(k, exact), m * squares(k, exact)]));
    let total = plan.total as f64;
    OnSamples {
        to_exact: to_exact.map(|s| mean(s[0], channels * total).sqrt()),
        inside: to_exact.map(|s| mean(s[1], channels * plan.measure).sqrt()),
        psnr_outside: -10.0 * mean(outside, channels * (total - plan.measure)).log10(),
        outside_unit_range: clipped / plan.measure,
    }
}

/// Two sums over the box's samples: `term` takes the flat index in the background and the region
/// weight. The order is fixed: samples of a row, then rows.
fn sum<const D: usize, const C: usize>(
    scene: &Scene<'_, D, C>,
    term: impl Fn(usize, f64) -> [f64; 2] + Sync,
) -> [f64; 2] {
    let (n0, whole) = (scene.shape[0], scene.whole());
    let rows: Vec<[f64; 2]> = scene
        .region
        .par_chunks(n0)
        .enumerate()
        .map(|(row, region)| {
            let (mut rest, mut at, mut stride) = (row, scene.start[0], whole[0]);
            for d in 1..D {
                at += (scene.start[d] + rest % scene.shape[d]) * stride;
                rest /= scene.shape[d];
                stride *= whole[d];
            }
            region.iter().enumerate().fold([0.0; 2], |sum, (i, m)| {
                let t = term(at + i, f64::from(*m));
                [sum[0] + t[0], sum[1] + t[1]]
            })
        })
        .collect();
    rows.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
}
