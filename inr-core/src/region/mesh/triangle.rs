//! One triangle: nearest point and crossing.

/// A triangle with the identities of its corners, which decide where an edge is hit exactly.
#[derive(Debug, Clone)]
pub(super) struct Triangle {
    pub(super) ids: [u32; 3],
    pub(super) corners: [[f64; 3]; 3],
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|d| a[d] - b[d])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Triangle {
    pub(super) fn center(&self) -> [f64; 3] {
        std::array::from_fn(|d| self.corners.iter().map(|c| c[d]).sum::<f64>() / 3.0)
    }

    /// Squared distance: to the plane where the foot lies inside, else to the nearest edge. Needles
    /// without area have edges only.
    pub(super) fn squared_distance(&self, x: &[f64; 3]) -> f64 {
        let [a, b, c] = self.corners;
        let normal = cross(minus(b, a), minus(c, a));
        let squared = dot(normal, normal);
        let is_left = |p, q| dot(cross(minus(q, p), minus(*x, p)), normal) >= 0.0;
        if squared > 0.0 && is_left(a, b) && is_left(b, c) && is_left(c, a) {
            let height = dot(minus(*x, a), normal);
            return height * height / squared;
        }
        let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| squared_distance_to_edge(p, q, x));
        edges.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// +1 where the ray leaves through the triangle's front (seen counter-clockwise), -1 where it enters.
    pub(super) fn crossing(&self, ray: &Ray) -> i32 {
        let [a, b, c] = self.corners.map(|corner| ray.to_own(corner));
        let [ia, ib, ic] = self.ids;
        // Signs of the areas that the ray's line makes with each edge. Two triangles compute the same
        // number for the edge they share, so exactly one of them has the line inside; on the edge
        // itself the order of the corners decides.
        let side = |p: [f64; 3], q: [f64; 3], up: bool| {
            let area = p[0] * q[1] - p[1] * q[0];
            if area != 0.0 { area > 0.0 } else { up }
        };
        let turn = side(a, b, ia < ib);
        if side(b, c, ib < ic) != turn || side(c, a, ic < ia) != turn {
            return 0;
        }
        let weights =
            [b[0] * c[1] - b[1] * c[0], c[0] * a[1] - c[1] * a[0], a[0] * b[1] - a[1] * b[0]];
        let total: f64 = weights.iter().sum();
        let along = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
        // Both have the sign of the turn: their quotient is the place along the ray.
        if total == 0.0 || (along > 0.0) != (total > 0.0) || along == 0.0 {
            return 0;
        }
        if turn { 1 } else { -1 }
    }
}

fn squared_distance_to_edge(p: [f64; 3], q: [f64; 3], x: &[f64; 3]) -> f64 {
    let (edge, to) = (minus(q, p), minus(*x, p));
    let squared = dot(edge, edge);
    let t = if squared > 0.0 { (dot(to, edge) / squared).clamp(0.0, 1.0) } else { 0.0 };
    let off: [f64; 3] = std::array::from_fn(|d| to[d] - t * edge[d]);
    dot(off, off)
}

/// A half-line; coordinates of its own put it on the third axis.
pub(super) struct Ray {
    pub(super) start: [f64; 3],
    pub(super) direction: [f64; 3],
    /// First, second, and longest axis of the direction.
    axes: [usize; 3],
    shear: [f64; 2],
}

impl Ray {
    pub(super) fn new(start: [f64; 3], direction: [f64; 3]) -> Self {
        let longer =
            |a: usize, b: usize| if direction[b].abs() > direction[a].abs() { b } else { a };
        let z = longer(longer(0, 1), 2);
        // Swapped for negative directions, which keeps the sense of rotation.
        let axes = match direction[z] > 0.0 {
            true => [(z + 1) % 3, (z + 2) % 3, z],
            false => [(z + 2) % 3, (z + 1) % 3, z],
        };
        let shear = [direction[axes[0]] / direction[z], direction[axes[1]] / direction[z]];
        Self { start, direction, axes, shear }
    }

    fn to_own(&self, point: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.axes.map(|d| point[d] - self.start[d]);
        let forward = if self.direction[self.axes[2]] > 0.0 { z } else { -z };
        [x - self.shear[0] * z, y - self.shear[1] * z, forward]
    }
}
