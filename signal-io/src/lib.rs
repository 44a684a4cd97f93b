//! Reading and writing natural signals in floating point.

mod atomic;
mod budget;
mod codec;
mod error;
mod format;
mod image;
mod plan;
mod read;
mod transfer;
mod write;

pub use crate::atomic::write_atomic;
pub use crate::error::{Error, Result};
pub use crate::format::{Format, SampleType};
pub use crate::image::Image;
pub use crate::read::{ReadOptions, decode_image, read_image};
pub use crate::transfer::{Transfer, linear_to_srgb, srgb_to_linear};
pub use crate::write::{WriteOptions, WriteReport, check_target, check_write, write_image};
