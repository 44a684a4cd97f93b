use thiserror::Error;

/// What can be wrong with the input of this crate.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A domain has an axis without samples.
    #[error("axis {axis} of the domain has no samples")]
    EmptyAxis {
        /// The axis, 0 being the one stored contiguously.
        axis: usize,
    },
    /// A pitch is zero, negative or not finite.
    #[error("the pitch of axis {axis} is {value}; it must be positive and finite")]
    Pitch {
        /// The axis, 0 being the one stored contiguously.
        axis: usize,
        /// The value given.
        value: f32,
    },
    /// A buffer has the wrong number of elements.
    #[error("expected {expected} values, found {found}")]
    Length {
        /// Number of elements the shape asks for.
        expected: usize,
        /// Number of elements given.
        found: usize,
    },
    /// A domain is so large that its sample count does not fit in memory's address range.
    #[error("a domain of shape {shape:?} has too many samples")]
    TooLarge {
        /// Samples per axis.
        shape: Vec<usize>,
    },
    /// A value is NaN or infinite.
    #[error("value {value} at {index:?}, channel {channel} is not finite")]
    NotFinite {
        /// Sample position, axis 0 first.
        index: Vec<usize>,
        /// Channel.
        channel: usize,
        /// The value found.
        value: f32,
    },
    /// A training went out of hand.
    #[error(
        "the training diverged at step {step} (loss {loss:e}); the state of step {kept} is kept. A smaller learning rate, \
        a smaller omega or a longer warm-up usually helps"
    )]
    Diverged {
        /// The step whose loss showed it.
        step: u64,
        /// That loss.
        loss: f64,
        /// The step whose state was kept.
        kept: u64,
    },
    /// A shape parameter of a region or a network is out of range.
    #[error("{what} must be {rule}, found {value}")]
    Parameter {
        /// Which parameter.
        what: &'static str,
        /// What it must satisfy.
        rule: &'static str,
        /// The value given.
        value: f32,
    },
}

/// Result with this crate's error.
pub type Result<T> = std::result::Result<T, Error>;
