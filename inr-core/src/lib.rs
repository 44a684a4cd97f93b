//! Continuous fields over `R^D`: signals with values and exact gradients at any point.
//!
//! A recording, a photograph, a scan or a light field is measured on a lattice, but it is used between
//! the lattice points as well: it is shifted by fractions of a sample, enlarged, differentiated,
//! integrated. This crate holds what such a signal is made of, once for every number of coordinates
//! `D` and channels `C`:
//!
//! * [`Domain`]: a lattice of sample positions in physical space; [`Samples`]: the values on it;
//! * [`Field`]: a function that gives values and [`Jet`]s (value and gradient) for batches of points;
//! * [`Spline`]: the cubic B-spline through samples, the field of gridded signals;
//! * [`Region`]: where something happens: painted masks, boxes, ellipsoids, closed triangle
//!   meshes, and sets made of them;
//! * [`Dual`] and [`Scalar`]: numbers that carry derivatives, with which a formula written once is
//!   its own gradient ([`gradient`]) and, nested, its own second derivatives ([`Dual2`]).
//!
//! ```
//! use inr_core::{Domain, Field, Jet, Samples, Spline, Unit, gradient};
//!
//! // 64 x 48 samples, a tenth of a millimetre apart.
//! let domain = Domain::new([64, 48], [0.1, 0.1], [0.0, 0.0], Unit::Millimetre)?;
//! let samples = Samples::<2, 1>::from_fn(domain, |[x, y]| [x.sin() * y.cos()]);
//! let field = Spline::interpolate(&samples);
//!
//! // On the lattice the field has the samples' values; between them it follows the function.
//! let (x, y) = (3.07, 2.41);
//! let mut jets = [Jet::<2, 1>::ZERO; 2];
//! field.eval_jet(&[domain.position([20, 30]), [x, y]], &mut jets);
//! assert!((jets[0].value[0] - samples.plane(0)[20 + 64 * 30]).abs() < 1e-5);
//! assert!((jets[1].value[0] - x.sin() * y.cos()).abs() < 1e-5);
//!
//! // Gradients are per physical unit, here per millimetre, and are not finite differences.
//! let [along_x, along_y] = jets[1].grad[0];
//! assert!((along_x - x.cos() * y.cos()).abs() < 1e-4);
//! assert!((along_y + x.sin() * y.sin()).abs() < 1e-4);
//!
//! // The readable definition of the same field, in f64, through dual numbers.
//! let (_, exact) = gradient(|p| field.eval_scalar(p)[0], [f64::from(x), f64::from(y)]);
//! assert!((f64::from(along_x) - exact[0]).abs() < 1e-5);
//! # Ok::<(), inr_core::Error>(())
//! ```
//!
//! # Conventions
//! * *Axes.* Axis 0 is contiguous in memory: x of an image (W, H), x of a volume (X, Y, Z). Channels
//!   are planes, one after the other; [`Samples::from_interleaved`] takes the order of most files.
//! * *Positions.* A sample is a point and owns the cell half a pitch around it. With unit pitch and
//!   origin 0 pixel centres are at integers and an image covers `[-0.5, W - 0.5]`.
//! * *Units.* Coordinates are physical: pixels, seconds, millimetres. A domain's pitch is the distance
//!   between neighbours per axis; [`Domain::reference_pitch`], `h_ref`, is their geometric mean.
//! * *Gradients.* `jet.grad[c][d]` is the derivative of channel `c` along axis `d`, per physical unit.
//!   Multiplied by `h_ref` it no longer depends on the resolution.
//! * *Beyond the border* a spline is its own mirror image about the outermost samples.
//! * *Numbers.* Work is in `f32`, definitions and tests in `f64`. Every function gives the same bits
//!   for any number of threads. NaN and infinity are not searched for on the way:
//!   [`Samples::check_finite`] does it at the entrance.
//!
//! | letter | stands for |
//! |---|---|
//! | `D`, `C` | coordinates, channels |
//! | `c`, `d` | index of a channel, of an axis |
//! | `x`, `y` | points; values or jets at these points |
//! | `h`, `n` | pitch of an axis; samples along it |
//! | `t` | position between two knots, 0 to 1 |
//!
//! # Fields with trained parameters
//! A [`Network`] is an encoding of the coordinates and a small perceptron, described by an [`Architecture`]: sine
//! networks, Fourier features, hash grids, cubic B-spline grids, DINER tables, the original NeRF network. It is a
//! [`Field`] like any other, with exact gradients. [`Network::loss_gradient`] differentiates any loss on values and
//! gradients with respect to its parameters; [`Trainer`] takes the steps, [`fit`] runs them for the samples of a
//! signal, and a [`Checkpoint`] keeps the result, or a training to go on with, as safetensors.
//!
//! ```
//! use inr_core::{Architecture, Domain, FitOptions, Frame, Network, Output, Samples, TrainOptions, Trainer, fit};
//!
//! let domain = Domain::unit([48, 32])?;
//! let samples = Samples::<2, 1>::from_fn(domain, |[x, y]| [0.5 + 0.3 * (0.3 * x).sin() * (0.2 * y).cos()]);
//! let architecture = Architecture::grid(&domain.shape(), 1 << 12);
//! let network = Network::new(architecture, Frame::of_cells(&domain), Output::of_range(0.0, 1.0), 1)?;
//! let mut trainer = Trainer::new(network, TrainOptions { batch: 768, ..TrainOptions::default() });
//! let options = FitOptions { steps: 200, budget: None, target_psnr: Some(40.0), peak: 1.0 };
//! let report = fit(&mut trainer, &samples, &options, |_, _| true)?;
//! assert!(report.reached, "{report:?}");
//! # Ok::<(), inr_core::Error>(())
//! ```
//!
//! # What is left out
//! Signals are held in memory as a whole. Networks run on the CPU.

mod basis;
mod buffer;
mod checkpoint;
pub mod cpu;
mod domain;
mod dual;
mod edt;
mod error;
mod field;
mod jet;
mod network;
mod prefilter;
mod random;
mod region;
mod samples;
mod scalar;
mod spline;
mod train;

pub use basis::{cubic_weights, cubic_weights_d1, cubic_weights_d2, cubic_weights_of_order};
pub use checkpoint::{AxisOrder, Checkpoint, Description, Training, import_diner, import_siren};
pub use domain::{Domain, Unit};
pub use dual::{Dual, Dual2, gradient, seed, seed2};
pub use edt::{distance_to, distance_to_cells};
pub use error::{Error, Result};
pub use field::Field;
pub use jet::Jet;
pub use network::{
    Activation, Alignment, Architecture, Encoding, Fourier, Frame, Frequencies, Grid,
    Interpolation, Level, Mlp, Network, Order, Output, Workspace,
};
pub use prefilter::{mirror, prefilter};
pub use region::{
    BoxRegion, Complement, Ellipsoid, Intersection, MeshRegion, RasterMask, Region, Translated,
    Union,
};
pub use samples::Samples;
pub use scalar::Scalar;
pub use spline::Spline;
pub use train::{
    Adam, Decay, FitOptions, FitProgress, FitReport, Lattice, Schedule, Shape, TrainOptions,
    Trainer, fit, psnr,
};
