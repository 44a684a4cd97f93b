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
    /// A network cannot hold a spline.
    #[error(
        "this network has no cubic level of {nodes:?} nodes between the signal's outermost samples with a linear map \
        past its layers; build it with Architecture::spline_grid and Frame::of_samples"
    )]
    NoSplineLevel {
        /// Nodes that the spline needs, per axis.
        nodes: Vec<usize>,
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
    /// The triangles of a mesh do not close a surface: it has no inside.
    #[error(
        "the mesh is open: {edges} of its edges do not join two triangles; close its holes, or use a part that is closed"
    )]
    OpenMesh {
        /// Edges that an odd number of triangles share.
        edges: usize,
    },
    /// A mesh has no triangles, or they refer to vertices that are not there.
    #[error("bad mesh: {what}")]
    Mesh {
        /// What is wrong.
        what: String,
    },
    /// Bytes that are no safetensors file, or only the beginning of one.
    #[error("not a safetensors file, or one that was cut off: {reason}")]
    NotSafetensors {
        /// What does not fit.
        reason: String,
    },
    /// A safetensors file that is not a checkpoint of this library.
    #[error(
        "not a checkpoint of npsolve: the file's metadata has no {missing}; networks of other programs can be \
        imported from their named tensors"
    )]
    ForeignTensors {
        /// The metadata that checkpoints have.
        missing: String,
    },
    /// A checkpoint written by a later release.
    #[error(
        "the checkpoint has version {found}, this release reads up to {supported}: update npsolve"
    )]
    CheckpointVersion {
        /// Version of the file.
        found: u64,
        /// The newest version that can be read.
        supported: u64,
    },
    /// A checkpoint's metadata is damaged.
    #[error("the checkpoint's metadata {entry:?} cannot be used: {reason}")]
    CheckpointEntry {
        /// Key of the metadata.
        entry: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A network has other coordinates or channels than the ones asked for.
    #[error(
        "the network has {} coordinates and {} channels, not {} and {}",
        found[0], found[1], expected[0], expected[1]
    )]
    Dimensions {
        /// Coordinates and channels asked for.
        expected: [usize; 2],
        /// Coordinates and channels of the network.
        found: [usize; 2],
    },
    /// A tensor is missing.
    #[error("there is no tensor {name:?}")]
    TensorMissing {
        /// Its name.
        name: String,
    },
    /// A tensor has no place in the architecture that the checkpoint names.
    #[error("the architecture has no tensor {name:?}")]
    TensorUnexpected {
        /// Its name.
        name: String,
    },
    /// A tensor has another shape than the architecture asks for.
    #[error("tensor {name:?} has shape {found:?} instead of {expected:?}")]
    TensorShape {
        /// Its name.
        name: String,
        /// The shape asked for.
        expected: Vec<usize>,
        /// Its shape.
        found: Vec<usize>,
    },
    /// A tensor holds numbers of another type than can be read.
    #[error("tensor {name:?} holds numbers of type {found}, which cannot be read here")]
    TensorType {
        /// Its name.
        name: String,
        /// Its type, as the format calls it.
        found: String,
    },
    /// A tensor's numbers cannot be right.
    #[error("the numbers of tensor {name:?} must be {rule}")]
    TensorValues {
        /// Its name.
        name: String,
        /// What they must be.
        rule: &'static str,
    },
}

/// Result with this crate's error.
pub type Result<T> = std::result::Result<T, Error>;
