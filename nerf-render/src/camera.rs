use inr_core::Scalar;
use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion};

use crate::{Distortion, Error, Ray, Result};

/// How far a camera-to-world matrix may be from a rigid motion: poses in text files keep 5 to 7
/// digits.
const RIGID_TOLERANCE: f64 = 1e-4;

/// How the world's points fall on the image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// All rays meet in the camera's origin: `u = fx x / z + cx`, after the lens distortion.
    Pinhole(Distortion),
    /// All rays are parallel to the viewing direction: `u = fx x + cx`.
    Orthographic,
}

/// Scale and centre of the image plane; u counts columns to the right, v rows downwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length in pixel columns; pixel columns per world unit for an orthographic camera.
    pub fx: f64,
    /// Focal length in pixel rows; pixel rows per world unit for an orthographic camera.
    pub fy: f64,
    /// Column coordinate of the optical axis, in pixels.
    pub cx: f64,
    /// Row coordinate of the optical axis, in pixels.
    pub cy: f64,
}

/// Which way a camera's own coordinate axes point; x points right in both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axes {
    /// y up, looking along -z: OpenGL, Blender, and the `transforms.json` of NeRF data sets.
    OpenGl,
    /// y down, looking along +z: OpenCV, COLMAP.
    OpenCv,
}

impl Axes {
    /// Signs that turn this convention's y and z into OpenCV's, and back.
    fn sign_yz(self) -> f64 {
        match self {
            Axes::OpenGl => -1.0,
            Axes::OpenCv => 1.0,
        }
    }
}

/// Which image coordinates the centre of the first pixel has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelCenter {
    /// `(0.5, 0.5)`: the image covers `[0, width]`. OpenGL, COLMAP.
    HalfInteger,
    /// `(0, 0)`: the image covers `[-0.5, width - 0.5]`. OpenCV's calibration.
    Integer,
}

/// A camera: image coordinates `(u, v)` in pixels against rays in the world.
///
/// `u` grows to the right and `v` downwards, whatever the axes; the world is in the units of the
/// pose's translation.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    intrinsics: Intrinsics,
    projection: Projection,
    axes: Axes,
    pixel_center: PixelCenter,
    /// Camera to world, orthonormal to f64 rounding.
    rotation: Matrix3<f64>,
    /// The camera's origin in the world.
    translation: [f64; 3],
}

impl Camera {
    /// A camera at a pose given as the matrix that takes camera coordinates (in the convention
    /// `axes`) to world coordinates.
    ///
    /// A rotation off by up to 1e-4 (poses rounded to a few digits) is made orthonormal.
    ///
    /// # Errors
    /// [`Error::Parameter`] unless `fx` and `fy` are positive and everything is finite;
    /// [`Error::NotRigid`].
    pub fn new(
        intrinsics: Intrinsics,
        projection: Projection,
        axes: Axes,
        pixel_center: PixelCenter,
        camera_to_world: &Matrix4<f64>,
    ) -> Result<Self> {
        check_lens(intrinsics, projection)?;
        let rotation = rigid_rotation(camera_to_world)?;
        let translation = [0, 1, 2].map(|row| camera_to_world[(row, 3)]);
        Ok(Self { intrinsics, projection, axes, pixel_center, rotation, translation })
    }

    /// Scale and centre of the image plane.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// How points fall on the image plane.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// The convention of the camera's own axes.
    pub fn axes(&self) -> Axes {
        self.axes
    }

    /// The matrix that takes camera coordinates, in the convention [`axes`](Self::axes), to the
    /// world.
    pub fn camera_to_world(&self) -> Matrix4<f64> {
        let mut matrix = self.rotation.to_homogeneous();
        for row in 0..3 {
            matrix[(row, 3)] = self.translation[row];
        }
        matrix
    }

    /// Image coordinates `(u, v)` of the centre of a pixel.
    pub fn pixel_center(&self, column: usize, row: usize) -> [f64; 2] {
        let offset = match self.pixel_center {
            PixelCenter::HalfInteger => 0.5,
            PixelCenter::Integer => 0.0,
        };
        [column as f64 + offset, row as f64 + offset]
    }

    /// Origin and unit direction, in the world, of the ray through the image position `(u, v)`, in
    /// pixels.
    ///
    /// With dual numbers `u` and `v` the result carries the exact derivatives of the ray, also
    /// through the inverse of the lens distortion.
    ///
    /// # Errors
    /// [`Error::Undistortable`]; [`Error::Parameter`] when `u` or `v` is not finite.
    pub fn ray<T: Scalar>(&self, u: T, v: T) -> Result<([T; 3], [T; 3])> {
        for value in [u.re(), v.re()] {
            if !value.is_finite() {
                let (what, rule) = ("the image position", "finite");
                return Err(Error::Parameter { what, rule, value });
            }
        }
        let k = self.intrinsics;
        let on_plane = [
            (u - T::from_f64(k.cx)) / T::from_f64(k.fx),
            (v - T::from_f64(k.cy)) / T::from_f64(k.fy),
        ];
        let (from, toward) = match self.projection {
            Projection::Pinhole(distortion) => {
                let ideal = distortion.undo(on_plane);
                let [x, y] = ideal.ok_or(Error::Undistortable { u: u.re(), v: v.re() })?;
                ([T::zero(); 3], [x, y, T::one()])
            }
            Projection::Orthographic => {
                let [x, y] = on_plane;
                ([x, y, T::zero()], [T::zero(), T::zero(), T::one()])
            }
        };
        let offset = self.rotate_to_world(from);
        let origin = std::array::from_fn(|d| offset[d] + T::from_f64(self.translation[d]));
        let length = toward.iter().map(|v| *v * *v).sum::<T>().sqrt();
        Ok((origin, self.rotate_to_world(toward.map(|v| v / length))))
    }

    /// The ray through the centre of a pixel, between two distances in world units.
    ///
    /// # Errors
    /// [`Error::Undistortable`]; [`Error::Parameter`] unless `0 <= near < far`.
    pub fn pixel_ray(&self, column: usize, row: usize, near: f32, far: f32) -> Result<Ray> {
        let [u, v] = self.pixel_center(column, row);
        let (origin, direction) = self.ray(u, v)?;
        Ray::new(origin.map(|v| v as f32), direction.map(|v| v as f32), near, far)
    }

    /// Image position `(u, v)`, in pixels, of a point of the world: the inverse of
    /// [`ray`](Self::ray) wherever that exists.
    ///
    /// Says nothing about whether the position lies within the picture. A point far outside it can
    /// land inside where the distortion polynomial folds back.
    ///
    /// # Errors
    /// [`Error::BehindCamera`] for a pinhole and a point that is not in front of it.
    pub fn project<T: Scalar>(&self, point: [T; 3]) -> Result<[T; 2]> {
        let offset = std::array::from_fn(|d| point[d] - T::from_f64(self.translation[d]));
        let [x, y, z] = self.rotate_to_camera(offset);
        let [x, y] = match self.projection {
            Projection::Pinhole(distortion) if z.re() > 0.0 => distortion.apply([x / z, y / z]),
            Projection::Pinhole(_) => return Err(Error::BehindCamera { depth: z.re() }),
            Projection::Orthographic => [x, y],
        };
        let k = self.intrinsics;
        Ok([x * T::from_f64(k.fx) + T::from_f64(k.cx), y * T::from_f64(k.fy) + T::from_f64(k.cy)])
    }

    /// From x right, y down, z forward to world axes.
    fn rotate_to_world<T: Scalar>(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        let sign = T::from_f64(self.axes.sign_yz());
        let own = [x, y * sign, z * sign];
        let entry = |row, column| T::from_f64(self.rotation[(row, column)]);
        std::array::from_fn(|row| (0..3).map(|column| entry(row, column) * own[column]).sum())
    }

    /// From world axes to x right, y down, z forward.
    fn rotate_to_camera<T: Scalar>(&self, world: [T; 3]) -> [T; 3] {
        let sign = T::from_f64(self.axes.sign_yz());
        let entry = |row, column| T::from_f64(self.rotation[(row, column)]);
        let own = |column| (0..3).map(|row| entry(row, column) * world[row]).sum::<T>();
        [own(0), own(1) * sign, own(2) * sign]
    }
}

fn check_lens(intrinsics: Intrinsics, projection: Projection) -> Result<()> {
    let Intrinsics { fx, fy, cx, cy } = intrinsics;
    let wrong = |what, rule, value| Err(Error::Parameter { what, rule, value });
    for value in [fx, fy] {
        if !(value > 0.0 && value.is_finite()) {
            return wrong("the focal length", "positive and finite", value);
        }
    }
    for value in [cx, cy] {
        if !value.is_finite() {
            return wrong("the principal point", "finite", value);
        }
    }
    if let Projection::Pinhole(Distortion { k1, k2, p1, p2, k3 }) = projection
        && let Some(value) = [k1, k2, p1, p2, k3].into_iter().find(|v| !v.is_finite())
    {
        return wrong("the distortion coefficient", "finite", value);
    }
    Ok(())
}

/// The rotation of a rigid motion, made orthonormal to f64 rounding.
fn rigid_rotation(motion: &Matrix4<f64>) -> Result<Matrix3<f64>> {
    let rotation: Matrix3<f64> = motion.fixed_view::<3, 3>(0, 0).into();
    let gram = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    let last_row = [0, 1, 2, 3].map(|k| (motion[(3, k)] - f64::from(u8::from(k == 3))).abs());
    let deviation = last_row.into_iter().fold(gram, f64::max);
    let is_motion = motion.iter().all(|v| v.is_finite()) && rotation.determinant() > 0.0;
    if !is_motion || deviation > RIGID_TOLERANCE {
        let deviation = if is_motion { deviation } else { f64::INFINITY };
        return Err(Error::NotRigid { deviation });
    }
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    let mut quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
    quaternion.renormalize();
    Ok(quaternion.to_rotation_matrix().into_inner())
}

#[cfg(test)]
mod tests;
