use proptest::prelude::*;
use safetensors::SafeTensors;
use serde_json::json;

use super::*;
use crate::random::Random;
use crate::{
    Architecture, Encoding, Field, Frame, Frequencies, Interpolation, Level, Network, Output, Unit,
};

mod damage;
mod imports;

/// A tensor's numbers and shape, as another reader of the format sees them.
struct Plain {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// Reads a tensor by the `safetensors` crate: nothing of this module takes part.
fn plain(bytes: &[u8], name: &str) -> Plain {
    let file = SafeTensors::deserialize(bytes).unwrap();
    let view = file.tensor(name).unwrap();
    assert_eq!(view.dtype(), safetensors::Dtype::F32);
    let number = |b: &[u8]| f64::from(f32::from_le_bytes(b.try_into().unwrap()));
    let values = view.data().chunks_exact(4).map(number).collect();
    Plain { shape: view.shape().to_vec(), values }
}

/// `W x` for a matrix `[out, in]`.
fn multiply(w: &Plain, x: &[f64]) -> Vec<f64> {
    assert_eq!(w.shape[1], x.len());
    w.values.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(w, x)| w * x).sum()).collect()
}

fn add(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// One small network of every kind.
fn architectures<const D: usize>() -> Vec<(&'static str, Architecture)> {
    let shape: Vec<usize> = (0..D).map(|d| 6 + d).collect();
    let mut nerf = Architecture::nerf();
    (nerf.mlp.width, nerf.mlp.depth, nerf.mlp.skip) = (19, 3, Some(1));
    if let Encoding::Fourier(f) = &mut nerf.encoding {
        f.frequencies = Frequencies::Axis { octaves: 3, base: 0.1 };
    }
    let diner = |i| Architecture::diner(&shape, i, 3, 20, 2, 6.1);
    vec![
        ("siren", Architecture::siren(37, 3, 5.3)),
        ("fourier", Architecture::fourier(11, 0.7, 16, 2)),
        ("nerf", nerf),
        ("hash", Architecture::hash(&shape, 32)),
        ("grid", Architecture::grid(&shape, 1 << 6)),
        ("diner", diner(Interpolation::Nearest)),
        ("diner cubic", diner(Interpolation::Cubic)),
    ]
}

/// A checkpoint of a half trained network; nothing in it is a round number.
fn checkpoint<const D: usize, const C: usize>(architecture: Architecture) -> Checkpoint<D, C> {
    let shape = std::array::from_fn(|d| 6 + d);
    let pitch = std::array::from_fn(|d| 0.1 + 0.7 * d as f32);
    let domain = Domain::new(shape, pitch, [-1.0 / 3.0; D], Unit::Millimetre).unwrap();
    let output = Output {
        offset: std::array::from_fn(|c| 0.1 * (c + 1) as f32),
        scale: std::array::from_fn(|c| 1.0 / (c + 3) as f32),
    };
    let mut network = Network::new(architecture, Frame::of_cells(&domain), output, 7).unwrap();
    let tables = network.tables();
    network.params_mut()[tables].iter_mut().for_each(|p| *p *= 1e4);
    let random = Random::new(4, 4);
    // Moments are zero in the padding, as the trainer's are, and tiny or negative zero in places.
    let moment = |k: u64, scale: f32| {
        let mut flat = vec![0.0; network.params().len()];
        for i in network.tensors().iter().flat_map(Tensor::indices) {
            flat[i] = random.symmetric(2 * i as u64 + k, scale);
        }
        flat[0] = -0.0;
        flat
    };
    let (first_moment, second_moment) = (moment(0, 1e-3), moment(1, 1e-40));
    let state =
        json!({"step": 1234, "rate": 0.1 + 0.2, "seed": u64::MAX, "schedule": ["cosine", 5e-324]});
    Checkpoint {
        network,
        domain,
        notes: [("channels", "R, G, \"B\""), ("encoding", "srgb"), ("ä", "\n")]
            .map(|(k, v)| (k.into(), v.into()))
            .into(),
        range: [-0.1, 1.0 / 3.0],
        training: Some(Training { first_moment, second_moment, state }),
    }
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

fn a_round_trip_changes_no_bit<const D: usize, const C: usize>() {
    for (name, architecture) in architectures::<D>() {
        let before = checkpoint::<D, C>(architecture);
        let bytes = before.to_bytes().unwrap();
        let after = Checkpoint::<D, C>::from_bytes(&bytes).unwrap();
        let (a, b) = (&before.network, &after.network);
        assert_eq!(bits(a.params()), bits(b.params()), "{name}");
        assert_eq!(
            (a.architecture(), a.frame(), a.output()),
            (b.architecture(), b.frame(), b.output())
        );
        assert_eq!(
            (before.domain, &before.notes, before.range),
            (after.domain, &after.notes, after.range)
        );
        let (was, is) = (before.training.as_ref().unwrap(), after.training.as_ref().unwrap());
        assert_eq!(bits(&was.first_moment), bits(&is.first_moment), "{name}");
        assert_eq!(bits(&was.second_moment), bits(&is.second_moment), "{name}");
        assert_eq!(was.state, is.state);
        let x: Vec<[f32; D]> = (0..50).map(|p| [0.04 * p as f32; D]).collect();
        let (mut want, mut got) = (vec![[0.0; C]; x.len()], vec![[0.0; C]; x.len()]);
        a.eval(&x, &mut want);
        b.eval(&x, &mut got);
        assert_eq!(bits(want.as_flattened()), bits(got.as_flattened()), "{name}");
        assert_eq!(bytes, after.to_bytes().unwrap(), "{name}: the same bytes every time");
        let finished = Checkpoint { training: None, ..before }.to_bytes().unwrap();
        assert!(Checkpoint::<D, C>::from_bytes(&finished).unwrap().training.is_none());
    }
}

#[test]
fn a_round_trip_changes_no_bit_audio() {
    a_round_trip_changes_no_bit::<1, 1>();
}
#[test]
fn a_round_trip_changes_no_bit_image() {
    a_round_trip_changes_no_bit::<2, 3>();
}
#[test]
fn a_round_trip_changes_no_bit_volume() {
    a_round_trip_changes_no_bit::<3, 1>();
}

proptest! {
    /// Numbers of the metadata, too: any finite f32 of the records and any f64 of the trainer's state.
    #[test]
    fn every_number_of_the_metadata_comes_back(
        a in proptest::num::f32::POSITIVE | proptest::num::f32::SUBNORMAL,
        b in proptest::num::f32::NORMAL,
        c in proptest::num::f64::NORMAL | proptest::num::f64::SUBNORMAL,
    ) {
        let mut before = checkpoint::<1, 1>(Architecture::siren(3, 1, a.max(f32::MIN_POSITIVE)));
        before.domain = Domain::new([5], [a], [b], Unit::Second).unwrap();
        before.network = Network::new(
            before.network.architecture().clone(),
            Frame { center: [b], half: [a] },
            Output { offset: [b], scale: [-a] },
            1,
        ).unwrap();
        before.range = [b.min(a), b.max(a)];
        let training = before.training.as_mut().unwrap();
        training.first_moment.resize(before.network.params().len(), 0.0);
        training.second_moment.resize(before.network.params().len(), 0.0);
        training.state = json!({"rate": c});
        let after = Checkpoint::<1, 1>::from_bytes(&before.to_bytes().unwrap()).unwrap();
        prop_assert_eq!(before.domain, after.domain);
        prop_assert_eq!(before.network.architecture(), after.network.architecture());
        prop_assert_eq!(before.network.frame(), after.network.frame());
        prop_assert_eq!(before.network.output(), after.network.output());
        prop_assert_eq!(before.range, after.range);
        prop_assert_eq!(before.training.unwrap().state, after.training.unwrap().state);
    }
}

/// f64 sums in another order than `eval_scalar`'s; observed 2e-15.
const SUM_TOLERANCE: f64 = 1e-12;

/// The documented names and shapes, evaluated in f64 from the file alone, are the field.
fn named_tensors_are_the_field<const D: usize, const C: usize>() {
    for (name, architecture) in architectures::<D>().into_iter().take(3) {
        let checkpoint = checkpoint::<D, C>(architecture.clone());
        let bytes = checkpoint.to_bytes().unwrap();
        let (frame, output) = (checkpoint.network.frame(), checkpoint.network.output());
        let x: [f64; D] = std::array::from_fn(|d| 0.3 + 0.17 * d as f64);
        let u: Vec<f64> = (0..D)
            .map(|d| (x[d] - f64::from(frame.center[d])) / f64::from(frame.half[d]))
            .collect();
        let features: Vec<f64> = match &architecture.encoding {
            Encoding::Fourier(fourier) => {
                let phases = multiply(&plain(&bytes, "encoding.frequencies"), &u);
                let axis = matches!(fourier.frequencies, Frequencies::Axis { .. });
                let group = if axis { D } else { phases.len() };
                let waves = phases.chunks(group).flat_map(|p| {
                    p.iter().map(|p| p.sin()).chain(p.iter().map(|p| p.cos())).collect::<Vec<_>>()
                });
                let input = if fourier.include_input { &u[..] } else { &[] };
                input.iter().copied().chain(waves).collect()
            }
            _ => u,
        };
        let mut h = features.clone();
        for k in 0..architecture.mlp.depth {
            let part = |kind: &str| plain(&bytes, &format!("mlp.{k}.{kind}"));
            let mut sum = add(&multiply(&part("weight"), &h), &part("bias").values);
            if architecture.mlp.skip == Some(k) {
                sum = add(&sum, &multiply(&part("skip_weight"), &features));
            }
            let sine = name == "siren";
            let omega = f64::from(architecture.mlp.activation.omega(k));
            h = sum
                .into_iter()
                .map(|u| if sine { (omega * u).sin() } else { u.max(0.0) })
                .collect();
        }
        let y = multiply(&plain(&bytes, "mlp.output.weight"), &h);
        let y = add(&y, &plain(&bytes, "mlp.output.bias").values);
        let want = checkpoint.network.eval_scalar(x);
        for c in 0..C {
            let got = f64::from(output.offset[c]) + f64::from(output.scale[c]) * y[c];
            let error = (got - want[c]).abs();
            assert!(error < SUM_TOLERANCE, "{name}: {got} from the file, {} expected", want[c]);
        }
    }
}

#[test]
fn named_tensors_are_the_field_audio() {
    named_tensors_are_the_field::<1, 1>();
}
#[test]
fn named_tensors_are_the_field_image() {
    named_tensors_are_the_field::<2, 3>();
}
#[test]
fn named_tensors_are_the_field_volume() {
    named_tensors_are_the_field::<3, 1>();
}

#[test]
fn rows_of_a_diner_table_are_samples_in_order() {
    let diner = Architecture::diner(&[6, 7], Interpolation::Nearest, 3, 8, 1, 2.0);
    let mut checkpoint = checkpoint::<2, 1>(diner);
    for (k, p) in checkpoint.network.params_mut()[..6 * 7 * 3].iter_mut().enumerate() {
        *p = k as f32;
    }
    let table = plain(&checkpoint.to_bytes().unwrap(), "encoding.level.0");
    assert_eq!(table.shape, [42, 3]);
    assert_eq!(table.values, (0..126).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn a_description_needs_no_d_and_c() {
    let before = checkpoint::<2, 3>(Architecture::siren(37, 3, 5.3));
    let bytes = before.to_bytes().unwrap();
    let about = Description::from_bytes(&bytes).unwrap();
    assert_eq!((about.version, about.dimensions, about.channels), (1, 2, 3));
    assert_eq!(about.architecture, *before.network.architecture());
    assert_eq!((about.shape, about.unit), (vec![6, 7], Unit::Millimetre));
    assert_eq!((about.pitch, about.origin), (vec![0.1, 0.8], vec![-1.0 / 3.0; 2]));
    assert_eq!((about.range, &about.notes), (before.range, &before.notes));
    assert_eq!(about.parameters, before.network.parameter_count());
    assert_eq!(about.training, before.training.map(|t| t.state));
    assert_eq!(about.tensors.len(), 3 * 8);
    assert_eq!(about.tensors[0], ("mlp.0.weight".to_string(), vec![37, 2]));
}
