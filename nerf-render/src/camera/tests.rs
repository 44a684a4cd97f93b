use inr_core::{Dual, Scalar, seed};
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

use super::*;

/// Undistortion leaves 1e-13 in normalised coordinates: 1e-10 pixels at focal lengths up to 1000,
/// and distances up to 50 lose two digits more.
const PIXEL_TOLERANCE: f64 = 1e-7;

/// Steps of 1e-3 pixels, 1e-5 of the focal length or less: truncation 1e-10, and cancellation of
/// 1e-13 over the step.
const DIFFERENCE_TOLERANCE: f64 = 1e-9;

fn plain_lens() -> Intrinsics {
    Intrinsics { fx: 100.0, fy: 120.0, cx: 32.0, cy: 24.0 }
}

fn at_origin(projection: Projection, axes: Axes) -> Camera {
    Camera::new(plain_lens(), projection, axes, PixelCenter::Integer, &Matrix4::identity()).unwrap()
}

fn camera() -> impl Strategy<Value = Camera> {
    let coefficient = -0.05..0.05_f64;
    let distortion =
        (-0.25..0.25_f64, coefficient, -0.01..0.01_f64, -0.01..0.01_f64, -0.005..0.005_f64);
    let projection = prop_oneof![
        Just(Projection::Pinhole(Distortion::default())),
        Just(Projection::Orthographic),
        distortion.prop_map(|(k1, k2, p1, p2, k3)| {
            Projection::Pinhole(Distortion { k1, k2, p1, p2, k3 })
        }),
    ];
    let axes = prop_oneof![Just(Axes::OpenGl), Just(Axes::OpenCv)];
    let pose = (prop::array::uniform3(-5.0..5.0_f64), prop::array::uniform3(-3.0..3.0_f64));
    let focal = (500.0..1000.0_f64, 500.0..1000.0_f64);
    (projection, axes, pose, focal).prop_map(|(projection, axes, (position, turn), (fx, fy))| {
        let pose = Isometry3::new(Vector3::from(position), Vector3::from(turn)).to_homogeneous();
        let intrinsics = Intrinsics { fx, fy, cx: 320.0, cy: 240.0 };
        Camera::new(intrinsics, projection, axes, PixelCenter::HalfInteger, &pose).unwrap()
    })
}

proptest! {
    #[test]
    fn project_inverts_ray(
        camera in camera(), u in 0.0..640.0_f64, v in 0.0..480.0_f64, t in 0.1..50.0_f64,
    ) {
        let (origin, direction) = camera.ray(u, v).unwrap();
        let point = std::array::from_fn(|d| origin[d] + t * direction[d]);
        let got = camera.project(point).unwrap();
        prop_assert!((got[0] - u).abs() < PIXEL_TOLERANCE, "{} {}", got[0], u);
        prop_assert!((got[1] - v).abs() < PIXEL_TOLERANCE, "{} {}", got[1], v);
    }

    #[test]
    fn directions_have_unit_length(
        camera in camera(), u in 0.0..640.0_f64, v in 0.0..480.0_f64,
    ) {
        let (_, direction) = camera.ray(u, v).unwrap();
        prop_assert!((Vector3::from(direction).norm() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn ray_derivatives_match_central_differences(
        camera in camera(), u in 0.0..640.0_f64, v in 0.0..480.0_f64,
    ) {
        let [du, dv] = seed([u, v]);
        let (origin, direction) = camera.ray(du, dv).unwrap();
        let h = 1e-3;
        for (axis, [a, b]) in [[h, 0.0], [0.0, h]].into_iter().enumerate() {
            let (from, toward) = camera.ray(u - a, v - b).unwrap();
            let (from2, toward2) = camera.ray(u + a, v + b).unwrap();
            for d in 0..3 {
                for (got, want) in [
                    (origin[d].eps[axis], (from2[d] - from[d]) / (2.0 * h)),
                    (direction[d].eps[axis], (toward2[d] - toward[d]) / (2.0 * h)),
                ] {
                    prop_assert!((got - want).abs() < DIFFERENCE_TOLERANCE, "{} {}", got, want);
                }
            }
        }
    }

    /// Chain rule through both: the derivative of `project(ray(u, v))` is the identity.
    #[test]
    fn round_trip_has_unit_jacobian(
        camera in camera(), u in 0.0..640.0_f64, v in 0.0..480.0_f64,
    ) {
        let [du, dv] = seed([u, v]);
        let (origin, direction) = camera.ray(du, dv).unwrap();
        let t = Dual::from_f64(3.0);
        let got = camera.project(std::array::from_fn(|d| origin[d] + t * direction[d])).unwrap();
        for c in 0..2 {
            for d in 0..2 {
                let identity = if c == d { 1.0 } else { 0.0 };
                prop_assert!((got[c].eps[d] - identity).abs() < 1e-9, "{:?}", got);
            }
        }
    }

    /// The conventions differ by half a turn about x.
    #[test]
    fn the_same_pose_in_both_conventions(
        camera in camera(), u in 0.0..640.0_f64, v in 0.0..480.0_f64,
    ) {
        let flip = Matrix4::from_diagonal(&[1.0, -1.0, -1.0, 1.0].into());
        let other_axes = if camera.axes() == Axes::OpenGl { Axes::OpenCv } else { Axes::OpenGl };
        let pose = camera.camera_to_world() * flip;
        let (lens, projection) = (camera.intrinsics(), camera.projection());
        let other = Camera::new(lens, projection, other_axes, PixelCenter::HalfInteger, &pose);
        let (a, b) = (camera.ray(u, v).unwrap(), other.unwrap().ray(u, v).unwrap());
        for d in 0..3 {
            prop_assert!((a.0[d] - b.0[d]).abs() < 1e-12 && (a.1[d] - b.1[d]).abs() < 1e-12);
        }
    }
}

#[test]
fn open_gl_looks_along_minus_z_with_y_up() {
    let camera = at_origin(Projection::Pinhole(Distortion::default()), Axes::OpenGl);
    assert_eq!(camera.ray(32.0, 24.0).unwrap(), ([0.0; 3], [0.0, 0.0, -1.0]));
    // One focal length right of and above the centre.
    let (_, d) = camera.ray(132.0, -96.0).unwrap();
    let third = 1.0 / 3.0_f64.sqrt();
    assert!(d.into_iter().zip([third, third, -third]).all(|(a, b)| (a - b).abs() < 1e-15), "{d:?}");
}

#[test]
fn open_cv_looks_along_z_with_y_down() {
    let camera = at_origin(Projection::Pinhole(Distortion::default()), Axes::OpenCv);
    assert_eq!(camera.ray(32.0, 24.0).unwrap(), ([0.0; 3], [0.0, 0.0, 1.0]));
    let (_, d) = camera.ray(132.0, -96.0).unwrap();
    let third = 1.0 / 3.0_f64.sqrt();
    assert!(d.into_iter().zip([third, -third, third]).all(|(a, b)| (a - b).abs() < 1e-15), "{d:?}");
}

#[test]
fn orthographic_rays_are_parallel() {
    let camera = at_origin(Projection::Orthographic, Axes::OpenGl);
    let (origin, direction) = camera.ray(132.0, 144.0).unwrap();
    assert_eq!((origin, direction), ([1.0, -1.0, 0.0], [0.0, 0.0, -1.0]));
    // Depth does not matter, not even its sign.
    assert_eq!(camera.project([1.0, -1.0, 7.0]).unwrap(), [132.0, 144.0]);
}

#[test]
fn first_pixel_center_by_convention() {
    let centers = [PixelCenter::HalfInteger, PixelCenter::Integer].map(|convention| {
        let (lens, ideal) = (plain_lens(), Projection::Pinhole(Distortion::default()));
        let pose = Matrix4::identity();
        let camera = Camera::new(lens, ideal, Axes::OpenCv, convention, &pose).unwrap();
        let [u, v] = camera.pixel_center(3, 0);
        let (_, direction) = camera.ray(u, v).unwrap();
        let ray = camera.pixel_ray(3, 0, 0.5, 9.0).unwrap();
        assert_eq!(ray.direction(), direction.map(|v| v as f32));
        [u, v]
    });
    assert_eq!(centers, [[3.5, 0.5], [3.0, 0.0]]);
}

#[test]
fn points_behind_and_positions_beyond_the_lens_are_typed_errors() {
    let barrel = Distortion { k1: -0.5, ..Distortion::default() };
    let camera = at_origin(Projection::Pinhole(barrel), Axes::OpenCv);
    assert_eq!(camera.project([0.0, 0.0, -2.0]), Err(Error::BehindCamera { depth: -2.0 }));
    assert_eq!(camera.ray(132.0, 24.0), Err(Error::Undistortable { u: 132.0, v: 24.0 }));
    assert!(matches!(camera.ray(f64::NAN, 0.0), Err(Error::Parameter { .. })));
}

#[test]
fn poses_must_be_rigid() {
    let with = |change: &dyn Fn(&mut Matrix4<f64>)| {
        let mut pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.9))
            .to_homogeneous();
        change(&mut pose);
        let ideal = Projection::Pinhole(Distortion::default());
        Camera::new(plain_lens(), ideal, Axes::OpenGl, PixelCenter::HalfInteger, &pose)
    };
    // Six digits of a text file are accepted and made orthonormal.
    let rounded = with(&|m| m.apply(|v| *v = (*v * 1e5).round() / 1e5)).unwrap();
    let r = rounded.camera_to_world().fixed_view::<3, 3>(0, 0).into_owned();
    assert!((r.transpose() * r - Matrix3::identity()).amax() < 1e-14);

    let scaled = with(&|m| m.fixed_view_mut::<3, 3>(0, 0).scale_mut(1.01));
    assert!(
        matches!(scaled, Err(Error::NotRigid { deviation }) if (deviation - 0.0201).abs() < 1e-9)
    );
    assert!(matches!(with(&|m| m[(3, 0)] = 0.5), Err(Error::NotRigid { .. })));
    assert!(matches!(with(&|m| m[(1, 3)] = f64::NAN), Err(Error::NotRigid { .. })));
    let mirrored = with(&|m| m.fixed_view_mut::<3, 1>(0, 0).neg_mut());
    assert_eq!(mirrored, Err(Error::NotRigid { deviation: f64::INFINITY }));
}

#[test]
fn bad_intrinsics_are_typed_errors() {
    for (fx, cx, k1) in
        [(0.0, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (9.0, f64::INFINITY, 0.0), (9.0, 1.0, f64::NAN)]
    {
        let lens = Intrinsics { fx, fy: 9.0, cx, cy: 1.0 };
        let projection = Projection::Pinhole(Distortion { k1, ..Distortion::default() });
        let pose = Matrix4::identity();
        let camera = Camera::new(lens, projection, Axes::OpenCv, PixelCenter::Integer, &pose);
        assert!(matches!(camera, Err(Error::Parameter { .. })));
    }
}
