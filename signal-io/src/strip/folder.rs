//! A series of pictures into a folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::{listing, pattern::Pattern};
use crate::format::extension;
use crate::plan::Plan;
use crate::{
    Error, Format, Image, Result, WriteOptions, WriteReport, atomic, check_target, write_image,
};

/// Where the pictures go and how they are called.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub(crate) folder: PathBuf,
    pub(crate) pattern: Pattern,
}

impl Series {
    /// The target that a path stands for: the pattern of its last part with `numbers` places, or the
    /// folder that it is or would be, and the names of `default_pattern` inside. `None` when it
    /// looks like a file: a name with an extension, not a folder and not ending in a slash.
    pub(crate) fn of_path(path: &Path, numbers: usize, default_pattern: &str) -> Option<Self> {
        if let Some((folder, pattern)) = Pattern::of_path(path) {
            return (pattern.number_count() == Some(numbers)).then_some(Self { folder, pattern });
        }
        let slash = path.to_string_lossy().ends_with(['/', std::path::MAIN_SEPARATOR]);
        let folder = slash || path.is_dir() || path.extension().is_none();
        let pattern = Pattern::parse(default_pattern).expect("a pattern");
        folder.then(|| Self { folder: path.to_path_buf(), pattern })
    }

    /// What can be known before there are pictures: the format, the place, and files in the way.
    ///
    /// # Errors
    /// [`Error::UnsupportedFormat`], [`Error::NoFolder`], [`Error::NotAFile`], and
    /// [`Error::Exists`] where there are files of this series and `force` does not allow them to go.
    pub(crate) fn check(&self, force: bool) -> Result<()> {
        let zeros = vec![0; self.pattern.number_count().unwrap_or(0)];
        let path = self.folder.join(self.pattern.name(&zeros));
        match fs::metadata(&self.folder) {
            Ok(found) if !found.is_dir() => Err(Error::NotAFile { path: self.folder.clone() }),
            Ok(_) => match self.present()?.first() {
                Some(name) if !force => Err(Error::Exists { path: self.folder.join(name) }),
                _ => check_target(path, true),
            },
            // Beside the folder, as there is nothing yet inside; only the extension matters here.
            Err(_) => {
                check_target(self.parent().join(self.pattern.name(&zeros)), true).map_err(|error| {
                    match error {
                        Error::NoFolder { folder, .. } => Error::NoFolder { path, folder },
                        other => other,
                    }
                })
            }
        }
    }

    /// The files of this series that are there already.
    fn present(&self) -> Result<Vec<String>> {
        listing::names(&self.folder, |name| self.pattern.matches(name))
    }

    fn parent(&self) -> PathBuf {
        let parent = self.folder.parent().filter(|p| !p.as_os_str().is_empty());
        parent.unwrap_or(Path::new(".")).to_path_buf()
    }

    /// Writes picture `k` under the name with the numbers `numbers[k]`.
    ///
    /// A new folder appears when it is complete: it is filled under another name beside and renamed.
    /// In a folder that is there, all pictures are written into a temporary folder first; only then
    /// their names are changed, one after the other.
    ///
    /// # Errors
    /// Those of [`Series::check`] and of [`write_image`]; [`Error::CannotHold`] when the folder has
    /// files of this series that would be left over among the new ones.
    pub(crate) fn write(
        &self,
        numbers: &[Vec<usize>],
        picture: impl Fn(usize) -> Image,
        options: &WriteOptions,
    ) -> Result<WriteReport> {
        self.check(options.force)?;
        let names: Vec<String> = numbers.iter().map(|n| self.pattern.name(n)).collect();
        self.check_picture(&self.folder.join(&names[0]), &picture(0), options)?;
        let write_all = |folder: &Path| -> Result<WriteReport> {
            let mut sum: Option<WriteReport> = None;
            for (k, name) in names.iter().enumerate() {
                let report = write_image(folder.join(name), &picture(k), options)
                    .map_err(|e| relocated(e, &self.folder.join(name)))?;
                sum = Some(match sum {
                    None => report,
                    Some(sum) => WriteReport {
                        samples: sum.samples + report.samples,
                        clipped: sum.clipped + report.clipped,
                        ..sum
                    },
                });
            }
            sum.ok_or_else(|| Error::Shape { what: "no pictures".to_owned() })
        };
        if self.folder.is_dir() {
            let present = self.present()?;
            if let Some(extra) = present.iter().find(|name| !names.contains(name)) {
                return Err(Error::CannotHold {
                    path: self.folder.clone(),
                    format: "a folder of pictures",
                    what: format!("{} new files beside the old {extra}", names.len()),
                    instead: "remove the old series or choose another folder".to_owned(),
                });
            }
            // Inside, where there is the right to write and renaming does not copy.
            let temporary = TemporaryFolder::new(&self.folder, &self.folder)?;
            let report = write_all(&temporary.path)?;
            // Found before the first one is renamed: folders and devices under these names.
            for name in &names {
                atomic::check_place(&self.folder.join(name), true)?;
            }
            for name in &names {
                rename(&temporary.path.join(name), &self.folder.join(name))?;
            }
            return Ok(report);
        }
        let temporary = TemporaryFolder::new(&self.folder, &self.parent())?;
        let report = write_all(&temporary.path)?;
        rename(&temporary.path, &self.folder)?;
        Ok(report)
    }

    /// Whether the format of the names can hold such a picture.
    fn check_picture(&self, path: &Path, image: &Image, options: &WriteOptions) -> Result<()> {
        let Some(format) = Format::from_extension(path) else { return Ok(()) };
        let plan = Plan::new(format, &extension(path), image, options);
        plan.map(|_| ()).map_err(|fault| fault.at(path, format.name(), "write"))
    }
}

fn rename(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).map_err(|source| Error::Io {
        path: to.to_path_buf(),
        action: "rename",
        source,
    })
}

/// An error about a file in the temporary folder, as one about the file it was to become.
fn relocated(error: Error, target: &Path) -> Error {
    let path = target.to_path_buf();
    match error {
        Error::Io { action, source, .. } => Error::Io { path, action, source },
        Error::Encode { format, reason, .. } => Error::Encode { path, format, reason },
        Error::CannotHold { format, what, instead, .. } => {
            Error::CannotHold { path, format, what, instead }
        }
        other => other,
    }
}

/// A folder that is removed with all that is in it when it goes out of scope under its first name.
struct TemporaryFolder {
    path: PathBuf,
}

impl TemporaryFolder {
    fn new(target: &Path, parent: &Path) -> Result<Self> {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let name: String = name.chars().take(40).collect(); // 255 bytes per name, at most 4 each.
        let (process, number) = (std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
        let path = parent.join(format!(".{name}.npsolve-tmp-folder-{process}-{number}"));
        fs::create_dir(&path).map_err(|source| Error::Io {
            path: target.to_path_buf(),
            action: "create",
            source,
        })?;
        Ok(Self { path })
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path); // Gone already after the rename.
    }
}
