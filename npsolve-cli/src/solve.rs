//! From a scene to blended planes, for any number of channels.

use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use poisson_loss::{
    Blend, Error, Metrics, Options, Patch, Problem, Report, measure, solve_with_progress,
};

use crate::channels::{self, ChannelJob, with_channels};
use crate::scene::{Scene, samples_of};
use crate::values::GuidanceName;

/// How a scene is blended.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// The gradient to follow.
    pub guidance: GuidanceName,
    /// Functional, lengths, tolerance.
    pub options: Options,
}

/// A blended scene.
pub struct Solution {
    /// The colour channels, one plane after the other; not clamped.
    pub planes: Vec<f32>,
    /// What the solver did.
    pub report: Report,
    /// How good it is, if asked for.
    pub metrics: Option<Metrics>,
    /// Time of the solver alone.
    pub seconds: f64,
}

/// Blends all channels, in groups of at most [`channels::MOST`].
pub fn solve_scene(
    scene: &Scene,
    settings: &Settings,
    with_metrics: bool,
    progress: &mut (dyn FnMut(f32) + Send),
) -> Result<Solution> {
    let count = scene.channels();
    if count > channels::MOST && !settings.guidance.is_per_channel() {
        bail!(
            "{} has {count} channels, and --guidance {} looks at all of them together, which works \
             up to {}; take strongest:channel, patch, sum or mix:MU,PHI",
            scene.names[0],
            settings.guidance,
            channels::MOST
        );
    }
    let mut parts = Vec::new();
    for first in (0..count).step_by(channels::MOST) {
        let size = channels::MOST.min(count - first);
        let mut share = |s: f32| progress((first as f32 + s * size as f32) / count as f32);
        let job = Group { scene, settings, first, with_metrics, progress: &mut share };
        let part = with_channels(size, job)
            .ok_or_else(|| anyhow!("{} has no colour channels to blend", scene.names[0]))??;
        parts.push((size, part));
    }
    let solution = joined(parts)
        .ok_or_else(|| anyhow!("{} has no colour channels to blend", scene.names[0]))?;
    if solution.planes.iter().any(|v| !v.is_finite()) {
        bail!(
            "blending {} into {} exceeds the range of 32-bit floats; scale both down",
            scene.names[1],
            scene.names[0]
        );
    }
    Ok(solution)
}

/// Some neighbouring channels of a scene.
struct Group<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    first: usize,
    with_metrics: bool,
    progress: &'a mut (dyn FnMut(f32) + Send),
}

impl ChannelJob for Group<'_> {
    type Output = Result<Solution>;

    fn run<const C: usize>(self) -> Result<Solution> {
        let (background, patch) = (
            samples_of::<C>(&self.scene.background, self.first)?,
            samples_of::<C>(&self.scene.patch, self.first)?,
        );
        let region = self.scene.region();
        let problem = Problem {
            background: &background,
            patch: Patch::Samples { samples: &patch, offset: self.scene.offset },
            region: &region,
            guidance: self.settings.guidance.to_guidance::<C>(),
            options: self.settings.options,
        };
        let explain = |e| explain(e, self.scene);
        let start = Instant::now();
        let Blend { samples, report } =
            solve_with_progress(&problem, self.progress).map_err(explain)?;
        let seconds = start.elapsed().as_secs_f64();
        let metrics = match self.with_metrics {
            true => Some(measure(&problem, &samples, None).map_err(explain)?),
            false => None,
        };
        Ok(Solution { planes: samples.as_planar().to_vec(), report, metrics, seconds })
    }
}

/// One solution from those of groups of channels.
fn joined(parts: Vec<(usize, Solution)>) -> Option<Solution> {
    let mut parts = parts.into_iter();
    let (mut count, mut all) = parts.next()?;
    for (size, part) in parts {
        all.planes.extend(part.planes);
        all.seconds += part.seconds;
        all.report.iterations = all.report.iterations.max(part.report.iterations);
        all.report.residual = all.report.residual.max(part.report.residual);
        all.report.excess += part.report.excess;
        all.metrics = all.metrics.zip(part.metrics).map(|(a, b)| joined_metrics(count, a, size, b));
        count += size;
    }
    Some(all)
}

/// Metrics of `n` and `m` channels together. The share of samples outside the unit range is that of
/// the worse group, a lower bound.
fn joined_metrics(n: usize, a: Metrics, m: usize, b: Metrics) -> Metrics {
    let (n, m) = (n as f64, m as f64);
    let mean = |a: f64, b: f64| (n * a + m * b) / (n + m);
    let rms = |a: f64, b: f64| mean(a * a, b * b).sqrt();
    let noise = |decibels: f64| 10f64.powf(-0.1 * decibels);
    Metrics {
        m1: a.m1 + b.m1,
        m2: a.m2 + b.m2,
        m1_paper: mean(a.m1_paper, b.m1_paper),
        m2_paper: mean(a.m2_paper, b.m2_paper),
        objective: a.objective + b.objective,
        excess_energy: None,
        rmse_to_exact: a.rmse_to_exact.zip(b.rmse_to_exact).map(|(a, b)| rms(a, b)),
        rmse_inside: a.rmse_inside.zip(b.rmse_inside).map(|(a, b)| rms(a, b)),
        pde_inside: rms(a.pde_inside, b.pde_inside),
        pde_outside: rms(a.pde_outside, b.pde_outside),
        seam_rms: rms(a.seam_rms, b.seam_rms),
        seam_max: a.seam_max.max(b.seam_max),
        psnr_outside: -10.0 * mean(noise(a.psnr_outside), noise(b.psnr_outside)).log10(),
        outside_unit_range: a.outside_unit_range.max(b.outside_unit_range),
    }
}

/// The solver's errors in terms of files and options.
pub fn explain(error: Error, scene: &Scene) -> anyhow::Error {
    let [background, patch] = &scene.names;
    match error {
        Error::EmptyRegion => anyhow!(
            "nothing to paste: no pixel of the mask lies on {background}; move the patch with --at \
             or --center, or paint more of the mask"
        ),
        Error::NoAnchor => anyhow!(
            "the mask covers all of {background}, so no colour is fixed anywhere; shrink the mask, \
             or keep the patch's own colours with --keep PX"
        ),
        Error::NotConverged { iterations, residual } => anyhow!(
            "blending {patch} into {background} did not converge: residual {residual:.1e} after \
             {iterations} iterations; raise --tolerance, and keep --length, --keep and --lambda in \
             proportion to the pictures"
        ),
        Error::NotFinite { .. } => anyhow!(
            "blending {patch} into {background} exceeds the range of 32-bit floats ({error}); \
             scale both down"
        ),
        other => anyhow!("blending {patch} into {background}: {other}"),
    }
}
