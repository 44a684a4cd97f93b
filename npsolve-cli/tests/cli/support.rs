//! A folder with generated pictures, and the program run in it.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use signal_io::{Image, SampleType, Transfer, WriteOptions, write_image};

/// A temporary folder; commands run inside it, so that messages hold plain names.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// An empty folder.
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// A folder with `background.png` (60 x 44), `patch.png` (30 x 24), both RGB, and `mask.png`.
    pub fn with_scene() -> Self {
        let folder = Self::new();
        folder.picture("background.png", &smooth(60, 44, 3, 0.3), SampleType::U16);
        folder.picture("patch.png", &smooth(30, 24, 3, 2.0), SampleType::U16);
        folder.picture("mask.png", &disc(30, 24), SampleType::U8);
        folder
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a picture as it is, whatever its values.
    pub fn picture(&self, name: &str, image: &Image, sample: SampleType) {
        let options = WriteOptions { sample: Some(sample), ..WriteOptions::default() };
        write_image(self.path(name), image, &options).expect("a picture that can be written");
    }

    /// Runs `npsolve` with arguments separated by spaces.
    pub fn run(&self, arguments: &str) -> Run {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("npsolve");
        let output = command
            .current_dir(self.0.path())
            .args(arguments.split_whitespace())
            .output()
            .expect("the program starts");
        Run(output)
    }

    /// Names of the files in it, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).expect("the folder");
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// What a run of the program left.
pub struct Run(Output);

impl Run {
    pub fn code(&self) -> i32 {
        self.0.status.code().expect("an exit code, not a signal")
    }

    pub fn stdout(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).expect("text")
    }

    pub fn stderr(&self) -> String {
        String::from_utf8(self.0.stderr.clone()).expect("text")
    }

    /// The run, which must have succeeded.
    #[track_caller]
    pub fn ok(self) -> Self {
        assert_eq!(self.code(), 0, "{}", self.stderr());
        self
    }

    /// The run, which must have failed with this code and a message with all these words.
    #[track_caller]
    pub fn fails(self, code: i32, words: &[&str]) -> Self {
        let message = self.stderr();
        assert_eq!(self.code(), code, "{message}");
        for word in words {
            assert!(message.contains(word), "no {word:?} in: {message}");
        }
        assert!(!message.contains("panicked"), "{message}");
        self
    }
}

/// Waves between 0.2 and 0.8, another one per channel.
pub fn smooth(width: usize, height: usize, channels: usize, phase: f32) -> Image {
    let value = |k: usize| {
        let (x, y, c) = (k % width, k / width % height, k / (width * height));
        let (x, y, c) = (x as f32, y as f32, c as f32);
        0.5 + 0.15 * (0.21 * x + phase + c).sin() + 0.15 * (0.17 * y - phase * c).cos()
    };
    let names: Vec<String> = match channels {
        1 => vec!["Y".to_owned()],
        3 => ["R", "G", "B"].map(str::to_owned).to_vec(),
        n => (0..n).map(|c| format!("C{c}")).collect(),
    };
    let data = (0..width * height * channels).map(value).collect();
    let mut image = Image::new(width, height, &names, data).expect("matching sizes");
    image.transfer = Transfer::Srgb;
    image
}

/// A white ellipse on black, two pixels clear of the border.
pub fn disc(width: usize, height: usize) -> Image {
    let inside = |k: usize| {
        let half = |n: usize| (n as f32 - 1.0) / 2.0;
        let part = |i: usize, n: usize| (i as f32 - half(n)) / (half(n) - 2.0);
        part(k % width, width).hypot(part(k / width, height)) < 1.0
    };
    let data = (0..width * height).map(|k| f32::from(u8::from(inside(k)))).collect();
    let mut image = Image::new(width, height, &["Y"], data).expect("matching sizes");
    image.transfer = Transfer::Srgb;
    image
}

/// One value everywhere.
pub fn flat(width: usize, height: usize, value: f32) -> Image {
    Image::new(width, height, &["Y"], vec![value; width * height]).expect("matching sizes")
}
