//! Maps from voxel indices to world coordinates: three rows of a 3 x 3 matrix and an offset.

use crate::{Error, Result};

/// Voxel index to world, in millimetres: row `r` gives world coordinate `r` as
/// `a[r][0] i + a[r][1] j + a[r][2] k + a[r][3]`.
pub type Affine = [[f64; 4]; 3];

/// Below this determinant, relative to the product of the columns' lengths, two axes are the same
/// for every practical purpose: the angle between them is less than a millionth.
const SINGULAR: f64 = 1e-6;

/// Voxel edges along the world's axes.
pub(crate) fn diagonal(size: [f64; 3]) -> Affine {
    std::array::from_fn(|r| std::array::from_fn(|c| if r == c { size[r] } else { 0.0 }))
}

/// Lengths of the voxel edges.
pub(super) fn voxel_size(a: &Affine) -> [f64; 3] {
    std::array::from_fn(|c| a[0][c].hypot(a[1][c]).hypot(a[2][c]))
}

/// World position of a voxel index.
pub(crate) fn apply(a: &Affine, index: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|r| (0..3).map(|c| a[r][c] * index[c]).sum::<f64>() + a[r][3])
}

/// The map `outer(inner(x))`.
pub(crate) fn compose(outer: &Affine, inner: &Affine) -> Affine {
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let linear: f64 = (0..3).map(|k| outer[r][k] * inner[k][c]).sum();
            if c == 3 { linear + outer[r][3] } else { linear }
        })
    })
}

/// Cross product.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Refuses maps that cannot be turned round, with the reason.
pub(super) fn check(a: &Affine) -> Result<()> {
    let fail = |what: String| Err(Error::Affine { what });
    if let Some(value) = a.iter().flatten().find(|v| !v.is_finite()) {
        return fail(format!("it contains {value}"));
    }
    let size = voxel_size(a);
    // The pitch of a domain is an f32.
    if let Some(bad) = size.iter().find(|s| !((**s as f32) > 0.0 && (**s as f32).is_finite())) {
        return fail(format!("a voxel edge of {bad} mm"));
    }
    let unit: Affine = std::array::from_fn(|r| {
        std::array::from_fn(|c| if c == 3 { a[r][3] } else { a[r][c] / size[c] })
    });
    let determinant = determinant(&unit);
    match determinant.abs() > SINGULAR {
        true => Ok(()),
        false => fail("its axes lie in one plane".to_owned()),
    }
}

/// Volume of the box that the axes span; negative where the map is a reflection.
pub(crate) fn determinant(a: &Affine) -> f64 {
    let row = |r: usize| [a[r][0], a[r][1], a[r][2]];
    let normal = cross(row(1), row(2));
    (0..3).map(|c| a[0][c] * normal[c]).sum()
}

/// World to voxel index, for a map that [`check`] has passed.
pub(super) fn inverse(a: &Affine) -> Affine {
    // Columns of unit length first: their product may leave the range of f64 otherwise.
    let size = voxel_size(a);
    let unit: Affine = std::array::from_fn(|r| {
        std::array::from_fn(|c| if c == 3 { a[r][3] } else { a[r][c] / size[c] })
    });
    let row = |r: usize| [unit[r][0], unit[r][1], unit[r][2]];
    let columns = [cross(row(1), row(2)), cross(row(2), row(0)), cross(row(0), row(1))];
    let determinant = determinant(&unit);
    std::array::from_fn(|r| {
        let linear = |c: usize| columns[c][r] / determinant / size[r];
        let offset = -(0..3).map(|c| linear(c) * a[c][3]).sum::<f64>();
        [linear(0), linear(1), linear(2), offset]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBLIQUE: Affine =
        [[1.8, -0.3, 0.1, -90.0], [0.4, 2.1, -0.2, 12.5], [-0.1, 0.5, -3.0, 700.0]];

    #[test]
    fn the_inverse_undoes_the_map() {
        let both = compose(&inverse(&OBLIQUE), &OBLIQUE);
        for (r, row) in both.iter().enumerate() {
            for (c, value) in row.iter().enumerate() {
                let expected = if r == c { 1.0 } else { 0.0 };
                assert!((value - expected).abs() < 1e-12, "{r} {c}: {value}");
            }
        }
        let index = apply(&inverse(&OBLIQUE), apply(&OBLIQUE, [3.0, -4.0, 5.0]));
        assert!(index.iter().zip([3.0, -4.0, 5.0]).all(|(a, b)| (a - b).abs() < 1e-10));
    }

    #[test]
    fn useless_maps_are_typed_errors() {
        let flat = [[1.0, 2.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mut nan = OBLIQUE;
        nan[2][3] = f64::NAN;
        for bad in [flat, nan, diagonal([1.0, 0.0, 1.0]), diagonal([1.0, 1e300, 1.0])] {
            assert!(matches!(check(&bad), Err(Error::Affine { .. })), "{bad:?}");
        }
        check(&OBLIQUE).unwrap();
        check(&diagonal([1e-6, 1e3, 1.0])).unwrap();
    }
}
