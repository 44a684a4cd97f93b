use std::fmt;

/// The number type a volume's file stores a value in.
///
/// Values in memory are `f32`: of 32-bit integers and doubles the first 24 significant bits are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum VoxelType {
    /// Unsigned, 8 bits.
    U8,
    /// Signed, 8 bits.
    I8,
    /// Unsigned, 16 bits.
    U16,
    /// Signed, 16 bits.
    I16,
    /// Unsigned, 32 bits.
    U32,
    /// Signed, 32 bits.
    I32,
    /// Single-precision float.
    F32,
    /// Double-precision float.
    F64,
}

impl VoxelType {
    /// Every type, small ones first.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// The short name: `u8`, `i16`, `f32` and so on.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// The type with this short name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name)
    }

    /// Bytes per value.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// True for the floating-point types.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The smallest and the largest value; infinite for floats.
    pub fn range(self) -> [f64; 2] {
        match self {
            Self::U8 => [0.0, f64::from(u8::MAX)],
            Self::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
            Self::U16 => [0.0, f64::from(u16::MAX)],
            Self::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
            Self::U32 => [0.0, f64::from(u32::MAX)],
            Self::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
            Self::F32 | Self::F64 => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    /// Calls `take` for every whole number in `bytes`.
    pub(super) fn decode(self, bytes: &[u8], little: bool, mut take: impl FnMut(f64)) {
        macro_rules! numbers {
            ($number:ty) => {
                for raw in bytes.chunks_exact(size_of::<$number>()) {
                    let raw = std::array::from_fn(|i| raw[i]);
                    let read =
                        if little { <$number>::from_le_bytes } else { <$number>::from_be_bytes };
                    take(f64::from(read(raw)));
                }
            };
        }
        match self {
            Self::U8 => numbers!(u8),
            Self::I8 => numbers!(i8),
            Self::U16 => numbers!(u16),
            Self::I16 => numbers!(i16),
            Self::U32 => numbers!(u32),
            Self::I32 => numbers!(i32),
            Self::F32 => numbers!(f32),
            Self::F64 => numbers!(f64),
        }
    }

    /// The nearest value this type has, and whether that is another one by more than rounding; NaN
    /// becomes 0 in integers.
    pub(super) fn quantize(self, value: f64) -> (f64, bool) {
        if self.is_float() {
            return (value, false);
        }
        let [min, max] = self.range();
        let nearest = value.round();
        match nearest.is_nan() {
            true => (0.0, true),
            false => (nearest.clamp(min, max), !(min..=max).contains(&nearest)),
        }
    }

    /// Appends a value that [`VoxelType::quantize`] has returned.
    pub(super) fn encode(self, value: f64, little: bool, out: &mut Vec<u8>) {
        macro_rules! number {
            ($number:ty) => {{
                let value = value as $number;
                match little {
                    true => out.extend(value.to_le_bytes()),
                    false => out.extend(value.to_be_bytes()),
                }
            }};
        }
        match self {
            Self::U8 => number!(u8),
            Self::I8 => number!(i8),
            Self::U16 => number!(u16),
            Self::I16 => number!(i16),
            Self::U32 => number!(u32),
            Self::I32 => number!(i32),
            Self::F32 => number!(f32),
            Self::F64 => number!(f64),
        }
    }
}

impl fmt::Display for VoxelType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the numbers of a file mean: `value = slope * number + intercept`.
///
/// The values of a [`Volume`](crate::Volume) are physical ones already; writing undoes the scaling.
/// Only NIfTI stores it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaling {
    /// Factor, finite and not 0.
    pub slope: f64,
    /// Value of the number 0, finite.
    pub intercept: f64,
}

impl Scaling {
    /// The numbers are the values.
    pub const IDENTITY: Self = Self { slope: 1.0, intercept: 0.0 };

    /// The scaling that spreads a range of values over all numbers of an integer type; the identity
    /// for floats, and for ranges that are empty or not finite.
    pub fn spread(range: [f32; 2], sample: VoxelType) -> Self {
        let [low, high] = range.map(f64::from);
        let [min, max] = sample.range();
        let slope = (high - low) / (max - min);
        match slope > 0.0 && slope.is_finite() {
            true => Self { slope, intercept: low - slope * min },
            false => Self::IDENTITY,
        }
    }

    /// Whether it can be undone.
    pub fn is_valid(self) -> bool {
        self.slope != 0.0 && self.slope.is_finite() && self.intercept.is_finite()
    }

    pub(super) fn to_value(self, number: f64) -> f32 {
        // The identity is left out so that infinite numbers and -0.0 stay what they are.
        if self == Self::IDENTITY {
            return number as f32;
        }
        (self.slope * number + self.intercept) as f32
    }

    pub(super) fn to_number(self, value: f32) -> f64 {
        let value = f64::from(value);
        if self == Self::IDENTITY { value } else { (value - self.intercept) / self.slope }
    }
}

impl Default for Scaling {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_trip_in_both_byte_orders() {
        for sample in VoxelType::ALL {
            assert_eq!(VoxelType::from_name(sample.name()), Some(sample));
            for little in [true, false] {
                for value in [0.0, 1.0, 100.0, -100.0, 127.0, -128.0, 65_535.0, 1e6] {
                    let (number, clipped) = sample.quantize(value);
                    let mut bytes = Vec::new();
                    sample.encode(number, little, &mut bytes);
                    assert_eq!(bytes.len(), sample.bytes());
                    let mut back = Vec::new();
                    sample.decode(&bytes, little, |v| back.push(v));
                    assert_eq!(back, [number], "{sample} {value}");
                    assert_eq!(clipped, number != value, "{sample} {value}");
                }
            }
        }
    }

    #[test]
    fn rounding_is_to_nearest_and_nan_is_clipped() {
        assert_eq!(VoxelType::U8.quantize(254.6), (255.0, false));
        assert_eq!(VoxelType::U8.quantize(255.6), (255.0, true));
        assert_eq!(VoxelType::I8.quantize(-128.4), (-128.0, false));
        assert_eq!(VoxelType::I16.quantize(f64::NAN), (0.0, true));
        assert!(VoxelType::F32.quantize(f64::NAN).0.is_nan());
    }

    #[test]
    fn spread_reaches_both_ends() {
        for sample in [VoxelType::U8, VoxelType::I16] {
            let scaling = Scaling::spread([-1000.0, 3000.0], sample);
            let [min, max] = sample.range();
            assert_eq!(scaling.to_value(min), -1000.0);
            assert_eq!(scaling.to_value(max), 3000.0);
            assert!((scaling.to_number(3000.0) - max).abs() < 1e-6);
        }
        assert_eq!(Scaling::spread([2.0, 2.0], VoxelType::U8), Scaling::IDENTITY);
        assert_eq!(Scaling::spread([0.0, f32::NAN], VoxelType::U8), Scaling::IDENTITY);
    }
}
