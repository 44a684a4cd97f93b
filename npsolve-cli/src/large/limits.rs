//! What blends in blocks can do, and the least memory that they take.

use anyhow::{Result, anyhow, bail};
use poisson_loss::BlockOptions;
use signal_io::{PictureInfo, Transfer};

use super::input::{BAND, Streamed};
use crate::args::{BlendArgs, BlendField, ObjectiveName, SceneArgs, ValueDomain};
use crate::field_file::is_network_name;
use crate::kind::{self, SignalKind};
use crate::scene;
use crate::values::Shape;

/// The program itself, its threads and the buffers of readers and writers. Measured: about 20 MiB.
pub const PROGRAM: u64 = 32 << 20;
/// Copies of a band of rows while it is converted and encoded.
const COPIES: u64 = 8;

/// Refuses options that blocks do not have.
pub fn check_options(args: &BlendArgs) -> Result<()> {
    let kind = args.scene.kind.unwrap_or_else(|| kind::of(&args.background));
    let networks = [&args.background, &args.patch, &args.output].map(|p| is_network_name(p));
    let (scene, solve) = (&args.scene, &args.solve);
    let refused: [(bool, &str); 15] = [
        (kind != SignalKind::Image, "other signals than pictures"),
        (networks.contains(&true), "fields in .safetensors files"),
        (args.field.is_some_and(|f| f != BlendField::Spline), "--field"),
        (args.budget.is_some() || args.steps.is_some(), "--budget and --steps"),
        (args.table_rows.is_some(), "--table-rows"),
        (args.objective != ObjectiveName::Screened, "--objective other than screened"),
        (solve.ramp, "--ramp"),
        (solve.band, "--band"),
        (solve.feather > 0.0, "--feather"),
        (!args.with.is_empty(), "--with"),
        (args.metrics.is_some(), "--metrics, which needs the whole result in memory"),
        (!scene.layers.is_empty(), "--layers"),
        (scene.match_range, "--match-range"),
        (
            matches!(scene.domain, Some(ValueDomain::Log | ValueDomain::Normalize)),
            "--domain log and normalize",
        ),
        (matches!(scene.region, Some(Shape::Mesh(_))), "a mesh as --region"),
    ];
    match refused.iter().find(|(given, _)| *given) {
        Some((_, what)) => {
            bail!(
                "--max-memory blends in blocks and does not have {what}; leave one of the two out"
            )
        }
        None if scene.from.is_some() || scene.to.is_some() => {
            bail!(
                "--from and --to are for sound; choose a part of the patch with --mask or --region"
            )
        }
        None => Ok(()),
    }
}

/// The patch's place, which has no fractions here.
pub fn whole_offset(
    infos: &[PictureInfo; 2],
    args: &SceneArgs,
    names: &[String; 2],
) -> Result<[isize; 2]> {
    let sizes = infos.each_ref().map(|i| [i.width, i.height]);
    let offset = scene::place(sizes, args, names)?;
    if offset.iter().any(|v| v.fract() != 0.0) {
        let [x, y] = offset;
        bail!(
            "the patch would go to {x},{y}, and --max-memory moves it by whole pixels only; round \
             --at or --center, or leave --max-memory out"
        );
    }
    Ok(offset.map(|v| v as isize))
}

/// Light beyond 1 is blended in logarithms unless something else is asked for.
pub fn check_domain(
    args: &BlendArgs,
    info: &PictureInfo,
    background: &Streamed,
    name: &str,
) -> Result<()> {
    let light = info.transfer == Transfer::Linear && background.low >= 0.0;
    if args.scene.domain.is_none() && light && background.high > 1.0 {
        bail!(
            "{name} holds light up to {}, which is blended in logarithms, and --max-memory does not have \
             that; choose other values with --domain linear or --domain srgb",
            background.high
        );
    }
    Ok(())
}

/// What of the limit is left for the blocks.
///
/// # Errors
/// Where it is too little, with the least that would do.
pub fn for_blocks(
    limit: u64,
    info: &PictureInfo,
    options: &BlockOptions,
    channels: usize,
) -> Result<u64> {
    let rest = beside_blocks(info);
    let needed = options.least_memory([info.width, info.height], channels);
    match limit.checked_sub(rest) {
        Some(left) if left >= needed => Ok(left),
        _ => Err(too_little(limit, needed + rest)),
    }
}

/// What the program takes beside the blocks: itself, and a band of rows.
fn beside_blocks(info: &PictureInfo) -> u64 {
    let row = info.width * info.channels.len();
    PROGRAM + COPIES * 4 * row.max(BAND) as u64
}

/// The error that names the least that would do.
pub fn too_little(limit: u64, needed: u64) -> anyhow::Error {
    let least = needed.div_ceil(1 << 20);
    anyhow!("--max-memory of {limit} bytes is too little for these pictures; {least}M is the least")
}
