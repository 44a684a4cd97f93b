//! The planes of a pipeline that are still needed.

/// Entries before and after every plane that may be read, by dimension two: shifts of a few
/// samples, and whole vectors that run over a row's end.
const MARGIN: usize = 32;
/// Bytes of a cache line.
const LINE: usize = 64;

/// The last few planes of a stage, each with a readable margin on both sides. A power of two of
/// them, so that a plane finds its place by masking.
#[derive(Default)]
pub struct Ring {
    data: Vec<f32>,
    first: usize,
    plane: usize,
    pitch: usize,
    mask: usize,
}

impl Ring {
    /// Room for `planes` planes that are read at offsets up to `reach` beyond their ends. What the
    /// margins hold is finite, and otherwise meaningless.
    pub fn reset(&mut self, planes: usize, plane: usize, reach: usize) {
        let margin = reach.max(MARGIN).next_multiple_of(LINE / 4);
        self.pitch = plane.next_multiple_of(LINE / 4) + margin;
        self.data.resize(planes * self.pitch + margin + LINE / 4, 0.0);
        self.first = margin + self.data.as_ptr().align_offset(LINE).min(LINE / 4);
        (self.plane, self.mask) = (plane, planes - 1);
    }

    #[inline(always)]
    pub fn at(&self, k: usize) -> &[f32] {
        &self.data[self.first + (k & self.mask) * self.pitch..][..self.plane]
    }

    #[inline(always)]
    pub fn at_mut(&mut self, k: usize) -> &mut [f32] {
        &mut self.data[self.first + (k & self.mask) * self.pitch..][..self.plane]
    }

    /// `n` entries from `offset` on, which may begin and end outside the plane.
    #[inline(always)]
    pub fn shifted(&self, k: usize, offset: isize, n: usize) -> &[f32] {
        let first = self.first + (k & self.mask) * self.pitch;
        &self.data[first.wrapping_add_signed(offset)..][..n]
    }
}
