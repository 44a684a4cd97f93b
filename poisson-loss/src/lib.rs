//! Gradient-domain blending in any dimension.

mod assembly;
mod axis;
mod banded;
mod baselines;
mod cg;
mod error;
mod exact;
mod fused;
mod guidance;
mod metrics;
mod multigrid;
mod objective;
mod operator;
mod plain;
mod plan;
mod problem;
mod tile;

pub use baselines::{Baseline, solve_baseline};
pub use error::{Error, Result};
pub use exact::{Blend, Report, solve, solve_with_progress};
pub use guidance::{CustomGuidance, Guidance, Strongest};
pub use metrics::{Metrics, measure};
pub use objective::{Objective, Options};
pub use problem::{Patch, Problem};
