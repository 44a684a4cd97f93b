//! The seeds of the fuzz targets are files that can be read; what fuzzing once found never panics again.

use std::fs;
use std::path::{Path, PathBuf};

#[path = "../../fuzz/src/read.rs"]
mod read;

fn files(folder: &str, reader: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz").join(folder).join(reader);
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    entries.map(|e| e.unwrap().path()).collect()
}

#[test]
fn seeds_are_files_of_their_formats() {
    for reader in read::READERS {
        let seeds = files("corpus", reader);
        assert!(!seeds.is_empty(), "{reader} has no seeds");
        for path in seeds {
            let needs_feature = ["audio_flac", "audio_ogg", "audio_mp3"].contains(&reader);
            let expected = cfg!(feature = "compressed-audio") || !needs_feature;
            assert_eq!(
                read::read(reader, &fs::read(&path).unwrap()),
                expected,
                "{}",
                path.display()
            );
        }
    }
}

#[test]
fn findings_do_no_harm() {
    for reader in read::READERS {
        for path in files("findings", reader) {
            println!("{}", path.display());
            read::read(reader, &fs::read(&path).unwrap());
        }
    }
}
