use proptest::prelude::*;

use super::*;
use crate::{BoxRegion, Ellipsoid, Unit};

/// f32 rounding of distances up to 100.
const TOLERANCE: f64 = 2e-5;

fn random_mask<const D: usize>(shape: [usize; D], pitch: [f32; D], bits: &[bool]) -> RasterMask<D> {
    let domain = Domain::new(shape, pitch, [-1.0; D], Unit::Millimetre).unwrap();
    RasterMask::new(domain, (0..domain.len()).map(|k| f32::from(u8::from(bits[k]))).collect())
        .unwrap()
}

/// The definition over all pairs of samples, in f64: `reach` pitches before the other's centre.
/// The lattice goes on for one ring of outside samples, which is as far as it matters.
fn distance_to_other_side<const D: usize>(
    mask: &RasterMask<D>,
    sample: usize,
    reach: f64,
    beyond_is_outside: bool,
) -> f64 {
    let (domain, here) = (mask.domain(), mask.domain().unflatten(sample));
    let ring = Domain::<D>::unit(domain.shape().map(|n| n + 2)).unwrap();
    let mut nearest = f64::INFINITY;
    for k in 0..ring.len() {
        let there = ring.unflatten(k);
        let within = (0..D).all(|d| there[d] > 0 && there[d] <= domain.shape()[d]);
        let flat: usize = (0..D)
            .map(|d| there[d].wrapping_sub(1).wrapping_mul(domain.strides()[d]))
            .fold(0, usize::wrapping_add);
        let other_is_inside = within && mask.is_inside(flat);
        if other_is_inside == mask.is_inside(sample) || !(within || beyond_is_outside) {
            continue;
        }
        let gap = |d: usize| ((here[d] + 1).abs_diff(there[d]) as f64 - reach).max(0.0);
        let squared = |d: usize| (gap(d) * f64::from(domain.pitch()[d])).powi(2);
        nearest = nearest.min((0..D).map(squared).sum::<f64>().sqrt());
    }
    nearest
}

fn check_against_definition<const D: usize>(mask: &RasterMask<D>) {
    for (k, signed) in mask.signed_distances().iter().enumerate() {
        let got = f64::from(if mask.is_inside(k) { -signed } else { *signed });
        let want = distance_to_other_side(mask, k, 0.5, true);
        assert!(got == want || (got - want).abs() < TOLERANCE, "sample {k}: {got} {want}");
        let x = mask.domain().position(mask.domain().unflatten(k));
        let here = mask.signed_distance(&x);
        assert!(here == *signed || (here - signed).abs() < TOLERANCE as f32, "{here} {signed}");
        assert_eq!(mask.weight(&x), mask.weights()[k]);
    }
    for beyond_is_outside in [false, true] {
        let inside = (0..mask.domain().len()).filter(|k| mask.is_inside(*k));
        let want = inside
            .map(|k| distance_to_other_side(mask, k, 0.0, beyond_is_outside))
            .fold(0.0, f64::max);
        let got = f64::from(mask.inradius(beyond_is_outside));
        assert!(got == want || (got - want).abs() < TOLERANCE, "inradius {got} {want}");
    }
}

fn bits(len: usize) -> impl Strategy<Value = Vec<bool>> {
    (0.05..1.0_f64).prop_flat_map(move |p| prop::collection::vec(prop::bool::weighted(p), len))
}

proptest! {
    #[test]
    fn distances_match_their_definition(
        shape in prop::array::uniform3(1..7_usize),
        pitch in prop::array::uniform3(0.2..4.0_f32),
        bits in bits(216),
    ) {
        check_against_definition(&random_mask([shape[0]], [pitch[0]], &bits));
        check_against_definition(&random_mask([shape[0], shape[1]], [pitch[0], pitch[1]], &bits));
        check_against_definition(&random_mask(shape, pitch, &bits));
    }

    /// A distance function has slope at most 1; so has its multilinear interpolant, per axis.
    #[test]
    fn distance_is_lipschitz_along_axes(
        bits in bits(20),
        x in prop::array::uniform2(-4.0..8.0_f32),
        step in 0.0..3.0_f32,
    ) {
        let mask = random_mask([5, 4], [1.0, 1.5], &bits);
        prop_assume!(bits[..20].iter().any(|b| *b));
        for axis in 0..2 {
            let mut y = x;
            y[axis] += step;
            let change = (mask.signed_distance(&y) - mask.signed_distance(&x)).abs();
            prop_assert!(change <= step + 1e-5, "{} over {}", change, step);
        }
    }
}

/// The cells of a sampled ball reach at most half a cell's diagonal to either side of its surface.
#[test]
fn raster_of_a_ball_is_a_ball_within_a_pitch() {
    let ball = Ellipsoid::ball([0.3, -0.2, 0.1], 5.0).unwrap();
    let domain = Domain::new([30, 30, 30], [0.5; 3], [-7.25; 3], Unit::Millimetre).unwrap();
    let mask = RasterMask::from_region(&ball, domain).unwrap();
    for k in (0..domain.len()).step_by(7) {
        // Between samples, but not beyond the last one.
        let x = domain.position(domain.unflatten(k)).map(|v| (v + 0.11).min(7.25));
        let error = (mask.signed_distance(&x) - ball.signed_distance(&x)).abs();
        assert!(error < 0.5, "{x:?}: {error}");
    }
    assert!((mask.inradius(true) - 5.0).abs() < 0.5);
}

/// A mask that fills its domain has the distance of a box, also beyond the lattice.
#[test]
fn full_mask_is_the_box_of_its_cells() {
    let domain = Domain::new([4, 3], [1.0, 2.0], [0.0, 10.0], Unit::Sample).unwrap();
    let mask = RasterMask::new(domain, vec![1.0; 12]).unwrap();
    let cells = BoxRegion::new([-0.5, 9.0], [3.5, 15.0]).unwrap();
    for x in [[-0.5, 12.0], [9.0, 12.0], [3.5, 14.0], [1.0, 30.0], [-6.0, 10.0], [0.0, 10.0]] {
        let (got, want) = (mask.signed_distance(&x), cells.signed_distance(&x));
        assert!((got - want).abs() < 1e-5, "{x:?}: {got} {want}");
    }
    assert_eq!(mask.inradius(false), f32::INFINITY);
    assert_eq!(mask.inradius(true), 2.0);
}

#[test]
fn weight_is_that_of_the_cell_and_zero_beyond() {
    let domain = Domain::new([2, 1], [2.0, 1.0], [10.0, 0.0], Unit::Sample).unwrap();
    let mask = RasterMask::new(domain, vec![0.25, 0.75]).unwrap();
    let at = |x: f32| mask.weight(&[x, 0.0]);
    assert_eq!([8.9, 9.1, 10.9, 11.1, 12.9, 13.1].map(at), [0.0, 0.25, 0.25, 0.75, 0.75, 0.0]);
    assert_eq!(mask.weight(&[10.0, 0.6]), 0.0);
    assert_eq!(at(f32::NAN), 0.0);
    assert!(mask.signed_distance(&[10.0, 0.0]) > 0.0 && mask.signed_distance(&[12.0, 0.0]) < 0.0);
}

#[test]
fn empty_mask_is_infinitely_far() {
    let mask = RasterMask::new(Domain::unit([3, 3]).unwrap(), vec![0.0; 9]).unwrap();
    assert_eq!(mask.signed_distance(&[0.5, 7.0]), f32::INFINITY);
    assert_eq!((mask.inradius(true), mask.inradius(false)), (0.0, 0.0));
}

#[test]
fn bad_weights_are_typed_errors() {
    let domain = Domain::unit([2]).unwrap();
    let length = RasterMask::new(domain, vec![0.0]).unwrap_err();
    assert_eq!(length, Error::Length { expected: 2, found: 1 });
    for weight in [-0.1, 1.1, f32::NAN] {
        let error = RasterMask::new(domain, vec![0.0, weight]).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }));
    }
}

#[test]
fn weights_on_a_lattice_are_those_of_its_positions() {
    let mask_domain = Domain::new([6, 5], [1.0, 0.5], [4.0, -2.0], crate::Unit::Sample).unwrap();
    let weights = (0..30).map(|k| (k * 7 % 11) as f32 / 10.0).collect();
    let mask = RasterMask::new(mask_domain, weights).unwrap();
    for pitch in [[1.0, 0.5], [0.75, 1.0], [2.0, 0.25]] {
        let lattice = Domain::new([20, 9], pitch, [0.125, -2.0], crate::Unit::Sample).unwrap();
        for (i, j) in [(0, 0), (2, 3), (7, 1), (5, 8)] {
            let mut got = vec![7.0; 20 - i];
            mask.weights_on(&lattice, [i, j], &mut got);
            let want: Vec<f32> = (i..20).map(|k| mask.weight(&lattice.position([k, j]))).collect();
            assert_eq!(got, want, "pitch {pitch:?} from {i}, {j}");
        }
    }
}

#[test]
fn samples_beyond_the_integers_of_f32_are_told_apart() {
    let first = 1usize << 27;
    let at = Domain::new([9], [1.0], [first as f32], crate::Unit::Sample).unwrap();
    let mask = RasterMask::new(at, (1..10).map(|k| k as f32 / 10.0).collect()).unwrap();
    let mut weights = [7.0; 15];
    mask.weights_on(&Domain::unit([1 << 28]).unwrap(), [first - 3], &mut weights);
    let want = |k: usize| if (3..12).contains(&k) { (k - 2) as f32 / 10.0 } else { 0.0 };
    assert!((0..15).all(|k| weights[k] == want(k)), "{weights:?}");
}
