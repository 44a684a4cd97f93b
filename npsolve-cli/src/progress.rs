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
    silent: bool,
}

impl Progress {
    /// Starts the clock.
    pub fn new(quiet: bool) -> Self {
        let silent = quiet || !io::stderr().is_terminal();
        Self { start: Instant::now(), bar: None, silent }
    }

    /// Takes the share of the work that is done, 0 to 1.
    pub fn update(&mut self, share: f32) {
        let elapsed = self.start.elapsed();
        if self.silent || elapsed < PATIENCE {
            return;
        }
        let bar = self.bar.get_or_insert_with(new_bar);
        bar.set_position((share.clamp(0.0, 1.0) * 100.0) as u64);
        if let Some(left) = time_left(elapsed, share) {
            bar.set_message(format!("{} s left", left.as_secs() + 1));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn new_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("solving {bar:40} {percent:>3} %  {msg}");
    ProgressBar::new(100).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
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
