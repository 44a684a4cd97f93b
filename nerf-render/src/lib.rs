//! Cameras and rays for radiance fields.
//!
//! A [`Camera`] relates image positions to rays in the world, with every convention in its type:
//! [`Projection`], lens [`Distortion`], [`Axes`] and [`PixelCenter`]. It is generic over
//! [`inr_core::Scalar`], so that dual numbers give the exact change of a ray per pixel. A [`Ray`] is
//! what one pixel sees, clipped to the box that holds the scene.
//!
//! Image positions `(u, v)` are in pixels, u to the right and v downwards. Lengths in the world are
//! in the units of the camera poses. Camera arithmetic is in `f64`; rays are in `f32`, as the fields
//! they sample.
//!
//! ```
//! use inr_core::seed;
//! use nalgebra::Matrix4;
//! use nerf_render::{Axes, Camera, Distortion, Intrinsics, PixelCenter, Projection};
//!
//! let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0 };
//! let lens = Projection::Pinhole(Distortion { k1: -0.1, ..Distortion::default() });
//! let pose = Matrix4::identity();
//! let camera = Camera::new(intrinsics, lens, Axes::OpenGl, PixelCenter::HalfInteger, &pose)?;
//!
//! // What pixel (100, 50) sees of the box [-1, 1] x [-1, 1] x [-4, -2].
//! let ray = camera.pixel_ray(100, 50, 0.1, 100.0)?;
//! let inside = ray.clip_box([-1.0, -1.0, -4.0], [1.0, 1.0, -2.0]).expect("the ray meets the box");
//! assert!((inside.at(inside.near())[2] + 2.0).abs() < 1e-5);
//!
//! // How the ray's direction turns per pixel at the image centre: one over the focal length.
//! let [u, v] = seed([320.0_f64, 240.0]);
//! let (_, direction) = camera.ray(u, v)?;
//! assert!((direction[0].eps[0] - 1.0 / 500.0).abs() < 1e-12);
//! # Ok::<(), nerf_render::Error>(())
//! ```
//!
//! # What is left out
//! Radiance fields themselves, sampling along rays and compositing are not here yet. Reading camera
//! files is not this crate's work: poses arrive as camera-to-world matrices.

mod camera;
mod distortion;
mod error;
mod ray;

pub use camera::{Axes, Camera, Intrinsics, PixelCenter, Projection};
pub use distortion::Distortion;
pub use error::{Error, Result};
pub use ray::Ray;
