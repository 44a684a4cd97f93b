//! The matrix of one piece of the line, factorised, and what is left of it for its separators.

use crate::axis::{End, ghost};
use crate::operator::{CellPoint, cell_points};
use crate::plan::Plan;

/// Coefficients of one piece: three that separate it from the previous one, and its interior.
pub const PIECE: usize = 1024;
/// Coefficients that separate two pieces: as far as the matrix reaches.
pub const SEPARATOR: usize = 3;
/// Diagonals at and above the main one.
const BAND: usize = SEPARATOR + 1;
/// How far the points of a cell reach, and the cells of a coefficient.
pub const REACH: isize = 2;

/// Three separators seen by three separators.
pub type Block = [[f64; SEPARATOR]; SEPARATOR];

/// What one piece's interior and separators give to the system of all separators.
#[derive(Clone, Copy)]
pub struct Ends {
    /// The separators of the piece, among themselves.
    pub left: Block,
    /// Those against the separators of the next piece.
    pub across: Block,
    /// The separators of the next piece among themselves, this piece's share.
    pub right: Block,
}

/// One piece's matrix, ready to be solved for its interior.
pub struct System {
    /// Entries `A[i][i + k]` of the piece's rows.
    upper: Vec<[f64; BAND]>,
    /// `L D L^T` of the interior: the inverse pivot, then the column of `L` below it.
    factor: Vec<[f64; BAND]>,
    /// The interior's answer to each separator of this piece and of the next.
    pub response: [Vec<f64>; 2 * SEPARATOR],
    pub ends: Ends,
}

/// Weights that a piece shares everywhere: of the squared slope and value, and whether its
/// coefficients may change.
#[derive(Clone, Copy, PartialEq)]
pub struct Class {
    pub gamma: f64,
    pub screening: f64,
    pub free: bool,
}

impl Class {
    /// The weights at a coefficient and its cell.
    pub fn at<const D: usize>(plan: &Plan<D>, i: usize) -> Self {
        let gamma = f64::from(plan.gamma.get(i).copied().unwrap_or(1.0) * plan.alpha[0]);
        let screening = f64::from(plan.colour[i] + plan.keep * plan.region[i]);
        Self { gamma, screening, free: plan.free.get(i).copied().unwrap_or(true) }
    }

    /// The class of a piece that lies away from the ends, if its weights are all the same.
    pub fn of_piece<const D: usize>(plan: &Plan<D>, piece: usize) -> Option<Self> {
        /// Cells around a piece that its rows see, and the coefficients those tie.
        const AROUND: usize = 6;
        let (n, first) = (plan.frame.shape[0], piece * PIECE);
        if first < AROUND || first + PIECE + AROUND > n {
            return None;
        }
        let around = first - AROUND..first + PIECE + AROUND;
        let same = |values: &[f32]| {
            let values = values.get(around.clone()).unwrap_or(&[]);
            values.iter().map(|v| u32::from(*v != values[0])).sum::<u32>() == 0
        };
        let frees = plan.free.get(around.clone()).unwrap_or(&[]);
        let uniform = same(&plan.gamma)
            && same(&plan.colour)
            && (plan.keep == 0.0 || same(&plan.region))
            && frees.iter().all(|f| *f == frees[0]);
        uniform.then(|| Self::at(plan, first))
    }
}

/// Calls `visit(cell, half, point, coefficients)` for the quadrature points of some cells: the
/// coefficients that a point sees are `None` where the change is zero.
pub fn for_points(
    n: usize,
    ends: [End; 2],
    cells: std::ops::Range<isize>,
    mut visit: impl FnMut(usize, usize, &CellPoint, [Option<usize>; 4]),
) {
    let points = cell_points();
    // Cells beyond a Zero end still lie under the outermost basis functions.
    let beyond = |end: End| if end == End::Zero { REACH } else { 0 };
    let cells = cells.start.max(-beyond(ends[0]))..cells.end.min(n as isize + beyond(ends[1]));
    for cell in cells {
        for (half, point) in points.iter().enumerate() {
            let outside = cell == 0 && half == 0 && ends[0] == End::Mirror
                || cell == n as isize - 1 && half == 1 && ends[1] == End::Mirror;
            if outside && n > 1 {
                continue;
            }
            let at = std::array::from_fn(|k| ghost(cell + point.first + k as isize, n, ends));
            visit(cell.clamp(0, n as isize - 1) as usize, half, point, at);
        }
    }
}

/// Adds what one point gives to the rows from `first` on.
fn add_point(
    upper: &mut [[f64; BAND]],
    first: usize,
    class: &Class,
    point: &CellPoint,
    at: [Option<usize>; 4],
) {
    for (k, i) in at.iter().enumerate() {
        let Some(row) = i.and_then(|i| i.checked_sub(first)).filter(|r| *r < upper.len()) else {
            continue;
        };
        for (l, j) in at.iter().enumerate() {
            let Some(right) = j.and_then(|j| j.checked_sub(first + row)) else { continue };
            let slopes = f64::from(point.slope[k]) * f64::from(point.slope[l]);
            let values = f64::from(point.value[k]) * f64::from(point.value[l]);
            upper[row][right] += 0.5 * (class.gamma * slopes + class.screening * values);
        }
    }
}

/// The rows of a piece whose weights are the same everywhere.
fn uniform_rows(class: &Class) -> Vec<[f64; BAND]> {
    let mut row = [[0.0; BAND]];
    let middle = 8;
    for_points(4 * middle, [End::Zero; 2], 0..2 * middle as isize, |_, _, point, at| {
        add_point(&mut row, middle, class, point, at);
    });
    vec![if class.free { row[0] } else { [1.0, 0.0, 0.0, 0.0] }; PIECE]
}

/// The rows of any piece; those beyond the line's last coefficient tie nothing.
fn rows<const D: usize>(plan: &Plan<D>, piece: usize) -> Vec<[f64; BAND]> {
    let (n, first) = (plan.frame.shape[0], piece * PIECE);
    let mut upper = vec![[0.0; BAND]; PIECE];
    let cells = first as isize - REACH..(first + PIECE) as isize + REACH;
    for_points(n, plan.frame.ends[0], cells, |cell, _, point, at| {
        add_point(&mut upper, first, &Class::at(plan, cell), point, at);
    });
    let free = |i: usize| i < n && plan.free.get(i).copied().unwrap_or(true);
    for (row, entries) in upper.iter_mut().enumerate() {
        let i = first + row;
        for k in 1..BAND {
            if !(free(i) && free(i + k)) {
                entries[k] = 0.0;
            }
        }
        if !free(i) {
            entries[0] = 1.0;
        }
    }
    upper
}

impl System {
    /// The system of a piece away from the ends with the same weights everywhere.
    pub fn uniform(class: &Class) -> Self {
        Self::new(uniform_rows(class))
    }

    /// The system of any piece.
    pub fn of_piece<const D: usize>(plan: &Plan<D>, piece: usize) -> Self {
        Self::new(rows(plan, piece))
    }

    fn new(upper: Vec<[f64; BAND]>) -> Self {
        let factor = factorise(&upper[SEPARATOR..]);
        let zero = [[0.0; SEPARATOR]; SEPARATOR];
        let ends = Ends { left: zero, across: zero, right: zero };
        let mut system = Self { upper, factor, response: Default::default(), ends };
        system.response = std::array::from_fn(|side| {
            let mut b = vec![0.0; PIECE - SEPARATOR];
            let mut unit = [0.0; 2 * SEPARATOR];
            unit[side] = 1.0;
            system.take_off(unit, &mut b);
            system.solve(&mut b);
            b
        });
        let mut ends = Ends { left: zero, across: zero, right: zero };
        for j in 0..SEPARATOR {
            let (of_left, of_right) = (&system.response[j], &system.response[SEPARATOR + j]);
            let (left, across) = (system.seen_from_left(of_left), system.seen_from_left(of_right));
            let right = system.seen_from_right(of_right);
            for i in 0..SEPARATOR {
                ends.left[i][j] = system.upper[i.min(j)][i.abs_diff(j)] + left[i];
                ends.across[i][j] = across[i];
                ends.right[i][j] = right[i];
            }
        }
        system.ends = ends;
        system
    }

    /// The entry that ties separator `i` of this piece to coefficient `p` of its interior.
    fn left(&self, i: usize, p: usize) -> f64 {
        if p <= i { self.upper[i][SEPARATOR + p - i] } else { 0.0 }
    }

    /// The entry that ties coefficient `PIECE - 1 - q` to separator `j` of the next piece.
    fn right(&self, j: usize, q: usize) -> f64 {
        if j + q < SEPARATOR { self.upper[PIECE - 1 - q][1 + j + q] } else { 0.0 }
    }

    /// What interior values add to the equations of the piece's separators.
    pub fn seen_from_left(&self, x: &[f64]) -> [f64; SEPARATOR] {
        std::array::from_fn(|i| (0..SEPARATOR).map(|p| self.left(i, p) * x[p]).sum())
    }

    /// What they add to the equations of the next piece's separators.
    pub fn seen_from_right(&self, x: &[f64]) -> [f64; SEPARATOR] {
        let last = x.len() - 1;
        std::array::from_fn(|j| (0..SEPARATOR).map(|q| self.right(j, q) * x[last - q]).sum())
    }

    /// Takes what separators of these values give off the interior's right-hand side.
    fn take_off(&self, separators: [f64; 2 * SEPARATOR], b: &mut [f64]) {
        let last = b.len() - 1;
        for i in 0..SEPARATOR {
            for p in 0..SEPARATOR {
                b[p] -= self.left(i, p) * separators[i];
                b[last - p] -= self.right(i, p) * separators[SEPARATOR + i];
            }
        }
    }

    /// Solves for the interior, in place.
    pub fn solve(&self, b: &mut [f64]) {
        let f = &self.factor[..b.len()];
        let (mut one, mut two, mut three) = (0.0, 0.0, 0.0);
        for i in 0..b.len() {
            let mut v = b[i];
            if i >= SEPARATOR {
                v -= f[i - 3][3] * three + f[i - 2][2] * two;
            } else if i == 2 {
                v -= f[0][2] * two;
            }
            if i >= 1 {
                v -= f[i - 1][1] * one;
            }
            b[i] = v;
            (three, two, one) = (two, one, v);
        }
        (one, two, three) = (0.0, 0.0, 0.0);
        for i in (0..b.len()).rev() {
            let v = b[i] * f[i][0] - (f[i][3] * three + f[i][2] * two) - f[i][1] * one;
            b[i] = v;
            (three, two, one) = (two, one, v);
        }
    }
}

/// `L D L^T` of a band matrix.
fn factorise(upper: &[[f64; BAND]]) -> Vec<[f64; BAND]> {
    let n = upper.len();
    let mut factor = vec![[0.0f64; BAND]; n];
    for i in 0..n {
        let mut column = upper[i];
        for m in 1..BAND.min(i + 1) {
            let above = factor[i - m];
            let scaled = above[m] / above[0];
            for k in 0..BAND - m {
                column[k] -= scaled * above[m + k];
            }
        }
        // 1e-300: an equation without any weight leaves its unknown at zero.
        let inverse = 1.0 / column[0].max(1e-300);
        factor[i] = [inverse, column[1] * inverse, column[2] * inverse, column[3] * inverse];
        for k in 1..BAND {
            if i + k >= n {
                factor[i][k] = 0.0;
            }
        }
    }
    factor
}
