use std::path::Path;

use crate::format::extension;

/// The file formats of volumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum VolumeFormat {
    /// NIfTI-1 and NIfTI-2 in one file, plain or gzip.
    Nifti,
    /// NRRD with its data attached.
    Nrrd,
    /// NumPy array (Z, Y, X) or (Z, Y, X, C).
    Npy,
    /// TIFF with one page per z.
    Tiff,
    /// Bare numbers, and a JSON file that describes them.
    Raw,
}

impl VolumeFormat {
    /// Extensions that [`read_volume`](crate::read_volume) and [`write_volume`](crate::write_volume) know.
    pub const EXTENSIONS: &'static str =
        "nii, nii.gz, nrrd, npy, tif, tiff, json (beside raw numbers)";

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nifti => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::Npy => "npy",
            Self::Tiff => "TIFF",
            Self::Raw => "raw volume",
        }
    }

    /// Whether files can say that a number means `slope * number + intercept`.
    pub fn has_scaling(self) -> bool {
        matches!(self, Self::Nifti | Self::Raw)
    }

    /// The format that a file name promises; upper and lower case are the same.
    pub fn from_extension(path: &Path) -> Option<Self> {
        Some(match extension(path).as_str() {
            "nii" => Self::Nifti,
            "gz" if extension(&path.with_extension("")) == "nii" => Self::Nifti,
            "nrrd" | "nhdr" => Self::Nrrd,
            "npy" => Self::Npy,
            "tif" | "tiff" => Self::Tiff,
            "json" => Self::Raw,
            _ => return None,
        })
    }

    /// The format that the first 8 bytes of a file show. Gzip counts as NIfTI: no other format here is
    /// compressed as a whole.
    pub fn from_content(head: &[u8]) -> Option<Self> {
        Some(match head {
            [0x1f, 0x8b, ..] => Self::Nifti,
            // The size of the header, 348 or 540, in both byte orders.
            [0x5c, 1, 0, 0, ..] | [0, 0, 1, 0x5c, ..] => Self::Nifti,
            [0x1c, 2, 0, 0, ..] | [0, 0, 2, 0x1c, ..] => Self::Nifti,
            [b'N', b'R', b'R', b'D', ..] => Self::Nrrd,
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Self::Npy,
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Self::Tiff,
            _ => return None,
        })
    }
}
