use std::path::Path;

use crate::format::extension;

/// The audio formats this crate knows. All are read, WAV is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum AudioFormat {
    /// RIFF WAVE.
    Wav,
    /// Free Lossless Audio Codec.
    Flac,
    /// Vorbis in an Ogg container.
    Ogg,
    /// MPEG-1 and MPEG-2 Audio Layer III.
    Mp3,
}

impl AudioFormat {
    /// Extensions that [`read_audio`](crate::read_audio) knows.
    pub const READABLE: &'static str = "wav, flac, ogg, mp3";
    /// Extensions that [`write_audio`](crate::write_audio) knows.
    pub const WRITABLE: &'static str = "wav";

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wav => "WAV",
            Self::Flac => "FLAC",
            Self::Ogg => "Ogg Vorbis",
            Self::Mp3 => "MP3",
        }
    }

    /// The format that a file name promises; upper and lower case are the same.
    pub fn from_extension(path: &Path) -> Option<Self> {
        Some(match extension(path).as_str() {
            "wav" | "wave" => Self::Wav,
            "flac" => Self::Flac,
            "ogg" | "oga" => Self::Ogg,
            "mp3" => Self::Mp3,
            _ => return None,
        })
    }

    /// The format that the first bytes of a file show (12 are enough).
    pub fn from_content(head: &[u8]) -> Option<Self> {
        Some(match head {
            [b'R', b'I', b'F', b'F' | b'X', _, _, _, _, b'W', b'A', b'V', b'E', ..]
            | [b'R', b'F', b'6', b'4', ..] => Self::Wav,
            [b'f', b'L', b'a', b'C', ..] => Self::Flac,
            [b'O', b'g', b'g', b'S', ..] => Self::Ogg,
            // A frame header: eleven ones, then the bits 01 for Layer III.
            [b'I', b'D', b'3', ..] => Self::Mp3,
            [0xff, second, ..] if second & 0xe6 == 0xe2 => Self::Mp3,
            _ => return None,
        })
    }
}
