use super::*;
use crate::{BoxRegion, Ellipsoid};
use proptest::prelude::*;

/// f32 rounding of coordinates and distances up to 10.
const TOLERANCE: f32 = 2e-6;

/// Vertices and triangles.
type Parts = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Corner `k` has coordinate `d` at the upper end where bit `d` is set; the sides look outward.
const SIDES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn box_mesh(min: [f32; 3], max: [f32; 3]) -> Parts {
    let corner = |k: u32| [0, 1, 2].map(|d| if k >> d & 1 == 1 { max[d] } else { min[d] });
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    ((0..8).map(corner).collect(), SIDES.into_iter().flat_map(halves).collect())
}

/// An icosahedron whose triangles are divided into four again and again, on the unit sphere.
fn icosphere(divisions: usize) -> Parts {
    let t = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    for (a, b) in [(1.0, t), (-1.0, t), (1.0, -t), (-1.0, -t)] {
        vertices.extend([[a, b, 0.0], [0.0, a, b], [b, 0.0, a]]);
    }
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>();
    // Three corners that are neighbours, 2 apart, turned outward.
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [vertices[a], vertices[b], vertices[c]];
                if [(p, q), (q, r), (r, p)].iter().all(|(p, q)| distance(p, q) < 4.1) {
                    let volume = p[0] * (q[1] * r[2] - q[2] * r[1])
                        + p[1] * (q[2] * r[0] - q[0] * r[2])
                        + p[2] * (q[0] * r[1] - q[1] * r[0]);
                    triangles.push(if volume > 0.0 { [p, q, r] } else { [p, r, q] });
                }
            }
        }
    }
    assert_eq!(triangles.len(), 20);
    let unit = |p: [f64; 3]| {
        let length = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        p.map(|v| v / length)
    };
    let middle = |p: [f64; 3], q: [f64; 3]| unit([0, 1, 2].map(|d| p[d] + q[d]));
    triangles = triangles.into_iter().map(|t| t.map(unit)).collect();
    for _ in 0..divisions {
        let quarters = |[p, q, r]: [[f64; 3]; 3]| {
            let (a, b, c) = (middle(p, q), middle(q, r), middle(r, p));
            [[p, a, c], [a, q, b], [c, b, r], [a, b, c]]
        };
        triangles = triangles.into_iter().flat_map(quarters).collect();
    }
    // Every triangle with corners of its own, as in files with flat normals.
    let corners: Vec<[f32; 3]> = triangles.iter().flatten().map(|p| p.map(|v| v as f32)).collect();
    let ids = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    (corners, ids)
}

proptest! {
    #[test]
    fn a_box_of_triangles_is_the_box(
        min in prop::array::uniform3(-5.0..0.0_f32),
        size in prop::array::uniform3(0.5..5.0_f32),
        x in prop::array::uniform3(-6.0..6.0_f32),
    ) {
        let max = std::array::from_fn(|d| min[d] + size[d]);
        let exact = BoxRegion::new(min, max).unwrap();
        let (vertices, triangles) = box_mesh(min, max);
        let mesh = MeshRegion::new(&vertices, &triangles).unwrap();
        let (got, want) = (mesh.signed_distance(&x), exact.signed_distance(&x));
        prop_assert!((got - want).abs() < TOLERANCE, "{} {}", got, want);
        prop_assert_eq!(mesh.weight(&x), exact.weight(&x));
    }

    /// Points in the planes, edges and corners of the box' triangles and its middle.
    #[test]
    fn places_on_a_lattice_are_no_exception(x in prop::array::uniform3(-3..4_i32)) {
        let x = x.map(|v| v as f32);
        let (vertices, triangles) = box_mesh([-2.0; 3], [2.0; 3]);
        let mesh = MeshRegion::new(&vertices, &triangles).unwrap();
        let exact = BoxRegion::new([-2.0; 3], [2.0; 3]).unwrap();
        prop_assert_eq!(mesh.signed_distance(&x).abs(), exact.signed_distance(&x).abs());
        if exact.signed_distance(&x) != 0.0 {
            prop_assert_eq!(mesh.weight(&x), exact.weight(&x));
        }
    }

    /// Every triangle looked at, for the distance; the direction of the surface, for the side.
    #[test]
    fn a_ball_of_triangles_is_nearly_the_ball(x in prop::array::uniform3(-1.5..1.5_f32)) {
        let (vertices, triangles) = icosphere(3);
        let mesh = MeshRegion::new(&vertices, &triangles).unwrap();
        let ball = Ellipsoid::ball([0.0; 3], 1.0).unwrap();
        // Edges of the third division are 0.165 long at most, so corners lie within 0.165 / sqrt(3) of the
        // middle of their triangle, and that within half the square of this below the sphere: 0.0046.
        let (got, want) = (mesh.signed_distance(&x), ball.signed_distance(&x));
        prop_assert!((got - want).abs() < 0.005, "{} {}", got, want);
        let at = |k: u32| vertices[k as usize].map(f64::from);
        let all = triangles.iter().map(|ids| Triangle { ids: *ids, corners: ids.map(at) });
        let nearest = all.map(|t| t.squared_distance(&x.map(f64::from))).fold(f64::MAX, f64::min);
        prop_assert!((f64::from(got.abs()) - nearest.sqrt()).abs() < 1e-6);
    }
}

#[test]
fn refinement_converges_to_the_ball() {
    let volume = |divisions| {
        let (vertices, triangles) = icosphere(divisions);
        let mesh = MeshRegion::new(&vertices, &triangles).unwrap();
        assert!(mesh.oriented);
        let (low, high) = mesh.bounds();
        assert!(
            low.iter().chain(&high).all(|v| (0.8..=1.001).contains(&v.abs())),
            "{low:?} {high:?}"
        );
        mesh.signed_distance(&[0.0; 3])
    };
    // The nearest triangle from the middle: second order in the length of edges.
    let errors = [1, 2, 3].map(|k| f64::from(volume(k)) + 1.0);
    let slopes = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    assert!(slopes.iter().all(|s| (1.8..2.2).contains(s)), "{errors:?} {slopes:?}");
}

#[test]
fn parts_unite_and_cavities_stay_empty() {
    let join = |parts: &[Parts]| {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for (v, t) in parts {
            let first = vertices.len() as u32;
            vertices.extend(v);
            triangles.extend(t.iter().map(|ids| ids.map(|id| id + first)));
        }
        MeshRegion::new(&vertices, &triangles).unwrap()
    };
    let (big, small) = (box_mesh([0.0; 3], [4.0; 3]), box_mesh([1.0; 3], [2.0; 3]));
    let shifted = box_mesh([3.0; 3], [6.0; 3]);
    let mut reversed = small.clone();
    reversed.1.iter_mut().for_each(|t| t.swap(0, 1));
    let union = join(&[big.clone(), shifted]);
    assert_eq!(
        [[0.5; 3], [3.5; 3], [5.5; 3], [-1.0; 3]].map(|x| union.weight(&x)),
        [1., 1., 1., 0.]
    );
    let solid = join(&[big.clone(), small]);
    assert_eq!(solid.weight(&[1.5; 3]), 1.0);
    let hollow = join(&[big.clone(), reversed]);
    assert_eq!((hollow.weight(&[1.5; 3]), hollow.weight(&[3.0; 3])), (0.0, 1.0));
    assert_eq!(hollow.signed_distance(&[1.5; 3]), 0.5);

    // Inside out, and with a single triangle turned round.
    let mut turned = big.clone();
    turned.1.iter_mut().for_each(|t| t.swap(0, 1));
    assert_eq!(join(&[turned]).weight(&[1.0; 3]), 1.0);
    let mut mixed = big;
    mixed.1[3].swap(0, 1);
    let mixed = join(&[mixed]);
    assert!(!mixed.oriented);
    assert_eq!((mixed.weight(&[1.0, 2.0, 3.0]), mixed.weight(&[5.0; 3])), (1.0, 0.0));
}

#[test]
fn meshes_without_an_inside_are_typed_errors() {
    let (vertices, mut triangles) = box_mesh([0.0; 3], [1.0; 3]);
    triangles.pop();
    let open = MeshRegion::new(&vertices, &triangles);
    assert!(matches!(open, Err(Error::OpenMesh { edges: 3 })), "{open:?}");
    triangles.push([0, 1, 8]);
    assert!(matches!(MeshRegion::new(&vertices, &triangles), Err(Error::Mesh { .. })));
    for none in [&[][..], &[[0, 0, 1]], &[[2, 2, 2]]] {
        assert!(matches!(MeshRegion::new(&vertices, none), Err(Error::Mesh { .. })));
    }
    let (mut vertices, triangles) = box_mesh([0.0; 3], [1.0; 3]);
    vertices[2][1] = f32::NAN;
    let result = MeshRegion::new(&vertices, &triangles);
    assert!(matches!(result, Err(Error::Parameter { .. })));
}
