//! `npsolve compare`: every solver and baseline on the same problem.

pub mod canvas;
pub mod font;
pub mod manifest;
mod methods;
mod sheet;
mod subject;
mod table;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use signal_io::WriteOptions;

use crate::args::CompareArgs;
use crate::channels::{Axes, Channels};
use crate::progress::Progress;
use crate::{console, files, kind};

use self::canvas::Canvas;
use self::methods::{Case, Row};
use self::subject::Subject;
use self::table::Table;

/// Runs the command.
pub fn run(args: &CompareArgs, quiet: bool) -> Result<()> {
    if let Some(csv) = &args.csv {
        files::check_text(csv, args.force)?;
    }
    if let Some(path) = &args.manifest {
        return manifest::run(path, args, quiet);
    }
    let (Some(background), Some(patch)) = (&args.background, &args.patch) else {
        bail!("name a background and a patch, or a --manifest");
    };
    let kind = args.scene.kind.unwrap_or_else(|| kind::of(background));
    let subject = Subject { kind, background, patch, scene: &args.scene, args };
    subject.open(One { args, quiet })
}

/// What is done with a case, whatever its kind.
trait Visitor {
    type Output;

    /// Compares.
    fn visit<const D: usize>(self, case: Case<'_, D>, shown: &dyn Shown) -> Result<Self::Output>
    where
        Axes<D>: Channels;
}

/// How results of a kind of signal are shown and kept.
trait Shown {
    /// What their file names end in.
    fn ending(&self) -> &'static str;

    /// Unit of lengths.
    fn unit(&self) -> &'static str;

    /// What a screen shows of these planes.
    fn view(&self, planes: &[f32]) -> Result<Canvas>;

    /// The part of it around the region.
    fn around(&self, planes: &[f32]) -> Result<Canvas> {
        self.view(planes)
    }

    /// Writes these planes.
    fn save(&self, planes: &[f32], path: &Path, force: bool) -> Result<()>;
}

/// A comparison of its own.
struct One<'a> {
    args: &'a CompareArgs,
    quiet: bool,
}

impl Visitor for One<'_> {
    type Output = ();

    fn visit<const D: usize>(self, case: Case<'_, D>, shown: &dyn Shown) -> Result<()>
    where
        Axes<D>: Channels,
    {
        let Self { args, quiet } = self;
        let targets = args.output.as_ref().map(|folder| Targets::new(folder, &case, shown));
        if let Some(targets) = &targets {
            targets.check(args.force)?;
        }
        let mut progress = Progress::new(quiet);
        let rows = case.run(&mut |share| progress.update(share))?;
        drop(progress);

        let table = Table::new(&case, &rows, shown.unit());
        if let Some(targets) = &targets {
            targets.write(&case, &rows, &table, args.force)?;
        }
        if let Some(csv) = &args.csv {
            files::write_text(csv, &table::to_csv(&[&table]), args.force)?;
        }
        if !quiet {
            console::warn(table.warnings());
        }
        if args.json {
            console::print(&files::to_json(&table)?)?;
        } else if !quiet {
            console::print(&table.to_text())?;
            if let Some(folder) = &args.output {
                let sheet = folder.join(SHEET);
                console::print(&format!("Look at {}.\n", sheet.display()))?;
            }
        }
        Ok(())
    }
}

const SHEET: &str = "sheet.png";
const TABLE_TEXT: &str = "table.txt";
const TABLE_CSV: &str = "table.csv";

/// The files that a comparison writes into its folder.
struct Targets<'a> {
    folder: PathBuf,
    shown: &'a dyn Shown,
    /// One result and one difference per method.
    files: Vec<[PathBuf; 2]>,
}

impl<'a> Targets<'a> {
    fn new<const D: usize>(folder: &Path, case: &Case<'_, D>, shown: &'a dyn Shown) -> Self {
        let ending = shown.ending();
        let pair = |slug: &str| {
            let difference = folder.join(format!("{slug}-difference.png"));
            [folder.join(format!("{slug}{ending}")), difference]
        };
        let files = case.methods().iter().map(|m| pair(&m.slug)).collect();
        Self { folder: folder.to_path_buf(), shown, files }
    }

    /// Makes the folder and looks for files in the way.
    fn check(&self, force: bool) -> Result<()> {
        files::make_folder(&self.folder)?;
        for name in [SHEET, TABLE_TEXT, TABLE_CSV] {
            files::check_text(&self.folder.join(name), force)?;
        }
        for [result, difference] in &self.files {
            files::check_picture(difference, force)?;
            if result.exists() && !force {
                bail!("{} exists; choose another name or add --force", result.display());
            }
        }
        Ok(())
    }

    fn write<const D: usize>(
        &self,
        case: &Case<'_, D>,
        rows: &[Row],
        table: &Table,
        force: bool,
    ) -> Result<()> {
        let options = WriteOptions { force, ..WriteOptions::default() };
        let ours = self.shown.view(methods::ours(rows)?)?;
        for (row, [result, difference]) in rows.iter().zip(&self.files) {
            let Some(planes) = &row.planes else { continue };
            self.shown.save(planes, result, force)?;
            let picture = sheet::difference(self.shown.view(planes)?, &ours)?;
            files::write(difference, &picture, &options)?;
        }
        let sheet = sheet::draw(case, rows, &|planes| self.shown.around(planes))?;
        files::write(&self.folder.join(SHEET), &sheet, &options)?;
        files::write_text(&self.folder.join(TABLE_TEXT), &table.to_text(), force)?;
        files::write_text(&self.folder.join(TABLE_CSV), &table::to_csv(&[table]), force)
    }
}
