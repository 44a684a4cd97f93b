//! Gradients as pictures.

use std::path::Path;

use signal_io::{Format, SampleType, Transfer};

use crate::picture_kind::PictureKind;

/// How a file holds a gradient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slopes {
    /// All derivatives: dx, then dy of each channel.
    Derivatives,
    /// The gradient's length per colour channel.
    Lengths,
}

impl Slopes {
    /// What a file of this name gets: all derivatives where the format takes any number of float channels.
    pub fn for_file(path: &Path) -> Self {
        match Format::from_extension(path) {
            Some(Format::Exr | Format::Npy) => Self::Derivatives,
            _ => Self::Lengths,
        }
    }

    /// The kind of the picture for a field of this kind: floats that are no light.
    pub fn picture_kind(self, of: &PictureKind) -> PictureKind {
        let channels = match self {
            Self::Derivatives => {
                of.channels.iter().flat_map(|c| [format!("{c}.dx"), format!("{c}.dy")]).collect()
            }
            Self::Lengths => colors(of).map(|c| of.channels[c].clone()).collect(),
        };
        PictureKind {
            channels,
            sample: SampleType::F32,
            transfer: Transfer::Unspecified,
            icc: None,
        }
    }

    /// Its planes, from the derivatives of all channels.
    pub fn planes(self, of: &PictureKind, derivatives: Vec<f32>) -> Vec<f32> {
        match self {
            Self::Derivatives => derivatives,
            Self::Lengths => {
                let n = derivatives.len() / (2 * of.channels.len()).max(1);
                let plane = |p: usize| &derivatives[p * n..(p + 1) * n];
                let length = |c: usize| {
                    plane(2 * c).iter().zip(plane(2 * c + 1)).map(|(dx, dy)| dx.hypot(*dy))
                };
                colors(of).flat_map(length).collect()
            }
        }
    }
}

/// The channels that are not alpha; all if there are no others.
fn colors(of: &PictureKind) -> impl Iterator<Item = usize> + '_ {
    let alone = of.channels.iter().all(|c| c == "A");
    (0..of.channels.len()).filter(move |c| alone || of.channels[*c] != "A")
}

/// Divides by the largest value, so that integers hold all; gives that value, 1 where all are zero.
pub fn normalise(planes: &mut [f32]) -> f32 {
    let largest = planes.iter().copied().fold(0.0, f32::max);
    let white = if largest > 0.0 { largest } else { 1.0 };
    planes.iter_mut().for_each(|v| *v /= white);
    white
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(channels: &[&str]) -> PictureKind {
        PictureKind {
            channels: channels.iter().map(|c| (*c).to_owned()).collect(),
            sample: SampleType::U8,
            transfer: Transfer::Srgb,
            icc: Some(vec![1]),
        }
    }

    #[test]
    fn lengths_leave_alpha_out() {
        let of = kind(&["Y", "A"]);
        let derivatives = vec![3.0, 0.0, 4.0, -2.0, 9.0, 9.0, 9.0, 9.0];
        let lengths = Slopes::for_file(Path::new("a.png"));
        assert_eq!(lengths.picture_kind(&of).channels, ["Y"]);
        let mut planes = lengths.planes(&of, derivatives.clone());
        assert_eq!(planes, [5.0, 2.0]);
        assert_eq!((normalise(&mut planes), &planes[..]), (5.0, &[1.0, 0.4][..]));
        assert_eq!(normalise(&mut [0.0, 0.0]), 1.0);

        let all = Slopes::for_file(Path::new("a.exr"));
        assert_eq!(all.picture_kind(&of).channels, ["Y.dx", "Y.dy", "A.dx", "A.dy"]);
        assert_eq!(all.planes(&of, derivatives.clone()), derivatives);
        assert_eq!(lengths.picture_kind(&kind(&["A"])).channels, ["A"]);
    }
}
