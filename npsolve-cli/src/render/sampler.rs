//! Values and gradients of a field as planes, averaged where the picture is coarser than the signal.

use inr_core::{Domain, Field, Jet, Result};

/// Points evaluated at a time: enough for all threads, little memory.
const BATCH: usize = 1 << 16;

/// What is wanted of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Its values.
    pub values: bool,
    /// Its derivatives.
    pub gradient: bool,
}

/// Planes of a rendered field, one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Planes {
    /// One per channel, if wanted.
    pub values: Vec<f32>,
    /// Two per channel, along x and along y, if wanted.
    pub gradient: Vec<f32>,
}

/// Samples a field on a lattice. Where the lattice is coarser than `pitch` along an axis, its cells
/// are averaged by one point per `pitch` (midpoint rule), like `Spline::resample`.
///
/// `progress` gets the share that is done. Time is linear in the points; memory beyond the result is constant
/// unless a row is very long.
///
/// # Errors
/// Those of `Domain::resized` when the finer lattice is too large.
pub fn sample<const C: usize>(
    field: &impl Field<2, C>,
    pitch: [f32; 2],
    lattice: &Domain<2>,
    wanted: Wanted,
    progress: &mut dyn FnMut(f32),
) -> Result<Planes> {
    let [width, height] = lattice.shape();
    // 1e-6: rounding of a pitch that is meant to be equal.
    let ratio: [usize; 2] = std::array::from_fn(|d| {
        let r = f64::from(lattice.pitch()[d]) / f64::from(pitch[d]);
        (r - 1e-6).ceil().max(1.0) as usize
    });
    let fine =
        lattice.resized([width.saturating_mul(ratio[0]), height.saturating_mul(ratio[1])])?;
    let [columns, lines] = fine.shape();
    let mut planes = Planes::default();
    planes.values.resize(if wanted.values { C * lattice.len() } else { 0 }, 0.0);
    planes.gradient.resize(if wanted.gradient { 2 * C * lattice.len() } else { 0 }, 0.0);

    // Rows of the picture that are summed together, and fine rows that are evaluated together.
    let rows = (BATCH / (columns * ratio[1])).max(1);
    let block = (BATCH / columns).max(1);
    let (mut x, mut y) = (Vec::new(), Batch::new(wanted.gradient));
    for first in (0..height).step_by(rows) {
        let last = (first + rows).min(height);
        let mut sums = vec![[[0.0f64; 3]; C]; (last - first) * width];
        let end = (last * ratio[1]).min(lines);
        for begin in (first * ratio[1]..end).step_by(block) {
            let here = begin..(begin + block).min(end);
            x.clear();
            x.extend(here.clone().flat_map(|j| (0..columns).map(move |i| fine.position([i, j]))));
            y.evaluate(field, &x);
            for (j, row) in here.zip(y.jets.chunks(columns)) {
                let sums = &mut sums[(j / ratio[1] - first) * width..][..width];
                for (sum, jets) in sums.iter_mut().zip(row.chunks(ratio[0])) {
                    jets.iter().for_each(|jet| add(sum, jet));
                }
            }
        }
        let weight = 1.0 / (ratio[0] * ratio[1]) as f64;
        planes.set(first * width, lattice.len(), &sums, weight, wanted);
        progress(last as f32 / height as f32);
    }
    Ok(planes)
}

fn add<const C: usize>(sum: &mut [[f64; 3]; C], jet: &Jet<2, C>) {
    for c in 0..C {
        let [dx, dy] = jet.grad[c];
        for (sum, part) in sum[c].iter_mut().zip([jet.value[c], dx, dy]) {
            *sum += f64::from(part);
        }
    }
}

impl Planes {
    fn set<const C: usize>(
        &mut self,
        first: usize,
        n: usize,
        sums: &[[[f64; 3]; C]],
        weight: f64,
        wanted: Wanted,
    ) {
        for (k, sum) in sums.iter().enumerate() {
            for c in 0..C {
                let [value, dx, dy] = sum[c].map(|s| (s * weight) as f32);
                if wanted.values {
                    self.values[c * n + first + k] = value;
                }
                if wanted.gradient {
                    self.gradient[2 * c * n + first + k] = dx;
                    self.gradient[(2 * c + 1) * n + first + k] = dy;
                }
            }
        }
    }
}

/// Results of a batch as jets, whether or not gradients were asked for.
struct Batch<const C: usize> {
    with_gradient: bool,
    values: Vec<[f32; C]>,
    jets: Vec<Jet<2, C>>,
}

impl<const C: usize> Batch<C> {
    fn new(with_gradient: bool) -> Self {
        Self { with_gradient, values: Vec::new(), jets: Vec::new() }
    }

    fn evaluate(&mut self, field: &impl Field<2, C>, x: &[[f32; 2]]) {
        self.jets.resize(x.len(), Jet::ZERO);
        if self.with_gradient {
            return field.eval_jet(x, &mut self.jets);
        }
        self.values.resize(x.len(), [0.0; C]);
        field.eval(x, &mut self.values);
        self.jets.iter_mut().zip(&self.values).for_each(|(jet, value)| jet.value = *value);
    }
}

#[cfg(test)]
mod tests {
    use inr_core::{Samples, Spline};

    use super::*;

    const BOTH: Wanted = Wanted { values: true, gradient: true };

    /// f32 positions of up to 50 times slopes of up to 1.
    const TOLERANCE: f32 = 2e-5;

    fn spline() -> Spline<2, 2> {
        let domain = Domain::unit([50, 31]).unwrap();
        Spline::interpolate(&Samples::from_fn(domain, |[x, y]| {
            [(0.3 * x).sin() * (0.2 * y).cos(), 0.02 * x - (0.4 * y).sin()]
        }))
    }

    fn rendered(lattice: &Domain<2>, wanted: Wanted) -> Planes {
        sample(&spline(), [1.0; 2], lattice, wanted, &mut |_| {}).unwrap()
    }

    #[track_caller]
    fn assert_close(got: &[f32], expected: &[f32]) {
        assert_eq!(got.len(), expected.len());
        for (k, (g, e)) in got.iter().zip(expected).enumerate() {
            assert!((g - e).abs() <= TOLERANCE, "{k}: got {g}, expected {e}");
        }
    }

    #[test]
    fn any_size_is_the_splines_own_resampling() {
        for shape in [[50, 31], [100, 93], [25, 31], [7, 4], [1, 1], [13, 100]] {
            let lattice = spline().domain().resized(shape).unwrap();
            let expected = spline().resample(&lattice).unwrap();
            assert_close(&rendered(&lattice, BOTH).values, expected.as_planar());
        }
    }

    #[test]
    fn gradients_are_the_splines_derivatives() {
        let lattice = spline().domain().resized([120, 40]).unwrap();
        let got = rendered(&lattice, BOTH).gradient;
        let derivatives = [[1, 0], [0, 1]].map(|d| spline().eval_lattice(&lattice, d));
        let n = lattice.len();
        for plane in 0..4 {
            let expected = derivatives[plane % 2].plane(plane / 2);
            assert_close(&got[plane * n..(plane + 1) * n], expected);
        }
    }

    #[test]
    fn long_rows_and_parts_of_the_work_give_the_same() {
        // More points per row of the result than a batch has, and many rows per batch.
        let long = Domain::new([1, 1], [60_000.0, 3.0], [0.0; 2], Default::default()).unwrap();
        let wide = Spline::interpolate(&Samples::<2, 1>::from_fn(
            Domain::unit([60_000, 3]).unwrap(),
            |[x, _]| [x % 2.0],
        ));
        let long = Domain::new(long.shape(), long.pitch(), [29_999.5, 1.0], Default::default());
        let mean = sample(&wide, [1.0; 2], &long.unwrap(), BOTH, &mut |_| {}).unwrap();
        assert!((mean.values[0] - 0.5).abs() < 1e-4, "{mean:?}");
        let lattice = spline().domain().resized([3000, 61]).unwrap();
        let both = rendered(&lattice, BOTH);
        let values = rendered(&lattice, Wanted { values: true, gradient: false });
        assert_eq!((both.values, 0), (values.values, values.gradient.len()));
    }

    #[test]
    fn progress_ends_at_one() {
        let mut shares = Vec::new();
        let lattice = spline().domain().resized([700, 900]).unwrap();
        let only = Wanted { values: false, gradient: true };
        sample(&spline(), [1.0; 2], &lattice, only, &mut |s| shares.push(s)).unwrap();
        assert!(shares.is_sorted() && shares.len() > 2 && shares.last() == Some(&1.0));
    }
}
