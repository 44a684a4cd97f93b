use crate::Jet;

/// A signal as a continuous function from `R^D` to `C` channels.
///
/// Both methods work on batches, because that is what is fast. Coordinates are physical: the
/// units of the [`Domain`](crate::Domain) the field was made from. A field is defined everywhere;
/// what it does outside its domain is part of its own documentation.
pub trait Field<const D: usize, const C: usize>: Send + Sync {
    /// Values at the points `x`.
    ///
    /// # Panics
    /// If `x` and `y` differ in length.
    fn eval(&self, x: &[[f32; D]], y: &mut [[f32; C]]);

    /// Values and gradients at the points `x`; gradients are per physical unit.
    ///
    /// # Panics
    /// If `x` and `y` differ in length.
    fn eval_jet(&self, x: &[[f32; D]], y: &mut [Jet<D, C>]);
}
