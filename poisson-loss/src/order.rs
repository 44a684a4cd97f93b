//! The order of axes that passes over tiles like: a long axis to run along, and one to cut.

use rayon::prelude::*;

use crate::tile::Frame;

/// Which axis comes at which place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Order<const D: usize>([usize; D]);

impl<const D: usize> Order<D> {
    /// The axes as they are.
    pub fn unchanged() -> Self {
        Self(std::array::from_fn(|d| d))
    }

    /// The longest axis first and the second longest last: the two angles of a light field, and the
    /// few frames of a clip, go in the middle. Among equals the order stays, and up to two
    /// dimensions always.
    pub fn longest_first(shape: [usize; D]) -> Self {
        let mut order = Self::unchanged().0;
        if D > 2 {
            order.sort_by_key(|d| std::cmp::Reverse(shape[*d]));
            order[1..].rotate_left(1);
        }
        Self(order)
    }

    /// What belongs to axes, in this order.
    pub fn of<T: Copy>(&self, values: [T; D]) -> [T; D] {
        self.0.map(|d| values[d])
    }

    pub fn frame(&self, frame: Frame<D>) -> Frame<D> {
        Frame { shape: self.of(frame.shape), ends: self.of(frame.ends) }
    }

    /// An array of a shape in this order.
    pub fn arrange<T: Copy + Default + Send + Sync>(
        &self,
        src: Vec<T>,
        shape: [usize; D],
    ) -> Vec<T> {
        if src.is_empty() || *self == Self::unchanged() {
            return src;
        }
        let mut strides = [1; D];
        for d in 1..D {
            strides[d] = strides[d - 1] * shape[d - 1];
        }
        let (to, strides) = (self.of(shape), self.of(strides));
        let mut dst = vec![T::default(); src.len()];
        dst.par_chunks_mut(to[0]).enumerate().for_each(|(row, dst)| {
            let (mut rest, mut at) = (row, 0);
            for d in 1..D {
                at += rest % to[d] * strides[d];
                rest /= to[d];
            }
            dst.iter_mut().enumerate().for_each(|(i, v)| *v = src[at + i * strides[0]]);
        });
        dst
    }

    /// The inverse of [`Order::arrange`]; `shape` is the same.
    pub fn restore<T: Copy + Default + Send + Sync>(
        &self,
        src: Vec<T>,
        shape: [usize; D],
    ) -> Vec<T> {
        let mut inverse = [0; D];
        (0..D).for_each(|k| inverse[self.0[k]] = k);
        Self(inverse).arrange(src, self.of(shape))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_transposed_and_restored() {
        let shape = [2, 3, 7, 5];
        let order = Order::longest_first(shape);
        assert_eq!(order.of(shape), [7, 3, 2, 5]);
        let src: Vec<usize> = (0..210).collect();
        let arranged = order.arrange(src.clone(), shape);
        let at = |x: usize, y: usize, u: usize, v: usize| x + 7 * (v + 3 * (u + 2 * y));
        assert_eq!(arranged[at(4, 3, 1, 2)], 1 + 2 * (2 + 3 * (4 + 7 * 3)));
        assert_eq!(order.restore(arranged, shape), src);
    }

    #[test]
    fn equal_axes_and_pictures_stay() {
        assert_eq!(Order::longest_first([4, 9]), Order::unchanged());
        assert_eq!(Order::longest_first([4, 4, 4]).of([0, 1, 2]), [0, 2, 1]);
    }
}
