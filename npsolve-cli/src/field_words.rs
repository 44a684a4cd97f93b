//! Networks in words.

use inr_core::{Activation, Alignment, Architecture, Encoding, Frequencies, Grid, Interpolation};

use crate::report::count;

/// The kind of a network: a name of `--field` where it has one.
pub fn kind(architecture: &Architecture) -> &'static str {
    match &architecture.encoding {
        Encoding::Identity if matches!(architecture.mlp.activation, Activation::Sine { .. }) => {
            "siren"
        }
        Encoding::Identity => "perceptron",
        Encoding::Fourier(_) => "fourier",
        Encoding::Grid(_) if architecture.mlp.bypass => "spline-grid",
        Encoding::Grid(grid) if grid.alignment == Alignment::Centres && grid.levels.len() == 1 => {
            "diner"
        }
        Encoding::Grid(grid) if grid.interpolation == Interpolation::Cubic => "grid",
        Encoding::Grid(_) => "hash",
    }
}

/// What a network computes, in one line.
pub fn sentence(architecture: &Architecture) -> String {
    let mlp = &architecture.mlp;
    let units = match &mlp.activation {
        Activation::Sine { omega } => {
            let all: Vec<String> = omega.iter().map(f32::to_string).collect();
            format!("sine (omega {})", all.join(", "))
        }
        Activation::Relu => "ReLU".to_owned(),
        Activation::Silu => "SiLU".to_owned(),
    };
    let layers = format!("{} of {} {units} units", count(mlp.depth, "layer"), mlp.width);
    let skip = mlp.skip.map_or(String::new(), |k| format!(", features once more in layer {k}"));
    let bypass = if mlp.bypass { ", a linear map past them" } else { "" };
    match &architecture.encoding {
        Encoding::Identity => format!("{layers}{skip}{bypass}"),
        Encoding::Fourier(fourier) => {
            let frequencies = match fourier.frequencies {
                Frequencies::Axis { octaves, base } => {
                    format!("{} per axis from {base}", count(octaves, "octave"))
                }
                Frequencies::Gaussian { count, sigma, .. } => {
                    format!("{count} random frequencies (sigma {sigma})")
                }
            };
            format!("{frequencies}, {layers}{skip}{bypass}")
        }
        Encoding::Grid(grid) => format!("{}, {layers}{skip}{bypass}", tables(grid)),
    }
}

fn tables(grid: &Grid) -> String {
    let way = match grid.interpolation {
        Interpolation::Nearest => "nearest-node",
        Interpolation::Linear => "linear",
        Interpolation::Smoothstep => "smoothstep",
        Interpolation::Cubic => "cubic",
    };
    let nodes = |k: usize| {
        let all: Vec<String> = grid.levels[k].nodes.iter().map(usize::to_string).collect();
        all.join(" x ")
    };
    let (n, features) = (grid.levels.len(), count(grid.features, "feature"));
    let most = grid.levels.iter().map(|l| l.rows).max().unwrap_or_default();
    match n {
        0 => "no tables".to_owned(),
        1 => format!("1 {way} table of {} nodes with {features}", nodes(0)),
        _ => format!(
            "{n} {way} tables from {} to {} nodes with {features} in up to {most} rows",
            nodes(0),
            nodes(n - 1)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field_kind::{FieldKind, FieldOptions};

    #[test]
    fn kinds_are_recognised() {
        for k in [FieldKind::Grid, FieldKind::Hash, FieldKind::Siren, FieldKind::Fourier] {
            let network = k.architecture(&[64, 48], &FieldOptions::default());
            assert_eq!(kind(&network), k.name(), "{}", sentence(&network));
        }
        let diner = FieldKind::Diner.architecture(&[64, 48], &FieldOptions::default());
        assert_eq!(kind(&diner), "diner");
        assert!(sentence(&diner).contains("64 x 48 nodes"), "{}", sentence(&diner));
        assert_eq!(kind(&Architecture::spline_grid(&[64, 48], 3)), "spline-grid");
        let nerf = sentence(&Architecture::nerf());
        assert!(nerf.contains("10 octaves") && nerf.contains("layer 5"), "{nerf}");
    }
}
