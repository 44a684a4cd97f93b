//! From a problem to blended planes, for any dimension and number of channels.

use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use inr_core::{Domain, Region, Samples};
use poisson_loss::{
    Baseline, Blend, Error, Metrics, Options, Patch, Problem, Report, measure, solve_baseline,
    solve_with_progress,
};

use crate::channels::{self, Axes, ChannelJob, Channels, with_channels};
use crate::scene::Scene;
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

/// A problem whose number of channels is known at run time only.
pub struct Setup<'a, const D: usize> {
    /// What stays outside.
    pub background: Planes<'a, D>,
    /// What goes in, with as many channels.
    pub patch: Planes<'a, D>,
    /// Where, in the background's coordinates.
    pub region: &'a dyn Region<D>,
    /// Place of the patch in the background, in the units of both domains.
    pub offset: [f32; D],
    /// Both files, for messages.
    pub names: &'a [String; 2],
}

/// Values on a lattice, one plane after the other.
#[derive(Clone, Copy)]
pub struct Planes<'a, const D: usize> {
    /// The lattice.
    pub domain: Domain<D>,
    /// A plane per channel.
    pub values: &'a [f32],
}

impl<const D: usize> Planes<'_, D> {
    /// Number of planes.
    pub fn channels(&self) -> usize {
        self.values.len() / self.domain.len()
    }

    /// `C` channels from channel `first` on.
    pub fn samples<const C: usize>(&self, first: usize) -> Result<Samples<D, C>> {
        let n = self.domain.len();
        let planes = &self.values[first * n..(first + C) * n];
        Ok(Samples::from_planar(self.domain, planes.to_vec())?)
    }
}

impl<const D: usize> Setup<'_, D> {
    fn problem<'b, const C: usize>(
        &'b self,
        background: &'b Samples<D, C>,
        patch: &'b Samples<D, C>,
        settings: &Settings,
    ) -> Problem<'b, D, C> {
        Problem {
            background,
            patch: Patch::Samples { samples: patch, offset: self.offset },
            region: self.region,
            guidance: settings.guidance.to_guidance::<D, C>(),
            options: settings.options,
        }
    }
}

impl<const D: usize> Setup<'_, D>
where
    Axes<D>: Channels,
{
    /// Blends all channels, in the groups that there is code for.
    pub fn solve(
        &self,
        settings: &Settings,
        with_metrics: bool,
        progress: &mut (dyn FnMut(f32) + Send),
    ) -> Result<Solution> {
        let count = self.background.channels();
        if !channels::is_one_group::<D>(count) && !settings.guidance.is_per_channel() {
            bail!(
                "{} has {count} channels, and --guidance {} looks at all of them together, which works \
                 with {}; take strongest:channel, patch, sum or mix:MU,PHI",
                self.names[0],
                settings.guidance,
                channels::in_words::<D>(),
            );
        }
        let mut parts = Vec::new();
        for [first, size] in channels::groups::<D>(count) {
            let mut share = |s: f32| progress((first as f32 + s * size as f32) / count as f32);
            let job = Group { setup: self, settings, first, with_metrics, progress: &mut share };
            let part = with_channels::<D, _>(size, job)
                .ok_or_else(|| anyhow!("{} has no channels to blend", self.names[0]))??;
            parts.push((size, part));
        }
        let solution =
            joined(parts).ok_or_else(|| anyhow!("{} has no channels to blend", self.names[0]))?;
        if solution.planes.iter().any(|v| !v.is_finite()) {
            bail!(
                "blending {} into {} exceeds the range of 32-bit floats; scale both down",
                self.names[1],
                self.names[0]
            );
        }
        Ok(solution)
    }
}

impl<const D: usize> Setup<'_, D>
where
    Axes<D>: Channels,
{
    /// What another method makes of it, without its report.
    pub fn baseline(&self, settings: &Settings, method: Baseline) -> Result<Vec<f32>> {
        let mut planes = Vec::new();
        for [first, size] in channels::groups::<D>(self.background.channels()) {
            let job = Classical { setup: self, settings, first, method };
            let part = with_channels::<D, _>(size, job)
                .ok_or_else(|| anyhow!("{} has no channels to blend", self.names[0]))??;
            planes.extend(part);
        }
        Ok(planes)
    }
}

/// Some neighbouring channels for another method.
struct Classical<'a, const D: usize> {
    setup: &'a Setup<'a, D>,
    settings: &'a Settings,
    first: usize,
    method: Baseline,
}

impl<const D: usize> ChannelJob for Classical<'_, D> {
    type Output = Result<Vec<f32>>;

    fn run<const C: usize>(self) -> Result<Vec<f32>> {
        let setup = self.setup;
        let (background, patch) =
            (setup.background.samples::<C>(self.first)?, setup.patch.samples::<C>(self.first)?);
        let problem = setup.problem(&background, &patch, self.settings);
        let blend = solve_baseline(&problem, self.method).map_err(|e| explain(e, setup.names))?;
        Ok(blend.samples.as_planar().to_vec())
    }
}

/// Blends the colour channels of pictures.
pub fn solve_scene(
    scene: &Scene,
    settings: &Settings,
    with_metrics: bool,
    progress: &mut (dyn FnMut(f32) + Send),
) -> Result<Solution> {
    let region = scene.region();
    scene.setup(&region).solve(settings, with_metrics, progress)
}

/// Some neighbouring channels.
struct Group<'a, const D: usize> {
    setup: &'a Setup<'a, D>,
    settings: &'a Settings,
    first: usize,
    with_metrics: bool,
    progress: &'a mut (dyn FnMut(f32) + Send),
}

impl<const D: usize> ChannelJob for Group<'_, D> {
    type Output = Result<Solution>;

    fn run<const C: usize>(self) -> Result<Solution> {
        let setup = self.setup;
        let (background, patch) =
            (setup.background.samples::<C>(self.first)?, setup.patch.samples::<C>(self.first)?);
        let problem = setup.problem(&background, &patch, self.settings);
        let explain = |e| explain(e, setup.names);
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
pub fn explain(error: Error, names: &[String; 2]) -> anyhow::Error {
    let [background, patch] = names;
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
