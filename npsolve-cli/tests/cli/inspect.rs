//! `inspect`.

use serde_json::Value;
use signal_io::{Image, SampleType};

use crate::support::{Folder, flat};

#[test]
fn pictures_and_masks_are_described() {
    let folder = Folder::with_scene();
    let text = folder.run("inspect background.png mask.png").ok().stdout();
    for words in ["60 x 44 pixels, 3 channels, 16-bit, sRGB", "1 component", "0 holes"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let run = folder.run("inspect --json mask.png background.png").ok();
    let report: Value = serde_json::from_str(&run.stdout()).unwrap();
    assert_eq!(report[0]["mask"]["components"], 1);
    assert_eq!(report[0]["mask"]["touches_border"], false);
    assert_eq!((&report[1]["width"], &report[1]["mask"]), (&60.into(), &Value::Null));
}

#[test]
fn bad_files_fail_after_the_good_ones_are_told() {
    let folder = Folder::with_scene();
    let run = folder.run("inspect nothing.png patch.png").fails(1, &["nothing.png"]);
    assert!(run.stdout().contains("patch.png: 30 x 24"));
}

#[test]
fn values_that_are_not_finite_are_counted() {
    let folder = Folder::new();
    let image = Image::new(2, 1, &["Y"], vec![f32::NAN, 443.0]).unwrap();
    folder.picture("a.npy", &image, SampleType::F32);
    folder.picture("b.npy", &flat(1, 1, f32::INFINITY), SampleType::F32);
    let text = folder.run("inspect a.npy b.npy").ok().stdout();
    assert!(text.contains("443 to 443") && text.contains("1 value not finite"), "{text}");
    assert!(text.contains("no finite value"), "{text}");
    folder.run("inspect a.npy b.npy --json").ok();
}
