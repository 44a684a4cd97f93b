//! The signals of a problem as spline coefficients on a box around the region.

use inr_core::{Field, Jet, Spline, mirror, prefilter};
use rayon::prelude::*;

use crate::problem::{Patch, Problem, aligned_shift, copy_box, zip_box};
use crate::tile::Frame;
use crate::{Error, Guidance, Result};

/// Samples around the box that the prefilter needs: `0.268^16 = 7e-10`.
const PREFILTER_REACH: usize = 16;

/// Coefficients on a box around the region.
pub(crate) struct Inputs<'a, const D: usize, const C: usize> {
    /// The background; empty where linear guidance does not need it.
    pub background: Vec<Vec<f32>>,
    /// Patch minus background.
    pub difference: Vec<Vec<f32>>,
    /// For linear guidance the field whose gradient is `v - grad c_S`, if it is not `difference`.
    pub target: Option<Vec<Vec<f32>>>,
    /// Set where the guidance needs the patch off the background's lattice.
    pub field: Option<Moved<'a, D, C>>,
    pub linear: bool,
}

/// A field moved by an offset.
pub(crate) struct Moved<'a, const D: usize, const C: usize> {
    field: Source<'a, D, C>,
    offset: [f32; D],
}

pub(crate) enum Source<'a, const D: usize, const C: usize> {
    Owned(Spline<D, C>),
    Borrowed(&'a dyn Field<D, C>),
}

impl<const D: usize, const C: usize> Moved<'_, D, C> {
    fn field(&self) -> &dyn Field<D, C> {
        match &self.field {
            Source::Owned(spline) => spline,
            Source::Borrowed(field) => *field,
        }
    }

    pub(crate) fn jets(&self, x: &mut [[f32; D]], y: &mut [Jet<D, C>]) {
        for x in x.iter_mut() {
            for d in 0..D {
                x[d] -= self.offset[d];
            }
        }
        self.field().eval_jet(x, y);
    }
}

impl<'a, const D: usize, const C: usize> Inputs<'a, D, C> {
    pub fn new(problem: &Problem<'a, D, C>, start: [usize; D], frame: Frame<D>) -> Result<Self> {
        let domain = *problem.background.domain();
        // A wider box, so that the prefilter's own mirror at its border is not felt inside.
        let wide: [usize; D] = std::array::from_fn(|d| start[d].saturating_sub(PREFILTER_REACH));
        let wide_shape: [usize; D] = std::array::from_fn(|d| {
            (start[d] + frame.shape[d] + PREFILTER_REACH).min(domain.shape()[d]) - wide[d]
        });
        let (mut patch, field) = sample_patch(problem, wide, wide_shape)?;
        let monochrome = matches!(problem.guidance, Guidance::Monochrome);
        let linear = field.is_none()
            && (problem.guidance.is_patch()
                || matches!(problem.guidance, Guidance::Mix { .. } | Guidance::Monochrome));
        let copied = |c: usize| {
            let lo = wide.map(|v| v as isize);
            copy_box(problem.background.plane(c), domain.shape(), lo, wide_shape, |_, _| None)
        };
        let wanted = if linear { 0 } else { C };
        let background: Vec<Vec<f32>> =
            (0..if monochrome { C } else { wanted }).map(copied).collect();
        check("background", &background, wide_shape, wide)?;
        // `mu S + phi T`, in place of `T`.
        let mix = |planes: &mut [Vec<f32>], mu: f32, phi: f32| {
            for (c, t) in planes.iter_mut().enumerate() {
                let s = problem.background.plane(c);
                zip_box(s, domain.shape(), wide, wide_shape, t, |t, s| *t = mu * s + phi * *t);
            }
        };
        let target = match &problem.guidance {
            Guidance::Mix { mu, phi } => {
                let mut target = patch.clone();
                mix(&mut target, mu - 1.0, *phi);
                Some(target)
            }
            Guidance::Monochrome => Some(monochrome_target(&problem.guidance, &background, &patch)),
            _ => None,
        };
        mix(&mut patch, -1.0, 1.0);
        if background.is_empty() && check("difference", &patch, wide_shape, wide).is_err() {
            let background: Vec<Vec<f32>> = (0..C).map(copied).collect();
            check("background", &background, wide_shape, wide)?;
        }
        let coefficients = |planes: Vec<Vec<f32>>| -> Vec<Vec<f32>> {
            planes
                .into_iter()
                .map(|mut plane| {
                    prefilter(&wide_shape, &mut plane);
                    let lo = std::array::from_fn(|d| (start[d] - wide[d]) as isize);
                    copy_box(&plane, wide_shape, lo, frame.shape, |_, _| None)
                })
                .collect()
        };
        let difference = coefficients(patch);
        let target = target.map(&coefficients);
        let background = if wanted == 0 { Vec::new() } else { coefficients(background) };
        Ok(Self { background, difference, target, field, linear })
    }
}

/// Luminance of the patch minus each channel of the background.
fn monochrome_target<const D: usize, const C: usize>(
    guidance: &Guidance<D, C>,
    background: &[Vec<f32>],
    patch: &[Vec<f32>],
) -> Vec<Vec<f32>> {
    let n = background[0].len();
    let gray: Vec<f32> = (0..n)
        .map(|k| {
            let mut jet = Jet::ZERO;
            (0..C).for_each(|c| jet.grad[c] = [patch[c][k]; D]);
            guidance.evaluate(&[0.0; D], &Jet::ZERO, &jet)[0][0]
        })
        .collect();
    background.iter().map(|s| gray.iter().zip(s).map(|(g, s)| g - s).collect()).collect()
}

/// The patch's values on a box of background samples, and the field itself where the box's
/// lattice does not carry it exactly.
pub(crate) fn sample_patch<'a, const D: usize, const C: usize>(
    problem: &Problem<'a, D, C>,
    start: [usize; D],
    shape: [usize; D],
) -> Result<(Vec<Vec<f32>>, Option<Moved<'a, D, C>>)> {
    let domain = problem.background.domain();
    let moved = match problem.patch {
        Patch::Samples { samples, offset } => {
            match aligned_shift(domain, samples.domain(), &offset) {
                Some(shift) => {
                    let (n, lo) = (
                        samples.domain().shape(),
                        std::array::from_fn(|d| start[d] as isize - shift[d]),
                    );
                    let planes: Vec<Vec<f32>> = (0..C)
                        .map(|c| {
                            copy_box(samples.plane(c), n, lo, shape, |i, d| Some(mirror(i, n[d])))
                        })
                        .collect();
                    check("patch", &planes, shape, start)?;
                    return Ok((planes, None));
                }
                None => {
                    samples.check_finite().map_err(|e| not_finite("patch", e))?;
                    Moved { field: Source::Owned(Spline::interpolate(samples)), offset }
                }
            }
        }
        Patch::Field { field, offset } => Moved { field: Source::Borrowed(field), offset },
    };
    let lattice = domain.cropped(start, shape).expect("a box inside a valid domain");
    let n = lattice.len();
    let mut planes = vec![vec![0.0f32; n]; C];
    let mut x: Vec<[f32; D]> = (0..n).map(|k| lattice.position(lattice.unflatten(k))).collect();
    x.iter_mut().for_each(|x| (0..D).for_each(|d| x[d] -= moved.offset[d]));
    let mut y = vec![[0.0f32; C]; n];
    moved.field().eval(&x, &mut y);
    for (k, y) in y.iter().enumerate() {
        (0..C).for_each(|c| planes[c][k] = y[c]);
    }
    check("patch", &planes, shape, start)?;
    Ok((planes, Some(moved)))
}

pub(crate) fn not_finite(signal: &'static str, error: inr_core::Error) -> Error {
    match error {
        inr_core::Error::NotFinite { index, channel, value } => {
            Error::NotFinite { signal, index, channel, value }
        }
        _ => Error::NotFinite { signal, index: Vec::new(), channel: 0, value: f32::NAN },
    }
}

/// Refuses NaN and infinity, naming the background sample.
pub(crate) fn check<const D: usize>(
    signal: &'static str,
    planes: &[Vec<f32>],
    shape: [usize; D],
    start: [usize; D],
) -> Result<()> {
    for (channel, plane) in planes.iter().enumerate() {
        // All exponent bits set is infinity or NaN; counting them needs no branch.
        let special = |v: &f32| u32::from(v.to_bits() & 0x7F80_0000 == 0x7F80_0000);
        let bad = plane
            .par_chunks(1 << 14)
            .find_map_first(|chunk| (chunk.iter().map(special).sum::<u32>() > 0).then_some(()));
        if bad.is_some() {
            let k = plane.iter().position(|v| !v.is_finite()).unwrap_or(0);
            let mut rest = k;
            let index = (0..D)
                .map(|d| {
                    let i = start[d] + rest % shape[d];
                    rest /= shape[d];
                    i
                })
                .collect();
            return Err(Error::NotFinite { signal, index, channel, value: plane[k] });
        }
    }
    Ok(())
}
