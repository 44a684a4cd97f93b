//! Where in the grid the pictures of a folder belong, by their names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::strip::natural;
use crate::strip::pattern::Pattern;
use crate::{Error, Result};

/// The files in the order of the grid, row after row, and how many columns and rows there are.
///
/// Row and column are the numbers in the two places of a pattern that has two, otherwise the last
/// two numbers before the extension. They need not start at 0 nor be consecutive.
pub(super) fn grid(path: &Path, files: Vec<PathBuf>) -> Result<(Vec<PathBuf>, [usize; 2])> {
    let pattern = if path.is_dir() { None } else { Pattern::of_path(path).map(|(_, p)| p) };
    let pattern = pattern.filter(|p| p.places() == 2);
    let mut places = BTreeMap::new();
    for file in files {
        let found = place(&file, pattern.as_ref());
        let place = found.map_err(|what| Error::NoPlace { path: file.clone(), what })?;
        if let Some(other) = places.insert(place, file.clone()) {
            let (row, column) = place;
            let what = format!("{} is row {row}, column {column}, too", other.display());
            return Err(Error::NoPlace { path: file, what });
        }
    }
    let rows: BTreeSet<u64> = places.keys().map(|place| place.0).collect();
    let columns: BTreeSet<u64> = places.keys().map(|place| place.1).collect();
    // At most as many steps as there are files: the first hole ends the search.
    for row in &rows {
        for column in &columns {
            if !places.contains_key(&(*row, *column)) {
                let (path, row, column) = (path.to_path_buf(), *row, *column);
                return Err(Error::MissingView { path, row, column });
            }
        }
    }
    Ok((places.into_values().collect(), [columns.len(), rows.len()]))
}

/// Row and column of a file.
fn place(file: &Path, pattern: Option<&Pattern>) -> std::result::Result<(u64, u64), String> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let numbers = match pattern {
        Some(pattern) => pattern.numbers(&name),
        None => natural::numbers(&stem),
    };
    match numbers[..] {
        [.., Some(row), Some(column)] => Ok((row, column)),
        [.., _, _] => Err("a number in its name is too large".to_owned()),
        _ => Err("there are no two numbers in its name".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_of(path: &str, names: &[&str]) -> Result<(Vec<String>, [usize; 2])> {
        let files = names.iter().map(PathBuf::from).collect();
        let (files, grid) = grid(Path::new(path), files)?;
        Ok((files.into_iter().map(|f| f.to_string_lossy().into_owned()).collect(), grid))
    }

    #[test]
    fn rows_and_columns_come_from_names() {
        let names = ["x1_8_4.png", "x1_0_12.png", "x1_8_12.png", "x1_0_4.png"];
        let sorted = ["x1_0_4.png", "x1_0_12.png", "x1_8_4.png", "x1_8_12.png"];
        let (files, grid) = grid_of("*.png", &names).unwrap();
        assert_eq!((files, grid), (sorted.map(str::to_owned).to_vec(), [2, 2]));
        // The camera's position behind row and column, as in the Stanford archive.
        let names = ["out_00_01_-3.5_11.2.png", "out_00_00_-4.5_11.2.png"];
        let (files, grid) = grid_of("out_%02d_%02d_*.png", &names).unwrap();
        assert_eq!((files[0].as_str(), grid), (names[1], [2, 1]));
    }

    #[test]
    fn holes_and_doubles_are_typed_errors() {
        let hole = grid_of("*", &["a_0_0", "a_0_7", "a_3_0"]);
        assert!(matches!(hole, Err(Error::MissingView { row: 3, column: 7, .. })), "{hole:?}");
        for names in [&["a_1_1", "b_1_1"][..], &["a_1"], &["a"], &["a_1_99999999999999999999"]] {
            let result = grid_of("*", names);
            assert!(matches!(result, Err(Error::NoPlace { .. })), "{names:?}: {result:?}");
        }
    }
}
