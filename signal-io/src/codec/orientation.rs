use ::image::metadata::Orientation;

use crate::Image;

/// Turns a stored picture upright.
pub(super) fn upright(image: Image, orientation: Orientation) -> Image {
    let (w, h) = (image.width(), image.height());
    match orientation {
        Orientation::NoTransforms => image,
        Orientation::FlipHorizontal => image.rearranged(w, h, |x, y| (w - 1 - x, y)),
        Orientation::FlipVertical => image.rearranged(w, h, |x, y| (x, h - 1 - y)),
        Orientation::Rotate180 => image.rearranged(w, h, |x, y| (w - 1 - x, h - 1 - y)),
        Orientation::Rotate90 => image.rearranged(h, w, |x, y| (y, h - 1 - x)),
        Orientation::Rotate270 => image.rearranged(h, w, |x, y| (w - 1 - y, x)),
        Orientation::Rotate90FlipH => image.rearranged(h, w, |x, y| (y, x)),
        Orientation::Rotate270FlipH => image.rearranged(h, w, |x, y| (w - 1 - y, h - 1 - x)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::image::{DynamicImage, GrayImage};

    #[test]
    fn agrees_with_the_image_crate() {
        let stored: Vec<u8> = (0..12).collect();
        for exif in 1..=8 {
            let orientation = Orientation::from_exif(exif).unwrap();
            let gray = GrayImage::from_raw(4, 3, stored.clone()).unwrap();
            let mut expected = DynamicImage::ImageLuma8(gray);
            expected.apply_orientation(orientation);

            let data = stored.iter().map(|v| f32::from(*v)).collect();
            let got = upright(Image::new(4, 3, &["Y"], data).unwrap(), orientation);
            assert_eq!(
                (got.width() as u32, got.height() as u32),
                (expected.width(), expected.height())
            );
            let got: Vec<u8> = got.as_planar().iter().map(|v| *v as u8).collect();
            assert_eq!(&got, expected.as_bytes(), "EXIF {exif}");
        }
    }
}
