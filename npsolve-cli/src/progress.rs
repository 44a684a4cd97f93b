//! A progress bar for the patient.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// What is faster than this needs no bar.
const PATIENCE: Duration = Duration::from_secs(2);

/// Shows how much of a job is done and how long the rest will take: on stderr, only on a terminal,
/// and only after two seconds.
pub struct Progress {
    start: Instant,
    bar: Option<ProgressBar>,
    label: &'static str,
    silent: bool,
}

impl Progress {
    /// Starts the clock of a blend.
    pub fn new(quiet: bool) -> Self {
        Self::of("solving", quiet)
    }

    /// Starts the clock of a job that is called so.
    pub fn of(label: &'static str, quiet: bool) -> Self {
        let silent = quiet || !io::stderr().is_terminal();
        Self { start: Instant::now(), bar: None, label, silent }
    }

    /// Takes the share of the work that is done, 0 to 1.
    pub fn update(&mut self, share: f32) {
        self.update_with(share, String::new);
    }

    /// The same, with something to say beside the time left.
    pub fn update_with(&mut self, share: f32, note: impl FnOnce() -> String) {
        let elapsed = self.start.elapsed();
        if self.silent || elapsed < PATIENCE {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| new_bar(self.label));
        bar.set_position((share.clamp(0.0, 1.0) * 100.0) as u64);
        let left = time_left(elapsed, share).map(|left| format!("{} s left", left.as_secs() + 1));
        let parts: Vec<String> =
            [note()].into_iter().filter(|n| !n.is_empty()).chain(left).collect();
        bar.set_message(parts.join("  "));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn new_bar(label: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix} {bar:40} {percent:>3} %  {msg}");
    ProgressBar::new(100)
        .with_prefix(label)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// At the pace so far; unknown in the first percent.
fn time_left(elapsed: Duration, share: f32) -> Option<Duration> {
    let share = f64::from(share);
    (share > 0.01)
        .then(|| elapsed.as_secs_f64() * (1.0 - share.min(1.0)) / share)
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_extrapolates_the_pace() {
        let three = Duration::from_secs(3);
        assert_eq!(time_left(three, 0.25), Some(Duration::from_secs(9)));
        assert_eq!(time_left(three, 2.0), Some(Duration::ZERO));
        assert_eq!(time_left(three, 0.0), None);
        assert_eq!(time_left(three, f32::NAN), None);
    }
}
