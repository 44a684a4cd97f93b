//! Preconditioned conjugate gradients, written once for every operator of this crate.

/// A symmetric positive definite system with its preconditioner and its own vectors.
pub trait System {
    /// `z = B r`; returns `r . z`.
    fn precondition(&mut self) -> f64;
    /// `p = z + beta p`, `q = A p`; returns `p . q`.
    fn direction(&mut self, beta: f32) -> f64;
    /// `x += alpha p`, `r -= alpha q`.
    fn advance(&mut self, alpha: f32);
}

/// How a solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Convergence {
    /// Iterations done.
    pub iterations: usize,
    /// `sqrt(r.z)` at the end over its value at the start: the energy norm of the error, to
    /// within the preconditioner's quality.
    pub residual: f64,
    /// `r . z` at the end: the excess of the quadratic form over its minimum, likewise.
    pub energy: f64,
    /// Whether the tolerance was reached.
    pub converged: bool,
}

/// Iterates until `sqrt(r.z)` has fallen by `tolerance` (or to `floor`, where rounding rules).
///
/// `progress` is called with the iteration and the relative residual.
pub fn solve(
    system: &mut impl System,
    tolerance: f64,
    max_iterations: usize,
    floor: f64,
    progress: &mut dyn FnMut(usize, f64),
) -> Convergence {
    let start = system.precondition();
    let mut convergence =
        Convergence { iterations: 0, residual: 0.0, energy: start.max(0.0), converged: true };
    // `floor` is the residual that f32 leaves on a problem that is solved already.
    if start <= floor * floor {
        return convergence;
    }
    let (mut rz, mut beta) = (start, 0.0);
    convergence.residual = 1.0;
    convergence.converged = false;
    while convergence.iterations < max_iterations {
        let pq = system.direction(beta);
        if !(pq > 0.0 && rz.is_finite()) {
            break;
        }
        system.advance((rz / pq) as f32);
        let next = system.precondition();
        convergence.iterations += 1;
        convergence.energy = next.max(0.0);
        convergence.residual = (next.max(0.0) / start).sqrt();
        progress(convergence.iterations, convergence.residual);
        if convergence.residual <= tolerance || next <= floor * floor {
            convergence.converged = true;
            break;
        }
        (beta, rz) = ((next / rz) as f32, next);
    }
    convergence
}
