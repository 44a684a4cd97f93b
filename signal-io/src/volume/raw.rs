//! Bare numbers beside a JSON file that describes them.
//!
//! ```json
//! { "file": "head.raw", "shape": [91, 109, 91], "dtype": "u8", "endian": "little", "spacing": [2, 2, 2] }
//! ```

use std::io::Write;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::affine::{self, Affine};
use super::nifti::bad_place;
use super::numbers::{self, Coding, Order};
use super::read::read_bounded;
use super::{LengthUnit, Scaling, VolumeFormat, VolumeReadOptions, VoxelType};
use crate::budget::{Budget, zeros};
use crate::error::Fault;
use crate::{Error, Result, Volume, atomic};

/// What is checked before the file's name is added.
type Checked<T> = std::result::Result<T, Fault>;

/// The file's fields; unknown ones are refused, as they would be misspelled ones.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// The file of the numbers, in the same folder.
    file: String,
    /// Voxels along x, y and z.
    shape: [u64; 3],
    #[serde(default = "one")]
    channels: u64,
    /// The name of a [`VoxelType`].
    dtype: String,
    #[serde(default)]
    endian: Endian,
    /// Whether channels come plane after plane or side by side.
    #[serde(default)]
    order: Channels,
    /// Bytes before the first number.
    #[serde(default)]
    offset_bytes: u64,
    /// Voxel size in millimetres; 1 where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spacing: Option<[f64; 3]>,
    /// Rows of the map from voxel indices to millimetres; takes the place of the spacing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    affine: Option<Affine>,
    /// A value is `slope * number + intercept`.
    #[serde(default = "unscaled")]
    slope: f64,
    #[serde(default)]
    intercept: f64,
    #[serde(default)]
    description: String,
}

fn one() -> u64 {
    1
}

fn unscaled() -> f64 {
    1.0
}

#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Endian {
    #[default]
    Little,
    Big,
}

#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Channels {
    #[default]
    Planar,
    Interleaved,
}

/// A description alone, without the folder it stands in.
pub(super) fn refuse<T>() -> Checked<T> {
    let what = "its numbers in another file (read it by its path)";
    Err(Fault::Feature(what.to_owned()))
}

/// The file of the numbers that belong to a new description.
pub(super) fn numbers_path(path: &Path) -> PathBuf {
    path.with_extension("raw")
}

pub(super) fn read(path: &Path, json: &[u8], options: &VolumeReadOptions) -> Result<Volume> {
    let name = VolumeFormat::Raw.name();
    let at = |fault: Fault| fault.at(path, name, "read");
    let description: Description = serde_json::from_slice(json)
        .map_err(|e| at(Fault::corrupt(format!("as a description of raw numbers: {e}"))))?;
    // A description from elsewhere must not reach files of other folders.
    let mut parts = Path::new(&description.file).components();
    let (Some(Component::Normal(file)), None) = (parts.next(), parts.next()) else {
        let reason = format!("{:?} is no file name in its folder", description.file);
        return Err(at(Fault::Corrupt(reason)));
    };
    let beside = path.with_file_name(file);
    let order = check(&description, options).map_err(at)?;
    let bytes = read_bounded(&beside, options.limit_bytes)?;
    decode(&description, order, &bytes).map_err(|fault| fault.at(&beside, name, "read"))
}

/// What can be known without the numbers: their type, their order, their count.
fn check(d: &Description, options: &VolumeReadOptions) -> Checked<(VoxelType, Order, usize)> {
    let sample = VoxelType::from_name(&d.dtype)
        .ok_or_else(|| Fault::Feature(format!("numbers of type {:?}", d.dtype)))?;
    let [x, y, z] = d.shape;
    let budget = Budget::new(options.limit_bytes);
    let count = budget.samples(x.saturating_mul(y), z, d.channels)?;
    if !(Scaling { slope: d.slope, intercept: d.intercept }).is_valid() {
        return Err(Fault::corrupt(format!("a scaling by {} and {}", d.slope, d.intercept)));
    }
    let (shape, channels) = (d.shape.map(|n| n as usize), d.channels as usize);
    let order = match d.order {
        Channels::Planar => Order::planar(shape, channels),
        Channels::Interleaved => Order::interleaved(shape, channels),
    };
    Ok((sample, order, count))
}

fn decode(
    d: &Description,
    (sample, order, count): (VoxelType, Order, usize),
    bytes: &[u8],
) -> Checked<Volume> {
    let offset = usize::try_from(d.offset_bytes).unwrap_or(usize::MAX);
    let mut body = bytes.get(offset..).ok_or_else(Fault::cut_short)?;
    if body.len() as u64 != (count as u64).saturating_mul(sample.bytes() as u64) {
        let n = body.len();
        return Err(Fault::corrupt(format!("{count} numbers of type {sample} in {n} bytes")));
    }
    let mut data = zeros(count)?;
    let scaling = Scaling { slope: d.slope, intercept: d.intercept };
    let coding = Coding { sample, little: d.endian == Endian::Little, scaling };
    numbers::read(&mut body, coding, &order, &mut data)?;
    let volume = Volume::new(d.shape.map(|n| n as usize), d.channels as usize, data)?;
    let mut volume = match (d.affine, d.spacing) {
        (Some(affine), _) => volume.with_affine(affine),
        (None, Some(spacing)) => volume.with_voxel_size(spacing),
        (None, None) => Ok(volume),
    }
    .map_err(bad_place)?;
    (volume.voxel_type, volume.scaling) = (sample, scaling);
    if (d.affine, d.spacing) == (None, None) {
        volume.length_unit = LengthUnit::Unknown;
    }
    volume.description = d.description.clone();
    Ok(volume)
}

/// Writes both files, the numbers first: a description without them would be worse.
pub(super) fn write(path: &Path, volume: &Volume, coding: Coding, force: bool) -> Result<usize> {
    let name = VolumeFormat::Raw.name();
    let beside = numbers_path(path);
    let diagonal = affine::diagonal(volume.voxel_size());
    let plain = volume.affine == diagonal;
    let description = Description {
        file: beside.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        shape: volume.shape().map(|n| n as u64),
        channels: volume.channels() as u64,
        dtype: coding.sample.name().to_owned(),
        endian: Endian::Little,
        order: Channels::Planar,
        offset_bytes: 0,
        spacing: plain.then(|| volume.voxel_size()),
        affine: (!plain).then_some(volume.affine),
        slope: coding.scaling.slope,
        intercept: coding.scaling.intercept,
        description: volume.description.clone(),
    };
    let mut json = serde_json::to_vec_pretty(&description).map_err(|e| Error::Encode {
        path: path.to_path_buf(),
        format: name,
        reason: e.to_string(),
    })?;
    json.push(b'\n');
    let order = Order::planar(volume.shape(), volume.channels());
    let clipped = atomic::replace(&beside, force, |w| {
        numbers::write(volume.as_planar(), coding, &order, w)
            .map_err(|fault| fault.at(&beside, name, "write"))
    })?;
    atomic::write_atomic(path, force, |w| w.write_all(&json))?;
    Ok(clipped)
}
