//! What belongs to a blend besides its result, as further layers of its picture.

use std::path::Path;

use anyhow::{Result, bail};
use clap::ValueEnum;
use inr_core::{Field, Jet, Region, Samples, Spline};
use signal_io::{Format, Image};

use crate::channels::{self, ChannelJob, with_channels};
use crate::scene::{Scene, samples_of};
use crate::solve::Settings;

/// `--with`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProblemLayer {
    /// The gradient of the result: layers gradient_x and gradient_y.
    Gradient,
    /// The gradient that it should have; outside the region the background's: guidance_x, guidance_y.
    Guidance,
    /// The difference of the two: residual_x, residual_y.
    Residual,
    /// The region's weights: layer region.
    Region,
}

/// Whether a file of this name can hold them.
pub fn check(path: &Path, wanted: &[ProblemLayer]) -> Result<()> {
    match Format::from_extension(path) {
        Some(Format::Exr) => Ok(()),
        _ if wanted.is_empty() => Ok(()),
        _ => bail!(
            "--with writes further layers, which {} cannot hold; end it with .exr",
            path.display()
        ),
    }
}

/// The picture with the layers that are wanted. `planes` are the result in the values that were blended, and so are
/// gradients: change per pixel.
pub fn add(
    picture: Image,
    scene: &Scene,
    settings: &Settings,
    planes: &[f32],
    wanted: &[ProblemLayer],
) -> Result<Image> {
    if wanted.is_empty() {
        return Ok(picture);
    }
    let (count, n) = (scene.channels(), scene.background.pixel_count());
    let mut names = picture.channels().to_vec();
    let mut data = picture.as_planar().to_vec();
    // Gradient and guidance along x and y, per channel.
    let mut vectors: Vec<[Vec<f32>; 4]> = Vec::new();
    for first in (0..count).step_by(channels::MOST) {
        let job = Vectors { scene, settings, planes, first };
        let part = with_channels::<2, _>(channels::MOST.min(count - first), job);
        vectors.extend(part.transpose()?.unwrap_or_default());
    }
    for layer in wanted {
        let pick = |v: &[Vec<f32>; 4], d: usize| match layer {
            ProblemLayer::Gradient => v[d].clone(),
            ProblemLayer::Guidance => v[2 + d].clone(),
            _ => v[d].iter().zip(&v[2 + d]).map(|(g, v)| g - v).collect(),
        };
        if *layer == ProblemLayer::Region {
            names.push("region.Y".to_owned());
            let mut weights = vec![0.0; n];
            let region = scene.region();
            for (y, row) in weights.chunks_mut(scene.background.width()).enumerate() {
                region.weights_on(&scene.background.domain(), [0, y], row);
            }
            data.extend(weights);
            continue;
        }
        let word = match layer {
            ProblemLayer::Gradient => "gradient",
            ProblemLayer::Guidance => "guidance",
            _ => "residual",
        };
        for (d, axis) in ["x", "y"].into_iter().enumerate() {
            for (v, channel) in vectors.iter().zip(scene.background.channels()) {
                // A layer of a layer is one with a longer name.
                names.push(format!("{word}_{axis}.{channel}"));
                data.extend(pick(v, d));
            }
        }
    }
    let mut out = Image::new(picture.width(), picture.height(), &names, data)?;
    (out.sample, out.transfer) = (signal_io::SampleType::F32, picture.transfer);
    out.icc = picture.icc;
    Ok(out)
}

/// Some channels.
struct Vectors<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    planes: &'a [f32],
    first: usize,
}

impl ChannelJob for Vectors<'_> {
    type Output = Result<Vec<[Vec<f32>; 4]>>;

    fn run<const C: usize>(self) -> Self::Output {
        let Self { scene, settings, planes, first } = self;
        let domain = scene.background.domain();
        let n = domain.len();
        let background = Spline::interpolate_owned(samples_of::<C>(&scene.background, first)?);
        let patch = Spline::interpolate_owned(samples_of::<C>(&scene.patch, first)?);
        let result = planes[first * n..(first + C) * n].to_vec();
        let result = Spline::interpolate_owned(Samples::<2, C>::from_planar(domain, result)?);
        let (guidance, region) = (settings.guidance.to_guidance::<2, C>(), scene.region());
        let mut out = vec![[(); 4].map(|()| vec![0.0; n]); C];
        let width = domain.shape()[0];
        let mut jets = [(); 3].map(|()| vec![Jet::<2, C>::ZERO; width]);
        let mut weights = vec![0.0; width];
        for y in 0..domain.shape()[1] {
            let x: Vec<[f32; 2]> = (0..width).map(|x| domain.position([x, y])).collect();
            let moved: Vec<[f32; 2]> =
                x.iter().map(|x| [x[0] - scene.offset[0], x[1] - scene.offset[1]]).collect();
            background.eval_jet(&x, &mut jets[0]);
            patch.eval_jet(&moved, &mut jets[1]);
            result.eval_jet(&x, &mut jets[2]);
            region.weights_on(&domain, [0, y], &mut weights);
            for (k, w) in weights.iter().enumerate() {
                let [s, t, b] = [&jets[0][k], &jets[1][k], &jets[2][k]];
                let v = guidance.evaluate(&x[k], s, t);
                for c in 0..C {
                    for d in 0..2 {
                        out[c][d][y * width + k] = b.grad[c][d];
                        // Far from the patch its spline is no part of the problem.
                        let inside = if *w > 0.0 { w * v[c][d] } else { 0.0 };
                        out[c][2 + d][y * width + k] = inside + (1.0 - w) * s.grad[c][d];
                    }
                }
            }
        }
        Ok(out)
    }
}
