use super::{Image, usual_names};
use crate::transfer::{linear_to_srgb, srgb_to_linear};
use crate::{Error, Result, Transfer};

/// Rec. 709 luminance weights of red, green and blue (ITU-R BT.709-6, item 3.2).
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Other channels, other curves: conversions of a picture.
impl Image {
    /// The channels with these names, in this order.
    ///
    /// # Errors
    /// [`Error::Shape`] when a name is missing or repeated, or when none is given.
    pub fn select(&self, names: &[&str]) -> Result<Self> {
        let mut data = Vec::with_capacity(names.len() * self.pixel_count());
        for name in names {
            let plane = self.plane_named(name).ok_or_else(|| Error::Shape {
                what: format!("no channel {name:?}; there are {:?}", self.channels),
            })?;
            data.extend_from_slice(plane);
        }
        let mut out = Self::new(self.width, self.height, names, data)?;
        (out.sample, out.transfer, out.icc) = (self.sample, self.transfer, self.icc.clone());
        Ok(out)
    }

    /// Takes the alpha plane off.
    pub fn split_alpha(self) -> (Self, Option<Vec<f32>>) {
        let Some(alpha) = self.alpha().map(<[f32]>::to_vec) else { return (self, None) };
        let colors = self.color_indices();
        if colors.is_empty() {
            return (self, None); // A picture of alpha only keeps its single plane.
        }
        let names = colors.iter().map(|c| self.channels[*c].clone()).collect();
        let data = colors.iter().flat_map(|c| self.plane(*c).iter().copied()).collect();
        (self.with_planes(names, data), Some(alpha))
    }

    /// Puts an alpha plane on, replacing the one that is there. Alpha becomes the last channel.
    ///
    /// # Errors
    /// [`Error::Shape`] when the plane has another number of pixels.
    pub fn with_alpha(self, alpha: &[f32]) -> Result<Self> {
        let (expected, found) = (self.pixel_count(), alpha.len());
        if expected != found {
            let what = format!("an alpha plane of {found} values for {expected} pixels");
            return Err(Error::Shape { what });
        }
        let (mut image, _) = self.split_alpha();
        image.channels.push("A".to_owned());
        image.data.extend_from_slice(alpha);
        Ok(image)
    }

    /// One grey channel `Y` from one or three colour channels, by Rec. 709 luminance weights; alpha
    /// is kept, a colour profile is not.
    ///
    /// The weights apply to the values as they are: for sRGB-encoded values the result is luma. For
    /// true luminance convert with [`to_transfer`](Self::to_transfer) first.
    ///
    /// # Errors
    /// [`Error::ChannelCount`] for other numbers of colour channels.
    pub fn to_gray(&self) -> Result<Self> {
        let planes: Vec<&[f32]> = self.color_indices().iter().map(|c| self.plane(*c)).collect();
        let gray = match planes[..] {
            [y] => y.to_vec(),
            [r, g, b] => (0..self.pixel_count())
                .map(|k| LUMINANCE[0] * r[k] + LUMINANCE[1] * g[k] + LUMINANCE[2] * b[k])
                .collect(),
            _ => return Err(Error::ChannelCount { expected: 3, found: planes.len() }),
        };
        let mut out = self.with_planes(vec!["Y".to_owned()], gray);
        out.icc = out.icc.filter(|_| planes.len() == 1);
        match self.alpha() {
            Some(alpha) => out.with_alpha(alpha),
            None => Ok(out),
        }
    }

    /// Three colour channels `R G B` from one (the same plane three times) or three; alpha is kept,
    /// a grey profile is not.
    ///
    /// # Errors
    /// [`Error::ChannelCount`] for other numbers of colour channels.
    pub fn to_rgb(&self) -> Result<Self> {
        let planes: Vec<&[f32]> = self.color_indices().iter().map(|c| self.plane(*c)).collect();
        let data = match planes[..] {
            [y] => y.repeat(3),
            [r, g, b] => [r, g, b].concat(),
            _ => return Err(Error::ChannelCount { expected: 3, found: planes.len() }),
        };
        let mut out = self.with_planes(usual_names(3), data);
        out.icc = out.icc.filter(|_| planes.len() == 3);
        match self.alpha() {
            Some(alpha) => out.with_alpha(alpha),
            None => Ok(out),
        }
    }

    /// The same light in another encoding: the sRGB curve is applied to or removed from the colour
    /// channels. From or to [`Transfer::Unspecified`] only the label changes.
    pub fn to_transfer(&self, transfer: Transfer) -> Self {
        let mut out = self.clone();
        let curve: fn(f32) -> f32 = match (self.transfer, transfer) {
            (Transfer::Srgb, Transfer::Linear) => srgb_to_linear,
            (Transfer::Linear, Transfer::Srgb) => linear_to_srgb,
            _ => |v| v,
        };
        let n = self.pixel_count();
        for c in self.color_indices() {
            out.data[c * n..(c + 1) * n].iter_mut().for_each(|v| *v = curve(*v));
        }
        out.transfer = transfer;
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rgba() -> Image {
        let data = (0..24).map(|v| v as f32 / 8.0).collect();
        let mut image = Image::new(3, 2, &["R", "G", "B", "A"], data).unwrap();
        image.icc = Some(vec![1, 2, 3]);
        image.transfer = Transfer::Srgb;
        image
    }

    #[test]
    fn alpha_comes_off_and_on() {
        let image = rgba();
        assert_eq!(image.color_count(), 3);
        assert_eq!(image.alpha().unwrap()[0], 18.0 / 8.0);
        let (colors, alpha) = image.clone().split_alpha();
        assert_eq!(colors.channels(), ["R", "G", "B"]);
        assert_eq!(colors.with_alpha(&alpha.unwrap()).unwrap(), image);
        assert!(matches!(image.with_alpha(&[1.0]), Err(Error::Shape { .. })));
    }

    #[test]
    fn gray_of_gray_rgb_is_the_gray() {
        let y = Image::new(2, 1, &["Y"], vec![0.25, 443.0]).unwrap();
        let rgb = y.to_rgb().unwrap();
        assert_eq!(rgb.channels(), ["R", "G", "B"]);
        let back = rgb.to_gray().unwrap();
        for (got, expected) in back.plane(0).iter().zip(y.plane(0)) {
            assert!((got - expected).abs() <= 1e-6 * expected, "{got} for {expected}");
        }
        assert_eq!(rgba().to_gray().unwrap().channels(), ["Y", "A"]);
    }

    #[test]
    fn transfer_leaves_alpha_alone() {
        let image = rgba();
        let linear = image.to_transfer(Transfer::Linear);
        assert_eq!(linear.alpha(), image.alpha());
        assert_eq!(linear.plane(1)[0], srgb_to_linear(0.75));
        let back = linear.to_transfer(Transfer::Srgb);
        for (got, expected) in back.as_planar().iter().zip(image.as_planar()) {
            assert!((got - expected).abs() <= 1e-6 * expected.max(1.0), "{got} for {expected}");
        }
    }
}
