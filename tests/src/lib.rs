//! What the tests across crates share: an independent reference of the blending problem, signals
//! to blend, and the sample data when it is there.

pub mod measured;
pub mod oracle;
pub mod random;
pub mod reference;
pub mod scenes;
pub mod signals;
