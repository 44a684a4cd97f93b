//! Random small blending problems in any dimension.

use inr_core::{Domain, RasterMask, Samples, Unit};
use poisson_loss::{Guidance, Objective, Options, Strongest, solve};

use crate::oracle::Case;
use crate::signals::{Random, mask, textured};

/// A background, a patch and a mask on one lattice.
#[derive(Debug, Clone)]
pub struct Pair<const D: usize, const C: usize> {
    /// What stays outside.
    pub background: Samples<D, C>,
    /// What goes in.
    pub patch: Samples<D, C>,
    /// Where.
    pub region: RasterMask<D>,
}

/// Least and most samples per axis: what keeps a few dozen solves within seconds.
fn sizes(dims: usize) -> [usize; 2] {
    [[45, 90], [20, 40], [8, 16], [6, 8], [4, 5]][dims - 1]
}

impl<const D: usize, const C: usize> Pair<D, C> {
    /// Shape, anisotropic pitch, signals, and a ball, a ring or a half-space as region: all from
    /// one seed. Something is always inside and something outside.
    pub fn random(seed: u64) -> Self {
        Self::random_of(seed, sizes(D))
    }

    /// The same with a least and a most number of samples per axis.
    pub fn random_of(seed: u64, [least, most]: [usize; 2]) -> Self {
        let mut random = Random::new(seed);
        random.unit();
        let shape: [usize; D] =
            std::array::from_fn(|_| least + (random.unit() * (most - least + 1) as f64) as usize);
        let pitch = std::array::from_fn(|_| 0.7 + 0.6 * random.unit() as f32);
        let origin = std::array::from_fn(|_| 4.0 * random.unit() as f32 - 2.0);
        let domain = Domain::new(shape, pitch, origin, Unit::Sample).expect("a valid lattice");
        let centre: [f64; D] = std::array::from_fn(|_| 0.5 * random.unit() - 0.25);
        let (kind, radius) = ((random.unit() * 3.0) as usize, 0.4 + 0.3 * random.unit());
        // A ball of the same radius is an ever smaller share of a cube of more axes. It must hold a sample, and the
        // nearest may be half a pitch away along every axis.
        let nearest = shape.iter().map(|n| (*n as f64).powi(-2)).sum::<f64>().sqrt();
        let radius = (radius * (D as f64 / 3.0).max(1.0).sqrt()).max(1.05 * nearest);
        let region = mask(domain, |u| {
            let r = (0..D).map(|d| (u[d] - centre[d]).powi(2)).sum::<f64>().sqrt();
            f64::from(match kind {
                0 => r < radius,
                1 => r < radius && r > 0.3 * radius,
                _ => u[0] < centre[0],
            })
        });
        Self { background: textured(domain, seed ^ 0x55), patch: textured(domain, !seed), region }
    }

    /// The same signals and region with a guidance and options.
    pub fn case(&self, guidance: Guidance<D, C>, options: Options) -> Case<'_, D, C> {
        let Self { background, patch, region } = self;
        Case { background, patch, region, guidance, options }
    }

    /// The blend's samples.
    ///
    /// # Panics
    /// If it cannot be solved.
    pub fn blend(&self, guidance: Guidance<D, C>, options: Options) -> Samples<D, C> {
        solve(&self.case(guidance, options).problem()).expect("a solvable problem").samples
    }

    /// The pair with every signal and the mask read through a map of sample indices.
    pub fn mapped(&self, domain: Domain<D>, index: impl Fn([usize; D]) -> [usize; D]) -> Self {
        let old = *self.background.domain();
        let weights = map_plane(&old, self.region.weights(), &domain, &index);
        Self {
            background: map_samples(&self.background, domain, &index),
            patch: map_samples(&self.patch, domain, &index),
            region: RasterMask::new(domain, weights).expect("the same weights"),
        }
    }
}

/// Samples read through a map from the new lattice's indices to the old one's.
pub fn map_samples<const D: usize, const C: usize>(
    samples: &Samples<D, C>,
    domain: Domain<D>,
    index: impl Fn([usize; D]) -> [usize; D],
) -> Samples<D, C> {
    let old = samples.domain();
    let planes = (0..C).flat_map(|c| map_plane(old, samples.plane(c), &domain, &index)).collect();
    Samples::from_planar(domain, planes).expect("as many samples")
}

fn map_plane<const D: usize>(
    old: &Domain<D>,
    plane: &[f32],
    domain: &Domain<D>,
    index: impl Fn([usize; D]) -> [usize; D],
) -> Vec<f32> {
    let strides = old.strides();
    let at = |k| {
        let i = index(domain.unflatten(k));
        (0..D).map(|d| i[d] * strides[d]).sum::<usize>()
    };
    (0..domain.len()).map(|k| plane[at(k)]).collect()
}

/// Largest difference of two arrays.
pub fn largest_difference(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "arrays to compare");
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

/// The screened objective with a length, at the solver's own tolerance.
pub fn screened(length: f32) -> Options {
    Options::with_objective(Objective::Screened { length: Some(length), keep: None })
}

/// The three rules of the paper.
pub fn rules<const D: usize, const C: usize>() -> [Guidance<D, C>; 3] {
    [Guidance::Patch, Guidance::Strongest(Strongest::Joint), Guidance::SUM]
}
