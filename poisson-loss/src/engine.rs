//! The linear system of a box, whichever way it is solved.

use rayon::prelude::*;

use crate::Options;
use crate::axis::Axis;
use crate::cg::{self, Convergence};
use crate::fused::{FusedOperator, FusedSystem, most_reach};
use crate::multigrid::Multigrid;
use crate::operator::SplineOperator;
use crate::order::Order;
use crate::plain::PlainSystem;
use crate::plan::Plan;
use crate::tile::Frame;

/// Screening that stands for a fixed value in the preconditioner of Dirichlet problems, in units
/// of the Laplacian's coefficients.
const FIXED: f32 = 100.0;

/// Residual of a problem that f32 input leaves solved: rounding of values of order one.
const FLOOR: f64 = 1e-7;

/// How often the fused passes may visit a sample on average, halos included, before plain ones are
/// faster: tiles of a cube come to 2.5, those of a light field of 5 x 5 views to 80.
const MOST_VISITS: f64 = 6.0;

/// The fused system where it applies, the plain one elsewhere; shared by all channels.
pub enum Engine<const D: usize> {
    Plain {
        operator: SplineOperator<D>,
        multigrid: Multigrid<D>,
        /// Coefficients that may change; empty where all may.
        free: Vec<bool>,
        order: Order<D>,
        /// In the order of the problem's axes.
        shape: [usize; D],
    },
    Fused(FusedOperator<D>),
}

impl<const D: usize> Engine<D> {
    pub fn new(plan: &Plan<D>) -> Self {
        // An axis of eight samples or more always gives a coarser level.
        let small = (0..D).all(|d| plan.frame.shape[d] < 8);
        let is_fused = plan.gamma.is_empty()
            && plan.free.is_empty()
            && !small
            && visits(&plan.frame) < MOST_VISITS;
        let shape = plan.frame.shape;
        let order = if is_fused { Order::unchanged() } else { Order::longest_first(shape) };
        let (frame, alpha) = (order.frame(plan.frame), order.of(plan.alpha));
        let screening = order.arrange(plan.screening(), shape);
        let free = order.arrange(plan.free.clone(), shape);
        let gamma = order.arrange(plan.gamma.clone(), shape);
        let axes: [Axis; D] =
            std::array::from_fn(|d| Axis::uniform(frame.shape[d], frame.ends[d], alpha[d]));
        let fixed = |(k, s): (usize, &f32)| if *free.get(k).unwrap_or(&true) { *s } else { FIXED };
        let nodal = screening.par_iter().enumerate().map(fixed).collect();
        let operator = SplineOperator { frame, alpha, screening, gamma: gamma.clone() };
        if is_fused {
            let multigrid = Multigrid::without_finest(axes, nodal);
            Self::Fused(FusedOperator::new(operator, multigrid))
        } else {
            let multigrid = Multigrid::new(axes, nodal, gamma);
            Self::Plain { operator, multigrid, free, order, shape }
        }
    }

    /// The solution of one right-hand side.
    pub fn solve(
        &self,
        r: Vec<f32>,
        options: &Options,
        step: &mut dyn FnMut(usize, f64),
    ) -> (Vec<f32>, Convergence) {
        let (tolerance, most) = (f64::from(options.tolerance), options.max_iterations);
        match self {
            Self::Plain { operator, multigrid, free, order, shape } => {
                let r = order.arrange(r, *shape);
                let mut system = PlainSystem::new(operator, multigrid, free, r);
                let convergence = cg::solve(&mut system, tolerance, most, FLOOR, step);
                (order.restore(system.x, *shape), convergence)
            }
            Self::Fused(shared) => {
                let mut system = FusedSystem::new(shared, r);
                let convergence = cg::solve(&mut system, tolerance, most, FLOOR, step);
                (system.x, convergence)
            }
        }
    }
}

/// How often the fused passes visit a sample of a typical tile.
fn visits<const D: usize>(frame: &Frame<D>) -> f64 {
    let tiles = frame.tiles(0, most_reach());
    tiles.first().map_or(1.0, |t| t.len() as f64 / t.core.iter().product::<usize>() as f64)
}
