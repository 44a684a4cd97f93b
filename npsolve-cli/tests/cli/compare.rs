//! `compare` on one scene and on lists of scenes.

use std::fs;

use serde_json::Value;
use signal_io::{ReadOptions, SampleType, read_image};

use crate::support::{Folder, flat, smooth};

const COMPARE: &str = "compare background.png patch.png --mask mask.png --at 12,9";
const SOLVERS: [&str; 7] = [
    "copy and paste",
    "PIE on links",
    "Neumann (DCT)",
    "paper on links",
    "paper, spline",
    "Dirichlet, spline",
    "screened (ours)",
];

#[test]
fn every_solver_has_a_row() {
    let folder = Folder::with_scene();
    let text = folder.run(&format!("{COMPARE} --guidance strongest")).ok().stdout();
    for word in SOLVERS.iter().chain(&["operator", "norm over channels", "length"]) {
        assert!(text.contains(word), "{word}: {text}");
    }
    let run = folder.run(&format!("{COMPARE} --keep 4 --lambda 2 --json")).ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    let rows = report["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|r| r["solver"].as_str().unwrap()).collect();
    assert_eq!(names[..7], SOLVERS);
    assert_eq!(names[7..], ["screened, keep 4"]);
    assert!(rows.iter().all(|r| r["error"].is_null()), "{report}");
}

/// The screened solution minimises what is measured.
#[test]
fn ours_has_the_least_objective() {
    let folder = Folder::with_scene();
    let run = folder.run(&format!("{COMPARE} --json")).ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    let rows = report["rows"].as_array().unwrap();
    let objective = |k: usize| rows[k]["objective"].as_f64().unwrap();
    for k in 0..6 {
        assert!(objective(6) < objective(k), "{}: {}", rows[k]["solver"], objective(k));
    }
}

#[test]
fn folder_has_sheet_tables_results_and_differences() {
    let folder = Folder::with_scene();
    folder.run("blend background.png patch.png --mask mask.png --at 12,9 -o mine.png --quiet").ok();
    let arguments = format!("{COMPARE} --other mine.png -o all/of/it --csv t.csv");
    folder.run(&arguments).ok();
    let picture = |name: &str| {
        read_image(folder.path("all/of/it").join(name), &ReadOptions::default()).expect(name)
    };
    for slug in ["paste", "pie", "neumann", "paper-links", "paper-spline", "dirichlet", "screened"]
    {
        picture(&format!("{slug}.png"));
        picture(&format!("{slug}-difference.png"));
    }
    assert_eq!(picture("screened-difference.png").as_planar().iter().sum::<f32>(), 0.0);
    assert!(picture("paste-difference.png").as_planar().iter().sum::<f32>() > 100.0);
    assert!(picture("sheet.png").width() > 1000);
    assert_eq!(picture("screened.png").as_planar(), picture("other-1-mine.png").as_planar());
    let csv = fs::read_to_string(folder.path("t.csv")).unwrap();
    assert_eq!(csv.lines().count(), 9, "{csv}");
    let columns = csv.lines().next().unwrap().split(',').count();
    // Two of the solvers' names hold a comma inside quotes.
    assert!(csv.lines().all(|l| l.replace(", ", " ").split(',').count() == columns), "{csv}");
    folder.run(&arguments).fails(1, &["t.csv", "--force"]);
    folder.run(&format!("{COMPARE} -o all/of/it")).fails(1, &["sheet.png", "--force"]);
    folder.run(&format!("{arguments} --force")).ok();
}

#[test]
fn other_results_must_have_the_backgrounds_size() {
    let folder = Folder::with_scene();
    let run = folder.run(&format!("{COMPARE} --other patch.png"));
    run.fails(1, &["patch.png", "30 x 24", "60 x 44"]);
}

#[test]
fn quiet_is_quiet() {
    let folder = Folder::with_scene();
    let run = folder.run(&format!("{COMPARE} --quiet")).ok();
    assert_eq!((run.stdout(), run.stderr()), (String::new(), String::new()));
}

#[test]
fn manifest_goes_on_after_a_bad_scene() {
    let folder = Folder::with_scene();
    folder.picture("gray.exr", &smooth(40, 30, 1, 0.0), SampleType::F32);
    folder.picture("gray_patch.exr", &smooth(20, 16, 1, 1.0), SampleType::F32);
    folder.picture("black.png", &flat(30, 24, 0.0), SampleType::U8);
    let manifest = r#"{ "conventions": {}, "blend_2d": [
        { "name": "good", "background": "background.png", "patch": "patch.png", "offset": [12, 9],
          "masks": { "disc": "mask.png", "none": "black.png" }, "guidance": ["import", "mixed_max"] },
        { "name": "lost", "background": "nothing.png", "patch": "patch.png", "offset": [0, 0],
          "masks": {}, "guidance": ["sum"] },
        { "name": "odd", "background": "background.png", "patch": "patch.png", "offset": [1, 1],
          "masks": {}, "guidance": ["melt"] },
        { "background": 3 },
        { "name": "gray", "background": "gray.exr", "patch": "gray_patch.exr", "offset": [9, 7] } ] }"#;
    fs::create_dir(folder.path("sub")).unwrap();
    fs::write(folder.path("list.json"), manifest).unwrap();
    let words = ["good-none", "black.png", "nothing.png", "melt", "scene 4", "5 of 8 cases failed"];
    let run = folder.run("compare --manifest list.json -o out").fails(1, &words);
    for word in ["good-disc", "strongest", "gray-all", "screened (ours)"] {
        assert!(run.stdout().contains(word), "{word}: {}", run.stdout());
    }
    for name in
        ["good-disc-patch.png", "good-disc-strongest.png", "gray-all-patch.png", "table.csv"]
    {
        assert!(folder.path("out").join(name).is_file(), "{name}");
    }
    folder.run("compare --manifest nothing.json").fails(1, &["nothing.json"]);
    fs::write(folder.path("bad.json"), "[1, 2").unwrap();
    folder.run("compare --manifest bad.json").fails(1, &["bad.json", "blend_2d"]);
    folder.run("compare").fails(2, &["BACKGROUND", "PATCH"]);
}
