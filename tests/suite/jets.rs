//! Values and gradients of every field against nested dual numbers, and those against what shares no code with them.

use inr_core::{
    Architecture, Domain, Field, Frame, Jet, Network, Output, Scalar, Spline, Unit, seed, seed2,
};
use npsolve_tests::measured::jet;
use npsolve_tests::oracle::coefficients_of;
use npsolve_tests::signals::{Random, textured};

/// f32 sums of up to `4^5` products, relative to the largest value or slope: 2e-6 observed.
const JETS: f64 = 1e-5;
/// Values and slopes of two f64 evaluations of the same f32 coefficients: 6e-7 observed, because the library's
/// prefilter is in f32.
const INDEPENDENT: f64 = 5e-6;
/// Second derivatives by nested duals against central differences of slopes over 1e-4 of a pitch, relative to the
/// largest: 1e-8 of truncation for cubics and smooth networks, 1e-11 of rounding.
const CURVATURE: f64 = 1e-5;

fn domain<const D: usize>() -> Domain<D> {
    let n = [60, 20, 9, 6, 5][D - 1];
    let shape = std::array::from_fn(|d| n + d % 2);
    let pitch = std::array::from_fn(|d| 0.6 + 0.3 * d as f32);
    Domain::new(shape, pitch, [-1.5; D], Unit::Sample).expect("a valid lattice")
}

/// Anywhere between the first and the last sample.
fn points<const D: usize>(domain: &Domain<D>, count: usize) -> Vec<[f32; D]> {
    let mut random = Random::new(9);
    let (h, n, o) = (domain.pitch(), domain.shape(), domain.origin());
    let mut at = |d: usize| o[d] + h[d] * (n[d] - 1) as f32 * random.unit() as f32;
    (0..count).map(|_| std::array::from_fn(&mut at)).collect()
}

/// Largest difference of pairs, relative to the largest expected.
fn relative(pairs: &[(f64, f64)]) -> f64 {
    let largest = pairs.iter().fold(0.0f64, |m, p| m.max(p.1.abs()));
    assert!(largest > 1e-3, "something to compare, not {largest:e}");
    pairs.iter().fold(0.0f64, |m, p| m.max((p.0 - p.1).abs())) / largest
}

/// A field that can be evaluated with any numbers.
trait Generic<const D: usize, const C: usize>: Field<D, C> {
    fn at<T: Scalar>(&self, x: [T; D]) -> [T; C];
}

impl<const D: usize, const C: usize> Generic<D, C> for Spline<D, C> {
    fn at<T: Scalar>(&self, x: [T; D]) -> [T; C] {
        self.eval_scalar(x)
    }
}

impl<const D: usize, const C: usize> Generic<D, C> for Network<D, C> {
    fn at<T: Scalar>(&self, x: [T; D]) -> [T; C] {
        self.eval_scalar(x)
    }
}

/// Batches against nested duals; the duals' second derivatives against differences of their first.
fn check<const D: usize, const C: usize>(name: &str, field: &impl Generic<D, C>) {
    let x = points(&domain::<D>(), 40);
    let mut jets = vec![Jet::<D, C>::ZERO; x.len()];
    field.eval_jet(&x, &mut jets);
    let (mut values, mut slopes, mut curvatures) = (Vec::new(), Vec::new(), Vec::new());
    let step = 1e-4;
    for (x, jet) in x.iter().zip(&jets) {
        let x = x.map(f64::from);
        let nested = field.at(seed2(x));
        for c in 0..C {
            values.push((f64::from(jet.value[c]), nested[c].re.re));
            let gradient = nested[c].gradient();
            slopes.extend((0..D).map(|d| (f64::from(jet.grad[c][d]), gradient[d])));
            let slope = |d: usize, by: f64| {
                let mut x = x;
                x[d] += by;
                field.at(seed(x))[c].eps[d]
            };
            let second = |d: usize| (slope(d, step) - slope(d, -step)) / (2.0 * step);
            curvatures.push((nested[c].laplacian(), (0..D).map(second).sum()));
        }
    }
    for (what, pairs, tolerance) in
        [("values", values, JETS), ("slopes", slopes, JETS), ("Laplacians", curvatures, CURVATURE)]
    {
        let error = relative(&pairs);
        println!("{name}, D = {D}, {what}: {error:.1e}");
        assert!(
            error < tolerance,
            "{name}, D = {D}, {what}: {error:e}, expected below {tolerance:e}"
        );
    }
}

fn splines_match_nested_duals<const D: usize, const C: usize>() {
    check("spline", &Spline::interpolate(&textured::<D, C>(domain(), 3)));
}

fn networks_match_nested_duals<const D: usize, const C: usize>() {
    let domain = domain::<D>();
    for (name, architecture) in [
        ("siren", Architecture::siren(24, 2, 4.0)),
        ("grid", Architecture::grid(&domain.shape(), 1 << 8)),
        ("spline grid", Architecture::spline_grid(&domain.shape(), C)),
    ] {
        let output = Output::of_range(0.0, 1.0);
        let mut network = Network::<D, C>::new(architecture, Frame::of_samples(&domain), output, 1)
            .expect("a valid architecture");
        // New tables are almost zero, and hide mistakes.
        let tables = network.tables();
        network.params_mut()[tables].iter_mut().for_each(|p| *p *= 1e4);
        check(name, &network);
    }
}

/// The spline through samples, by the tridiagonal systems and by sums over truncated powers.
fn splines_are_sums_of_truncated_powers<const D: usize, const C: usize>() {
    let domain = domain::<D>();
    let samples = textured::<D, C>(domain, 5);
    let spline = Spline::interpolate(&samples);
    let coefficients = coefficients_of(&samples);
    let pitch = domain.pitch().map(f64::from);
    let (mut values, mut slopes) = (Vec::new(), Vec::new());
    for x in points(&domain, 30) {
        let x = x.map(f64::from);
        let at: [f64; D] =
            std::array::from_fn(|d| (x[d] - f64::from(domain.origin()[d])) / pitch[d]);
        let got = spline.eval_scalar(seed(x));
        for c in 0..C {
            let (value, slope) = jet(&domain.shape(), &pitch, &coefficients[c], &at);
            values.push((got[c].re, value));
            slopes.extend((0..D).map(|d| (got[c].eps[d], slope[d])));
        }
    }
    for (what, pairs) in [("values", values), ("slopes", slopes)] {
        let error = relative(&pairs);
        println!("truncated powers, D = {D}, {what}: {error:.1e}");
        assert!(error < INDEPENDENT, "D = {D}, {what}: {error:e}, expected below {INDEPENDENT:e}");
    }
}

in_every_dimension! {
    splines_match_nested_duals;
    networks_match_nested_duals;
    splines_are_sums_of_truncated_powers;
}
