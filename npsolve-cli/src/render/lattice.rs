//! Where the pixels of a rendered picture are.

use inr_core::{Domain, Result};

use crate::values::{Crop, Size};

/// The lattice of a picture of a field over `signal`: the crop or the whole, covered by so many pixels
/// that its outer edges stay in place. Without a size or a scale pixels are as large as the signal's.
pub fn target(
    signal: &Domain<2>,
    crop: Option<Crop>,
    size: Option<Size>,
    scale: Option<f32>,
) -> Result<Domain<2>> {
    let shape = signal.shape();
    let whole = Crop { start: [0.0; 2], size: shape.map(|n| n as f32) };
    let Crop { start, size: extent } = crop.unwrap_or(whole);
    let scale = f64::from(scale.unwrap_or(1.0));
    // Casts of large numbers saturate; what is too large is an error of the domain.
    let scaled = extent.map(|e| (f64::from(e) * scale).round().max(1.0) as usize);
    let pixels = size.map_or(scaled, |Size(pixels)| pixels);
    if crop.is_none() {
        return signal.resized(pixels);
    }
    let mut pitch = signal.pitch();
    let mut origin = signal.origin();
    for d in 0..2 {
        let (h, n) = (f64::from(signal.pitch()[d]), pixels[d] as f64);
        let step = f64::from(extent[d]) / n;
        pitch[d] = (h * step) as f32;
        // Edge `start` of the crop is half a sample before sample `start`.
        let first = f64::from(start[d]) - 0.5 + 0.5 * step;
        origin[d] = (f64::from(signal.origin()[d]) + h * first) as f32;
    }
    Domain::new(pixels, pitch, origin, signal.unit_of_length())
}

/// Whether a crop lies within the signal.
pub fn is_inside(signal: &Domain<2>, crop: &Crop) -> bool {
    let inside = |d: usize| crop.start[d] + crop.size[d] <= signal.shape()[d] as f32;
    inside(0) && inside(1)
}

#[cfg(test)]
mod tests {
    use inr_core::Unit;

    use super::*;

    fn signal() -> Domain<2> {
        Domain::new([12, 8], [0.5, 2.0], [3.0, -1.0], Unit::Millimetre).unwrap()
    }

    fn crop(start: [f32; 2], size: [f32; 2]) -> Option<Crop> {
        Some(Crop { start, size })
    }

    #[test]
    fn without_options_it_is_the_signals() {
        assert_eq!(target(&signal(), None, None, None), Ok(signal()));
        assert_eq!(target(&signal(), crop([0.0; 2], [12.0, 8.0]), None, None), Ok(signal()));
    }

    #[test]
    fn whole_crops_are_parts_of_the_lattice() {
        let part = target(&signal(), crop([2.0, 3.0], [5.0, 4.0]), None, None);
        assert_eq!(part, signal().cropped([2, 3], [5, 4]));
        let finer = target(&signal(), crop([2.0, 3.0], [5.0, 4.0]), Some(Size([20, 4])), None);
        assert_eq!(finer, part.unwrap().resized([20, 4]));
    }

    #[test]
    fn sizes_and_scales_keep_the_edges() {
        let half = target(&signal(), None, None, Some(0.5)).unwrap();
        assert_eq!(Ok(half), signal().resized([6, 4]));
        assert_eq!(target(&signal(), None, Some(Size([6, 4])), None), Ok(half));
        let tiny = target(&signal(), None, None, Some(1e-6)).unwrap();
        assert_eq!(tiny.shape(), [1, 1]);
        assert!(target(&signal(), None, None, Some(1e30)).is_err());
    }

    #[test]
    fn fractions_shift_the_samples() {
        let part = target(&signal(), crop([1.5, 0.0], [2.0, 0.5]), None, None).unwrap();
        assert_eq!((part.shape(), part.pitch()), ([2, 1], [0.5, 1.0]));
        assert_eq!(part.origin(), [3.0 + 1.5 * 0.5, -1.0 - 0.25 * 2.0]);
        assert!(is_inside(&signal(), &Crop { start: [1.5, 0.0], size: [10.5, 8.0] }));
        assert!(!is_inside(&signal(), &Crop { start: [1.5, 0.0], size: [11.0, 8.0] }));
    }
}
