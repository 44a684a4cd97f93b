//! Continuous fields over `R^D`.

mod domain;
mod error;
mod field;
mod jet;
mod samples;

pub use domain::{Domain, Unit};
pub use error::{Error, Result};
pub use field::Field;
pub use jet::Jet;
pub use samples::Samples;
