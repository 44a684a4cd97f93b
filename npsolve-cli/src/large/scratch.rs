//! Files that a blend in blocks needs for a while, and the wish to stop it.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Hidden files beside a result: `.NAME.npsolve-background` and others. All are removed in the end, except for the state
/// of the blend where [`Scratch::keep_state`] says so.
pub struct Scratch {
    folder: PathBuf,
    stem: OsString,
    made: Vec<PathBuf>,
    /// Held while it lives: two runs for one result would use the same files.
    _lock: File,
    /// Leave the file from which a stopped blend goes on.
    pub keep_state: bool,
}

impl Scratch {
    /// For the result in `output`, whose folder is there.
    ///
    /// # Errors
    /// Where nothing can be written beside it, or another run does so.
    pub fn new(output: &Path) -> Result<Self> {
        let target = fs::canonicalize(output).unwrap_or_else(|_| output.to_path_buf());
        let folder = target.parent().map(Path::to_path_buf).unwrap_or_default();
        let mut stem = OsString::from(".");
        stem.push(target.file_name().unwrap_or_default());
        stem.push(".npsolve-");
        let lock = place(&folder, &stem, "lock");
        let failed = || format!("cannot make the scratch file {}", lock.display());
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(&lock);
        let file = file.with_context(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                bail!(
                    "another npsolve is writing {}; wait for it, or choose another -o",
                    output.display()
                )
            }
            Err(TryLockError::Error(e)) => return Err(e).with_context(failed),
        }
        Ok(Self { folder, stem, made: vec![lock], _lock: file, keep_state: false })
    }

    /// The path of a scratch file that is about to be made.
    pub fn make(&mut self, name: &str) -> PathBuf {
        let path = place(&self.folder, &self.stem, name);
        self.made.push(path.clone());
        path
    }

    /// The path of the state.
    pub fn state(&self) -> PathBuf {
        place(&self.folder, &self.stem, "state")
    }

    /// Bytes of the files so far.
    pub fn bytes(&self) -> u64 {
        self.made.iter().filter_map(|path| fs::metadata(path).ok()).map(|m| m.len()).sum()
    }
}

fn place(folder: &Path, stem: &OsString, name: &str) -> PathBuf {
    let mut full = stem.clone();
    full.push(name);
    folder.join(full)
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if !self.keep_state {
            self.made.push(self.state());
        }
        for path in self.made.iter().rev() {
            let _ = fs::remove_file(path); // Not all were made; nothing better can be done for the others.
        }
    }
}

/// Whether somebody pressed Ctrl-C or asked the program to end. The second time ends it at once.
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Listens from now on.
    pub fn install() -> Self {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // Without it the signal ends the program as usual, and leaves the scratch files.
            let _ = flag::register_conditional_shutdown(signal, 1, asked.clone());
            let _ = flag::register(signal, asked.clone());
        }
        Self(asked)
    }

    /// Whether to stop.
    pub fn is_asked_for(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// An error if so.
    pub fn check(&self) -> Result<()> {
        match self.is_asked_for() {
            true => bail!("stopped before the solution began; nothing is left of it"),
            false => Ok(()),
        }
    }
}
