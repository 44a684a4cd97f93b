/// The number type an audio file stores a sample in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AudioSample {
    /// 8-bit integer, stored with an offset of 128.
    U8,
    /// 16-bit integer.
    I16,
    /// 24-bit integer.
    I24,
    /// 32-bit integer; reading rounds to the 24 significant bits of a float.
    I32,
    /// Single-precision float; also what double precision and lossy formats decode to.
    F32,
}

impl AudioSample {
    /// "8-bit", "16-bit", "24-bit", "32-bit" or "float".
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "8-bit",
            Self::I16 => "16-bit",
            Self::I24 => "24-bit",
            Self::I32 => "32-bit",
            Self::F32 => "float",
        }
    }

    /// Bits per sample.
    pub fn bits(self) -> u16 {
        match self {
            Self::U8 => 8,
            Self::I16 => 16,
            Self::I24 => 24,
            Self::I32 | Self::F32 => 32,
        }
    }

    /// True for the floating-point type.
    pub fn is_float(self) -> bool {
        self == Self::F32
    }

    /// The smallest integer type with this many bits.
    pub(super) fn integer(bits: u32) -> Self {
        match bits {
            0..=8 => Self::U8,
            9..=16 => Self::I16,
            17..=24 => Self::I24,
            _ => Self::I32,
        }
    }

    /// The integer that stands for 1.0, one more than the largest there is.
    pub(super) fn full_scale(self) -> f64 {
        f64::from(1u32 << (self.bits() - 1))
    }
}

/// A value as an integer with `full_scale` for 1.0, to nearest, and whether it was clipped: more
/// than one step beyond what there is, or NaN, which becomes 0.
///
/// 1.0 itself is one step beyond; counting it would report every sound with a peak of 1 as damaged.
pub(super) fn to_integer(value: f32, full_scale: f64) -> (i32, bool) {
    let scaled = (f64::from(value) * full_scale).round();
    let clipped = !(-full_scale..=full_scale).contains(&scaled);
    // `as` turns NaN into 0; the clamp keeps 24 bits within 24 bits.
    (scaled.clamp(-full_scale, full_scale - 1.0) as i32, clipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_and_clipped() {
        let sixteen = |v| to_integer(v, AudioSample::I16.full_scale());
        assert_eq!(sixteen(1.0), (32_767, false));
        assert_eq!(sixteen(-1.0), (-32_768, false));
        assert_eq!(sixteen(1.0001), (32_767, true));
        assert_eq!(sixteen(-1.0001), (-32_768, true));
        assert_eq!(sixteen(0.6 / 32_768.0), (1, false));
        assert_eq!(sixteen(-0.4 / 32_768.0), (0, false));
        assert_eq!(sixteen(f32::NAN), (0, true));
        assert_eq!(sixteen(f32::NEG_INFINITY), (-32_768, true));
        assert_eq!(to_integer(1.0, AudioSample::I32.full_scale()), (i32::MAX, false));
    }
}
