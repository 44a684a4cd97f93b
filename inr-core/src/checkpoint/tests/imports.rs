//! Files as PyTorch programs write them, against an evaluation in f64 that follows the papers.

use safetensors::tensor::TensorView;
use safetensors::{Dtype, serialize};

use super::*;

/// Multiples of 1/64 below 1: every type of number holds them exactly.
fn number(k: u64) -> f64 {
    (Random::new(9, 9).below(k, 127) as f64 - 63.0) / 64.0
}

/// A matrix `[out, in]` or a vector by name.
struct Tensors(Vec<(String, Plain)>);

impl Tensors {
    /// A perceptron of these sizes; `name` gives a layer's.
    fn perceptron(sizes: &[usize], name: impl Fn(usize) -> String) -> Self {
        let mut list = Vec::new();
        for (k, pair) in sizes.windows(2).enumerate() {
            let seed = 1000 * k as u64;
            let values = |from: u64, n: usize| (0..n as u64).map(|i| number(from + i)).collect();
            let weight =
                Plain { shape: vec![pair[1], pair[0]], values: values(seed, pair[0] * pair[1]) };
            let bias = Plain { shape: vec![pair[1]], values: values(seed + 500, pair[1]) };
            list.push((format!("{}.weight", name(k)), weight));
            list.push((format!("{}.bias", name(k)), bias));
        }
        Self(list)
    }

    /// Sitzmann et al. 2020, eq. 1, with a linear last layer.
    fn eval(&self, omega: &[f64], input: &[f64]) -> Vec<f64> {
        let layers = self.0.chunks_exact(2).filter(|l| l[0].0.ends_with("weight"));
        let mut h = input.to_vec();
        for (k, layer) in layers.enumerate() {
            h = add(&multiply(&layer[0].1, &h), &layer[1].1.values);
            if let Some(omega) = omega.get(k) {
                h.iter_mut().for_each(|u| *u = (omega * *u).sin());
            }
        }
        h
    }

    /// The file as another program writes it.
    fn to_bytes(&self, dtype: Dtype) -> Vec<u8> {
        let encode = |v: f64| match dtype {
            Dtype::F16 => half_bits(v).to_le_bytes().to_vec(),
            Dtype::BF16 => (v as f32).to_le_bytes()[2..].to_vec(),
            Dtype::F64 => v.to_le_bytes().to_vec(),
            _ => (v as f32).to_le_bytes().to_vec(),
        };
        let data: Vec<Vec<u8>> = self
            .0
            .iter()
            .map(|(_, t)| t.values.iter().flat_map(|v| encode(*v)).collect())
            .collect();
        let view = |(i, (name, t)): (usize, &(String, Plain))| {
            (name.clone(), TensorView::new(dtype, t.shape.clone(), &data[i]).unwrap())
        };
        serialize(self.0.iter().enumerate().map(view), None).unwrap()
    }
}

/// binary16 of a multiple of 1/64 below 1, by the definition of the format.
fn half_bits(v: f64) -> u16 {
    let sign = u16::from(v < 0.0) << 15;
    let exponent = v.abs().log2().floor();
    if v == 0.0 {
        return sign;
    }
    let fraction = (v.abs() / exponent.exp2() - 1.0) * 1024.0;
    sign | (((exponent + 15.0) as u16) << 10) | fraction as u16
}

/// The picture of the tables.
pub const SHAPE: [usize; 2] = [7, 5];

const FRAME: Frame<2> = Frame { center: [3.0, 4.0], half: [3.5, 4.5] };

fn output() -> Output<3> {
    Output::of_range(0.0, 1.0)
}

fn mixed_names(k: usize) -> String {
    if k == 3 { "net.3".into() } else { format!("net.{k}.linear") }
}

fn diner(features: usize, table: &str) -> Tensors {
    let mut tensors = Tensors::perceptron(&[features, 9, 9, 3], mixed_names);
    let values = (0..35 * features as u64).map(|k| number(9000 + k)).collect();
    tensors.0.push((table.into(), Plain { shape: vec![35, features], values }));
    tensors
}

/// Files for the tests of damage.
pub fn siren_file() -> Vec<u8> {
    Tensors::perceptron(&[2, 11, 11, 3], mixed_names).to_bytes(Dtype::F16)
}

pub fn diner_file() -> Vec<u8> {
    diner(2, "table").to_bytes(Dtype::F64)
}

fn check_siren(tensors: &Tensors, bytes: &[u8], omega: &[f32], order: AxisOrder) {
    let network = import_siren::<2, 3>(bytes, omega, order, FRAME, output()).unwrap();
    let full: Vec<f64> = (0..3).map(|k| f64::from(omega[k.min(omega.len() - 1)])).collect();
    for p in 0..20 {
        let x = [0.37 * p as f64, 7.0 - 0.29 * p as f64];
        let [u, v] = [(x[0] - 3.0) / 3.5, (x[1] - 4.0) / 4.5];
        let input = if order == AxisOrder::FirstAxisFirst { [u, v] } else { [v, u] };
        let want = tensors.eval(&full, &input);
        let got = network.eval_scalar(x);
        for c in 0..3 {
            let error = (got[c] - (0.5 + 0.5 * want[c])).abs();
            assert!(error < SUM_TOLERANCE, "{got:?} for {want:?}");
        }
    }
}

#[test]
fn an_imported_siren_is_the_formula_of_the_paper() {
    let names: [fn(usize) -> String; 6] = [
        mixed_names,
        |k| format!("net.{k}.linear"),
        |k| format!("net.net.{k}.0"),
        |k| format!("layers.{k}"),
        |k| format!("layers.{k}.linear"),
        |k| if k == 3 { "last_layer".into() } else { format!("layers.{k}") },
    ];
    for name in names {
        let tensors = Tensors::perceptron(&[2, 11, 11, 11, 3], name);
        let bytes = tensors.to_bytes(Dtype::F32);
        check_siren(&tensors, &bytes, &[3.0], AxisOrder::FirstAxisFirst);
        check_siren(&tensors, &bytes, &[3.0, 1.0, 2.0], AxisOrder::LastAxisFirst);
    }
}

#[test]
fn every_type_of_number_gives_the_same_network() {
    let tensors = Tensors::perceptron(&[2, 11, 11, 11, 3], mixed_names);
    for dtype in [Dtype::F16, Dtype::BF16, Dtype::F32, Dtype::F64] {
        check_siren(&tensors, &tensors.to_bytes(dtype), &[3.0], AxisOrder::LastAxisFirst);
    }
}

#[test]
fn layers_without_bias_have_none() {
    let mut tensors = Tensors::perceptron(&[2, 11, 11, 11, 3], mixed_names);
    tensors.0[3].1.values.fill(0.0);
    let whole = tensors.to_bytes(Dtype::F32);
    check_siren(&tensors, &whole, &[3.0], AxisOrder::FirstAxisFirst);
    let zero = tensors.0.remove(3);
    let bytes = tensors.to_bytes(Dtype::F32);
    tensors.0.insert(3, zero);
    check_siren(&tensors, &bytes, &[3.0], AxisOrder::FirstAxisFirst);
}

#[test]
fn an_imported_diner_has_the_value_of_its_row_at_each_sample() {
    for (features, table) in
        [(2, "table"), (3, "hash_table"), (4, "net.table"), (8, "table.weight")]
    {
        let tensors = diner(features, table);
        let bytes = tensors.to_bytes(Dtype::F32);
        let frame = Frame::of_cells(&Domain::unit(SHAPE).unwrap());
        let import = |shape| {
            let nearest = Interpolation::Nearest;
            import_diner::<2, 3>(&bytes, shape, nearest, &[2.0], frame, output())
        };
        let network = import(SHAPE).unwrap();
        let values = &tensors.0.last().unwrap().1.values;
        // The row of a pixel is its place in the picture.
        for (pixel, row) in values.chunks_exact(features).enumerate() {
            let want = tensors.eval(&[2.0, 2.0], row);
            let got = network.eval_scalar([(pixel % 7) as f64, (pixel / 7) as f64]);
            for c in 0..3 {
                let error = (got[c] - (0.5 + 0.5 * want[c])).abs();
                assert!(error < SUM_TOLERANCE, "pixel {pixel}: {got:?} for {want:?}");
            }
        }
        let wrong = import([7, 6]);
        let (expected, found) = (vec![42, features], vec![35, features]);
        let shape = Error::TensorShape { name: table.into(), expected, found };
        assert_eq!(wrong.map(|_| ()), Err(shape));
    }
}

#[test]
fn what_cannot_be_imported_is_named() {
    let import = |tensors: &Tensors, dtype| {
        let bytes = tensors.to_bytes(dtype);
        let order = AxisOrder::FirstAxisFirst;
        import_siren::<2, 3>(&bytes, &[30.0], order, FRAME, output()).map(|_| ())
    };
    let shape = |name: &str, expected: [usize; 2], found: [usize; 2]| {
        let (expected, found) = (expected.to_vec(), found.to_vec());
        Err(Error::TensorShape { name: name.into(), expected, found })
    };
    let siren = |sizes: &[usize]| Tensors::perceptron(sizes, mixed_names);
    let unequal = import(&siren(&[2, 11, 12, 11, 3]), Dtype::F32);
    assert_eq!(unequal, shape("net.1.linear.weight", [11, 11], [12, 11]));
    let volume = import(&siren(&[3, 11, 11, 11, 3]), Dtype::F32);
    assert_eq!(volume, shape("net.0.linear.weight", [11, 2], [11, 3]));
    let grey = import(&siren(&[2, 11, 11, 11, 1]), Dtype::F32);
    assert_eq!(grey, shape("net.3.weight", [3, 11], [1, 11]));
    for n in [0, 2] {
        let mut few = siren(&[2, 11, 11, 11, 3]);
        few.0.truncate(n);
        let name = format!("net.{}.linear.weight", n / 2);
        assert_eq!(import(&few, Dtype::F32), Err(Error::TensorMissing { name }));
    }
    let mut large = siren(&[2, 11, 11, 11, 3]);
    large.0[2].1.values[5] = 1e39;
    let (name, rule) = ("net.1.linear.weight".to_string(), "finite");
    assert_eq!(import(&large, Dtype::F64), Err(Error::TensorValues { name, rule }));
    let (name, found) = ("net.0.linear.weight".to_string(), "I32".to_string());
    let integers = import(&siren(&[2, 11, 11, 11, 3]), Dtype::I32);
    assert_eq!(integers, Err(Error::TensorType { name, found }));
}
