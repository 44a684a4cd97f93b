//! From a problem to numbers on a box: which samples are solved for, and with which weights.

use inr_core::{Domain, distance_to};
use rayon::prelude::*;

use crate::axis::End;
use crate::problem::{Problem, Support};
use crate::tile::Frame;
use crate::{Error, Objective, Options, Result};

/// Coefficients solved for beyond the region where nothing decays slowly: the B-spline's own
/// decay, `0.268^8 = 3e-5`, times a change that is fixed a few samples further in.
const MARGIN: usize = 8;
/// In paper mode the change outside decays only through the spline basis: `0.268^20 = 4e-12`.
const PAPER_MARGIN: usize = 20;
/// Share of the inradius that is the default coupling length.
const DEFAULT_LENGTH: f32 = 0.04;
/// Least default coupling length, in reference pitches.
const LEAST_LENGTH: f32 = 2.0;
/// `band`: factor of the colour weight and width in reference pitches.
const BAND: (f32, f32) = (10.0, 2.0);

/// Coupling lengths after which the change of the background is below the tolerance. At the edge
/// it is at most about `exp(-2)` of the signals' range: most of the mismatch is a mean, which the
/// region absorbs, and the rest is shared with the inside.
fn decay_lengths(tolerance: f32) -> f32 {
    (-tolerance.ln() - 2.0).max(1.0)
}

/// Samples around the region in which the change fades below the tolerance.
pub fn margin<const D: usize>(
    domain: &Domain<D>,
    options: &Options,
    length: Option<f32>,
) -> [usize; D] {
    let paper = matches!(options.objective, Objective::Paper { .. });
    std::array::from_fn(|d| {
        let decay =
            length.map_or(0.0, |l| l / domain.pitch()[d] * decay_lengths(options.tolerance));
        decay.ceil().min(1e9) as usize + if paper { PAPER_MARGIN } else { MARGIN }
    })
}

/// Weights of the quadratic form on the box that is solved for. One value per sample cell.
pub struct Plan<const D: usize> {
    /// First background sample of the box.
    pub start: [usize; D],
    pub frame: Frame<D>,
    /// `(h_ref / h_d)^2` per axis.
    pub alpha: [f32; D],
    pub h_ref: f32,
    /// Region weight.
    pub region: Vec<f32>,
    /// How much of the guidance is followed: the region weight, faded by `feather`. Empty where it is the region weight; see [`Plan::guide`].
    faded: Vec<f32>,
    /// Weight of `|c - c_S|^2`.
    pub colour: Vec<f32>,
    /// What that weight is outside the region before `ramp` and `band`.
    pub colour_outside: f32,
    /// Weight of `|c - c_T|^2`, times the region weight.
    pub keep: f32,
    /// Weight of the squared gradient, or empty where it is 1.
    pub gamma: Vec<f32>,
    /// Coefficients that may change, or empty where all may.
    pub free: Vec<bool>,
    /// Sum of the region weights.
    pub measure: f64,
    /// Samples of the whole background.
    pub total: usize,
    /// The coupling length in use, physical units.
    pub length: Option<f32>,
    pub support: Support<D>,
    pub warnings: Vec<String>,
}

impl<const D: usize> Plan<D> {
    pub fn new<const C: usize>(problem: &Problem<'_, D, C>) -> Result<Self> {
        let options = &problem.options;
        options.validate()?;
        let domain = *problem.background.domain();
        let mut support = problem.support()?;
        let covered = support.measure >= domain.len() as f64;
        let keeps = matches!(options.objective, Objective::Screened { keep: Some(_), .. });
        if covered && !keeps {
            return Err(Error::NoAnchor);
        }
        let h_ref = domain.reference_pitch();
        let length = match options.objective {
            Objective::Screened { length: Some(l), .. } => Some(l),
            Objective::Screened { length: None, .. } => {
                Some(default_length(&domain, &support, h_ref))
            }
            _ => None,
        };
        let margin = margin(&domain, options, length);
        let (start, frame) = solved_box(&domain, &support, margin);
        let boxed = domain.cropped(start, frame.shape).expect("a box inside a valid domain");
        let region = support.weights_on(start, frame.shape);
        let warnings = std::mem::take(&mut support.warnings);
        let mut plan = Self {
            start,
            frame,
            alpha: domain.pitch().map(|h| (h_ref / h).powi(2)),
            h_ref,
            faded: Vec::new(),
            colour: Vec::new(),
            colour_outside: 0.0,
            keep: 0.0,
            gamma: Vec::new(),
            free: Vec::new(),
            measure: support.measure,
            total: domain.len(),
            length,
            region,
            support,
            warnings,
        };
        plan.set_guide(&boxed, options.feather);
        plan.set_weights(&boxed, problem);
        Ok(plan)
    }

    /// The plan of one block of a larger screened problem of unit pitch, whose weights are known.
    /// Everything begins at the block's first sample.
    pub fn of_block(frame: Frame<D>, region: Vec<f32>, length: f32, keep: Option<f32>) -> Self {
        let whole = Support {
            start: [0; D],
            shape: frame.shape,
            weight: region,
            measure: 0.0,
            warnings: Vec::new(),
        };
        let (measured, region) = whole.measured();
        let colour_outside = length.powi(-2);
        Self {
            start: [0; D],
            frame,
            alpha: [1.0; D],
            h_ref: 1.0,
            faded: Vec::new(),
            colour: region.par_iter().map(|m| colour_outside * (1.0 - m)).collect(),
            colour_outside,
            keep: keep.map_or(0.0, |l| l.powi(-2)),
            gamma: Vec::new(),
            free: Vec::new(),
            measure: measured.measure,
            total: frame.len(),
            length: Some(length),
            region,
            support: measured,
            warnings: Vec::new(),
        }
    }

    /// Fades the guidance over `feather` inside the region's edge.
    fn set_guide(&mut self, boxed: &Domain<D>, feather: f32) {
        if feather > 0.0 {
            let inside = distance_to(boxed, |k| self.region[k] < 0.5);
            let fade = |(m, d): (&f32, f32)| m * (d / feather).min(1.0);
            self.faded = self.region.iter().zip(inside).map(fade).collect();
        }
    }

    /// How much of the guidance is followed: the region weight, faded by `feather`.
    pub fn guide(&self) -> &[f32] {
        if self.faded.is_empty() { &self.region } else { &self.faded }
    }

    fn set_weights<const C: usize>(&mut self, boxed: &Domain<D>, problem: &Problem<'_, D, C>) {
        let options = &problem.options;
        let outside = self.region.par_iter().map(|m| 1.0 - m);
        match options.objective {
            Objective::Screened { keep, .. } => {
                let length = self.length.expect("screened problems have a length");
                self.colour_outside = (self.h_ref / length).powi(2);
                self.colour = outside.map(|o| self.colour_outside * o).collect();
                self.keep = keep.map_or(0.0, |l| (self.h_ref / l).powi(2));
            }
            Objective::Paper { lambda } => {
                let weight = f64::from(lambda) * self.measure / (self.total as f64 - self.measure);
                self.colour_outside = weight as f32;
                self.colour = outside.map(|o| self.colour_outside * o).collect();
                self.gamma = self.region.clone();
            }
            Objective::Dirichlet => {
                self.colour = vec![0.0; self.region.len()];
                self.free = erode(&self.frame, &self.region);
                return;
            }
        }
        if options.ramp || options.band {
            let distance = distance_to(boxed, |k| self.region[k] >= 0.5);
            let scale = self.length.unwrap_or(self.h_ref);
            for (c, d) in self.colour.iter_mut().zip(distance) {
                if options.ramp && d.is_finite() {
                    *c *= ramp(d, scale);
                }
                if options.band && d <= BAND.1 * self.h_ref {
                    *c *= BAND.0;
                }
            }
        }
    }

    /// Weight of the squared value per cell: background's colours outside, patch's inside.
    pub fn screening(&self) -> Vec<f32> {
        self.colour.par_iter().zip(&self.region).map(|(c, m)| c + self.keep * m).collect()
    }
}

/// `ramp`: factor of the colour weight at a distance from the region.
pub fn ramp(distance: f32, scale: f32) -> f32 {
    (1.0 + distance / scale).powi(2)
}

/// Largest distance of a region sample to a sample outside, in physical units. Samples beyond the
/// signal do not count as outside.
pub fn default_length<const D: usize>(domain: &Domain<D>, support: &Support<D>, h_ref: f32) -> f32 {
    if D == 1 {
        let depth = depth_of_line(&support.weight, support.start[0], domain.shape()[0]);
        return (DEFAULT_LENGTH * depth as f32 * domain.pitch()[0]).max(LEAST_LENGTH * h_ref);
    }
    let (start, frame) = solved_box(domain, support, [1; D]);
    let weight = support.weights_on(start, frame.shape);
    let boxed = domain.cropped(start, frame.shape).expect("a box inside a valid domain");
    let inradius = distance_to(&boxed, |k| weight[k] < 0.5)
        .into_iter()
        .filter(|d| d.is_finite())
        .fold(0.0f32, f32::max);
    (DEFAULT_LENGTH * inradius).max(LEAST_LENGTH * h_ref)
}

/// Samples from the deepest sample inside a line's region to the nearest one outside. `weight` begins
/// at sample `start` of `n`.
fn depth_of_line(weight: &[f32], start: usize, n: usize) -> usize {
    let (mut deepest, mut from) = (0, 0);
    while from < weight.len() {
        let inside = weight[from] >= 0.5;
        let run = weight[from..].iter().take_while(|w| (**w >= 0.5) == inside).count();
        if inside {
            // A run that ends with the signal has its outside on the other side.
            let (at_start, at_end) = (start + from == 0, start + from + run == n);
            deepest = deepest.max(match (at_start, at_end) {
                (true, true) => 0,
                (false, false) => run.div_ceil(2),
                _ => run,
            });
        }
        from += run;
    }
    deepest
}

/// The support widened by `margin`. A side that comes within reach of the signal's border is the
/// border. Between two free ends the number of intervals is made even, which keeps the finest
/// multigrid transfer regular.
pub(crate) fn solved_box<const D: usize>(
    domain: &Domain<D>,
    support: &Support<D>,
    margin: [usize; D],
) -> ([usize; D], Frame<D>) {
    let mut start = [0; D];
    let mut shape = [0; D];
    let mut ends = [[End::Mirror; 2]; D];
    for d in 0..D {
        let n = domain.shape()[d];
        let mut lo = support.start[d].saturating_sub(margin[d]);
        let mut hi = (support.start[d] + support.shape[d]).saturating_add(margin[d]).min(n);
        // A gap of up to eight samples to the border costs less than a second kind of border.
        if lo <= MARGIN {
            lo = 0;
        }
        if n - hi <= MARGIN {
            hi = n;
        }
        let zeros = usize::from(lo > 0) + usize::from(hi < n);
        if (hi - lo + zeros).is_multiple_of(2) && margin[d] > 1 {
            if hi < n {
                hi -= 1;
            } else if lo > 0 {
                lo += 1;
            }
        }
        ends[d] = [lo > 0, hi < n].map(|cut| if cut { End::Zero } else { End::Mirror });
        start[d] = lo;
        shape[d] = hi - lo;
    }
    (start, Frame { shape, ends })
}

/// Coefficients whose whole support lies in the region: those that a Dirichlet problem may change.
fn erode<const D: usize>(frame: &Frame<D>, region: &[f32]) -> Vec<bool> {
    let mut free: Vec<bool> = region.iter().map(|m| *m >= 1.0).collect();
    let mut stride = 1;
    for d in 0..D {
        let (n, ends) = (frame.shape[d], frame.ends[d]);
        let old = free.clone();
        for (k, f) in free.iter_mut().enumerate() {
            let i = k / stride % n;
            *f = (-2..=2).all(|j| {
                crate::axis::ghost(i as isize + j, n, ends)
                    .is_some_and(|p| old[k - i * stride + p * stride])
            });
        }
        stride *= n;
    }
    free
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_of_a_line_is_that_of_the_distance_transform() {
        let lines: [&[f32]; 6] = [
            &[0.0, 1.0, 1.0, 1.0, 0.0, 0.6, 0.0],
            &[1.0, 1.0, 0.4, 1.0, 1.0, 1.0],
            &[0.0, 0.3, 0.0],
            &[1.0, 1.0, 1.0],
            &[0.0, 1.0, 1.0, 1.0, 1.0, 0.0],
            &[1.0],
        ];
        for line in lines {
            let domain = Domain::<1>::unit([line.len()]).unwrap();
            let distances = distance_to(&domain, |k| line[k] < 0.5).into_iter();
            let want = distances.filter(|d| d.is_finite()).fold(0.0f32, f32::max);
            assert_eq!(depth_of_line(line, 0, line.len()) as f32, want, "{line:?}");
        }
    }
}
