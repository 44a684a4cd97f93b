use ::exr::prelude::f16;

use crate::Image;

/// Values of a number type, channels side by side, and how many colour values were clipped.
pub(crate) struct Quantized<T> {
    pub(crate) values: Vec<T>,
    pub(crate) clipped: usize,
}

/// Applies `convert` to every value, which answers the stored number and whether it was clipped.
pub(crate) fn interleave<T>(image: &Image, convert: impl Fn(f32) -> (T, bool)) -> Quantized<T> {
    let counts: Vec<bool> = image.channels().iter().map(|c| c != "A").collect();
    let planes: Vec<&[f32]> = (0..counts.len()).map(|c| image.plane(c)).collect();
    let mut values = Vec::with_capacity(image.as_planar().len());
    let mut clipped = 0;
    for k in 0..image.pixel_count() {
        for (plane, counted) in planes.iter().zip(&counts) {
            let (value, clip) = convert(plane[k]);
            values.push(value);
            clipped += usize::from(clip && *counted);
        }
    }
    Quantized { values, clipped }
}

/// 0..1 to 0..=255, to nearest. Clipped when that nearest integer is out of range; NaN becomes 0.
pub(crate) fn to_u8(value: f32) -> (u8, bool) {
    let (v, clipped) = to_integer(value, 255.0);
    (v as u8, clipped)
}

/// 0..1 to 0..=65535, to nearest. Clipped when that nearest integer is out of range; NaN becomes 0.
pub(crate) fn to_u16(value: f32) -> (u16, bool) {
    let (v, clipped) = to_integer(value, 65_535.0);
    (v as u16, clipped)
}

fn to_integer(value: f32, max: f32) -> (f32, bool) {
    // `as` turns NaN into 0, so the clamp only has to keep the two ends apart.
    let scaled = (value * max).round();
    (scaled.clamp(0.0, max), !(0.0..=max).contains(&scaled))
}

/// To half precision, to nearest even. Finite values beyond the largest half (65504) stay finite.
pub(crate) fn to_f16(value: f32) -> (f16, bool) {
    let half = f16::from_f32(value);
    match value.is_finite() && half.is_infinite() {
        true => (if value > 0.0 { f16::MAX } else { f16::MIN }, true),
        false => (half, false),
    }
}

/// As it is.
pub(crate) fn to_f32(value: f32) -> (f32, bool) {
    (value, false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_integer_comes_back() {
        for k in 0..=u8::MAX {
            assert_eq!(to_u8(f32::from(k) / 255.0), (k, false));
        }
        for k in 0..=u16::MAX {
            assert_eq!(to_u16(f32::from(k) / 65_535.0), (k, false));
        }
    }

    #[test]
    fn clipping_starts_half_a_step_outside() {
        assert_eq!(to_u8(1.0 + 0.4 / 255.0), (255, false));
        assert_eq!(to_u8(1.0 + 0.6 / 255.0), (255, true));
        assert_eq!(to_u8(-0.4 / 255.0), (0, false));
        assert_eq!(to_u8(-0.6 / 255.0), (0, true));
        assert_eq!(to_u8(f32::NAN), (0, true));
        assert_eq!(to_u16(f32::INFINITY), (65_535, true));
        assert_eq!(to_u16(f32::NEG_INFINITY), (0, true));
    }

    #[test]
    fn halves_stay_finite() {
        assert_eq!(to_f16(443.25), (f16::from_f32(443.25), false));
        assert_eq!(to_f16(-1e6), (f16::MIN, true));
        assert_eq!(to_f16(65_504.0), (f16::MAX, false));
        assert_eq!(to_f16(f32::INFINITY), (f16::INFINITY, false));
        assert!(to_f16(f32::NAN).0.is_nan());
    }
}
