use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result};

/// Writes a file so that it is there completely or not at all.
///
/// The writer is a temporary file in the same folder (`.NAME.npsolve-tmp-...`), which is flushed,
/// synced and renamed to `path` after `write` returned `Ok`; otherwise, and also on a panic, it is
/// removed and an existing target is untouched. A symbolic link is followed, not replaced.
///
/// Without `force` an existing target is an error, checked before and after writing. A file that
/// another process creates between the second check and the rename is overwritten.
///
/// # Errors
/// [`Error::Exists`], [`Error::NoFolder`], [`Error::NotAFile`] and [`Error::Io`], the last also for
/// what `write` returns.
pub fn write_atomic<T>(
    path: impl AsRef<Path>,
    force: bool,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
) -> Result<T> {
    let path = path.as_ref();
    replace(path, force, |w| {
        write(w).map_err(|e| Error::Io { path: path.to_path_buf(), action: "write", source: e })
    })
}

/// The same for writers that have errors of their own.
pub(crate) fn replace<T>(
    path: &Path,
    force: bool,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<T>,
) -> Result<T> {
    let (replacement, file) = Replacement::start(path, force)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    let value = write(&mut writer)?;
    let file = writer.into_inner().map_err(|e| failed(path, "write", e.into_error()))?;
    replacement.finish(file)?;
    Ok(value)
}

/// A file that is being made and takes its final name at the end, or is removed.
pub(crate) struct Replacement {
    path: PathBuf,
    target: PathBuf,
    force: bool,
    temporary: Temporary,
}

impl Replacement {
    /// Makes the temporary file.
    pub(crate) fn start(path: &Path, force: bool) -> Result<(Self, File)> {
        check_place(path, force)?;
        // Renaming onto a link would replace the link and leave its target as it was.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let (temporary, file) =
            Temporary::create(&target).map_err(|e| failed(path, "create", e))?;
        Ok((Self { path: path.to_path_buf(), target, force, temporary }, file))
    }

    /// Gives the temporary file, to which everything is written, its name.
    pub(crate) fn finish(self, file: File) -> Result<()> {
        let path = &self.path;
        // Without the sync a power cut after the rename can leave an empty file under the final name.
        file.sync_all().map_err(|e| failed(path, "sync", e))?;
        drop(file);
        check_place(path, self.force)?;
        fs::rename(&self.temporary.path, &self.target).map_err(|e| failed(path, "rename", e))?;
        self.temporary.keep();
        Ok(())
    }
}

fn failed(path: &Path, action: &'static str, source: io::Error) -> Error {
    Error::Io { path: path.to_path_buf(), action, source }
}

/// Existing target, missing folder: what can be known before the work starts.
pub(crate) fn check_place(path: &Path, force: bool) -> Result<()> {
    match fs::metadata(path) {
        Ok(found) if !found.is_file() => {
            return Err(Error::NotAFile { path: path.to_path_buf() });
        }
        Ok(_) if !force => return Err(Error::Exists { path: path.to_path_buf() }),
        _ => {}
    }
    let folder = folder_of(path);
    match folder.is_dir() {
        true => Ok(()),
        false => Err(Error::NoFolder { path: path.to_path_buf(), folder }),
    }
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

/// A file that is removed when it goes out of scope.
struct Temporary {
    path: PathBuf,
    keep: bool,
}

impl Temporary {
    fn create(target: &Path) -> io::Result<(Self, File)> {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        // 150 characters, up to 200 bytes or so: file systems stop at 255 bytes per name.
        let name: String = name.chars().take(if name.is_ascii() { 150 } else { 40 }).collect();
        let (process, number) = (std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
        let path = folder_of(target).join(format!(".{name}.npsolve-tmp-{process}-{number}"));
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(&path)?;
        Ok((Self { path, keep: false }, file))
    }

    fn keep(mut self) {
        self.keep = true;
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.keep {
            let _ = fs::remove_file(&self.path); // Nothing better can be done while failing.
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn complete_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let failed = write_atomic(&path, false, |w| {
            w.write_all(b"half of it")?;
            Err::<(), _>(io::Error::other("disk on fire"))
        });
        assert!(matches!(failed, Err(Error::Io { .. })));
        assert!(names(folder.path()).is_empty(), "{:?}", names(folder.path()));

        write_atomic(&path, false, |w| w.write_all(b"one")).unwrap();
        let refused = write_atomic(&path, false, |w| w.write_all(b"two"));
        assert!(matches!(refused, Err(Error::Exists { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"one");
        write_atomic(&path, true, |w| w.write_all(b"three")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"three");
        assert_eq!(names(folder.path()), ["report.json"]);
    }

    #[test]
    fn a_panicking_writer_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let caught = std::panic::catch_unwind(|| {
            let _ = write_atomic(&path, false, |_| -> io::Result<()> { panic!("expected") });
        });
        assert!(caught.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn folders_are_checked() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("no/such/a.csv");
        let result = write_atomic(&missing, true, |_| Ok(()));
        assert!(matches!(result, Err(Error::NoFolder { .. })));
        let result = write_atomic(folder.path(), true, |_| Ok(()));
        assert!(matches!(result, Err(Error::NotAFile { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_atomic(&link, true, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }
}
