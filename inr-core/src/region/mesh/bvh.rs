//! A tree of boxes around triangles: most of them need not be looked at.

use super::triangle::{Ray, Triangle};

/// Triangles in a leaf: looking at a few is as cheap as another two boxes.
const LEAF: usize = 4;

/// Levels of a tree that halves its triangles until `u32` indices run out, and room: the size of stacks.
const DEPTH: usize = 64;

#[derive(Debug, Clone)]
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    /// Triangles of a leaf; of an inner node the index of the second child, the first one follows it.
    content: Content,
}

#[derive(Debug, Clone)]
enum Content {
    Leaf { begin: usize, end: usize },
    Inner { second: usize },
}

#[derive(Debug, Clone)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

impl Bvh {
    /// Splits at the median along the longest axis of the centres: `O(n log n)`, never deeper than
    /// `log2 n`.
    ///
    /// # Panics
    /// Without triangles.
    pub(super) fn new(mut triangles: Vec<Triangle>) -> Self {
        assert!(!triangles.is_empty(), "a tree without triangles");
        let mut nodes = Vec::with_capacity(2 * triangles.len() / LEAF + 1);
        let end = triangles.len();
        build(&mut triangles, 0, end, &mut nodes);
        Self { nodes, triangles }
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    pub(super) fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        (self.nodes[0].low, self.nodes[0].high)
    }

    /// Squared distance to the nearest triangle.
    pub(super) fn squared_distance(&self, x: &[f64; 3]) -> f64 {
        let mut best = f64::INFINITY;
        let mut stack = Vec::with_capacity(DEPTH);
        stack.push((0, self.nodes[0].squared_distance(x)));
        while let Some((index, distance)) = stack.pop() {
            if distance >= best {
                continue;
            }
            match self.nodes[index].content {
                Content::Leaf { begin, end } => {
                    for triangle in &self.triangles[begin..end] {
                        best = best.min(triangle.squared_distance(x));
                    }
                }
                Content::Inner { second } => {
                    let near = (index + 1, self.nodes[index + 1].squared_distance(x));
                    let far = (second, self.nodes[second].squared_distance(x));
                    let (near, far) = if near.1 <= far.1 { (near, far) } else { (far, near) };
                    stack.extend([far, near]);
                }
            }
        }
        best
    }

    /// Crossings of a ray with the triangles: those out of their front minus those into it, and all.
    pub(super) fn crossings(&self, ray: &Ray) -> (i32, u32) {
        let (mut winding, mut all) = (0, 0);
        let mut stack = Vec::with_capacity(DEPTH);
        stack.push(0);
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if !node.is_hit(ray) {
                continue;
            }
            match node.content {
                Content::Leaf { begin, end } => {
                    for triangle in &self.triangles[begin..end] {
                        let crossing = triangle.crossing(ray);
                        winding += crossing;
                        all += crossing.unsigned_abs();
                    }
                }
                Content::Inner { second } => stack.extend([second, index + 1]),
            }
        }
        (winding, all)
    }
}

fn build(triangles: &mut [Triangle], begin: usize, end: usize, nodes: &mut Vec<Node>) {
    let part = &mut triangles[begin..end];
    let (low, high) = around(part.iter().flat_map(|t| t.corners));
    let index = nodes.len();
    nodes.push(Node { low, high, content: Content::Leaf { begin, end } });
    if part.len() <= LEAF {
        return;
    }
    let (low, high) = around(part.iter().map(Triangle::center));
    let length = |d: usize| high[d] - low[d];
    let axis = (1..3).fold(0, |best, d| if length(d) > length(best) { d } else { best });
    let half = part.len() / 2;
    part.select_nth_unstable_by(half, |a, b| a.center()[axis].total_cmp(&b.center()[axis]));
    build(triangles, begin, begin + half, nodes);
    let second = nodes.len();
    build(triangles, begin + half, end, nodes);
    nodes[index].content = Content::Inner { second };
}

fn around(points: impl Iterator<Item = [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|d| low[d].min(p[d])), std::array::from_fn(|d| high[d].max(p[d])))
    })
}

impl Node {
    fn squared_distance(&self, x: &[f64; 3]) -> f64 {
        (0..3).map(|d| (self.low[d] - x[d]).max(x[d] - self.high[d]).max(0.0).powi(2)).sum()
    }

    /// Whether the ray may meet the box: no crossing is missed for rounding.
    fn is_hit(&self, ray: &Ray) -> bool {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for d in 0..3 {
            let a = (self.low[d] - ray.start[d]) / ray.direction[d];
            let b = (self.high[d] - ray.start[d]) / ray.direction[d];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // Quotients of differences of f32 numbers in f64: 1e-12 covers a few roundings, and the largest
        // coordinate stands for what was lost in differences.
        let scale =
            (0..3).map(|d| ray.start[d].abs().max(self.high[d].abs()).max(self.low[d].abs()));
        enter <= leave * (1.0 + 1e-12) + 1e-12 * scale.fold(0.0, f64::max)
    }
}
