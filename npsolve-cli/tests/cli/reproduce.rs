//! `reproduce` on generated scenes, with few steps.

use std::fs;

use serde_json::Value;
use signal_io::{ReadOptions, read_image};

use crate::support::Folder;

const MANIFEST: &str = r#"{ "blend_2d": [
    { "name": "waves", "background": "background.png", "patch": "patch.png", "offset": [12, 9],
      "masks": { "free": "mask.png" } } ] }"#;

fn folder() -> Folder {
    let folder = Folder::with_scene();
    fs::write(folder.path("list.json"), MANIFEST).unwrap();
    folder
}

fn rows(folder: &Folder, arguments: &str) -> Vec<Value> {
    let run = folder.run(&format!("reproduce {arguments} --quick --json -o out")).ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    let notes = report["notes"].to_string();
    assert!(notes.contains("splines") && notes.contains("pixel differences"), "{notes}");
    report["rows"].as_array().unwrap().clone()
}

#[test]
fn table1_scores_every_solver_against_both_minima() {
    let folder = folder();
    let rows = rows(&folder, "table1 --manifest list.json");
    assert_eq!(rows.len(), 2 * 6);
    let number =
        |row: &Value, key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
    for row in &rows {
        assert_eq!(row["scene"], "waves/free");
        // Nobody is below the exact minimum of either objective by more than its own rounding.
        let excess = [number(row, "excess_screened"), number(row, "excess_loss")];
        assert!(excess.iter().all(|e| *e > -1e-7), "{row}");
        assert!(number(row, "m1") > 0.0 && number(row, "seconds") >= 0.0);
        match row["solver"].as_str().unwrap() {
            "ours, exact" => assert_eq!(excess[0], 0.0),
            "ours, grid network" => assert!(excess[0] < 1e-4, "{row}"),
            // Rounding to f32 is all that is left.
            "paper, minimum of loss" => assert!(excess[1] < 1e-6, "{row}"),
            _ => assert!(excess[0] > 0.0, "{row}"),
        }
    }
    let text = |name: &str| fs::read_to_string(folder.path("out").join(name)).unwrap();
    assert!(
        text("table1.txt").starts_with("npsolve reproduce table1 --manifest list.json --quick")
    );
    assert_eq!(text("table1.csv").lines().count(), 13);
    assert!(text("table1.tex").contains("\\begin{tabular}"));
    read_image(folder.path("out/table1.png"), &ReadOptions::default()).unwrap();
    let again = folder.run("reproduce table1 --manifest list.json --quick -o out");
    again.fails(1, &["table1.txt", "--force"]);
}

#[test]
fn figures_have_their_rows_and_pictures() {
    let folder = folder();
    for (figure, count) in [("lambda", 18), ("guidance", 5), ("ablation", 11)] {
        let rows = rows(&folder, &format!("{figure} --manifest list.json --steps 5"));
        assert_eq!(rows.len(), count, "{figure}");
        read_image(folder.path("out").join(format!("{figure}.png")), &ReadOptions::default())
            .expect(figure);
    }
    let rows = rows(&folder, "mask --manifest list.json");
    let pixels = |k: usize| rows[k]["region_pixels"].as_f64().unwrap();
    // The rectangle first, then from the smallest mask to the largest, two solvers each.
    assert!((4..rows.len()).step_by(2).all(|k| pixels(k) > pixels(k - 2)), "{rows:?}");
}

/// What is outside the region is lost when nothing but its edge is compared.
#[test]
fn the_ablation_ruins_the_background() {
    let folder = Folder::new();
    let rows = rows(&folder, "ablation --steps 150 --scenes ball");
    let noise = |name: &str| {
        let row = rows.iter().find(|r| r["variant"] == name).unwrap();
        row["psnr_outside"].as_f64().unwrap()
    };
    // So few steps are enough from the background; a random start needs thousands to get there.
    assert!(noise("from S") > noise("colour at boundary, from S") + 10.0, "{rows:?}");
}

#[test]
fn unknown_scenes_and_empty_lists_are_named() {
    let folder = folder();
    let run = folder.run("reproduce mask --manifest list.json --scenes sea -o out");
    run.fails(1, &["sea", "waves"]);
    fs::write(folder.path("none.json"), r#"{ "blend_2d": [] }"#).unwrap();
    folder.run("reproduce mask --manifest none.json -o out").fails(1, &["no scenes"]);
    folder.run("reproduce figure9").fails(2, &["figure9", "table1"]);
    let quiet = folder.run("reproduce guidance --manifest list.json --quick --quiet -o out").ok();
    assert_eq!((quiet.stdout(), quiet.stderr()), (String::new(), String::new()));
}
