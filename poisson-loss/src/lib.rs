//! Gradient-domain blending of sampled signals, in any dimension.
//!
//! A piece of one signal goes into another and keeps its structure, while its level adapts to the new
//! surroundings: the blend follows prescribed gradients inside a region and the background's own
//! gradients and values outside. Both sides of the boundary may give way, over a length that is
//! chosen, so that no edge is left where the two signals disagree. One code path serves audio
//! (`D = 1`), images (2), volumes and video (3) and light fields (4), with any number of channels.
//!
//! [`solve`] minimises the objective exactly among cubic splines; [`solve_baseline`] runs the methods
//! of the literature on the same [`Problem`]; [`measure`] scores any result, also somebody else's,
//! with one operator.
//!
//! ```
//! use inr_core::{Domain, Ellipsoid, Field, Samples};
//! use poisson_loss::{
//!     Baseline, Guidance, Options, Patch, Problem, measure, solve, solve_baseline,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A slow wave, and finer ripples in a much brighter light.
//! let domain = Domain::unit([160, 120])?;
//! let wave = |[x, y]: [f32; 2]| [0.3 + 0.1 * (0.05 * x + 0.03 * y).sin()];
//! let ripples = |[x, y]: [f32; 2]| [0.7 + 0.05 * (0.4 * x).sin() * (0.3 * y).cos()];
//! let background = Samples::<2, 1>::from_fn(domain, wave);
//! let patch = Samples::from_fn(domain, ripples);
//! let problem = Problem {
//!     background: &background,
//!     patch: Patch::Samples { samples: &patch, offset: [0.0, 0.0] },
//!     region: &Ellipsoid::new([80.0, 60.0], [20.0, 14.0])?,
//!     guidance: Guidance::Patch,
//!     options: Options::default(),
//! };
//! let blend = solve(&problem)?;
//!
//! // The ripples are in; the light is the background's. Far away nothing has changed, not a bit.
//! let centre = 80 + 160 * 60;
//! assert!((blend.samples.plane(0)[centre] - background.plane(0)[centre]).abs() < 0.1);
//! assert_eq!(blend.samples.plane(0)[0], background.plane(0)[0]);
//!
//! // Copy and paste leaves a step of 0.4 at the edge, and scores accordingly.
//! let paste = solve_baseline(&problem, Baseline::Paste)?;
//! let ours = measure(&problem, &blend.samples, None)?;
//! let pasted = measure(&problem, &paste.samples, Some(&blend.samples))?;
//! assert!(ours.seam_rms < 0.2 * pasted.seam_rms);
//! assert!(pasted.excess_energy.unwrap() > 1.0); // More than twice the least possible objective.
//!
//! // The blend is a function: here its value between the samples.
//! let mut value = [[0.0]];
//! blend.to_field().eval(&[[80.25, 60.5]], &mut value);
//! assert!((value[0][0] - blend.samples.plane(0)[centre]).abs() < 0.05);
//! # Ok(())
//! # }
//! ```
//!
//! # Conventions
//! | letter | stands for |
//! |---|---|
//! | `S`, `c_S` | the background, and the spline through its samples (the paper's *source*) |
//! | `T`, `c_T` | the patch in the background's coordinates (the paper's *target*; "source" elsewhere) |
//! | `Omega`, `m` | the region, and its weight in `[0, 1]` on a sample's cell |
//! | `v` | the guidance: the gradient to follow inside |
//! | `c` | the blend |
//! | `l`, `l_in` | lengths over which the background, and the patch's own colours, give way |
//! | `h_d`, `h_ref` | pitch of axis `d`, and the geometric mean of all pitches |
//! | `J`, `J*` | the objective, and its least value among splines on the background's lattice |
//!
//! Axes, positions and units are those of [`inr_core`]: axis 0 is contiguous, pixel centres are at
//! integers, coordinates and lengths are physical. Gradients are per reference pitch, `h_ref * dc/dx_d`,
//! which keeps one length one length on lattices with unequal pitches and at any resolution.
//! Values may have any range; nothing is clamped ([`Metrics::outside_unit_range`] says how much an
//! export to integers would clip).
//!
//! # Choosing
//! * *Guidance.* [`Guidance::Patch`] imports an object with its surface.
//!   [`Guidance::Strongest`] keeps whichever detail is stronger: holes, writing, transparent things.
//!   [`Guidance::SUM`] overlays, [`Guidance::Mix`] weighs, [`Guidance::Monochrome`] takes structure
//!   without colour, and [`Guidance::Custom`] is a function of position and both jets.
//! * *Objective.* [`Objective::Screened`] unless there is a reason: it has a continuum limit, so a finer
//!   lattice gives the same blend, and its length is a length. With `keep` the patch's own colours
//!   return inside. [`Objective::Paper`] reproduces the publication and depends on the sampling
//!   density. [`Objective::Dirichlet`] fixes the background's values outside.
//! * *Tolerance.* The default, 1e-6, is what `f32` can hold; 1e-4 is invisible in 8 bits and cheaper.
//!
//! # What exact means
//! The minimum is that of a quadratic form: integrals by the midpoint rule with two points per knot
//! interval and axis, over cubic splines with knots at the background's samples. On that form no other
//! method can score below [`solve`], up to its tolerance. A finer lattice is another form, with
//! another minimum. Masks are constant on sample cells. Linear cost and memory in the samples
//! of a box around the region; the same bits for any number of threads.
//!
//! Source: Perez, Gangnet and Blake, "Poisson image editing", 2003; Wu et al., "Neural Poisson Solver",
//! 2024. The screened objective is not theirs: see [`Objective`].

mod assembly;
mod axis;
#[cfg(test)]
mod banded;
mod baselines;
mod blocks;
mod cg;
mod engine;
mod error;
mod exact;
mod fused;
mod guidance;
mod inputs;
mod line;
mod metrics;
mod multigrid;
mod neural;
mod objective;
mod operator;
mod order;
mod plain;
mod plan;
mod problem;
mod ring;
mod tile;

pub use baselines::{Baseline, solve_baseline};
pub use blocks::{
    BlockOptions, BlockProblem, BlockProgress, BlockReport, BlockSink, BlockSource, BlockStage,
    PlaneFile, solve_in_blocks,
};
pub use error::{Error, Result};
pub use exact::{Blend, Report, solve, solve_with_progress};
pub use guidance::{CustomGuidance, Guidance, Strongest};
pub use metrics::{Metrics, measure};
pub use neural::{
    ColorTerm, DiscreteMinimum, PaperBlend, PaperLoss, PaperOptions, PaperProgress, PaperSignals,
    PaperStart, PaperWeights, Stencil, discrete_minimum, paper_loss, train_paper,
};
pub use neural::{NeuralOptions, NeuralProgress, NeuralReport, insert, neural_box, train_blend};
pub use objective::{Objective, Options};
pub use problem::{Patch, Problem};
