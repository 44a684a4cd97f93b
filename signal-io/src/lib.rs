//! Reading and writing natural signals in floating point.
//!
//! A picture in any of the usual formats becomes an [`Image`]: planes of `f32` with names, and with
//! what is needed to write it back as it was (number type, encoding, colour profile); sound becomes
//! an [`Audio`], a scan a [`Volume`] with its place in the world, a film a [`Video`], pictures from a grid of
//! cameras a [`LightField`], a glTF scene a [`Mesh`]. Nothing a file says is believed before it is checked, and a
//! target is replaced completely or not at all.
//!
//! ```
//! use signal_io::{Image, ReadOptions, WriteOptions, check_target, read_image, write_image};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("ramp.png");
//! check_target(&path, false)?; // Before a long job: extension, folder, existing file.
//!
//! let image = Image::new(3, 1, &["Y"], vec![0.0, 0.5, 1.25])?;
//! let report = write_image(&path, &image, &WriteOptions::default())?;
//! assert_eq!((report.clipped, report.samples), (1, 3)); // 1.25 became 1.
//!
//! let back = read_image(&path, &ReadOptions::default())?;
//! let samples = back.to_samples::<1>()?; // The type the blending crates work with.
//! samples.check_finite()?;
//! assert_eq!(samples.plane(0)[2], 1.0);
//! assert!((samples.plane(0)[1] - 0.5).abs() < 1e-5); // 16 bits: the default for floats in PNG.
//! # Ok(())
//! # }
//! ```
//!
//! # Formats
//! | format | extensions | read as | written as | alpha | ICC | [`Transfer`] |
//! |---|---|---|---|---|---|---|
//! | PNG | png | 8, 16 bit; palettes and 1, 2, 4 bit expand to 8 | 8, 16 bit | yes | yes | sRGB |
//! | JPEG | jpg, jpeg | 8 bit; CMYK becomes RGB | 8 bit, quality 95 | no | yes | sRGB |
//! | TIFF | tif, tiff | 1 to 16 bit, half, float, double | 8, 16 bit, float | yes | yes | sRGB; floats unspecified |
//! | WebP | webp | 8 bit; grey is RGB | 8 bit, lossless | yes | yes | sRGB |
//! | GIF | gif | 8 bit, first frame | not | yes | no | sRGB |
//! | PNM | pbm, pgm, ppm, pnm, pam | up to 16 bit | 8, 16 bit | pam | no | sRGB |
//! | PFM | pfm | float | float | no | no | linear |
//! | Radiance | hdr | float | 8 bits and an exponent | no | no | linear |
//! | OpenEXR | exr | half, float, uint; any channels | half, float; any channels | yes | no | linear |
//! | npy | npy | bool, u1, u2, f2, f4, f8; (H, W) or (H, W, C), both orders | u1, u2, f2, f4 | 4 channels | no | unspecified |
//!
//! *Numbers.* Integers are scaled to [0, 1]; floats stay as they are, be they 443, negative or NaN.
//! Writing rounds to nearest and clamps to what the number type has; [`WriteReport::clipped`] counts
//! what that changed. By default the number type is the image's own where the format has it,
//! otherwise the widest one: 16 bits for floats in PNG, floats for integers in EXR. Asking for what
//! a format has not is [`Error::CannotHold`].
//!
//! *Encoding.* Display formats store sRGB-encoded values, EXR, HDR and PFM light. Writing from one
//! kind to the other converts the colour channels with the sRGB curve; npy and float TIFF say nothing
//! about their numbers, so these are neither converted on the way in nor on the way out
//! ([`Transfer::Unspecified`]); [`ReadOptions::transfer`] tells what they are where that is known.
//!
//! *Channels.* `Y` or `R G B`, with `A` for alpha, in display formats; the names of the file in EXR
//! (layers as `diffuse.R`); `C0 C1 ...` where there are none. Arrays of 3 or 4 channels count as
//! `R G B` and `R G B A`. Grey is written to HDR and ppm as three equal channels.
//!
//! *Orientation.* That of EXIF (JPEG, PNG, WebP), TIFF and Radiance is applied when reading.
//!
//! *Larger than memory.* [`RowReader`] and [`RowWriter`] take PNG, TIFF, npy and PFM some rows at a time, with the
//! same values, conversions and reports.
//!
//! # Sound
//! An [`Audio`] has one plane of `f32` per channel and a sampling rate; 1 is full scale.
//!
//! | format | extensions | read as | written as | feature |
//! |---|---|---|---|---|
//! | WAV | wav, wave | 8, 16, 24, 32 bit, float, double; 1 to 8 channels | the same but doubles | |
//! | FLAC | flac | up to 32 bit; checksums are verified | not | `compressed-audio` |
//! | Ogg Vorbis | ogg, oga | float | not | `compressed-audio` |
//! | MP3 | mp3 | float; layer III | not | `compressed-audio` |
//!
//! Integers of `b` bits are scaled by `2^(1 - b)`, floats stay as they are, be they beyond 1 or NaN.
//! Writing rounds to nearest without dither; [`AudioReport::clipped`] counts what did not fit.
//! WAV files whose length was not known while writing are read to their end; other files that are
//! cut short are errors, except for Ogg and MP3, which give what is there. Delay and padding of
//! encoders are cut off where the file states them. Left out are files of more than 4 GiB (RF64),
//! ADPCM and other encodings inside WAV, chained Ogg streams, tags, cue points and loops.
//!
//! Sound is resampled ([`Audio::resampled`]), measured ([`Audio::peak`], [`Audio::mean`],
//! [`Audio::loudness`], [`Audio::click_energy`]) and taken apart into spectra over time ([`Stft`]).
//!
//! # Volumes
//! ```
//! use signal_io::{Volume, VolumeReadOptions, VolumeWriteOptions, VoxelType, read_volume, write_volume};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("scan.nii.gz");
//! let mut scan = Volume::new([2, 2, 1], 1, vec![0.0, 80.0, 160.0, 255.0])?.with_voxel_size([1.0, 1.0, 2.5])?;
//! scan.voxel_type = VoxelType::U8;
//! write_volume(&path, &scan, &VolumeWriteOptions::default())?;
//!
//! let back = read_volume(&path, &VolumeReadOptions::default())?;
//! assert_eq!(back.range(), Some([0.0, 255.0])); // Not scaled to [0, 1].
//! assert_eq!(back.domain().pitch(), [1.0, 1.0, 2.5]); // Millimetres.
//! let samples = back.to_samples::<1>()?;
//! assert_eq!(Volume::from_samples(&samples, &back)?, back);
//! # Ok(())
//! # }
//! ```
//!
//! | format | extensions | numbers | place | scaling | channels |
//! |---|---|---|---|---|---|
//! | NIfTI-1, NIfTI-2 | nii, nii.gz | u8 i8 u16 i16 u32 i32 f32 f64, RGB(A) read | affine, else rotation, else sizes; m, mm, um | yes | axes 4 to 7 |
//! | NRRD, attached | nrrd | the same; raw, gzip, ascii; written as gzip | directions and origin, else spacings; units | no | one axis |
//! | npy | npy | the same, both orders | no | no | (Z, Y, X, C) |
//! | TIFF stack | tif, tiff | the same; one page per z | voxel size, in ImageJ's description | no | pixels or ImageJ's pages |
//! | raw | json beside the numbers | the same, both byte orders | sizes or affine | yes | planes or side by side |
//!
//! Every format is read in both byte orders and written in little-endian.
//!
//! *Numbers.* A file's scaling (`slope * number + intercept`) is applied; nothing is normalised. Writing uses
//! the number type and the scaling of the file the volume came from, so that values nobody changed become the
//! same numbers again: up to 24 bits, and where the scaled values are different `f32`.
//! [`VolumeReport::clipped`] counts what left the type's range.
//!
//! *Place.* The affine takes voxel indices to millimetres, and axes of the world point right, anterior,
//! superior where the file knows. [`Placement`] relates two volumes: a shift, or anything else, for which
//! [`Volume::resampled_like`] puts one onto the other's lattice. What NIfTI and NRRD say besides (intent,
//! extensions, key and value pairs) returns to a file of the same format.
//!
//! *Raw numbers* are described by a JSON file, which is what one opens:
//! ```json
//! { "file": "head.raw", "shape": [91, 109, 91], "dtype": "i16", "endian": "little", "spacing": [2, 2, 2] }
//! ```
//! `file` stands in the same folder; `shape` is x, y, z with x fastest. Optional: `channels` (1), `order`
//! (`"planar"` or `"interleaved"`), `endian` (`"little"`), `offset_bytes` (0), `spacing` in millimetres (1) or
//! `affine` (three rows of four), `slope` (1), `intercept` (0), `description`. Writing makes `head.raw` beside
//! `head.json`.
//!
//! # Meshes
//! [`read_mesh`] collects the triangles of a glTF scene (`.glb`, `.gltf`) with the transforms of its nodes;
//! [`Mesh::to_region`] makes a closed one a region. Colours, skins and animations are not read; Draco and sparse
//! accessors are [`Error::UnsupportedFeature`].
//!
//! # What is left out
//! * Of volumes: numbers in a separate file (.hdr and .img, .nhdr), complex and 64-bit integer numbers; time
//!   has no lattice of its own, a series is channels. Sheared axes count as orthogonal in [`Volume::domain`].
//! * Profiles are carried, not interpreted: the sRGB curve stands in for the curve of any profile, and
//!   the primaries of EXR files and the gamma of PNG files are ignored.
//! * Alpha stays as stored. EXR multiplies it into the colours by custom, PNG does not; going from
//!   one to the other changes nothing in the numbers.
//! * As a picture, only the first frame of animations (as a [`Video`] all), the first page of TIFF, the
//!   largest resolution and the layers of the first one's size of EXR are read; the data window's
//!   offset is dropped. Deep and subsampled EXR, CMYK,
//!   palette and YCbCr TIFF are [`Error::UnsupportedFeature`].
//! * Texts, dates and other metadata are not carried.
//!
//! # Safety against files
//! [`ReadOptions::limit_bytes`] bounds the decoded picture; a header that promises more than the
//! bytes of the file can hold is [`Error::Corrupt`] before memory is taken (not for WebP, whose
//! pictures of one colour need no bytes at all; its format ends at 16384 pixels a side). Files that
//! are cut short are errors, except for bytes after the last pixel: the end chunk of PNG and GIF.
//! Altered pixels go unnoticed where a format has no checksum; PNG has.

mod atomic;
mod audio;
mod budget;
mod codec;
mod error;
mod format;
mod image;
mod light_field;
mod mesh;
mod plan;
mod read;
mod rows;
mod sniff;
mod strip;
mod transfer;
mod video;
mod volume;
mod write;

pub use crate::atomic::write_atomic;
pub use crate::audio::{
    Audio, AudioFormat, AudioReport, AudioSample, AudioWriteOptions, Complex32, Stft,
    check_audio_target, decode_audio, read_audio, write_audio,
};
pub use crate::error::{Error, Result};
pub use crate::format::{Format, SampleType};
pub use crate::image::Image;
pub use crate::light_field::{
    LightField, LightFieldFormat, LightFieldReadOptions, LightFieldReport, LightFieldWriteOptions,
    check_light_field_target, decode_light_field, read_light_field, write_light_field,
};
pub use crate::mesh::{Mesh, decode_mesh, read_mesh};
pub use crate::read::{ReadOptions, decode_image, read_image};
pub use crate::rows::{PictureInfo, RowReader, RowWriter};
pub use crate::sniff::{is_animation, is_tiff_stack, is_view_grid};
pub use crate::transfer::{Transfer, linear_to_srgb, srgb_to_linear};
pub use crate::video::{
    Timing, Video, VideoFormat, VideoReport, VideoWriteOptions, check_video_target, decode_video,
    read_video, write_video,
};
pub use crate::volume::{
    Affine, LengthUnit, Placement, Scaling, Volume, VolumeFormat, VolumeReadOptions, VolumeReport,
    VolumeWriteOptions, VoxelType, check_volume_target, decode_volume, read_volume, write_volume,
};
pub use crate::write::{WriteOptions, WriteReport, check_target, check_write, write_image};
