//! Masks from pictures.

use anyhow::{Result, bail};
use inr_core::RasterMask;
use signal_io::Image;

/// A mask with more than this share of nearly black samples was probably saved with losses.
const SUSPICIOUS_SHARE: f64 = 0.01;

/// Weights from a picture: its alpha where it is not opaque everywhere, else its luminance as stored.
pub fn from_image(
    image: &Image,
    name: &str,
    patch: &Image,
    warnings: &mut Vec<String>,
) -> Result<RasterMask<2>> {
    let [of_mask, of_patch] = [image, patch].map(|i| [i.width(), i.height()]);
    check_size(of_mask, of_patch, name)?;
    let weights = weights_of(image, name)?;
    let faint = weights.iter().filter(|w| is_faint(**w)).count();
    warnings.extend(faint_warning(faint, weights.len(), name));
    checked(image, weights, &format!("the mask {name}"))
}

/// A mask has the patch's size.
pub fn check_size([w, h]: [usize; 2], patch: [usize; 2], name: &str) -> Result<()> {
    if [w, h] != patch {
        let [pw, ph] = patch;
        bail!(
            "the mask {name} is {w} x {h} pixels and the patch {pw} x {ph}; a mask covers the patch \
             pixel by pixel, so give it the patch's size"
        );
    }
    Ok(())
}

/// Whether a weight is nearly black but not black.
pub fn is_faint(weight: f32) -> bool {
    weight > 0.0 && weight < 0.1
}

/// What to say of a mask with so many faint weights.
pub fn faint_warning(faint: usize, all: usize, name: &str) -> Option<String> {
    (faint as f64 > SUSPICIOUS_SHARE * all as f64).then(|| {
        format!(
            "{faint} samples of the mask {name} are nearly black but not black, and are blended \
             softly; if it was saved as JPEG, save it as PNG"
        )
    })
}

/// Weights from the patch's own alpha.
pub fn from_alpha(alpha: Vec<f32>, name: &str, patch: &Image) -> Result<RasterMask<2>> {
    checked(patch, alpha, &format!("the alpha of {name}"))
}

/// The mask in a picture, as a plane of weights that may still be out of range.
pub fn weights_of(image: &Image, name: &str) -> Result<Vec<f32>> {
    match image.alpha() {
        Some(alpha) if alpha.iter().any(|a| *a != 1.0) => return Ok(alpha.to_vec()),
        _ => {}
    }
    if !matches!(image.color_count(), 1 | 3) {
        let n = image.color_count();
        bail!("the mask {name} has {n} colour channels; use a grey or RGB picture, or alpha");
    }
    let gray = image.to_gray()?;
    // The luminance weights sum to 1 only up to rounding: white would be 1.0000001.
    let round = |v: &f32| if (*v - 1.0).abs() < 1e-6 { 1.0 } else { *v };
    Ok(gray.plane(0).iter().map(round).collect())
}

fn checked(image: &Image, weights: Vec<f32>, what: &str) -> Result<RasterMask<2>> {
    check_range(&weights, image.width(), 0, what)?;
    if weights.iter().all(|w| *w == 0.0) {
        bail!(empty(what));
    }
    Ok(RasterMask::new(image.domain(), weights)?)
}

/// Weights of rows from row `first` on lie between 0 and 1.
pub fn check_range(weights: &[f32], width: usize, first: usize, what: &str) -> Result<()> {
    if let Some(k) = weights.iter().position(|w| !(0.0..=1.0).contains(w)) {
        let (x, y, value) = (k % width, first + k / width, weights[k]);
        bail!("{what} holds {value} at pixel {x},{y}; weights lie between 0 (out) and 1 (in)");
    }
    Ok(())
}

/// What to say of a mask without any weight.
pub fn empty(what: &str) -> String {
    format!("{what} is empty: no pixel is to be pasted; paint what to paste white")
}
