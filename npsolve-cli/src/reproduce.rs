//! `npsolve reproduce`: the paper's table and figures, made again and measured alike.

mod ablation;
mod generated;
mod guidance;
mod lambda;
mod mask;
mod panel;
mod setting;
mod solvers;
mod table;
mod table1;

use std::path::PathBuf;

use anyhow::Result;
use signal_io::{Image, WriteOptions};

use crate::args::{Figure, ReproduceArgs};
use crate::progress::Progress;
use crate::{console, files};

use self::table::Table;

/// What a figure consists of.
struct Made {
    table: Table,
    picture: Image,
}

/// Runs the command.
pub fn run(args: &ReproduceArgs, quiet: bool) -> Result<()> {
    let targets = Targets::new(args)?;
    let settings = setting::choose(args)?;
    let mut meter = Meter::new(quiet);
    let made = match args.figure {
        Figure::Table1 => table1::make(&settings, args, &mut meter)?,
        Figure::Lambda => lambda::make(&settings[0], args, &mut meter)?,
        Figure::Guidance => guidance::make(&settings[0], &mut meter)?,
        Figure::Mask => mask::make(&settings[0], &mut meter)?,
        Figure::Ablation => ablation::make(&settings[0], args, &mut meter)?,
    };
    drop(meter);
    targets.write(&made)?;
    if args.json {
        return console::print(&files::to_json(&made.table.to_json())?);
    }
    if !quiet {
        console::print(&made.table.to_text())?;
        console::print(&format!("\nLook at {}.\n", targets.path("png").display()))?;
    }
    Ok(())
}

/// The files of a figure.
struct Targets {
    folder: PathBuf,
    name: &'static str,
    force: bool,
}

impl Targets {
    /// Makes the folder and looks for files in the way.
    fn new(args: &ReproduceArgs) -> Result<Self> {
        let this =
            Self { folder: args.output.clone(), name: args.figure.name(), force: args.force };
        files::make_folder(&this.folder)?;
        for extension in ["txt", "csv", "tex"] {
            files::check_text(&this.path(extension), this.force)?;
        }
        files::check_picture(&this.path("png"), this.force)?;
        Ok(this)
    }

    fn path(&self, extension: &str) -> PathBuf {
        self.folder.join(format!("{}.{extension}", self.name))
    }

    fn write(&self, made: &Made) -> Result<()> {
        let (table, command) = (&made.table, command_line());
        let text = format!("{command}\n\n{}", table.to_text());
        files::write_text(&self.path("txt"), &text, self.force)?;
        files::write_text(&self.path("csv"), &table.to_csv(), self.force)?;
        let tex = format!("% {command}\n{}", table.to_tex());
        files::write_text(&self.path("tex"), &tex, self.force)?;
        let options = WriteOptions { force: self.force, ..WriteOptions::default() };
        files::write(&self.path("png"), &made.picture, &options)?;
        Ok(())
    }
}

/// The command that makes the files, as typed.
fn command_line() -> String {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .map(|a| if a.contains(' ') { format!("'{a}'") } else { a })
        .collect();
    format!("npsolve {} ({})", arguments.join(" "), env!("CARGO_PKG_VERSION"))
}

/// A progress bar over several jobs of unequal weight.
pub struct Meter {
    progress: Progress,
    done: f32,
    total: f32,
}

impl Meter {
    fn new(quiet: bool) -> Self {
        Self { progress: Progress::of("reproducing", quiet), done: 0.0, total: 1.0 }
    }

    /// Says how much work there is in all; any unit.
    fn expect(&mut self, total: f32) {
        (self.done, self.total) = (0.0, total.max(f32::MIN_POSITIVE));
    }

    /// Work within the job that runs.
    fn within(&mut self, amount: f32) {
        self.progress.update((self.done + amount) / self.total);
    }

    /// The end of a job of this weight.
    fn finish(&mut self, amount: f32) {
        self.done += amount;
        self.within(0.0);
    }
}
