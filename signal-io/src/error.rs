use std::io;
use std::path::{Path, PathBuf};

use crate::SampleType;

/// What can be wrong with a file, a request or a picture.
///
/// Every error that comes from a file names the file and says what to do next; errors of signals
/// in memory ([`Error::ChannelCount`], [`Error::Shape`], [`Error::Audio`], [`Error::Volume`], [`Error::Affine`]) leave the name to the caller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write.
    #[error("cannot {action} {}: {source}; check the path, the permissions and the free space", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was attempted: "read", "write", "rename".
        action: &'static str,
        /// The system's answer.
        source: io::Error,
    },
    /// There is no such file.
    #[error("{} does not exist; check the spelling of the path", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// Neither the content nor the extension belongs to a format known for this direction.
    #[error("{}: unknown format {extension:?}; use one of: {known}", path.display())]
    UnsupportedFormat {
        /// The file.
        path: PathBuf,
        /// The extension, without the dot; empty when there is none.
        extension: String,
        /// The extensions that work.
        known: &'static str,
    },
    /// The format is known, but the file uses a part of it that is not read.
    #[error("{}: {format} with {what} is not supported; convert the file to a plainer one", path.display())]
    UnsupportedFeature {
        /// The file.
        path: PathBuf,
        /// The name of its format.
        format: &'static str,
        /// The part that is not read.
        what: String,
    },
    /// The file is damaged, cut short, or not what it claims to be.
    #[error("{} is not a valid {format} file: {reason}; copy or export it again", path.display())]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// The name of the format that was expected.
        format: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// The decoded picture, or the file itself, would exceed the limit.
    #[error("{} needs at least {needed} bytes and the limit is {limit}; raise the limit or use a smaller file", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// A picture that is to be read or written by rows, in a file whose rows do not come one after the other.
    #[error("{}: {what}, so it is not {action} row by row; convert it to PNG without interlacing, TIFF, npy in C order or PFM, or allow more memory", path.display())]
    NotByRows {
        /// The file.
        path: PathBuf,
        /// What keeps the rows apart, with the bytes that the whole picture would take.
        what: String,
        /// "read" or "written".
        action: &'static str,
    },
    /// The limit allows the picture, the machine does not.
    #[error("{} needs {needed} bytes of memory, which this machine cannot give; use a smaller file", path.display())]
    OutOfMemory {
        /// The file.
        path: PathBuf,
        /// Bytes needed.
        needed: u64,
    },
    /// The file has no bytes, or its picture no pixels.
    #[error("{} holds no samples; choose another file", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The format of the target cannot hold the picture as requested.
    #[error("{}: {format} cannot hold {what}; {instead}", path.display())]
    CannotHold {
        /// The target.
        path: PathBuf,
        /// The name of its format.
        format: &'static str,
        /// What does not fit.
        what: String,
        /// What to do instead.
        instead: String,
    },
    /// The encoder failed for a reason that is not the file system's.
    #[error("cannot encode {} as {format}: {reason}; try another format", path.display())]
    Encode {
        /// The target.
        path: PathBuf,
        /// The name of its format.
        format: &'static str,
        /// What the encoder says.
        reason: String,
    },
    /// A picture has another number of colour channels than the operation wants (alpha not counted).
    #[error(
        "expected {expected} colour channels, found {found}; convert with to_gray, to_rgb or select"
    )]
    ChannelCount {
        /// Channels wanted.
        expected: usize,
        /// Channels there.
        found: usize,
    },
    /// Sizes, values and channel names of a picture do not belong together.
    #[error("bad picture: {what}")]
    Shape {
        /// What does not fit, with both values.
        what: String,
    },
    /// Samples, channels and rate of audio in memory do not belong together.
    #[error("bad audio: {what}")]
    Audio {
        /// What does not fit, with both values.
        what: String,
    },
    /// The format is known, but its decoder was left out when the program was built.
    #[error("{}: reading {format} needs the feature {feature}, which this build is without; build with --features {feature} or convert the file to WAV", path.display())]
    FeatureOff {
        /// The file.
        path: PathBuf,
        /// The name of its format.
        format: &'static str,
        /// The cargo feature of this crate.
        feature: &'static str,
    },
    /// Sizes, values and indices of a volume do not belong together.
    #[error("bad volume: {what}")]
    Volume {
        /// What does not fit, with both values.
        what: String,
    },
    /// A map from voxel indices to the world that cannot be turned round.
    #[error("bad map from voxels to the world: {what}")]
    Affine {
        /// What is wrong with it.
        what: String,
    },
    /// The target is there already.
    #[error("{} exists; choose another name or allow overwriting (force)", path.display())]
    Exists {
        /// The target.
        path: PathBuf,
    },
    /// The folder of the target is not there.
    #[error("cannot write {}: there is no folder {}; create it first", path.display(), folder.display())]
    NoFolder {
        /// The target.
        path: PathBuf,
        /// The missing folder.
        folder: PathBuf,
    },
    /// The target exists and is a folder or a device, so it cannot be replaced by a file.
    #[error("{} is not a regular file; choose another name", path.display())]
    NotAFile {
        /// The target.
        path: PathBuf,
    },
    /// One file of a series is not like the others.
    #[error("{} does not fit to {}: {what}; bring it to the same size and channels, or take it out", path.display(), first.display())]
    Mismatch {
        /// The odd file.
        path: PathBuf,
        /// The first file of the series.
        first: PathBuf,
        /// What differs, with both values.
        what: String,
    },
    /// A number is left out in the names of a sequence.
    #[error("{} is missing from its sequence; add it, or use a pattern with * instead of the number, which allows gaps", path.display())]
    MissingFrame {
        /// The file that should be there.
        path: PathBuf,
    },
    /// A picture cannot be divided into lenslets.
    #[error("{} holds no light field: {what}; give the numbers of views across and down, whose multiples its size must be", path.display())]
    NotLenslets {
        /// The picture.
        path: PathBuf,
        /// What does not fit, with its size.
        what: String,
    },
    /// A name in a folder of views does not say where its view belongs.
    #[error("{} has no place in a grid of views: {what}; name views by row and column, as view_03_04.png, or give a pattern as *_%d_%d.png", path.display())]
    NoPlace {
        /// The file.
        path: PathBuf,
        /// What is wrong with its name.
        what: String,
    },
    /// The views in a folder do not fill a grid.
    #[error("{} has no view for row {row}, column {column} of its grid; add it, or take out the views beside it", path.display())]
    MissingView {
        /// The folder.
        path: PathBuf,
        /// The first number in the names of its row.
        row: u64,
        /// The second number.
        column: u64,
    },
}

/// Result with this crate's error.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An error of the file system, told apart where the caller can act on it.
    pub(crate) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            io::ErrorKind::NotFound => Self::NotFound { path },
            _ => Self::Io { path, action, source },
        }
    }
}

/// What a codec reports: it knows bytes, not paths. The caller adds path and format.
#[derive(Debug)]
pub(crate) enum Fault {
    Corrupt(String),
    Feature(String),
    TooLarge { needed: u64, limit: u64 },
    OutOfMemory { needed: u64 },
    Empty,
    CannotHold { what: String, instead: String },
    Encode(String),
    Image(Error),
    Io(io::Error),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::Image(error)
    }
}

impl Fault {
    /// A damaged file.
    pub(crate) fn corrupt(reason: impl Into<String>) -> Self {
        Self::Corrupt(reason.into())
    }

    /// What a decoder says it does not support, without saying so twice.
    pub(crate) fn feature(message: &impl std::fmt::Display) -> Self {
        let text = message.to_string();
        Self::Feature(text.trim_end_matches(" is unsupported").to_owned())
    }

    /// A file that ends early.
    pub(crate) fn cut_short() -> Self {
        Self::corrupt("it ends before its data is complete")
    }

    /// A picture that does not fit the format.
    pub(crate) fn cannot_hold(what: impl Into<String>, instead: impl Into<String>) -> Self {
        Self::CannotHold { what: what.into(), instead: instead.into() }
    }

    /// A sample type that does not fit the format.
    pub(crate) fn cannot_hold_sample(sample: SampleType, instead: &str) -> Self {
        Self::cannot_hold(format!("{} samples", sample.name()), instead)
    }

    /// Adds what the codec did not know.
    pub(crate) fn at(self, path: &Path, format: &'static str, action: &'static str) -> Error {
        let path = path.to_path_buf();
        match self {
            Self::Corrupt(reason) => Error::Corrupt { path, format, reason },
            Self::Feature(what) => Error::UnsupportedFeature { path, format, what },
            Self::TooLarge { needed, limit } => Error::TooLarge { path, needed, limit },
            Self::OutOfMemory { needed } => Error::OutOfMemory { path, needed },
            Self::Empty => Error::Empty { path },
            Self::CannotHold { what, instead } => Error::CannotHold { path, format, what, instead },
            Self::Encode(reason) => Error::Encode { path, format, reason },
            Self::Image(error) => error,
            Self::Io(source) => Error::io(&path, action, source),
        }
    }
}
