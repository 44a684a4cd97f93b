//! Files in and out: every message names the file and the next step.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use serde::Serialize;
use signal_io::{Error, Format, Image, ReadOptions, SampleType, WriteOptions, WriteReport};

/// Reads a picture whose values are all finite.
pub fn read(path: &Path) -> Result<Image> {
    let image = read_any(path)?;
    check_finite(path, &image)?;
    Ok(image)
}

/// Reads a picture, whatever its values.
pub fn read_any(path: &Path) -> Result<Image> {
    signal_io::read_image(path, &ReadOptions::default()).map_err(in_our_words)
}

fn check_finite(path: &Path, image: &Image) -> Result<()> {
    let Some(k) = image.as_planar().iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let (width, n) = (image.width(), image.pixel_count());
    bail!(
        "{} holds {} at pixel {},{} of channel {}; replace such values first",
        path.display(),
        image.as_planar()[k],
        k % n % width,
        k % n / width,
        image.channels()[k / n],
    )
}

/// Whether a picture like this can be written to `path`: call it before the work.
pub fn check_write(path: &Path, image: &Image, options: &WriteOptions) -> Result<()> {
    signal_io::check_write(path, image, options).map_err(in_our_words)
}

/// Extension, folder and existing file of a picture to come.
pub fn check_picture(path: &Path, force: bool) -> Result<()> {
    signal_io::check_target(path, force).map_err(in_our_words)
}

/// Folder and existing file of a text to come.
pub fn check_text(path: &Path, force: bool) -> Result<()> {
    if path.is_dir() {
        bail!("{} is a folder; name a file in it", path.display());
    }
    if path.exists() && !force {
        bail!("{} exists; choose another name or add --force", path.display());
    }
    match path.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) if !folder.is_dir() => bail!(
            "cannot write {}: there is no folder {}; create it first",
            path.display(),
            folder.display()
        ),
        _ => Ok(()),
    }
}

/// Reads any file that fits the memory.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    match fs::read(path) {
        Ok(bytes) => Ok(bytes),
        Err(e) if e.kind() == ErrorKind::NotFound => {
            bail!("{} does not exist; check the spelling of the path", path.display())
        }
        Err(e) => Err(e)
            .with_context(|| format!("cannot read {}; check path and permissions", path.display())),
    }
}

/// Makes a folder with those above it.
pub fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path)
        .with_context(|| format!("cannot make the folder {}; choose another -o", path.display()))
}

/// Writes a picture completely or not at all.
pub fn write(path: &Path, image: &Image, options: &WriteOptions) -> Result<WriteReport> {
    signal_io::write_image(path, image, options).map_err(in_our_words)
}

/// Writes a text completely or not at all.
pub fn write_text(path: &Path, text: &str, force: bool) -> Result<()> {
    write_bytes(path, text.as_bytes(), force)
}

/// Writes any content completely or not at all.
pub fn write_bytes(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    signal_io::write_atomic(path, force, |w| w.write_all(bytes)).map_err(in_our_words)
}

/// Pretty JSON with a final newline; numbers that are not finite become null.
pub fn to_json(value: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(value).context("cannot format the report as JSON")? + "\n")
}

/// The number type a picture like this gets in a file of this name.
pub fn stored_type(path: &Path, image: &Image, wanted: Option<SampleType>) -> SampleType {
    let eight_bits =
        matches!(Format::from_extension(path), Some(Format::Jpeg | Format::WebP | Format::Gif));
    let integers_only = matches!(Format::from_extension(path), Some(Format::Png | Format::Pnm));
    match wanted {
        Some(sample) => sample,
        None if eight_bits => SampleType::U8,
        None if integers_only && image.sample.is_float() => SampleType::U16,
        None => image.sample,
    }
}

/// The library speaks of functions and options; here they are flags.
pub fn in_our_words(error: Error) -> anyhow::Error {
    match error {
        Error::Exists { path } => {
            anyhow!("{} exists; choose another name or add --force", path.display())
        }
        Error::CannotHold { path, format, what, instead } => {
            let next = match () {
                () if what.contains("alpha") => "write .png, .tif or .exr",
                () if what.contains("colour channel") => "write .exr or .npy, or add --gray",
                () if what.contains("samples") => "choose another --depth or extension",
                () => &instead,
            };
            anyhow!("{}: {format} cannot hold {what}; {next}", path.display())
        }
        Error::TooLarge { path, needed, limit } => anyhow!(
            "{} needs at least {needed} bytes and the limit is {limit}; use a smaller file",
            path.display()
        ),
        Error::NotByRows { path, what, action: "written" } => {
            anyhow!("{}: {what}; with --max-memory write .png, .tif, .npy or .pfm", path.display())
        }
        Error::NotByRows { path, what, .. } => anyhow!(
            "{}: {what}; raise --max-memory, or convert it to PNG without interlacing, TIFF, npy in C \
             order or PFM, which are read by rows",
            path.display()
        ),
        other => other.into(),
    }
}
