//! The demos that make their own signals.

use crate::support::Folder;

#[test]
fn every_kind_has_a_demo_that_can_be_run_again() {
    for (kind, file) in [
        ("audio", "blend.wav"),
        ("volume", "blend.nii.gz"),
        ("video", "blend.webp"),
        ("lightfield", "blend.npy"),
    ] {
        let folder = Folder::new();
        for _ in 0..2 {
            let run = folder.run(&format!("demo --kind {kind} -o out")).ok();
            assert!(run.stdout().contains("npsolve blend"), "{}", run.stdout());
        }
        for name in ["background", "patch", "paste"] {
            let other = file.replace("blend", name);
            assert!(folder.path("out").join(&other).is_file(), "{other}");
        }
        for name in [file, "paste.png", "blend.png"] {
            assert!(folder.path("out").join(name).is_file(), "{kind}: {name}");
        }
    }
}
