//! How networks are trained.

mod adam;
mod fit;
mod lattice;
mod schedule;
mod state;
mod trainer;

pub use adam::{Adam, Decay};
pub use fit::{FitOptions, FitProgress, FitReport, fit, psnr};
pub use lattice::Lattice;
pub use schedule::{Schedule, Shape};
pub use trainer::{TrainOptions, Trainer};
