/// How the stored values relate to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Transfer {
    /// Encoded for display with the sRGB curve (or the curve of the embedded profile), as stored in
    /// PNG, JPEG, WebP, GIF, integer TIFF and PNM.
    #[default]
    Srgb,
    /// Proportional to light, as stored in EXR, Radiance HDR and PFM.
    Linear,
    /// Numbers without a stated meaning: npy arrays and float TIFF. Writing never converts them.
    Unspecified,
}

/// The sRGB curve inverted: display value to light, both 1 at white.
///
/// Exact piecewise definition, odd in its argument (negative values mirror the positive ones) and
/// continued beyond 1 without clamping, so that it is a bijection of the reals.
///
/// Source: IEC 61966-2-1.
pub fn srgb_to_linear(value: f32) -> f32 {
    let v = value.abs();
    let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    linear.copysign(value)
}

/// The sRGB curve: light to display value. Inverse of [`srgb_to_linear`], with the same extension.
///
/// Source: IEC 61966-2-1.
pub fn linear_to_srgb(value: f32) -> f32 {
    let v = value.abs();
    let encoded = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// powf is good to about 2 ulp; the inverse multiplies relative errors by at most 2.4.
    const ROUND_TRIP: f32 = 1e-6;

    #[test]
    fn the_curves_are_inverse_and_odd() {
        for k in -2000..=2000 {
            let v = k as f32 * 0.01;
            let back = linear_to_srgb(srgb_to_linear(v));
            assert!((back - v).abs() <= ROUND_TRIP * v.abs().max(1.0), "{v} came back as {back}");
            assert_eq!(srgb_to_linear(-v), -srgb_to_linear(v));
        }
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert!((srgb_to_linear(1.0) - 1.0).abs() < 1e-6);
        assert!(linear_to_srgb(443.0) > 10.0, "values above white are not clamped");
    }

    #[test]
    fn reference_values_of_the_standard() {
        // 8-bit 188 is the well-known display value of half the light (0.5029).
        assert!((srgb_to_linear(188.0 / 255.0) - 0.502_886).abs() < 1e-5);
        assert!((srgb_to_linear(10.0 / 255.0) - 0.003_035_27).abs() < 1e-7);
        assert!((linear_to_srgb(0.18) - 0.461_356).abs() < 1e-5);
    }

    #[test]
    fn every_sixteen_bit_value_survives_the_linear_detour() {
        for k in 0..=65_535_u32 {
            let v = k as f32 / 65_535.0;
            let back = (linear_to_srgb(srgb_to_linear(v)) * 65_535.0).round() as u32;
            assert_eq!(back, k);
        }
    }
}
