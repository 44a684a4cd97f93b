//! Pictures of one size and kind, one below the other in one tall picture: what videos (frames) and
//! light fields (views) are stored as. Plane after plane, and in a plane picture after picture, so
//! the planes of the tall picture are the planes of the signal.

pub(crate) mod folder;
pub(crate) mod listing;
pub(crate) mod natural;
pub(crate) mod pattern;
pub(crate) mod pictures;

use inr_core::{Domain, Samples};

use crate::{Error, Image, Result};

/// Picture `k` of the `count` in a strip.
///
/// # Panics
/// If `k >= count`.
pub(crate) fn picture(strip: &Image, count: usize, k: usize) -> Image {
    assert!(k < count, "picture {k} of {count}");
    let height = strip.height() / count;
    let n = strip.width() * height;
    let planes = (0..strip.channels().len()).map(|c| &strip.plane(c)[k * n..(k + 1) * n]);
    let data = planes.flatten().copied().collect();
    let mut image = Image::new(strip.width(), height, strip.channels(), data)
        .expect("part of a picture that was checked");
    adopt(&mut image, strip);
    image
}

/// What a picture says about its numbers, from another one.
pub(crate) fn adopt(image: &mut Image, like: &Image) {
    (image.sample, image.transfer, image.icc) = (like.sample, like.transfer, like.icc.clone());
}

/// What differs between two pictures that shall stand in one strip, in words.
pub(crate) fn difference(image: &Image, first: &Image) -> Option<String> {
    let size = |i: &Image| format!("{} x {} pixels", i.width(), i.height());
    if (image.width(), image.height()) != (first.width(), first.height()) {
        return Some(format!("{} where {} were expected", size(image), size(first)));
    }
    if image.channels() != first.channels() {
        let list = |i: &Image| i.channels().join(", ");
        return Some(format!("channels {} where {} were expected", list(image), list(first)));
    }
    (image.transfer != first.transfer)
        .then(|| format!("values are {:?} where {:?} was expected", image.transfer, first.transfer))
}

/// One below the other; sample type, transfer and profile are those of the first.
///
/// # Errors
/// [`Error::Shape`] for no pictures, and with the number of the one that differs from the first.
pub(crate) fn stack(pictures: &[Image]) -> Result<Image> {
    let Some(first) = pictures.first() else {
        return Err(Error::Shape { what: "no pictures".to_owned() });
    };
    for (k, image) in pictures.iter().enumerate() {
        if let Some(what) = difference(image, first) {
            return Err(Error::Shape { what: format!("picture {k}: {what}") });
        }
    }
    let mut data = Vec::with_capacity(first.as_planar().len() * pictures.len());
    for c in 0..first.channels().len() {
        pictures.iter().for_each(|p| data.extend_from_slice(p.plane(c)));
    }
    let height = first.height() * pictures.len();
    let mut strip = Image::new(first.width(), height, first.channels(), data)?;
    adopt(&mut strip, first);
    Ok(strip)
}

/// The colour channels of a strip on the lattice of the whole signal.
pub(crate) fn to_samples<const D: usize, const C: usize>(
    strip: &Image,
    shape: [usize; D],
    pitch: [f32; D],
) -> Result<Samples<D, C>> {
    let shape_error = |e: inr_core::Error| Error::Shape { what: e.to_string() };
    let domain =
        Domain::new(shape, pitch, [0.0; D], inr_core::Unit::Sample).map_err(shape_error)?;
    let colors = strip.channels().iter().enumerate().filter(|(_, name)| *name != "A");
    if strip.color_count() != C {
        return Err(Error::ChannelCount { expected: C, found: strip.color_count() });
    }
    let data = colors.flat_map(|(c, _)| strip.plane(c).iter().copied()).collect();
    Samples::from_planar(domain, data).map_err(shape_error)
}

/// The strip of these samples: axis 0 across, all others down.
pub(crate) fn from_samples<const D: usize, const C: usize>(
    samples: &Samples<D, C>,
    like: &Image,
) -> Result<Image> {
    let shape = samples.domain().shape();
    let domain = Domain::unit([shape[0], samples.domain().len() / shape[0]])
        .map_err(|e| Error::Shape { what: e.to_string() })?;
    let flat = Samples::<2, C>::from_planar(domain, samples.as_planar().to_vec())
        .map_err(|e| Error::Shape { what: e.to_string() })?;
    Image::from_samples(&flat, like)
}

/// Whether the rows of a strip are those of `count` pictures.
pub(crate) fn check_count(strip: &Image, count: usize) -> Result<()> {
    match count > 0 && strip.height().is_multiple_of(count) {
        true => Ok(()),
        false => {
            let what = format!("{} rows are not those of {count} pictures", strip.height());
            Err(Error::Shape { what })
        }
    }
}
