use std::collections::HashSet;

use inr_core::{Domain, Samples};

use crate::transfer::{linear_to_srgb, srgb_to_linear};
use crate::{Error, Result, SampleType, Transfer};

/// Rec. 709 luminance weights of red, green and blue (ITU-R BT.709-6, item 3.2).
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// A picture in floating point with one or more named channels.
///
/// Planes are stored one after the other; inside a plane rows go from top to bottom and x is
/// contiguous: value `(x, y)` of channel `c` is `as_planar()[(c * height + y) * width + x]`.
/// Integer files are scaled to [0, 1]; float files keep their numbers, whatever they are (443,
/// negative, NaN). The channel named `A` is alpha; all others are colour channels in the sense of
/// this crate, be they `Y`, `R G B`, or the layers of an EXR file.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    channels: Vec<String>,
    data: Vec<f32>,
    /// The number type of the file the picture came from: what it is written back as.
    pub sample: SampleType,
    /// How the colour channels relate to light. Alpha is always linear.
    pub transfer: Transfer,
    /// The ICC profile of the file. Carried along, never interpreted.
    pub icc: Option<Vec<u8>>,
}

impl Image {
    /// Takes planar values with their channel names; float, [`Transfer::Unspecified`], no profile.
    ///
    /// # Errors
    /// [`Error::Shape`] when the picture has no pixels or channels, when the number of values is not
    /// `width * height * channels`, or when channel names are empty or repeated.
    pub fn new<S: AsRef<str>>(
        width: usize,
        height: usize,
        channels: &[S],
        data: Vec<f32>,
    ) -> Result<Self> {
        let channels: Vec<String> = channels.iter().map(|c| c.as_ref().to_owned()).collect();
        let fail = |what| Err(Error::Shape { what });
        if Domain::<2>::unit([width, height]).is_err() || channels.is_empty() {
            return fail(format!("{width} x {height} pixels in {} channels", channels.len()));
        }
        if (width * height).checked_mul(channels.len()) != Some(data.len()) {
            let (c, n) = (channels.len(), data.len());
            return fail(format!("{width} x {height} pixels in {c} channels, but {n} values"));
        }
        let mut seen = HashSet::new();
        if let Some(name) = channels.iter().find(|c| c.is_empty() || !seen.insert(c.as_str())) {
            return fail(format!("the channel name {name:?} is empty or not unique"));
        }
        let (sample, transfer) = (SampleType::F32, Transfer::Unspecified);
        Ok(Self { width, height, channels, data, sample, transfer, icc: None })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels.
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// Channel names in the order of the planes, alpha included.
    pub fn channels(&self) -> &[String] {
        &self.channels
    }

    /// The lattice of pixel centres: unit pitch, first pixel at the origin.
    pub fn domain(&self) -> Domain<2> {
        Domain::unit([self.width, self.height]).expect("checked when the picture was made")
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The planes, without the picture around them.
    pub fn into_planar(self) -> Vec<f32> {
        self.data
    }

    /// The values of one channel.
    ///
    /// # Panics
    /// If `channel >= channels().len()`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.pixel_count();
        &self.data[channel * n..(channel + 1) * n]
    }

    /// The values of the channel with this name.
    pub fn plane_named(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().position(|c| c == name).map(|c| self.plane(c))
    }

    /// The alpha plane: 0 transparent, 1 opaque. Not multiplied into or divided out of the colours.
    pub fn alpha(&self) -> Option<&[f32]> {
        self.plane_named("A")
    }

    /// Indices of the channels that are not alpha.
    fn color_indices(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|c| self.channels[*c] != "A").collect()
    }

    /// Number of channels that are not alpha.
    pub fn color_count(&self) -> usize {
        self.color_indices().len()
    }

    /// The same picture with other channels; sample type, transfer and profile stay.
    fn with_planes(&self, channels: Vec<String>, data: Vec<f32>) -> Self {
        debug_assert_eq!(data.len(), self.pixel_count() * channels.len());
        let (width, height, icc) = (self.width, self.height, self.icc.clone());
        let (sample, transfer) = (self.sample, self.transfer);
        Self { width, height, channels, data, sample, transfer, icc }
    }

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

    /// The colour channels as typed samples.
    ///
    /// # Errors
    /// [`Error::ChannelCount`] when there are not exactly `C` colour channels.
    pub fn to_samples<const C: usize>(&self) -> Result<Samples<2, C>> {
        let colors = self.color_indices();
        if colors.len() != C {
            return Err(Error::ChannelCount { expected: C, found: colors.len() });
        }
        let data = colors.iter().flat_map(|c| self.plane(*c).iter().copied()).collect();
        Samples::from_planar(self.domain(), data).map_err(|e| Error::Shape { what: e.to_string() })
    }

    /// A picture of these samples, without alpha; sample type, transfer and profile are those of
    /// `like`.
    ///
    /// The channel names are those of `like` when it has `C` colour channels; otherwise they are the
    /// usual ones (`Y`, `R G B`, `C0 C1 ...`) and the profile, made for other channels, is left out.
    ///
    /// # Errors
    /// [`Error::Shape`] when `C` is 0.
    pub fn from_samples<const C: usize>(samples: &Samples<2, C>, like: &Self) -> Result<Self> {
        let [width, height] = samples.domain().shape();
        let colors = like.color_indices();
        let same = colors.len() == C;
        let names = match same {
            true => colors.iter().map(|c| like.channels[*c].clone()).collect(),
            false => usual_names(C),
        };
        let mut out = Self::new(width, height, &names, samples.as_planar().to_vec())?;
        (out.sample, out.transfer) = (like.sample, like.transfer);
        out.icc = like.icc.clone().filter(|_| same);
        Ok(out)
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

    /// Rearranges the pixels: `source(x, y)` says which old pixel comes to the new `(x, y)`.
    pub(crate) fn rearranged(
        &self,
        width: usize,
        height: usize,
        source: impl Fn(usize, usize) -> (usize, usize),
    ) -> Self {
        debug_assert_eq!(width * height, self.pixel_count());
        let mut data = Vec::with_capacity(self.data.len());
        for c in 0..self.channels.len() {
            let plane = self.plane(c);
            for y in 0..height {
                data.extend(
                    (0..width).map(|x| source(x, y)).map(|(x, y)| plane[y * self.width + x]),
                );
            }
        }
        Self { width, height, ..self.with_planes(self.channels.clone(), data) }
    }
}

/// The names of channels that come without: `Y`, `R G B`, `R G B A`, else `C0 C1 ...`.
///
/// Two channels are not grey with alpha: arrays of two channels are vector fields as a rule.
pub(crate) fn usual_names(count: usize) -> Vec<String> {
    match count {
        1 => vec!["Y".to_owned()],
        3 | 4 => ["R", "G", "B", "A"][..count].iter().map(|c| (*c).to_owned()).collect(),
        _ => (0..count).map(|c| format!("C{c}")).collect(),
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
    fn bad_pictures_are_typed_errors() {
        for (w, h, names, n) in [
            (0, 2, vec!["Y"], 0),
            (2, 2, vec![], 0),
            (2, 2, vec!["Y"], 5),
            (1, 1, vec!["Y", "Y"], 2),
            (1, 1, vec![""], 1),
            (usize::MAX, usize::MAX, vec!["Y"], 1),
        ] {
            let result = Image::new(w, h, &names, vec![0.0; n]);
            assert!(matches!(result, Err(Error::Shape { .. })), "{w} {h} {names:?} {n}");
        }
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
    fn samples_round_trip_with_metadata() {
        let image = rgba();
        let samples = image.to_samples::<3>().unwrap();
        let back = Image::from_samples(&samples, &image).unwrap();
        assert_eq!(back, image.clone().split_alpha().0);
        let gray = Image::from_samples(&Samples::<2, 1>::zeros(image.domain()), &image).unwrap();
        assert_eq!((gray.channels(), &gray.icc), (&["Y".to_owned()][..], &None));
        assert!(matches!(
            image.to_samples::<1>(),
            Err(Error::ChannelCount { expected: 1, found: 3 })
        ));
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
