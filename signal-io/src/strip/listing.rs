//! Which files of a folder are the pictures of a series.

use std::fs;
use std::path::{Path, PathBuf};

use super::natural;
use super::pattern::Pattern;
use crate::{Error, Format, Result};

/// More files than any series has; a folder of more is not listed to its end.
const MAX_FILES: usize = 1 << 20;

/// The names in a folder that `accept` agrees to, in natural order. Names that are not Unicode, and
/// hidden ones, count as other files.
pub(crate) fn names(folder: &Path, accept: impl Fn(&str) -> bool) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| Error::io(folder, "read", e))? {
        let entry = entry.map_err(|e| Error::io(folder, "read", e))?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        if !name.starts_with('.') && accept(&name) {
            names.push(name);
        }
        if names.len() > MAX_FILES {
            let what = format!("more than {MAX_FILES} files");
            let path = folder.to_path_buf();
            return Err(Error::UnsupportedFeature { path, format: "picture sequence", what });
        }
    }
    names.sort_by(|a, b| natural::compare(a, b));
    Ok(names)
}

/// The pictures that a path stands for: those of a folder, or those whose names fit a pattern. They
/// are sorted by the numbers in their names, and there is at least one. `None` for any other path.
pub(crate) fn candidates(path: &Path) -> Option<Result<Vec<PathBuf>>> {
    let (folder, pattern) = place(path)?;
    Some(list(path, &folder, pattern.as_ref()).map(|names| in_folder(&folder, names)))
}

/// The same for a sequence.
///
/// # Errors
/// [`Error::Empty`], and [`Error::MissingFrame`] with a number that is left out, unless the pattern
/// has `*` or `?`: who writes one wants what is there.
pub(crate) fn sequence(path: &Path) -> Option<Result<Vec<PathBuf>>> {
    let (folder, pattern) = place(path)?;
    let gaps_allowed = pattern.as_ref().is_some_and(|p| p.number_count().is_none());
    let complete = |names: Vec<String>| match natural::missing(&names).filter(|_| !gaps_allowed) {
        Some(name) => Err(Error::MissingFrame { path: folder.join(name) }),
        None => Ok(in_folder(&folder, names)),
    };
    Some(list(path, &folder, pattern.as_ref()).and_then(complete))
}

/// The folder and, unless all pictures are meant, the pattern.
fn place(path: &Path) -> Option<(PathBuf, Option<Pattern>)> {
    match path.is_dir() {
        true => Some((path.to_path_buf(), None)),
        // A file may be called like a pattern.
        false if path.exists() => None,
        false => Pattern::of_path(path).map(|(folder, pattern)| (folder, Some(pattern))),
    }
}

fn list(path: &Path, folder: &Path, pattern: Option<&Pattern>) -> Result<Vec<String>> {
    let accept = |name: &str| match pattern {
        Some(pattern) => pattern.matches(name),
        None => Format::from_extension(Path::new(name)).is_some(),
    };
    match names(folder, accept)? {
        names if names.is_empty() => Err(Error::Empty { path: path.to_path_buf() }),
        names => Ok(names),
    }
}

fn in_folder(folder: &Path, names: Vec<String>) -> Vec<PathBuf> {
    names.into_iter().map(|name| folder.join(name)).collect()
}
