use thiserror::Error;

/// What can be wrong with the input of this crate.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A camera or ray parameter is out of range.
    #[error("{what} must be {rule}, found {value}")]
    Parameter {
        /// Which parameter.
        what: &'static str,
        /// What it must satisfy.
        rule: &'static str,
        /// The value given.
        value: f64,
    },
    /// A camera-to-world matrix is not a rotation and a translation.
    #[error(
        "the camera-to-world matrix is off a rigid motion by {deviation:e}; remove scale, shear and \
         reflection first"
    )]
    NotRigid {
        /// Largest deviation of an entry of `R^T R` from the identity, or of the last row from
        /// `0 0 0 1`; infinite for a reflection and for entries that are not finite.
        deviation: f64,
    },
    /// No ray through the lens reaches this image position.
    #[error("the lens distortion maps no ray to the image position ({u}, {v})")]
    Undistortable {
        /// Column coordinate in pixels.
        u: f64,
        /// Row coordinate in pixels.
        v: f64,
    },
    /// A point to project is not in front of the camera.
    #[error("the point is at depth {depth}, not in front of the camera")]
    BehindCamera {
        /// Distance along the viewing direction, in world units.
        depth: f64,
    },
}

/// Result with this crate's error.
pub type Result<T> = std::result::Result<T, Error>;
