mod bvh;
mod triangle;

use std::collections::HashMap;

use self::bvh::Bvh;
use self::triangle::{Ray, Triangle};
use crate::{Error, Region, Result};

/// Directions of the rays that count crossings: no two components alike, far from the axes and the
/// diagonals, along which edges of constructed meshes lie.
const DIRECTIONS: [[f64; 3]; 3] =
    [[0.541_3, 0.311_7, 0.780_9], [-0.268_1, 0.843_7, 0.465_2], [0.713_9, -0.602_3, -0.357_1]];

/// The inside of a closed triangle mesh.
///
/// Vertices at the same position count as one: files repeat them where normals differ. A mesh may
/// consist of many closed parts. Where all triangles are turned the same way round, parts that overlap
/// are united, a part inside out in another one is a cavity, and it does not matter which way round the
/// whole is (non-zero winding). Where they are not, every surface separates an inside from an outside
/// (parity).
///
/// The signed distance is exact up to f32 rounding of the coordinates for meshes whose parts do not
/// overlap; else surfaces inside of other parts count as boundary, too, and it is a bound. The sign
/// comes from crossings along up to three rays, the majority of which decides. Cost: `O(log n)` for `n`
/// triangles as a rule.
///
/// Source: the crossing test is the watertight one of Woop, Benthin and Wald, "Watertight ray/triangle
/// intersection", 2013, in f64.
#[derive(Debug, Clone)]
pub struct MeshRegion {
    tree: Bvh,
    /// Non-zero winding, else parity.
    oriented: bool,
}

impl MeshRegion {
    /// The inside of the triangles, which are triples of indices of vertices in physical units.
    ///
    /// Triangles without area because two of their corners are the same are left out.
    ///
    /// # Errors
    /// [`Error::OpenMesh`] when an edge belongs to an odd number of triangles; [`Error::Mesh`] without
    /// triangles and for indices out of range; [`Error::Parameter`] for vertices that are not finite.
    pub fn new(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self> {
        if let Some(&value) = vertices.iter().flatten().find(|v| !v.is_finite()) {
            return Err(Error::Parameter { what: "the mesh's vertex", rule: "finite", value });
        }
        let welded = weld(vertices);
        let mut corners = Vec::with_capacity(triangles.len());
        for triangle in triangles {
            let mut ids = [0; 3];
            for (id, &index) in ids.iter_mut().zip(triangle) {
                *id = *welded.get(index as usize).ok_or_else(|| Error::Mesh {
                    what: format!("a triangle has corner {index} of {} vertices", vertices.len()),
                })?;
            }
            let [a, b, c] = ids;
            if a != b && b != c && c != a {
                corners.push(ids);
            }
        }
        if corners.is_empty() {
            let what = format!("no triangle with an area among {}", triangles.len());
            return Err(Error::Mesh { what });
        }
        let oriented = check_closed(&corners)?;
        let at = |id: u32| vertices[id as usize].map(f64::from);
        let list = corners.iter().map(|ids| Triangle { ids: *ids, corners: ids.map(at) }).collect();
        Ok(Self { tree: Bvh::new(list), oriented })
    }

    /// The corners of the smallest box around the mesh.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let (low, high) = self.tree.bounds();
        (low.map(|v| v as f32), high.map(|v| v as f32))
    }

    /// Number of triangles that have an area.
    pub fn triangle_count(&self) -> usize {
        self.tree.triangle_count()
    }

    fn contains(&self, x: &[f64; 3]) -> bool {
        let (low, high) = self.tree.bounds();
        if (0..3).any(|d| !(low[d] <= x[d] && x[d] <= high[d])) {
            return false;
        }
        let inside = |direction: &[f64; 3]| {
            let (winding, crossings) = self.tree.crossings(&Ray::new(*x, *direction));
            if self.oriented { winding != 0 } else { crossings % 2 == 1 }
        };
        let (first, second) = (inside(&DIRECTIONS[0]), inside(&DIRECTIONS[1]));
        if first == second { first } else { inside(&DIRECTIONS[2]) }
    }
}

impl Region<3> for MeshRegion {
    fn signed_distance(&self, x: &[f32; 3]) -> f32 {
        let x = x.map(f64::from);
        let distance = self.tree.squared_distance(&x).sqrt() as f32;
        if self.contains(&x) { -distance } else { distance }
    }

    /// Without the distance, which costs more than the crossings.
    fn weight(&self, x: &[f32; 3]) -> f32 {
        if self.contains(&x.map(f64::from)) { 1.0 } else { 0.0 }
    }
}

/// The index of the first vertex at the position of each.
fn weld(vertices: &[[f32; 3]]) -> Vec<u32> {
    let mut first = HashMap::new();
    let ids = vertices.iter().enumerate().map(|(k, v)| {
        // Adding zero makes -0 the same as 0.
        *first.entry(v.map(|c| (c + 0.0).to_bits())).or_insert(k as u32)
    });
    ids.collect()
}

/// Whether the triangles agree on which way round is outside.
fn check_closed(corners: &[[u32; 3]]) -> Result<bool> {
    // Per edge: triangles that have it, and those that run along it upwards minus downwards.
    let mut edges: HashMap<(u32, u32), (usize, i64)> = HashMap::new();
    for [a, b, c] in corners {
        for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
            let edge = edges.entry((from.min(to), from.max(to))).or_default();
            edge.0 += 1;
            edge.1 += if from < to { 1 } else { -1 };
        }
    }
    match edges.values().filter(|(count, _)| count % 2 == 1).count() {
        0 => Ok(edges.values().all(|(_, balance)| *balance == 0)),
        open => Err(Error::OpenMesh { edges: open }),
    }
}

#[cfg(test)]
mod tests;
