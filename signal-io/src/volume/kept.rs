/// The unit of lengths in a volume's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum LengthUnit {
    /// Not said; taken as millimetres.
    Unknown,
    /// Metres.
    Metre,
    /// Millimetres.
    #[default]
    Millimetre,
    /// Micrometres.
    Micrometre,
}

impl LengthUnit {
    /// Millimetres in one of this unit.
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Unknown | Self::Millimetre => 1.0,
            Self::Metre => 1e3,
            Self::Micrometre => 1e-3,
        }
    }

    /// The usual abbreviation; empty for the unknown unit.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::Metre => "m",
            Self::Millimetre => "mm",
            Self::Micrometre => "um",
        }
    }

    /// The unit with this abbreviation or name.
    pub(super) fn from_symbol(symbol: &str) -> Self {
        match symbol.trim().to_lowercase().as_str() {
            "m" | "meter" | "metre" => Self::Metre,
            "mm" | "millimeter" | "millimetre" => Self::Millimetre,
            "um" | "\u{b5}m" | "\u{3bc}m" | "\\u00b5m" | "micron" | "micrometer" => {
                Self::Micrometre
            }
            _ => Self::Unknown,
        }
    }
}

/// What is not interpreted and returns to a file of the same kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Kept {
    /// Whether the file says where the volume's axes point in a body.
    pub(super) oriented: bool,
    /// From and to NIfTI.
    pub(super) nifti: Option<Box<super::nifti::Extra>>,
    /// Key and value pairs of NRRD.
    pub(super) entries: Vec<(String, String)>,
}
