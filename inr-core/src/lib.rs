//! Continuous fields over `R^D`.

mod basis;
pub mod cpu;
mod domain;
mod dual;
mod edt;
mod error;
mod field;
mod jet;
mod prefilter;
mod region;
mod samples;
mod scalar;
mod spline;

pub use basis::{cubic_weights, cubic_weights_d1, cubic_weights_d2, cubic_weights_of_order};
pub use domain::{Domain, Unit};
pub use dual::{Dual, Dual2, gradient, seed, seed2};
pub use edt::{distance_to, distance_to_cells};
pub use error::{Error, Result};
pub use field::Field;
pub use jet::Jet;
pub use prefilter::{mirror, prefilter};
pub use region::{
    BoxRegion, Complement, Ellipsoid, Intersection, RasterMask, Region, Translated, Union,
};
pub use samples::Samples;
pub use scalar::Scalar;
pub use spline::Spline;
