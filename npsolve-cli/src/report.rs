//! What a blend tells its user: JSON and a few plain lines.

use poisson_loss::{Metrics, Report};
use serde::Serialize;

/// Seconds per stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading and checking the files.
    pub read: f64,
    /// Solving, without measuring.
    pub solve: f64,
    /// Writing the result.
    pub write: f64,
}

/// `--json` and `--metrics`: numbers that are not finite appear as null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlendReport {
    m1: f64,
    m2: f64,
    objective: f64,
    excess_energy: Option<f64>,
    residual: f64,
    seam_rms: f64,
    seam_max: f64,
    psnr_outside: f64,
    clipped_fraction: f64,
    iterations: usize,
    seconds: Seconds,
    solver: String,
    guidance: String,
    warnings: Vec<String>,
    m1_paper: f64,
    m2_paper: f64,
    pde_inside: f64,
    pde_outside: f64,
    outside_unit_range: f64,
    region_samples: f64,
    box_start: Vec<usize>,
    box_shape: Vec<usize>,
    length: Option<f32>,
    kind: &'static str,
    domain: &'static str,
    size: Vec<usize>,
    channels: usize,
    offset: Vec<f64>,
    rmse_to_exact: Option<f64>,
    rmse_inside: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    network: Option<NetworkReport>,
    #[serde(flatten)]
    extras: Extras,
}

/// Measures that one kind of signal has and others have not.
pub type Extras = serde_json::Map<String, serde_json::Value>;

/// What the training of a network did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NetworkReport {
    /// Kind of network.
    pub field: String,
    /// Trained numbers.
    pub parameters: usize,
    /// Steps taken.
    pub steps: u64,
    /// Loss at the end.
    pub loss: f64,
    /// Root mean square distance to the exact solution on the last batches, where there is one.
    pub distance: Option<f64>,
    /// Seconds of the training.
    pub seconds: f64,
}

/// What a report is made of, besides the solver's own.
pub struct Context<'a> {
    /// Name of the solver.
    pub solver: String,
    /// Name of the guidance.
    pub guidance: String,
    /// Time spent.
    pub seconds: Seconds,
    /// Share of the result's samples that the file could not hold.
    pub clipped_fraction: f64,
    /// Everything the user should know.
    pub warnings: &'a [String],
    /// Kind of signal.
    pub kind: &'static str,
    /// The values that were blended and measured.
    pub domain: &'static str,
    /// Size of the result, x first.
    pub size: Vec<usize>,
    /// Colour channels of the result.
    pub channels: usize,
    /// Where the patch's first sample went, in samples, x first.
    pub offset: Vec<f64>,
    /// What only this kind of signal has.
    pub extras: Extras,
    /// The training, if the result is a network.
    pub network: Option<NetworkReport>,
}

impl BlendReport {
    /// Collects the numbers. The solver's own estimate stands in for the excess where no exact
    /// solution is at hand.
    pub fn new(metrics: &Metrics, report: &Report, context: Context<'_>) -> Self {
        let estimate = report.excess / metrics.objective;
        Self {
            m1: metrics.m1,
            m2: metrics.m2,
            objective: metrics.objective,
            excess_energy: metrics.excess_energy.or(Some(estimate)),
            residual: report.residual,
            seam_rms: metrics.seam_rms,
            seam_max: metrics.seam_max,
            psnr_outside: metrics.psnr_outside,
            clipped_fraction: context.clipped_fraction,
            iterations: report.iterations,
            seconds: context.seconds,
            solver: context.solver,
            guidance: context.guidance,
            warnings: context.warnings.to_vec(),
            m1_paper: metrics.m1_paper,
            m2_paper: metrics.m2_paper,
            pde_inside: metrics.pde_inside,
            pde_outside: metrics.pde_outside,
            outside_unit_range: metrics.outside_unit_range,
            region_samples: report.region_samples,
            box_start: report.box_start.clone(),
            box_shape: report.box_shape.clone(),
            length: report.length,
            kind: context.kind,
            domain: context.domain,
            size: context.size,
            channels: context.channels,
            offset: context.offset,
            rmse_to_exact: metrics.rmse_to_exact,
            rmse_inside: metrics.rmse_inside,
            network: context.network,
            extras: context.extras,
        }
    }
}

/// "3 channels", "1 channel".
pub fn count(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}
