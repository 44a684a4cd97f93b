//! The perceptron on one tile of points: forward with tangents, then one reverse sweep.
//!
//! Rows are points in blocks: first the values of all points, then their tangents along axis 0, and so on.
//! A row holds one layer's units, padded to whole vectors with zeros that stay zero.

use std::ops::Range;

use super::activation::{self, Unit};
use super::architecture::Mlp;
use crate::Scalar;
use crate::buffer::Buffer;
use crate::cpu::{Product, Start, add_rows, product, tangents, thin_product};

/// Numbers per row are multiples of this: the widest vector.
pub(crate) const PAD: usize = 16;

pub(crate) fn padded(n: usize) -> usize {
    n.next_multiple_of(PAD)
}

/// Where a perceptron's weights are in the flat buffer, relative to its beginning.
///
/// A hidden layer has `inputs` rows of `stride` weights, as many rows again for each feature in the skip
/// layer, and `stride` biases; the output has one row of `stride` weights per channel, and its biases.
#[derive(Debug, Clone)]
pub(crate) struct Layers {
    pub features: usize,
    pub width: usize,
    pub outputs: usize,
    hidden: Vec<Hidden>,
    output: usize,
    output_bias: usize,
    /// One row of padded features per channel, for the linear map that goes past the layers.
    bypass: Option<usize>,
    /// Numbers in all.
    pub len: usize,
}

#[derive(Debug, Clone)]
pub(crate) struct Hidden {
    pub unit: Unit,
    /// Units of the previous layer, or features.
    pub inputs: usize,
    pub weights: usize,
    /// Weights of the features that come in once more.
    pub skip: Option<usize>,
    pub bias: usize,
}

/// Everything about one tile that the reverse sweep needs, and its scratch.
#[derive(Debug, Default)]
pub(crate) struct Tape {
    /// Points, and 1 + tangents.
    pub points: usize,
    pub blocks: usize,
    /// Inputs of the perceptron, `[block][point][padded feature]`.
    pub features: Buffer,
    /// Outputs, `[block][point][channel]`; the reverse sweep takes their cotangents from `y_bar`.
    pub y: Buffer,
    pub y_bar: Buffer,
    /// Cotangents of the features, once the sweep is done.
    pub features_bar: Buffer,
    past: Buffer,
    layers: Vec<Saved>,
    bar: [Buffer; 2],
}

#[derive(Debug, Default)]
struct Saved {
    /// Outputs of the units: values, then tangents.
    h: Buffer,
    /// Slopes, and curvatures if the unit keeps them.
    g: Buffer,
    s: Buffer,
    /// Tangents of the weighted sums.
    z: Buffer,
}

/// The weights of every hidden layer but transposed, `[unit][padded input]`: what the reverse sweep
/// multiplies with.
#[derive(Debug, Default)]
pub(crate) struct Transposed {
    hidden: Vec<Buffer>,
    skip: Buffer,
}

impl Layers {
    pub fn new(mlp: &Mlp, features: usize, outputs: usize) -> Self {
        let (stride, mut at) = (padded(mlp.width), 0);
        let mut take = |n: usize| {
            at += n;
            at - n
        };
        let hidden = (0..mlp.depth)
            .map(|k| {
                let inputs = if k == 0 { features } else { mlp.width };
                Hidden {
                    unit: Unit::of(&mlp.activation, k),
                    inputs,
                    weights: take(inputs * stride),
                    skip: (mlp.skip == Some(k)).then(|| take(features * stride)),
                    bias: take(stride),
                }
            })
            .collect();
        let (output, output_bias) = (take(outputs * stride), take(padded(outputs)));
        let bypass = mlp.bypass.then(|| take(outputs * padded(features)));
        Self { features, width: mlp.width, outputs, hidden, output, output_bias, bypass, len: at }
    }

    pub fn stride(&self) -> usize {
        padded(self.width)
    }

    pub fn hidden(&self) -> &[Hidden] {
        &self.hidden
    }

    /// The output's weights and its biases.
    pub fn output(&self) -> (Range<usize>, Range<usize>) {
        let weights = self.output..self.output + self.outputs * self.stride();
        (weights, self.output_bias..self.output_bias + self.outputs)
    }

    /// The weights of the linear map past the layers.
    pub fn bypass(&self) -> Option<Range<usize>> {
        self.bypass.map(|at| at..at + self.outputs * padded(self.features))
    }

    /// Points that a tile should have: a multiple of 12, so that rows are whole blocks of every kernel; about
    /// 100 rows (24 to 48 points of an image are equally fast), fewer where activations would leave the
    /// second cache.
    pub fn tile(&self, blocks: usize) -> usize {
        let point = self.stride() * self.hidden.len() * blocks * 3 * size_of::<f32>();
        (96 / blocks).min(1_000_000 / point).next_multiple_of(12).max(12)
    }

    /// Weights for the reverse sweep.
    pub fn transpose(&self, params: &[f32], out: &mut Transposed) {
        let stride = self.stride();
        out.hidden.resize_with(self.hidden.len(), Buffer::default);
        for (layer, out) in self.hidden.iter().zip(&mut out.hidden) {
            transpose(&params[layer.weights..], layer.inputs, self.width, stride, out);
        }
        for layer in &self.hidden {
            if let Some(skip) = layer.skip {
                transpose(&params[skip..], self.features, self.width, stride, &mut out.skip);
            }
        }
    }

    /// The definition: channels of one point from its features, for any scalar.
    pub fn plain<T: Scalar>(&self, mlp: &Mlp, params: &[f32], features: &[T]) -> Vec<T> {
        let c = |v: f32| T::from_f64(f64::from(v));
        let stride = self.stride();
        let column = |at: usize, x: &[T], unit: usize| -> T {
            x.iter().enumerate().map(|(i, x)| *x * c(params[at + i * stride + unit])).sum()
        };
        let mut h = features.to_vec();
        for (k, layer) in self.hidden.iter().enumerate() {
            let unit = |j: usize| {
                let skip = layer.skip.map_or(T::zero(), |at| column(at, features, j));
                let u = column(layer.weights, &h, j) + skip + c(params[layer.bias + j]);
                activation::plain(&mlp.activation, k, u)
            };
            h = (0..self.width).map(unit).collect();
        }
        let row = |k: usize| -> T {
            let weights = &params[self.output + k * stride..];
            h.iter().zip(weights).map(|(h, w)| *h * c(*w)).sum()
        };
        let past = |k: usize| -> T {
            let Some(at) = self.bypass else { return T::zero() };
            let weights = &params[at + k * padded(self.features)..];
            features.iter().zip(weights).map(|(f, w)| *f * c(*w)).sum()
        };
        (0..self.outputs).map(|k| row(k) + c(params[self.output_bias + k]) + past(k)).collect()
    }

    /// Evaluates the perceptron on `tape.features`. With `keep`, everything for [`Layers::backward`] is kept.
    pub fn forward(&self, params: &[f32], tape: &mut Tape, keep: bool) {
        let (stride, points, blocks) = (self.stride(), tape.points, tape.blocks);
        let (rows, values) = (points * blocks, points * stride);
        let feature_stride = padded(self.features);
        tape.layers.resize_with(self.hidden.len(), Saved::default);
        for (k, layer) in self.hidden.iter().enumerate() {
            let (before, rest) = tape.layers.split_at_mut(k);
            let saved = &mut rest[0];
            saved.h.resize(rows * stride);
            saved.z.resize((rows - points) * stride);
            let slopes = if keep || blocks > 1 { values } else { 0 };
            saved.g.resize(slopes);
            let curved = keep && blocks > 1 && layer.unit.keeps_curvature();
            saved.s.resize(if curved { values } else { 0 });
            let (a, a_row) = match before.last() {
                None => (&tape.features, feature_stride),
                Some(previous) => (&previous.h, stride),
            };
            let parts = [
                Some((a, a_row, layer.inputs, layer.weights)),
                layer.skip.map(|at| (&tape.features, feature_stride, self.features, at)),
            ];
            let (u, z) = (&mut saved.h[..values], &mut saved.z[..]);
            for (part, (a, a_row, depth, weights)) in parts.into_iter().flatten().enumerate() {
                let b = &params[weights..weights + depth * stride];
                let multiply = |a: &[f32], c: &mut [f32], first: Start<'_>| {
                    product(&mut Product {
                        shape: [c.len() / stride, stride, depth],
                        a,
                        a_row,
                        a_step: 1,
                        b,
                        b_row: stride,
                        c,
                        c_row: stride,
                        start: if part == 0 { first } else { Start::Result },
                    });
                };
                multiply(a, u, Start::Row(&params[layer.bias..layer.bias + stride]));
                multiply(&a[points * a_row..], z, Start::Zero);
            }
            let (u, t) = saved.h.split_at_mut(values);
            activation::forward(layer.unit, u, &mut saved.g, &mut saved.s);
            if blocks > 1 {
                tangents(t, &saved.g, &saved.z);
            }
        }
        let last = &tape.layers[self.hidden.len() - 1].h;
        let (weights, bias) = self.output();
        tape.y.resize(rows * self.outputs);
        thin_product(last, &params[weights], stride, self.outputs, &mut tape.y);
        if let Some(bypass) = self.bypass() {
            let y = &mut tape.past;
            y.resize(rows * self.outputs);
            thin_product(&tape.features, &params[bypass], feature_stride, self.outputs, y);
            tape.y.iter_mut().zip(y.iter()).for_each(|(y, past)| *y += past);
        }
        for y in tape.y[..points * self.outputs].chunks_exact_mut(self.outputs) {
            y.iter_mut().zip(&params[bias.clone()]).for_each(|(y, b)| *y += b);
        }
    }

    /// Adds the gradient with respect to the weights to `gradient`, given the cotangents `tape.y_bar`. With
    /// `features`, their cotangents are left in `tape.features_bar`.
    pub fn backward(
        &self,
        params: &[f32],
        transposed: &Transposed,
        tape: &mut Tape,
        gradient: &mut [f32],
        features: bool,
    ) {
        let (stride, points, blocks) = (self.stride(), tape.points, tape.blocks);
        let (rows, values, outputs) = (points * blocks, points * stride, self.outputs);
        let feature_stride = padded(self.features);
        let [bar, below] = &mut tape.bar;
        bar.resize(rows * stride);
        below.resize(rows * stride);
        let (weights, bias) = self.output();
        product(&mut Product {
            shape: [rows, stride, outputs],
            a: &tape.y_bar,
            a_row: outputs,
            a_step: 1,
            b: &params[weights.clone()],
            b_row: stride,
            c: bar,
            c_row: stride,
            start: Start::Zero,
        });
        product(&mut Product {
            shape: [outputs, stride, rows],
            a: &tape.y_bar,
            a_row: 1,
            a_step: outputs,
            b: &tape.layers[self.hidden.len() - 1].h,
            b_row: stride,
            c: &mut gradient[weights],
            c_row: stride,
            start: Start::Result,
        });
        for y_bar in tape.y_bar[..points * outputs].chunks_exact(outputs) {
            gradient[bias.clone()].iter_mut().zip(y_bar).for_each(|(g, y)| *g += y);
        }
        if features {
            tape.features_bar.resize(rows * feature_stride);
            tape.features_bar.fill(0.0);
        }
        if let Some(bypass) = self.bypass() {
            product(&mut Product {
                shape: [outputs, feature_stride, rows],
                a: &tape.y_bar,
                a_row: 1,
                a_step: outputs,
                b: &tape.features,
                b_row: feature_stride,
                c: &mut gradient[bypass.clone()],
                c_row: feature_stride,
                start: Start::Result,
            });
            if features {
                product(&mut Product {
                    shape: [rows, feature_stride, outputs],
                    a: &tape.y_bar,
                    a_row: outputs,
                    a_step: 1,
                    b: &params[bypass],
                    b_row: feature_stride,
                    c: &mut tape.features_bar,
                    c_row: feature_stride,
                    start: Start::Result,
                });
            }
        }
        for (k, layer) in self.hidden.iter().enumerate().rev() {
            let (before, rest) = tape.layers.split_at(k);
            let Saved { h, g, s, z } = &rest[0];
            activation::backward(layer.unit, bar, &h[..values], g, s, z);
            add_rows(&bar[..values], &mut gradient[layer.bias..layer.bias + stride]);
            let (a, a_step) = match before.last() {
                None => (&tape.features, feature_stride),
                Some(previous) => (&previous.h, stride),
            };
            let parts = [
                Some((a, a_step, layer.inputs, layer.weights)),
                layer.skip.map(|at| (&tape.features, feature_stride, self.features, at)),
            ];
            for (a, a_step, inputs, weights) in parts.into_iter().flatten() {
                product(&mut Product {
                    shape: [inputs, stride, rows],
                    a,
                    a_row: 1,
                    a_step,
                    b: bar,
                    b_row: stride,
                    c: &mut gradient[weights..weights + inputs * stride],
                    c_row: stride,
                    start: Start::Result,
                });
            }
            let descend = |b: &[f32], c: &mut [f32], c_row: usize, start: Start<'_>| {
                product(&mut Product {
                    shape: [rows, c_row, self.width],
                    a: bar,
                    a_row: stride,
                    a_step: 1,
                    b,
                    b_row: c_row,
                    c,
                    c_row,
                    start,
                });
            };
            if layer.skip.is_some() && features {
                descend(&transposed.skip, &mut tape.features_bar, feature_stride, Start::Result);
            }
            if k > 0 {
                descend(&transposed.hidden[k], below, stride, Start::Zero);
                std::mem::swap(bar, below);
            } else if features {
                descend(
                    &transposed.hidden[k],
                    &mut tape.features_bar,
                    feature_stride,
                    Start::Result,
                );
            }
        }
    }
}

/// `[rows][stride]` to `[columns][padded rows]`.
fn transpose(src: &[f32], rows: usize, columns: usize, stride: usize, dst: &mut Buffer) {
    let out = padded(rows);
    dst.resize(columns * out);
    dst.fill(0.0);
    for i in 0..rows {
        for (j, v) in src[i * stride..i * stride + columns].iter().enumerate() {
            dst[j * out + i] = *v;
        }
    }
}
