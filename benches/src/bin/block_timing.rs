//! Seconds, sweeps and peak memory of a blend in blocks from file to file, one JSON line.
//!
//! `block_timing SIDE MEGABYTES FOLDER`: a picture of SIDE x SIDE samples with three channels, whose region is a
//! disc of 0.9 times its side; the files are made in FOLDER first and removed at the end.

use std::path::Path;
use std::time::Instant;

use npsolve_benches::peak_memory_bytes;
use poisson_loss::{
    BlockOptions, BlockProblem, BlockSink, Guidance, Options, PlaneFile, solve_in_blocks,
};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [side, megabytes, folder] = &arguments[..] else {
        eprintln!("usage: block_timing SIDE MEGABYTES FOLDER");
        std::process::exit(2)
    };
    let side: usize = side.parse().expect("samples per side");
    let max_memory = megabytes.parse::<u64>().expect("megabytes") << 20;
    let folder = Path::new(folder);
    let file = |name: &str| folder.join(format!("block-timing-{name}"));
    let wave = |frequency: f32| {
        move |c: usize, x: f32, y: f32| {
            let phase = c as f32 + 10.0 * frequency;
            0.5 + 0.2 * (frequency * x + phase).sin() * (0.7 * frequency * y - phase).cos()
                + 0.05 * (0.9 * x + 0.4 * y).sin()
        }
    };
    let radius = 0.45 * side as f32;
    let disc = |_: usize, x: f32, y: f32| {
        f32::from((x - 0.5 * side as f32).hypot(y - 0.5 * side as f32) < radius)
    };
    let background = planes(&file("background"), side, 3, wave(0.004));
    let patch = planes(&file("patch"), side, 3, wave(0.007));
    let mask = planes(&file("mask"), side, 1, disc);
    let mut result =
        PlaneFile::create(&file("result"), [side; 2], 3, 0).expect("a file for the result");
    let problem = BlockProblem::<2, 3> {
        background: &background,
        patch: &patch,
        mask: &mask,
        offset: [0, 0],
        guidance: Guidance::Patch,
        options: Options::default(),
    };
    let options = BlockOptions { max_memory, ..BlockOptions::default() };
    let begin = Instant::now();
    let report = solve_in_blocks(&problem, &options, &file("state"), &mut result, &mut |_| true)
        .expect("a blend");
    let seconds = begin.elapsed().as_secs_f64();
    println!(
        "{{\"side\": {side}, \"channels\": 3, \"seconds\": {seconds:.1}, \"ns_per_sample_and_channel\": {:.0}, \
         \"sweeps\": {}, \"change\": {:.1e}, \"blocks\": {}, \"coarse_step\": {}, \"max_memory\": {max_memory}, \
         \"peak_bytes\": {}}}",
        1e9 * seconds / (3 * side * side) as f64,
        report.sweeps,
        report.change,
        report.blocks,
        report.coarse_step,
        peak_memory_bytes(),
    );
    for name in ["background", "patch", "mask", "result"] {
        std::fs::remove_file(file(name)).expect("a file to remove");
    }
}

/// Makes a file of planes, row by row.
fn planes(
    path: &Path,
    side: usize,
    channels: usize,
    value: impl Fn(usize, f32, f32) -> f32,
) -> PlaneFile<2> {
    let mut file = PlaneFile::create(path, [side; 2], channels, 0).expect("a file in the folder");
    let mut row = vec![0.0; side];
    for c in 0..channels {
        for y in 0..side {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = value(c, x as f32, y as f32));
            file.write(c, [0, y], [side, 1], &row).expect("room for the planes");
        }
    }
    file
}
