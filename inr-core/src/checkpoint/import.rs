//! Networks that other programs trained, from their named tensors.

use super::container::Container;
use super::records::{FrameRecord, OutputRecord};
use crate::network::tensors;
use crate::{
    Activation, Architecture, Encoding, Error, Frame, Interpolation, Mlp, Network, Output, Result,
};

/// Where layer `k` of a perceptron may be: `{0}k{1}.weight` and `{0}k{1}.bias`.
const LAYERS: [(&str, &str); 5] = [
    ("net.", ".linear"),
    ("net.", ""),
    ("net.net.", ".0"),
    ("layers.", ".linear"),
    ("layers.", ""),
];

/// The output layer where it is not numbered.
const LAST_LAYER: &str = "last_layer";

/// Names of a table of features.
const TABLES: [&str; 6] =
    ["table", "hash_table", "net.table", "net.hash_table", "table.weight", "hash_table.weight"];

/// Which of a network's inputs is which axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisOrder {
    /// x, y, z: the order of this library.
    FirstAxisFirst,
    /// z, y, x: row before column, the order of coordinates made by NumPy's `mgrid` and PyTorch's
    /// `meshgrid`, and so of most published image networks.
    LastAxisFirst,
}

/// A sine network from a safetensors file with PyTorch's names.
///
/// Layer `k` (0, 1, ...) is `net.{k}.linear`, `net.{k}`, `net.net.{k}.0`, `layers.{k}.linear` or
/// `layers.{k}`, each with `.weight` (`[out, in]`) and, unless it is 0, `.bias`. The last one is the output,
/// or else `last_layer`; it is linear, as it is in the published networks. Width and depth follow from
/// the shapes; all hidden layers have the same width. Numbers may be `f16`, `bf16`, `f32` or `f64`; other
/// tensors are ignored.
///
/// `omega` has the sine's factor per hidden layer, the last one repeating. `frame` and `output` are what the
/// network was trained with: for the authors' images [`Frame::of_samples`], [`Output::of_range`] of
/// the signal's range, and [`AxisOrder::LastAxisFirst`].
///
/// Source of the names: the code that Sitzmann et al. 2020 published (`net.{k}.linear` in the notebook,
/// `net.net.{k}.0` in the scripts).
///
/// # Errors
/// [`Error::NotSafetensors`]; [`Error::TensorMissing`] if there are not at least two layers;
/// [`Error::TensorShape`], [`Error::TensorType`] and [`Error::TensorValues`] (what is not finite as `f32`);
/// [`Error::Parameter`] if a number is out of range.
pub fn import_siren<const D: usize, const C: usize>(
    bytes: &[u8],
    omega: &[f32],
    order: AxisOrder,
    frame: Frame<D>,
    output: Output<C>,
) -> Result<Network<D, C>> {
    let file = Container::read(bytes)?;
    let layers = find_layers(&file)?;
    let mlp = perceptron(&file, &layers, omega)?;
    let names = layers.into_iter().flat_map(weight_and_bias);
    let architecture = Architecture { encoding: Encoding::Identity, mlp };
    fill(&file, architecture, names, order, frame, output)
}

/// A DINER, one row of features per sample and a sine network, from a safetensors file with PyTorch's
/// names.
///
/// The perceptron is named as in [`import_siren`]; the table is `table`, `hash_table`, one of these within
/// `net.`, or followed by `.weight`. It is `[samples, features]` with 1, 2, 3, 4 or 8 features; samples come in
/// the order of a picture, x fastest, which is [`Samples`](crate::Samples)'. `shape` is the signal's, x
/// first. [`Interpolation::Nearest`] is the published field; with another one values between the
/// samples, and gradients, are this library's choice.
///
/// `frame` is that of the signal's cells, [`Frame::of_cells`], whatever coordinates were used in training:
/// the network never saw any.
///
/// Source of the names: the code that Xie et al. 2023 published.
///
/// # Errors
/// Those of [`import_siren`], and [`Error::TooLarge`].
pub fn import_diner<const D: usize, const C: usize>(
    bytes: &[u8],
    shape: [usize; D],
    interpolation: Interpolation,
    omega: &[f32],
    frame: Frame<D>,
    output: Output<C>,
) -> Result<Network<D, C>> {
    let file = Container::read(bytes)?;
    let missing = || Error::TensorMissing { name: TABLES[0].into() };
    let table = TABLES.into_iter().find(|n| file.shape(n).is_some()).ok_or_else(missing)?;
    let samples = shape.iter().try_fold(1usize, |n, m| n.checked_mul(*m));
    let samples = samples.ok_or_else(|| Error::TooLarge { shape: shape.to_vec() })?;
    let features = match file.shape(table) {
        Some([_, features]) => *features,
        found => {
            let (expected, found) = (vec![samples, 3], found.unwrap_or_default().to_vec());
            return Err(Error::TensorShape { name: table.into(), expected, found });
        }
    };
    let layers = find_layers(&file)?;
    // The perceptron's numbers come from the file.
    let mut architecture = Architecture::diner(&shape, interpolation, features, 1, 1, 1.0);
    architecture.mlp = perceptron(&file, &layers, omega)?;
    let names = std::iter::once(table.to_string());
    let names = names.chain(layers.into_iter().flat_map(weight_and_bias));
    // A row is found by its sample, not by coordinates.
    fill(&file, architecture, names, AxisOrder::FirstAxisFirst, frame, output)
}

/// Names of the layers without `.weight` and `.bias`, the output last.
fn find_layers(file: &Container<'_>) -> Result<Vec<String>> {
    let exists = |layer: &String| file.shape(&format!("{layer}.weight")).is_some();
    let numbered = |k: usize| LAYERS.iter().map(move |(a, b)| format!("{a}{k}{b}")).find(exists);
    let mut layers: Vec<String> = (0..).map_while(numbered).collect();
    layers.extend(Some(LAST_LAYER.to_string()).filter(exists));
    if layers.len() < 2 {
        let (before, after) = LAYERS[0];
        return Err(Error::TensorMissing {
            name: format!("{before}{}{after}.weight", layers.len()),
        });
    }
    Ok(layers)
}

fn perceptron(file: &Container<'_>, layers: &[String], omega: &[f32]) -> Result<Mlp> {
    let first = file.shape(&format!("{}.weight", layers[0])).unwrap_or_default();
    Ok(Mlp {
        width: first.first().copied().unwrap_or(0),
        depth: layers.len() - 1,
        activation: Activation::Sine { omega: omega.to_vec() },
        skip: None,
        bypass: false,
    })
}

fn weight_and_bias(layer: String) -> [String; 2] {
    [format!("{layer}.weight"), format!("{layer}.bias")]
}

/// A network whose tensors, in their order, have these names in the file.
fn fill<const D: usize, const C: usize>(
    file: &Container<'_>,
    architecture: Architecture,
    names: impl Iterator<Item = String>,
    order: AxisOrder,
    frame: Frame<D>,
    output: Output<C>,
) -> Result<Network<D, C>> {
    FrameRecord::of(&frame).check()?;
    OutputRecord::of(&output).check()?;
    let tensors = tensors::<D>(&architecture, C)?;
    // Layers without biases have none in the file; they stay 0.
    let absent = |name: &str| name.ends_with(".bias") && file.shape(name).is_none();
    let pairs: Vec<_> = tensors.iter().zip(names).filter(|(_, name)| !absent(name)).collect();
    for (tensor, name) in &pairs {
        file.check(name, &tensor.shape)?;
    }
    let mut network = Network::zeros(architecture, frame, output)?;
    for (tensor, name) in pairs {
        let mut values = file.values(&name)?;
        if order == AxisOrder::LastAxisFirst && tensor.name == "mlp.0.weight" {
            values.chunks_exact_mut(D).for_each(<[f32]>::reverse);
        }
        tensor.set(network.params_mut(), values);
    }
    Ok(network)
}
