//! `npsolve compare`: every solver and baseline on the same problem.

pub mod canvas;
pub mod font;
pub mod manifest;
mod methods;
mod sheet;
mod table;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use signal_io::{Image, SampleType, WriteOptions};

use crate::args::CompareArgs;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::{console, files};

use self::methods::{Case, Row};
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
    let scene = Scene::read(background, patch, &args.scene)?;
    let case = Case::new(String::new(), scene, args)?;
    let targets = args.output.as_ref().map(|folder| Targets::new(folder, &case));
    if let Some(targets) = &targets {
        targets.check(args.force)?;
    }
    let mut progress = Progress::new(quiet);
    let rows = case.run(&mut |share| progress.update(share))?;
    drop(progress);

    let table = Table::new(&case, &rows);
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

const SHEET: &str = "sheet.png";
const TABLE_TEXT: &str = "table.txt";
const TABLE_CSV: &str = "table.csv";

/// The files that a comparison writes into its folder.
struct Targets {
    folder: PathBuf,
    /// One result and one difference per method.
    pictures: Vec<[PathBuf; 2]>,
}

impl Targets {
    fn new(folder: &Path, case: &Case) -> Self {
        let extension = result_extension(&case.scene.background);
        let pair = |slug: &str| {
            let difference = folder.join(format!("{slug}-difference.png"));
            [folder.join(format!("{slug}.{extension}")), difference]
        };
        let pictures = case.methods().iter().map(|m| pair(&m.slug)).collect();
        Self { folder: folder.to_path_buf(), pictures }
    }

    /// Makes the folder and looks for files in the way.
    fn check(&self, force: bool) -> Result<()> {
        files::make_folder(&self.folder)?;
        for name in [SHEET, TABLE_TEXT, TABLE_CSV] {
            files::check_text(&self.folder.join(name), force)?;
        }
        self.pictures.iter().flatten().try_for_each(|path| files::check_picture(path, force))
    }

    fn write(&self, case: &Case, rows: &[Row], table: &Table, force: bool) -> Result<()> {
        let options = WriteOptions { force, ..WriteOptions::default() };
        let ours = methods::ours(rows)?;
        for (row, [result, difference]) in rows.iter().zip(&self.pictures) {
            let Some(planes) = &row.planes else { continue };
            files::write(result, &case.scene.picture(planes.clone(), false)?, &options)?;
            let shown = sheet::difference(&case.scene, planes, ours)?;
            files::write(difference, &shown, &options)?;
        }
        let sheet = sheet::draw(case, rows)?;
        files::write(&self.folder.join(SHEET), &sheet, &options)?;
        files::write_text(&self.folder.join(TABLE_TEXT), &table.to_text(), force)?;
        files::write_text(&self.folder.join(TABLE_CSV), &table::to_csv(&[table]), force)
    }
}

/// A format that holds every result: floats stay floats, integers are clamped as in `blend`.
fn result_extension(background: &Image) -> &'static str {
    match (background.channels().len(), background.sample) {
        (1 | 3, SampleType::U8 | SampleType::U16) => "png",
        (1 | 3, _) => "exr",
        _ => "npy",
    }
}
