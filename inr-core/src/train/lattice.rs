use crate::random::Random;

/// Mini-batches of a gridded signal: every `stride`-th sample along each axis, from an offset that changes
/// from batch to batch. `prod(stride)` batches, an epoch, visit every sample once.
///
/// Neighbours in a batch are neighbours in the tables of a grid, which makes lattices about twice as fast as
/// scattered samples; they train as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lattice<const D: usize> {
    shape: [usize; D],
    stride: [usize; D],
}

impl<const D: usize> Lattice<D> {
    /// Lattices of about `batch` points (at least 1) in a signal of this shape.
    pub fn new(shape: [usize; D], batch: usize) -> Self {
        let mut stride = [1; D];
        let count = |stride: &[usize; D]| -> usize {
            (0..D).map(|d| shape[d].div_ceil(stride[d])).product()
        };
        while count(&stride) > batch.max(1) {
            // The finest axis that can be coarser still; the last one where several are equal, because rows
            // are better left whole.
            let finest =
                (0..D).filter(|d| stride[*d] < shape[*d]).min_by_key(|d| (stride[*d], D - d));
            let Some(d) = finest else { break };
            stride[d] += 1;
        }
        Self { shape, stride }
    }

    /// Batches that visit every sample once.
    pub fn epoch(&self) -> u64 {
        self.stride.iter().map(|s| *s as u64).product()
    }

    /// The samples of batch number `step`, as indices of the flat buffer in ascending order.
    pub fn batch(&self, seed: u64, step: u64, out: &mut Vec<usize>) {
        let (epoch, k) = (step / self.epoch(), step % self.epoch());
        let random = Random::new(seed, Random::BATCHES);
        // Offsets of an epoch in the order a k + b modulo their number, a without common divisor: each once.
        let n = self.epoch();
        let draw = |k: u64| random.below(2 * epoch + k, n as usize) as u64;
        let factor = (draw(0)..).map(|a| a.max(1)).find(|a| gcd(*a, n) == 1).unwrap_or(1);
        let mut offset =
            ((u128::from(k) * u128::from(factor) + u128::from(draw(1))) % u128::from(n)) as usize;
        let start: [usize; D] = std::array::from_fn(|d| {
            let o = offset % self.stride[d];
            offset /= self.stride[d];
            o
        });
        out.clear();
        self.walk(D - 1, 0, &start, out);
    }

    fn walk(&self, d: usize, base: usize, start: &[usize; D], out: &mut Vec<usize>) {
        let below: usize = self.shape[..d].iter().product();
        for i in (start[d]..self.shape[d]).step_by(self.stride[d]) {
            if d == 0 {
                out.push(base + i);
            } else {
                self.walk(d - 1, base + i * below, start, out);
            }
        }
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_epoch_visits_every_sample_once() {
        for (shape, batch) in [([7, 5, 3], 10), ([16, 1, 9], 20), ([4, 4, 4], 1000), ([5, 1, 1], 1)]
        {
            let lattice = Lattice::new(shape, batch);
            let mut seen = vec![0; shape.iter().product()];
            let mut points = Vec::new();
            for epoch in 1..=2 {
                for k in 0..lattice.epoch() {
                    lattice.batch(3, (epoch - 1) * lattice.epoch() + k, &mut points);
                    assert!(points.is_sorted() && points.len() <= batch);
                    points.iter().for_each(|p| seen[*p] += 1);
                }
                assert!(seen.iter().all(|n| *n == epoch), "{shape:?}");
            }
        }
    }

    #[test]
    fn seeds_differ() {
        let lattice = Lattice::new([64, 64], 64);
        let first = |seed| {
            let mut points = Vec::new();
            lattice.batch(seed, 0, &mut points);
            points
        };
        assert_eq!(first(1), first(1));
        assert!((2..6).any(|s| first(s) != first(1)));
    }
}
