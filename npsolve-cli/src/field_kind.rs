//! The kinds of networks that can stand for a signal, and everything they are by default.

use clap::{Args, ValueEnum};
use inr_core::{Architecture, Encoding, Interpolation, TrainOptions};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::values;

/// `--field`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FieldKind {
    /// Cubic B-spline tables and a small network: smooth, for values and gradients.
    #[default]
    Grid,
    /// Hashed linear tables and a small network: the most dB per second; its gradient jumps.
    Hash,
    /// Sine network: no tables, few numbers, smooth; slow.
    Siren,
    /// Random Fourier features and a ReLU network.
    Fourier,
    /// A row of features per sample and a sine network: exact samples, little between them.
    Diner,
}

/// The numbers of a field and of its training. Each kind has some of them: those that its defaults name.
#[derive(Debug, Clone, PartialEq, Default, Args, Serialize, Deserialize)]
pub struct FieldOptions {
    /// Most rows of a table per level, a power of two (grid, hash).
    #[arg(long, value_name = "N", help_heading = "Network", value_parser = values::power_of_two)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_rows: Option<usize>,
    /// Features per level or sample: 1, 2, 3, 4 or 8 (grid, hash, diner); number of frequencies (fourier).
    #[arg(long, value_name = "N", help_heading = "Network", value_parser = values::at_least_one)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub features: Option<usize>,
    /// How features between nodes come about: nearest, linear, smoothstep or cubic (hash, diner).
    #[arg(long, value_name = "WAY", help_heading = "Network", value_parser = values::interpolation)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<Interpolation>,
    /// Units of a hidden layer.
    #[arg(long, value_name = "N", help_heading = "Network", value_parser = values::at_least_one)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<usize>,
    /// Hidden layers.
    #[arg(long, value_name = "N", help_heading = "Network", value_parser = values::at_least_one)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<usize>,
    /// Frequency of the sine layers (siren, diner).
    #[arg(long, value_name = "W", help_heading = "Network", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub omega: Option<f32>,
    /// Width of the frequencies' distribution, in cycles per half the picture's side (fourier).
    #[arg(long, value_name = "S", help_heading = "Network", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f32>,
    /// Learning rate of the network at the beginning.
    #[arg(long, value_name = "R", help_heading = "Training", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<f32>,
    /// Learning rate of the tables at the beginning (grid, hash, diner).
    #[arg(long, value_name = "R", help_heading = "Training", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_rate: Option<f32>,
    /// Samples per step.
    #[arg(long, value_name = "N", help_heading = "Training", value_parser = values::at_least_one)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub batch: Option<usize>,
}

impl FieldOptions {
    /// What is given, by the names of the options with underscores.
    pub fn given(&self) -> Map<String, Value> {
        match serde_json::to_value(self) {
            Ok(Value::Object(map)) => map,
            _ => Map::new(), // A record of numbers is always an object.
        }
    }

    /// These options, and the other's where there is none.
    fn or(&self, other: Self) -> Self {
        Self {
            table_rows: self.table_rows.or(other.table_rows),
            features: self.features.or(other.features),
            interpolation: self.interpolation.or(other.interpolation),
            width: self.width.or(other.width),
            depth: self.depth.or(other.depth),
            omega: self.omega.or(other.omega),
            sigma: self.sigma.or(other.sigma),
            rate: self.rate.or(other.rate),
            table_rate: self.table_rate.or(other.table_rate),
            batch: self.batch.or(other.batch),
        }
    }
}

impl FieldKind {
    /// The name that `--field` takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::Hash => "hash",
            Self::Siren => "siren",
            Self::Fourier => "fourier",
            Self::Diner => "diner",
        }
    }

    /// Everything this kind can be told, with its default: the one place where they are.
    ///
    /// Chosen on photographs of 768 x 512 pixels, among a handful of values of each number.
    pub fn defaults(self) -> FieldOptions {
        let tables = FieldOptions {
            table_rows: Some(1 << 15),
            features: Some(8),
            width: Some(64),
            depth: Some(2),
            rate: Some(9e-3),
            table_rate: Some(3e-2),
            batch: Some(8192),
            ..FieldOptions::default()
        };
        // Half the batch costs these less than half a dB for the same number of steps.
        let plain = FieldOptions {
            width: Some(128),
            depth: Some(3),
            batch: Some(4096),
            ..FieldOptions::default()
        };
        match self {
            Self::Grid => tables,
            Self::Hash => FieldOptions { interpolation: Some(Interpolation::Linear), ..tables },
            // omega: Sitzmann et al. 2020; 40 is worth a further 0.5 dB on large pictures.
            Self::Siren => FieldOptions { omega: Some(30.0), rate: Some(1e-3), ..plain },
            // sigma: 10 cycles per picture, Tancik et al. 2020.
            Self::Fourier => {
                FieldOptions { features: Some(128), sigma: Some(5.0), rate: Some(5e-3), ..plain }
            }
            // Xie et al. 2023 train both parts alike; tables that move six times as fast gain 2 dB.
            Self::Diner => FieldOptions {
                features: Some(3),
                interpolation: Some(Interpolation::Nearest),
                width: Some(64),
                depth: Some(2),
                omega: Some(6.0),
                rate: Some(5e-4),
                table_rate: Some(3e-3),
                batch: Some(8192),
                ..FieldOptions::default()
            },
        }
    }

    /// Steps of a fit without any limit of its own.
    pub fn steps(self) -> u64 {
        match self {
            Self::Grid | Self::Hash | Self::Diner => 2000,
            Self::Siren | Self::Fourier => 3000,
        }
    }

    /// These options with this kind's defaults for the rest.
    ///
    /// # Errors
    /// A sentence about the option that this kind does not have, or whose value it cannot take.
    pub fn resolve(self, options: &FieldOptions) -> Result<FieldOptions, String> {
        let (has, name) = (self.defaults().given(), self.name());
        if let Some(option) = options.given().keys().find(|k| !has.contains_key(*k)) {
            let flag = option.replace('_', "-");
            return Err(format!("a {name} field has no --{flag}; leave one of the two out"));
        }
        let all = options.or(self.defaults());
        let rows = matches!(self, Self::Grid | Self::Hash | Self::Diner);
        if rows && !matches!(all.features, Some(1..=4 | 8)) {
            return Err(format!("--features of a {name} field: choose 1, 2, 3, 4 or 8"));
        }
        Ok(all)
    }

    /// The network for a signal of this shape; of `options` those that [`FieldKind::resolve`] gave.
    pub fn architecture(self, shape: &[usize], options: &FieldOptions) -> Architecture {
        let o = options.or(self.defaults());
        let (rows, features) = (o.table_rows.unwrap_or_default(), o.features.unwrap_or_default());
        let (width, depth) = (o.width.unwrap_or_default(), o.depth.unwrap_or_default());
        let (omega, sigma) = (o.omega.unwrap_or_default(), o.sigma.unwrap_or_default());
        let interpolation = o.interpolation.unwrap_or(Interpolation::Linear);
        let mut network = match self {
            Self::Grid => Architecture::grid(shape, rows),
            Self::Hash => Architecture::hash(shape, rows),
            Self::Siren => Architecture::siren(width, depth, omega),
            Self::Fourier => Architecture::fourier(features, sigma, width, depth),
            Self::Diner => Architecture::diner(shape, interpolation, features, width, depth, omega),
        };
        (network.mlp.width, network.mlp.depth) = (width, depth);
        if let (Self::Grid | Self::Hash, Encoding::Grid(grid)) = (self, &mut network.encoding) {
            grid.features = features;
            if self == Self::Hash {
                grid.interpolation = interpolation;
            }
            // Cubic cells reach one node further on either side.
            let more = grid.interpolation.taps().saturating_sub(2);
            for level in grid.levels.iter_mut().filter(|_| self == Self::Hash && more > 0) {
                level.nodes.iter_mut().for_each(|n| *n += more);
                level.rows = level.nodes.iter().product::<usize>().min(rows);
            }
        }
        network
    }

    /// How such a network is trained; of `options` those that [`FieldKind::resolve`] gave.
    pub fn train_options(self, options: &FieldOptions, seed: u64) -> TrainOptions {
        let (o, usual) = (options.or(self.defaults()), TrainOptions::default());
        TrainOptions {
            rate: o.rate.unwrap_or(usual.rate),
            table_rate: o.table_rate.unwrap_or(usual.table_rate),
            batch: o.batch.unwrap_or(usual.batch),
            seed,
            ..usual
        }
    }
}

#[cfg(test)]
mod tests {
    use inr_core::{Domain, Frame, Network, Output};

    use super::*;

    const ALL: [FieldKind; 5] =
        [FieldKind::Grid, FieldKind::Hash, FieldKind::Siren, FieldKind::Fourier, FieldKind::Diner];

    #[test]
    fn every_kind_makes_a_network_for_any_picture() {
        let ways = ["nearest", "linear", "smoothstep", "cubic"].map(values::interpolation);
        for shape in [[1, 1], [1, 9], [2, 3], [300, 200], [40_000, 1]] {
            let domain = Domain::unit(shape).unwrap();
            for kind in ALL {
                for way in [None].into_iter().chain(ways.iter().map(|w| w.clone().ok())) {
                    let options = FieldOptions { interpolation: way, ..FieldOptions::default() };
                    let Ok(options) = kind.resolve(&options) else { continue };
                    let (frame, output) = (Frame::of_cells(&domain), Output::of_range(0.0, 1.0));
                    let network = kind.architecture(&shape, &options);
                    let network = Network::<2, 3>::new(network, frame, output, 1);
                    assert!(network.is_ok(), "{kind:?} {shape:?} {way:?}: {:?}", network.err());
                }
            }
        }
    }

    #[test]
    fn options_of_other_kinds_are_refused() {
        let omega = FieldOptions { omega: Some(3.0), ..FieldOptions::default() };
        let message = FieldKind::Grid.resolve(&omega).unwrap_err();
        assert!(message.contains("grid") && message.contains("--omega"), "{message}");
        assert_eq!(FieldKind::Siren.resolve(&omega).unwrap().omega, Some(3.0));
        let rows = FieldOptions { table_rows: Some(64), ..FieldOptions::default() };
        assert!(FieldKind::Diner.resolve(&rows).unwrap_err().contains("--table-rows"));
        let five = FieldOptions { features: Some(5), ..FieldOptions::default() };
        assert!(FieldKind::Hash.resolve(&five).unwrap_err().contains("1, 2, 3, 4 or 8"));
        assert!(FieldKind::Fourier.resolve(&five).is_ok());
    }

    #[test]
    fn what_is_given_wins_over_the_defaults() {
        let options = FieldOptions {
            width: Some(7),
            depth: Some(1),
            table_rows: Some(16),
            rate: Some(0.5),
            batch: Some(9),
            ..FieldOptions::default()
        };
        let kind = FieldKind::Grid;
        let options = kind.resolve(&options).unwrap();
        let network = kind.architecture(&[64, 64], &options);
        assert_eq!((network.mlp.width, network.mlp.depth), (7, 1));
        let Encoding::Grid(grid) = network.encoding else { panic!("a grid has tables") };
        assert!(
            grid.levels.iter().all(|l| l.rows <= 16) && Some(grid.features) == options.features
        );
        let train = kind.train_options(&options, 5);
        assert_eq!((train.rate, train.batch, train.seed), (0.5, 9, 5));
        assert_eq!(Some(train.table_rate), kind.defaults().table_rate);
    }
}
