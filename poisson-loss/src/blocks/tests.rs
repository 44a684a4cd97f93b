//! Blends in blocks against the same blends in memory.

use inr_core::{Domain, RasterMask, Samples, Unit};

use super::*;
use crate::{Objective, Patch, Problem, Strongest, solve};

/// A few times the default tolerance of the sweeps: what they leave, for values of order one.
const TOLERANCE: f32 = 5e-5;

fn path(name: &str) -> std::path::PathBuf {
    std::env::temp_dir().join(format!("npsolve-blocks-{}-{name}", std::process::id()))
}

fn picture<const C: usize>(shape: [usize; 2], phase: f32) -> Samples<2, C> {
    Samples::from_fn(Domain::unit(shape).unwrap(), |[x, y]| {
        std::array::from_fn(|c| {
            let c = c as f32 + phase;
            let slow = (0.011 * x + c).sin() + (0.017 * y - c).cos();
            0.5 + 0.2 * slow + 0.1 * (0.37 * x + 0.21 * y + c).sin() * (0.11 * x).cos()
        })
    })
}

/// A disc with a hole and a soft edge.
fn disc(shape: [usize; 2]) -> Samples<2, 1> {
    let middle = shape.map(|n| 0.5 * n as f32);
    let radius = 0.47 * shape[0].min(shape[1]) as f32;
    Samples::from_fn(Domain::unit(shape).unwrap(), |[x, y]| {
        let r = (x - middle[0]).hypot(y - middle[1]);
        [(radius - r).clamp(0.0, 1.0) * (r - 0.15 * radius).clamp(0.0, 1.0)]
    })
}

struct Case {
    background: Samples<2, 2>,
    patch: Samples<2, 2>,
    mask: Samples<2, 1>,
    offset: [isize; 2],
    guidance: Guidance<2, 2>,
    options: Options,
}

impl Case {
    fn new(whole: [usize; 2], patch: [usize; 2], offset: [isize; 2]) -> Self {
        let objective = Objective::Screened { length: Some(9.0), keep: None };
        Self {
            background: picture(whole, 0.3),
            patch: picture(patch, 1.9),
            mask: disc(patch),
            offset,
            guidance: Guidance::Patch,
            options: Options::with_objective(objective),
        }
    }

    fn in_memory(&self) -> Samples<2, 2> {
        let offset = self.offset.map(|v| v as f32);
        let lattice = Domain::new(self.mask.domain().shape(), [1.0; 2], offset, Unit::Sample);
        let problem = Problem {
            background: &self.background,
            patch: Patch::Samples { samples: &self.patch, offset },
            region: &RasterMask::new(lattice.unwrap(), self.mask.plane(0).to_vec()).unwrap(),
            guidance: self.guidance.clone(),
            options: self.options,
        };
        solve(&problem).unwrap().samples
    }

    fn problem(&self) -> BlockProblem<'_, 2, 2> {
        BlockProblem {
            background: &self.background,
            patch: &self.patch,
            mask: &self.mask,
            offset: self.offset,
            guidance: self.guidance.clone(),
            options: self.options,
        }
    }

    fn in_blocks(&self, max_memory: u64, name: &str) -> (Samples<2, 2>, BlockReport) {
        let mut out = Samples::zeros(*self.background.domain());
        let options = BlockOptions { max_memory, ..BlockOptions::default() };
        let state = path(name);
        let report = solve_in_blocks(&self.problem(), &options, &state, &mut out, &mut |at| {
            println!("{at:?}");
            true
        });
        assert!(!state.exists());
        (out, report.unwrap())
    }

    fn check(&self, max_memory: u64, name: &str) -> BlockReport {
        let (got, report) = self.in_blocks(max_memory, name);
        let want = self.in_memory();
        let pairs = got.as_planar().iter().zip(want.as_planar());
        let error = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{name}: off by {error:e}, {report:?}");
        assert!(error < TOLERANCE, "{name}: off by {error}, {report:?}");
        report
    }
}

#[test]
fn one_block_is_the_blend_in_memory() {
    let case = Case::new([150, 130], [90, 100], [31, 12]);
    let report = case.check(1 << 30, "one");
    assert_eq!((report.blocks, report.sweeps, report.coarse_step), (1, 1, 0));
}

/// Memory for blocks of about 150 samples and what is around them.
const LITTLE: u64 = 16 << 20;

#[test]
fn many_blocks_are_the_blend_in_memory() {
    let case = Case::new([700, 620], [560, 480], [60, 71]);
    let report = case.check(LITTLE, "many");
    assert!(report.blocks >= 9 && report.coarse_step > 0, "{report:?}");
    assert!(report.sweeps <= 12, "{report:?}");
}

#[test]
fn blocks_at_the_border_are_the_blend_in_memory() {
    // The patch reaches over two borders.
    let mut case = Case::new([520, 610], [560, 480], [-90, 200]);
    case.guidance = Guidance::Strongest(Strongest::Joint);
    case.check(LITTLE, "border");
}

#[test]
fn kept_colours_and_mixes_are_the_blend_in_memory() {
    let mut case = Case::new([600, 520], [560, 480], [20, 20]);
    case.guidance = Guidance::Mix { mu: 0.5, phi: 0.7 };
    case.options.objective = Objective::Screened { length: Some(5.0), keep: Some(40.0) };
    case.check(LITTLE, "keep");
}

#[test]
fn a_stopped_run_goes_on() {
    let case = Case::new([520, 500], [440, 400], [40, 50]);
    let options = BlockOptions { max_memory: LITTLE, ..BlockOptions::default() };
    let state = path("stopped");
    let mut out = Samples::zeros(*case.background.domain());
    let mut left = 7;
    let stopped = solve_in_blocks(&case.problem(), &options, &state, &mut out, &mut |at| {
        left -= usize::from(at.stage == BlockStage::Blocks);
        left > 0
    });
    assert_eq!(stopped, Err(Error::Stopped));
    let mut first = None;
    let done = solve_in_blocks(&case.problem(), &options, &state, &mut out, &mut |at| {
        if at.stage == BlockStage::Blocks {
            first.get_or_insert((at.sweep, at.block));
        }
        true
    });
    let blocks = done.unwrap().blocks;
    assert_eq!(first, Some((7 / blocks, 7 % blocks + 1)));
    assert!(out == case.in_blocks(LITTLE, "whole").0);
}

#[test]
fn a_run_stopped_while_writing_only_writes() {
    let case = Case::new([520, 500], [440, 400], [40, 50]);
    let options = BlockOptions { max_memory: LITTLE, ..BlockOptions::default() };
    let state = path("writing");
    let mut out = Samples::zeros(*case.background.domain());
    let run = |options: &BlockOptions, go_on: fn(BlockStage) -> bool, out: &mut Samples<2, 2>| {
        let mut stages = Vec::new();
        let done = solve_in_blocks(&case.problem(), options, &state, out, &mut |at| {
            stages.push(at.stage);
            go_on(at.stage)
        });
        (done, stages)
    };
    let (stopped, _) = run(&options, |stage| stage != BlockStage::Result, &mut out);
    assert_eq!(stopped, Err(Error::Stopped));
    // Another problem of the same shape has to be solved.
    let other = BlockOptions { fingerprint: 1, ..options };
    let kept = std::fs::read(&state).unwrap();
    let (stopped, stages) = run(&other, |_| false, &mut out);
    assert_eq!((stopped, stages), (Err(Error::Stopped), vec![BlockStage::Correction]));
    std::fs::write(&state, kept).unwrap();
    let (done, stages) = run(&options, |_| true, &mut out);
    assert!(done.unwrap().change <= options.tolerance);
    assert!(stages.iter().all(|stage| *stage == BlockStage::Result), "{stages:?}");
    assert!(out == case.in_blocks(LITTLE, "written-at-once").0);
}

/// Takes whole rows in order alone.
struct FromTheTop(Samples<2, 2>, [usize; 2]);

impl BlockSink<2> for FromTheTop {
    fn write(
        &mut self,
        channel: usize,
        start: [usize; 2],
        shape: [usize; 2],
        values: &[f32],
    ) -> std::io::Result<()> {
        assert_eq!((channel, start), (self.1[0], [0, self.1[1]]));
        assert_eq!(shape[0], self.0.domain().shape()[0]);
        self.1 = if channel == 1 { [0, start[1] + shape[1]] } else { [1, start[1]] };
        self.0.write(channel, start, shape, values)
    }
}

#[test]
fn results_in_whole_rows_are_the_same() {
    let case = Case::new([330, 500], [300, 400], [-20, 50]);
    let options = BlockOptions { max_memory: LITTLE, whole_rows: true, ..BlockOptions::default() };
    let mut out = FromTheTop(Samples::zeros(*case.background.domain()), [0, 0]);
    let state = path("rows");
    let done = solve_in_blocks(&case.problem(), &options, &state, &mut out, &mut |_| true);
    assert!(done.unwrap().blocks > 1);
    assert_eq!(out.1, [0, 500]);
    let expected = case.in_blocks(LITTLE, "blocks").0;
    let pairs = out.0.as_planar().iter().zip(expected.as_planar());
    let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // The halo's last weights, and rounding.
    assert!(largest < 1e-5, "{largest}");
    let less = BlockOptions { max_memory: 1 << 20, ..options };
    let refused = solve_in_blocks(&case.problem(), &less, &state, &mut out.0, &mut |_| true);
    assert!(matches!(refused, Err(Error::Memory { .. })), "{refused:?}");
}

#[test]
fn results_do_not_depend_on_the_threads() {
    let case = Case::new([420, 400], [380, 360], [10, 20]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| case.in_blocks(LITTLE, &format!("threads-{threads}")).0)
    };
    assert!(with(1) == with(3));
}

#[test]
fn plain_files_hold_planes() {
    let (file, samples) = (path("planes"), picture::<3>([23, 17], 0.0));
    let mut planes = PlaneFile::create(&file, [23, 17], 3, 10).unwrap();
    for c in 0..3 {
        planes.write(c, [0, 0], [23, 17], samples.plane(c)).unwrap();
    }
    let planes = PlaneFile::open(&file, [23, 17], 3, 10).unwrap();
    let (mut got, mut want) = (vec![0.0; 40], vec![0.0; 40]);
    planes.read(2, [7, 3], [5, 8], &mut got).unwrap();
    samples.read(2, [7, 3], [5, 8], &mut want).unwrap();
    assert_eq!(got, want);
    assert!(PlaneFile::<2>::open(&file, [23, 18], 3, 10).is_err());
    std::fs::remove_file(file).unwrap();
}

#[test]
fn what_blocks_cannot_do_is_refused() {
    let mut case = Case::new([100, 90], [60, 50], [10, 20]);
    let state = path("refused");
    let solve = |case: &Case, max_memory| {
        let mut out = Samples::<2, 2>::zeros(*case.background.domain());
        let options = BlockOptions { max_memory, ..BlockOptions::default() };
        solve_in_blocks(&case.problem(), &options, &state, &mut out, &mut |_| true).unwrap_err()
    };
    assert!(matches!(solve(&case, 1000), Error::Memory { given: 1000, .. }));
    case.options.objective = Objective::Dirichlet;
    assert!(matches!(solve(&case, 1 << 30), Error::Parameter { .. }));
}
