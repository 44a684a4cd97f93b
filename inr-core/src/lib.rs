//! Continuous fields over `R^D`.

mod domain;
mod dual;
mod error;
mod field;
mod jet;
mod samples;
mod scalar;

pub use domain::{Domain, Unit};
pub use dual::{Dual, Dual2, gradient, seed, seed2};
pub use error::{Error, Result};
pub use field::Field;
pub use jet::Jet;
pub use samples::Samples;
pub use scalar::Scalar;
