//! Fuzz targets for everything that reads files; see README.md.

pub mod read;

/// The body of a fuzz target.
#[macro_export]
macro_rules! target {
    ($reader:literal) => {
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
            $crate::read::read($reader, bytes);
        });
    };
}
