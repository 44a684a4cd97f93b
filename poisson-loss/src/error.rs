use thiserror::Error;

/// What can be wrong with a blending problem.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// No sample of the background lies inside the region.
    #[error("the region contains no sample of the background; move the patch or check the mask")]
    EmptyRegion,
    /// The region covers everything, so nothing ties the result to the background's colours.
    #[error(
        "the region covers the whole background, so no colour is fixed anywhere; \
         shrink the mask, or keep the patch's colours with a length"
    )]
    NoAnchor,
    /// An option is out of range.
    #[error("{name} is {value}; it must be {rule}")]
    Parameter {
        /// The option.
        name: &'static str,
        /// What it must satisfy.
        rule: &'static str,
        /// The value given.
        value: f64,
    },
    /// An input value is NaN or infinite.
    #[error(
        "the {signal} holds {value} at sample {index:?}, channel {channel}; all values must be finite"
    )]
    NotFinite {
        /// Background, patch or guidance.
        signal: &'static str,
        /// Sample position, axis 0 first.
        index: Vec<usize>,
        /// Channel.
        channel: usize,
        /// The value found.
        value: f32,
    },
    /// A result to be measured lies on another lattice than the problem.
    #[error("the result has shape {found:?}, the background {expected:?}")]
    Shape {
        /// Shape of the background.
        expected: Vec<usize>,
        /// Shape given.
        found: Vec<usize>,
    },
    /// The solver stopped before the tolerance.
    #[error(
        "no convergence: relative residual {residual:.1e} after {iterations} iterations; \
         raise the tolerance or the iteration limit"
    )]
    NotConverged {
        /// Iterations done.
        iterations: usize,
        /// Residual reached, relative to the start.
        residual: f64,
    },
    /// A network whose gradient jumps or vanishes was asked to follow gradients.
    #[error(
        "this network's gradient jumps between cells or vanishes, so a loss on gradients would see only part of it; \
         take a cubic grid, a sine network, or smoothstep interpolation with SiLU"
    )]
    NoGradient,
    /// A source or sink of blocks failed.
    #[error("{what}: {reason}")]
    Storage {
        /// Which of them.
        what: &'static str,
        /// What the system says.
        reason: String,
    },
    /// A problem does not fit the memory that it may take.
    #[error("{given} bytes of memory are too few; at least {needed} are needed")]
    Memory {
        /// The least that would do.
        needed: u64,
        /// What was given.
        given: u64,
    },
    /// The caller's progress function asked to stop.
    #[error("stopped on request; what is done so far is kept in the state file")]
    Stopped,
    /// The training of a network failed.
    #[error(transparent)]
    Network(#[from] inr_core::Error),
}

/// Result with this crate's error.
pub type Result<T> = std::result::Result<T, Error>;
