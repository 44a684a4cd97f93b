//! The reference discretisation in f64, written from its definition: every quadrature point is
//! visited, every product of two basis functions is added to a sparse matrix, and the system is
//! solved by Cholesky (small) or by Jacobi-preconditioned conjugate gradients run to 1e-13. It
//! shares no code with the solver it checks.

use std::collections::BTreeMap;

/// Value and gradient (per reference pitch) of every channel at a quadrature point.
#[derive(Clone, Debug)]
pub struct Point {
    /// Position in samples.
    pub at: Vec<f64>,
    /// Flat index of the sample whose cell holds the point.
    pub cell: usize,
    /// Coefficient, value weight, slope weight per axis.
    pub basis: Vec<(usize, f64, Vec<f64>)>,
}

/// A lattice with its quadrature points.
pub struct Lattice {
    /// Samples per axis, axis 0 contiguous.
    pub shape: Vec<usize>,
    /// Two points per knot interval and axis, at 1/4 and 3/4.
    pub points: Vec<Point>,
}

fn bspline(x: f64) -> f64 {
    let a = x.abs();
    if a >= 2.0 {
        0.0
    } else if a >= 1.0 {
        (2.0 - a).powi(3) / 6.0
    } else {
        2.0 / 3.0 - a * a + a * a * a / 2.0
    }
}

fn bspline_slope(x: f64) -> f64 {
    let a = x.abs();
    let slope = if a >= 2.0 {
        0.0
    } else if a >= 1.0 {
        -(2.0 - a).powi(2) / 2.0
    } else {
        -2.0 * a + 1.5 * a * a
    };
    slope * x.signum()
}

fn reflect(mut i: i64, n: usize) -> usize {
    let last = n as i64 - 1;
    while i < 0 || i > last {
        if last == 0 {
            return 0;
        }
        i = if i < 0 { -i } else { 2 * last - i };
    }
    i as usize
}

impl Lattice {
    /// All points; `pitch` in units of the reference pitch.
    pub fn new(shape: &[usize], pitch: &[f64]) -> Self {
        let dims = shape.len();
        let mut points = Vec::new();
        let cells: usize = shape.iter().product();
        for cell in 0..cells {
            let mut rest = cell;
            let index: Vec<usize> = shape
                .iter()
                .map(|n| {
                    let i = rest % n;
                    rest /= n;
                    i
                })
                .collect();
            for half in 0..1usize << dims {
                let at: Vec<f64> = (0..dims)
                    .map(|d| index[d] as f64 + if half >> d & 1 == 0 { -0.25 } else { 0.25 })
                    .collect();
                let inside = (0..dims)
                    .all(|d| shape[d] == 1 || at[d] > 0.0 && at[d] < (shape[d] - 1) as f64);
                if inside {
                    points.push(Self::point(shape, pitch, at, cell));
                }
            }
        }
        Self { shape: shape.to_vec(), points }
    }

    fn point(shape: &[usize], pitch: &[f64], at: Vec<f64>, cell: usize) -> Point {
        let dims = shape.len();
        let mut basis: BTreeMap<usize, (f64, Vec<f64>)> = BTreeMap::new();
        for tap in 0..4usize.pow(dims as u32) {
            let (mut flat, mut stride, mut rest) = (0, 1, tap);
            let (mut value, mut slopes) = (1.0, vec![1.0; dims]);
            for d in 0..dims {
                let knot = at[d].floor() as i64 - 1 + (rest % 4) as i64;
                rest /= 4;
                let x = at[d] - knot as f64;
                flat += reflect(knot, shape[d]) * stride;
                stride *= shape[d];
                value *= bspline(x);
                for (e, slope) in slopes.iter_mut().enumerate() {
                    *slope *= if e == d { bspline_slope(x) / pitch[d] } else { bspline(x) };
                }
            }
            let entry = basis.entry(flat).or_insert((0.0, vec![0.0; dims]));
            entry.0 += value;
            entry.1.iter_mut().zip(&slopes).for_each(|(a, b)| *a += b);
        }
        Point { at, cell, basis: basis.into_iter().map(|(k, (v, s))| (k, v, s)).collect() }
    }

    /// Value and slopes of a spline at a point.
    pub fn jet(&self, point: &Point, coefficients: &[f64]) -> (f64, Vec<f64>) {
        let (mut value, mut slopes) = (0.0, vec![0.0; self.shape.len()]);
        for (k, v, s) in &point.basis {
            value += coefficients[*k] * v;
            slopes.iter_mut().zip(s).for_each(|(a, b)| *a += coefficients[*k] * b);
        }
        (value, slopes)
    }
}

/// Coefficients of the spline through samples: the tridiagonal system per axis, by elimination.
pub fn coefficients(shape: &[usize], samples: &[f64]) -> Vec<f64> {
    let mut data = samples.to_vec();
    let mut stride = 1;
    for &n in shape {
        for start in (0..data.len()).filter(|k| k / stride % n == 0) {
            if n == 1 {
                continue;
            }
            let (mut upper, mut rhs) = (vec![0.0; n], vec![0.0; n]);
            for i in 0..n {
                let sub = if i == 0 {
                    0.0
                } else if i + 1 == n {
                    2.0 / 6.0
                } else {
                    1.0 / 6.0
                };
                let sup = if i == 0 { 2.0 / 6.0 } else { 1.0 / 6.0 };
                let pivot = 4.0 / 6.0 - if i > 0 { sub * upper[i - 1] } else { 0.0 };
                upper[i] = sup / pivot;
                rhs[i] =
                    (data[start + i * stride] - if i > 0 { sub * rhs[i - 1] } else { 0.0 }) / pivot;
            }
            for i in (0..n - 1).rev() {
                rhs[i] -= upper[i] * rhs[i + 1];
            }
            for i in 0..n {
                data[start + i * stride] = rhs[i];
            }
        }
        stride *= n;
    }
    data
}

/// Values at the knots.
pub fn nodal(shape: &[usize], coefficients: &[f64]) -> Vec<f64> {
    let mut data = coefficients.to_vec();
    let mut stride = 1;
    for &n in shape {
        let old = data.clone();
        for (k, v) in data.iter_mut().enumerate() {
            let i = (k / stride % n) as i64;
            let at = |j: i64| old[k - i as usize * stride + reflect(j, n) * stride];
            *v = (at(i - 1) + 4.0 * at(i) + at(i + 1)) / 6.0;
        }
        stride *= n;
    }
    data
}

/// What is asked at a quadrature point, one channel: the weights and targets of the two terms.
#[derive(Clone, Debug)]
pub struct Terms {
    /// Weight and target of the gradient.
    pub gradient: (f64, Vec<f64>),
    /// Weights and targets of the value.
    pub values: Vec<(f64, f64)>,
}

/// `sum over points` of the weighted squares (no normalisation).
pub fn energy(lattice: &Lattice, c: &[f64], terms: &[Terms]) -> f64 {
    lattice
        .points
        .iter()
        .zip(terms)
        .map(|(p, t)| {
            let (value, slopes) = lattice.jet(p, c);
            let g: f64 = slopes.iter().zip(&t.gradient.1).map(|(a, b)| (a - b).powi(2)).sum();
            t.gradient.0 * g + t.values.iter().map(|(w, v)| w * (value - v).powi(2)).sum::<f64>()
        })
        .sum()
}

/// The minimising coefficients. `fixed` marks coefficients that keep the values in `start`.
pub fn minimise(lattice: &Lattice, terms: &[Terms], start: &[f64], fixed: &[bool]) -> Vec<f64> {
    let n = start.len();
    let free: Vec<bool> = (0..n).map(|i| fixed.is_empty() || !fixed[i]).collect();
    if n <= 900 {
        let mut matrix = vec![0.0; n * n];
        let rhs = assemble(lattice, terms, n, |i, j, v| matrix[i * n + j] += v);
        return direct(&matrix, &rhs, start, &free);
    }
    let mut matrix: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); n];
    let rhs = assemble(lattice, terms, n, |i, j, v| *matrix[i].entry(j).or_insert(0.0) += v);
    let rows: Vec<Vec<(usize, f64)>> =
        matrix.into_iter().map(|r| r.into_iter().collect()).collect();
    iterate(&rows, &rhs, start, &free)
}

/// Hands every product of two basis functions to `add` as row, column, value; returns the right-hand side.
fn assemble(
    lattice: &Lattice,
    terms: &[Terms],
    n: usize,
    mut add: impl FnMut(usize, usize, f64),
) -> Vec<f64> {
    let mut rhs = vec![0.0; n];
    for (p, t) in lattice.points.iter().zip(terms) {
        let value_weight: f64 = t.values.iter().map(|(w, _)| w).sum();
        let value_target: f64 = t.values.iter().map(|(w, v)| w * v).sum();
        for (i, vi, si) in &p.basis {
            let slope_dot: f64 = si.iter().zip(&t.gradient.1).map(|(a, b)| a * b).sum();
            rhs[*i] += t.gradient.0 * slope_dot + vi * value_target;
            for (j, vj, sj) in &p.basis {
                let stiffness: f64 = si.iter().zip(sj).map(|(a, b)| a * b).sum();
                add(*i, *j, t.gradient.0 * stiffness + value_weight * vi * vj);
            }
        }
    }
    rhs
}

fn direct(matrix: &[f64], rhs: &[f64], start: &[f64], free: &[bool]) -> Vec<f64> {
    let unknown: Vec<usize> = (0..rhs.len()).filter(|i| free[*i]).collect();
    let n = rhs.len();
    let m = unknown.len();
    let a = nalgebra::DMatrix::from_fn(m, m, |k, l| matrix[unknown[k] * n + unknown[l]]);
    let known = |i: usize| (0..n).filter(|j| !free[*j]).map(move |j| matrix[i * n + j] * start[j]);
    let b = nalgebra::DVector::from_fn(m, |k, _| rhs[unknown[k]] - known(unknown[k]).sum::<f64>());
    let x = a.cholesky().expect("a positive definite reference matrix").solve(&b);
    let mut c = start.to_vec();
    unknown.iter().enumerate().for_each(|(k, i)| c[*i] = x[k]);
    c
}

fn iterate(rows: &[Vec<(usize, f64)>], rhs: &[f64], start: &[f64], free: &[bool]) -> Vec<f64> {
    let n = rhs.len();
    let apply = |x: &[f64]| -> Vec<f64> {
        rows.iter().map(|r| r.iter().map(|(j, v)| v * x[*j]).sum()).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let diagonal: Vec<f64> = rows
        .iter()
        .enumerate()
        .map(|(i, r)| r.iter().find(|(j, _)| *j == i).map_or(1.0, |(_, v)| *v))
        .collect();
    let mut x = start.to_vec();
    let ax = apply(&x);
    let mut r: Vec<f64> = (0..n).map(|i| if free[i] { rhs[i] - ax[i] } else { 0.0 }).collect();
    let mut z: Vec<f64> = (0..n).map(|i| r[i] / diagonal[i]).collect();
    let (mut p, mut rz) = (z.clone(), dot(&r, &z));
    let goal = rz * 1e-26;
    for _ in 0..100_000 {
        if rz <= goal {
            return x;
        }
        let mut q = apply(&p);
        q.iter_mut().zip(free).for_each(|(q, f)| *q = if *f { *q } else { 0.0 });
        let alpha = rz / dot(&p, &q);
        for i in 0..n {
            x[i] += alpha * p[i];
            r[i] -= alpha * q[i];
            z[i] = r[i] / diagonal[i];
        }
        let next = dot(&r, &z);
        for i in 0..n {
            p[i] = z[i] + next / rz * p[i];
        }
        rz = next;
    }
    panic!("the reference solve did not converge: {:e}", rz / goal);
}
