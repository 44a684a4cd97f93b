/// Value and gradient of a field at one point: `grad[c][d]` is the derivative of channel `c`
/// along axis `d`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet<const D: usize, const C: usize> {
    /// One value per channel.
    pub value: [f32; C],
    /// One gradient per channel.
    pub grad: [[f32; D]; C],
}

impl<const D: usize, const C: usize> Jet<D, C> {
    /// All zero.
    pub const ZERO: Self = Self { value: [0.0; C], grad: [[0.0; D]; C] };
}

impl<const D: usize, const C: usize> Default for Jet<D, C> {
    fn default() -> Self {
        Self::ZERO
    }
}
