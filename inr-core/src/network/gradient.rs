//! Loss and parameter gradient of a batch.

use std::ops::Range;

use rayon::prelude::*;

use super::encoder::Encoder;
use super::layers::{self, Tape, Transposed};
use super::{Frame, Network};
use crate::Jet;
use crate::buffer::Buffer;

/// What a loss looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Values; a good deal cheaper. The gradients that the loss is shown are zero, and the cotangents it
    /// leaves for them are not looked at.
    Value,
    /// Values and gradients.
    Jet,
}

/// Memory that [`Network::loss_gradient`] keeps from batch to batch.
#[derive(Debug, Default)]
pub struct Workspace {
    transposed: Transposed,
    /// One gradient of the perceptron per chunk.
    chunks: Vec<Buffer>,
    features_bar: Buffer,
}

/// At most this many chunks: as many threads can work on a batch.
const MOST_CHUNKS: usize = 64;
/// Points of a chunk at least; below, adding up its gradient costs more than it is worth.
const LEAST_POINTS: usize = 512;
/// Numbers in the gradients of all chunks at most, where networks are wide.
const MOST_NUMBERS: usize = 1 << 23;
/// Tasks that the tables are cut into at least.
const LEAST_TASKS: usize = 8;

impl<const D: usize, const C: usize> Network<D, C> {
    /// The loss of a batch of points; its gradient with respect to the parameters is added to `gradient`.
    ///
    /// `loss(first, y, y_bar)` is called for pieces of the batch, on several threads: `y` are the jets of
    /// the points from number `first` on, and it leaves the derivatives of its return value with respect to
    /// them in `y_bar`. The sum of all returned values is returned.
    ///
    /// The same bits for any number of threads: pieces depend on the batch's size alone, and their sums
    /// are added in order.
    ///
    /// # Panics
    /// If `gradient` is not as long as [`Network::params`].
    pub fn loss_gradient(
        &self,
        x: &[[f32; D]],
        order: Order,
        loss: &(impl Fn(usize, &[Jet<D, C>], &mut [Jet<D, C>]) -> f64 + Sync),
        work: &mut Workspace,
        gradient: &mut [f32],
    ) -> f64 {
        assert_eq!(gradient.len(), self.params().len(), "one derivative per parameter");
        if x.is_empty() {
            return 0.0;
        }
        let blocks = if order == Order::Jet { 1 + D } else { 1 };
        let (tile, len) = (self.layers.tile(blocks), self.layers.len);
        let most = MOST_CHUNKS.min(MOST_NUMBERS / len).max(4);
        let chunk = x.len().div_ceil(most).max(LEAST_POINTS).next_multiple_of(tile);
        let params = &self.params()[self.perceptron()];
        let tables = matches!(self.encoder, Encoder::Tables(_));
        // Numbers per point that go on to the tables.
        let features = blocks * self.layers.features;

        let Workspace { transposed, chunks, features_bar } = work;
        self.layers.transpose(params, transposed);
        let transposed = &*transposed;
        chunks.resize_with(x.len().div_ceil(chunk), Buffer::default);
        features_bar.resize(if tables { x.len() * features } else { 0 });
        let mut parts: Vec<&mut [f32]> = if tables {
            features_bar.chunks_mut(chunk * features).collect()
        } else {
            chunks.iter().map(|_| &mut [][..]).collect()
        };

        let losses: Vec<f64> = x
            .par_chunks(chunk)
            .zip(chunks.par_iter_mut().zip(parts.par_iter_mut()))
            .enumerate()
            .map_init(Tape::default, |tape, (k, (x, (gradient, features_bar)))| {
                gradient.resize(len);
                gradient.fill(0.0);
                let mut y = vec![Jet::<D, C>::ZERO; tile.min(x.len())];
                let mut y_bar = y.clone();
                let mut sum = 0.0;
                for (t, x) in x.chunks(tile).enumerate() {
                    let (y, y_bar) = (&mut y[..x.len()], &mut y_bar[..x.len()]);
                    self.forward(x, blocks, true, tape);
                    self.jets(tape, y);
                    y_bar.fill(Jet::ZERO);
                    sum += loss(k * chunk + t * tile, y, y_bar);
                    self.cotangents(y_bar, tape);
                    self.layers.backward(params, transposed, tape, gradient, tables);
                    if tables {
                        let bar = &mut features_bar[t * tile * features..][..x.len() * features];
                        self.sort_by_level(tape, bar);
                    }
                }
                sum
            })
            .collect();

        let (of_tables, of_layers) = gradient.split_at_mut(self.perceptron().start);
        of_layers.par_chunks_mut(4096).enumerate().for_each(|(k, sum)| {
            for chunk in chunks.iter() {
                let part = &chunk[k * 4096..][..sum.len()];
                sum.iter_mut().zip(part).for_each(|(s, v)| *s += v);
            }
        });
        self.scatter(x, tile, blocks, features_bar, of_tables);
        losses.iter().sum()
    }

    /// The cotangents of the last layer.
    fn cotangents(&self, y_bar: &[Jet<D, C>], tape: &mut Tape) {
        tape.y_bar.resize(tape.points * tape.blocks * C);
        let block = tape.points * C;
        for (p, bar) in y_bar.iter().enumerate() {
            for c in 0..C {
                tape.y_bar[p * C + c] = self.output.scale[c] * bar.value[c];
                for d in 0..tape.blocks - 1 {
                    tape.y_bar[(1 + d) * block + p * C + c] = self.output.scale[c] * bar.grad[c][d];
                }
            }
        }
    }

    /// The cotangents of a tile's features as the tables want them, `[level][block][point][feature]`: what
    /// one table needs lies together, which matters because each is visited by itself.
    fn sort_by_level(&self, tape: &Tape, out: &mut [f32]) {
        let Encoder::Tables(tables) = &self.encoder else { return };
        let stride = layers::padded(self.layers.features);
        let n = tables.features;
        for (level, out) in out.chunks_exact_mut(tape.blocks * tape.points * n).enumerate() {
            for (row, out) in tape.features_bar.chunks_exact(stride).zip(out.chunks_exact_mut(n)) {
                out.copy_from_slice(&row[level * n..level * n + n]);
            }
        }
    }

    /// Adds the features' cotangents to the tables' gradient: every task owns some rows of one table and
    /// looks at all points in order.
    fn scatter(
        &self,
        x: &[[f32; D]],
        tile: usize,
        blocks: usize,
        bar: &[f32],
        gradient: &mut [f32],
    ) {
        let Encoder::Tables(tables) = &self.encoder else { return };
        let features = blocks * self.layers.features;
        let parts = LEAST_TASKS.div_ceil(tables.levels.len());
        let mut tasks: Vec<(usize, Range<usize>, &mut [f32])> = Vec::new();
        let mut rest = gradient;
        for (level, table) in tables.levels.iter().enumerate() {
            let part = if table.is_hashed() { table.rows } else { table.rows.div_ceil(parts) };
            for first in (0..table.rows).step_by(part) {
                let rows = first..(first + part).min(table.rows);
                let (mine, others) = rest.split_at_mut(rows.len() * tables.features);
                tasks.push((level, rows, mine));
                rest = others;
            }
        }
        let frame: &Frame<D> = &self.frame;
        tasks.into_par_iter().with_max_len(1).for_each(|(level, rows, gradient)| {
            for (x, bar) in x.chunks(tile).zip(bar.chunks(tile * features)) {
                let n = x.len() * blocks * tables.features;
                let bar = &bar[level * n..(level + 1) * n];
                tables.backward(level, rows.clone(), gradient, frame, x, bar);
            }
        });
    }
}
