use std::path::Path;

/// The number type a file stores a sample in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// 8-bit integer; 255 is 1.0.
    U8,
    /// 16-bit integer; 65535 is 1.0.
    U16,
    /// Half-precision float: 11 significant bits, up to 65504.
    F16,
    /// Single-precision float.
    F32,
}

impl SampleType {
    /// "8-bit", "16-bit", "half-float" or "float".
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "8-bit",
            Self::U16 => "16-bit",
            Self::F16 => "half-float",
            Self::F32 => "float",
        }
    }

    /// True for the floating-point types.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F16 | Self::F32)
    }
}

/// The file formats this crate knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Portable Network Graphics.
    Png,
    /// JPEG.
    Jpeg,
    /// Tagged Image File Format, BigTIFF included.
    Tiff,
    /// WebP; written without loss.
    WebP,
    /// GIF; read only, first frame.
    Gif,
    /// Netpbm: PBM, PGM, PPM and PAM.
    Pnm,
    /// Portable float map.
    Pfm,
    /// Radiance RGBE.
    Hdr,
    /// OpenEXR.
    Exr,
    /// NumPy array.
    Npy,
}

impl Format {
    /// Extensions that [`read_image`](crate::read_image) knows.
    pub const READABLE: &'static str =
        "png, jpg, tif, webp, gif, pbm, pgm, ppm, pnm, pam, pfm, hdr, exr, npy";
    /// Extensions that [`write_image`](crate::write_image) knows.
    pub const WRITABLE: &'static str =
        "png, jpg, tif, webp, pgm, ppm, pnm, pam, pfm, hdr, exr, npy";

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
            Self::WebP => "WebP",
            Self::Gif => "GIF",
            Self::Pnm => "PNM",
            Self::Pfm => "PFM",
            Self::Hdr => "Radiance HDR",
            Self::Exr => "OpenEXR",
            Self::Npy => "npy",
        }
    }

    /// The format that a file name promises; upper and lower case are the same.
    pub fn from_extension(path: &Path) -> Option<Self> {
        Some(match extension(path).as_str() {
            "png" | "apng" => Self::Png,
            "jpg" | "jpeg" | "jpe" | "jfif" => Self::Jpeg,
            "tif" | "tiff" => Self::Tiff,
            "webp" => Self::WebP,
            "gif" => Self::Gif,
            "pbm" | "pgm" | "ppm" | "pnm" | "pam" => Self::Pnm,
            "pfm" => Self::Pfm,
            "hdr" | "rgbe" | "pic" => Self::Hdr,
            "exr" => Self::Exr,
            "npy" => Self::Npy,
            _ => return None,
        })
    }

    /// The format that the first bytes of a file show (12 are enough).
    pub fn from_content(head: &[u8]) -> Option<Self> {
        Some(match head {
            [0x89, b'P', b'N', b'G', ..] => Self::Png,
            [0xff, 0xd8, 0xff, ..] => Self::Jpeg,
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Self::Tiff,
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Self::WebP,
            [b'G', b'I', b'F', b'8', ..] => Self::Gif,
            [0x76, 0x2f, 0x31, 0x01, ..] => Self::Exr,
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Self::Npy,
            [b'#', b'?', b'R', ..] => Self::Hdr,
            [b'P', b'F' | b'f', c, ..] if c.is_ascii_whitespace() => Self::Pfm,
            [b'P', b'1'..=b'7', c, ..] if c.is_ascii_whitespace() || *c == b'#' => Self::Pnm,
            _ => return None,
        })
    }
}

/// The extension in lower case, without the dot; empty when there is none.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listed_extensions_are_known() {
        for list in [Format::READABLE, Format::WRITABLE] {
            for ext in list.split(", ") {
                let path = format!("a.b/picture.{}", ext.to_uppercase());
                assert!(Format::from_extension(Path::new(&path)).is_some(), "{ext}");
            }
        }
        assert_eq!(Format::from_extension(Path::new("png")), None);
    }

    #[test]
    fn short_heads_are_unknown() {
        assert_eq!(Format::from_content(b""), None);
        assert_eq!(Format::from_content(b"P5"), None);
        assert_eq!(Format::from_content(b"RIFF\0\0\0\0WAVE"), None);
        assert_eq!(Format::from_content(b"P6\n"), Some(Format::Pnm));
    }
}
