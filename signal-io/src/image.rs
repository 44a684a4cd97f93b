mod convert;

use std::collections::HashSet;

use inr_core::{Domain, Samples};

use crate::{Error, Result, SampleType, Transfer};

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
}
