//! `npsolve demo`: built-in pictures, or signals made on the spot, blended in front of the user's eyes.

mod signals;

use std::path::Path;

use anyhow::Result;
use poisson_loss::{Baseline, Guidance, Options, Patch, Problem, solve_baseline};
use signal_io::{Image, ReadOptions, WriteOptions, decode_image};

use crate::args::{DemoArgs, SceneArgs};
use crate::kind::SignalKind;
use crate::progress::Progress;
use crate::scene::{Scene, samples_of};
use crate::solve::{Settings, solve_scene};
use crate::values::GuidanceName;
use crate::{console, files};

const BACKGROUND: (&str, &[u8]) = ("coffee.jpg", include_bytes!("../assets/coffee.jpg"));
const PATCH: (&str, &[u8]) = ("cat.jpg", include_bytes!("../assets/cat.jpg"));
const MASK: (&str, &[u8]) = ("cat_mask.png", include_bytes!("../assets/cat_mask.png"));
/// Where the cat looks out of the picture's corner.
const PLACE: [f32; 2] = [420.0, 6.0];

const PASTE: &str = "paste.png";
const BLEND: &str = "blend.png";
const BESIDE: &str = "paste-and-blend.png";

/// Runs the command.
pub fn run(args: &DemoArgs, quiet: bool) -> Result<()> {
    files::make_folder(&args.output)?;
    if args.kind != SignalKind::Image {
        return signals::run(args.kind, &args.output, quiet);
    }
    let scene = scene()?;
    let settings = Settings {
        guidance: GuidanceName::Patch,
        // Invisible in 8 bits.
        options: Options { tolerance: 1e-4, ..Options::default() },
    };
    let mut progress = Progress::new(quiet);
    let solution = solve_scene(&scene, &settings, false, &mut |share| progress.update(share))?;
    drop(progress);

    for (name, bytes) in [BACKGROUND, PATCH, MASK] {
        files::write_bytes(&args.output.join(name), bytes, true)?;
    }
    let paste = scene.picture(pasted(&scene)?, false)?;
    let blend = scene.picture(solution.planes.clone(), false)?;
    let options = WriteOptions { force: true, ..WriteOptions::default() };
    for (name, picture) in
        [(PASTE, &paste), (BLEND, &blend), (BESIDE, &side_by_side(&paste, &blend)?)]
    {
        files::write(&args.output.join(name), picture, &options)?;
    }
    if quiet {
        return Ok(());
    }
    let length = solution.report.length.unwrap_or_default();
    console::print(&format!(
        "A cat's face ({} x {} pixels) went into a photograph of a cup of coffee ({} x {}).\n\
         Copied and pasted, it has a hard edge: the light of the two pictures differs.\n\
         Blended, it keeps its gradients and takes the colours of its surroundings; the picture\n\
         around it gives way over {length:.1} pixels. {} pixels took {:.2} seconds and {} iterations.\n",
        scene.patch.width(),
        scene.patch.height(),
        scene.background.width(),
        scene.background.height(),
        solution.report.region_samples.round(),
        solution.seconds,
        solution.report.iterations,
    ))?;
    console::print(&paths(&args.output))
}

fn paths(folder: &Path) -> String {
    let path = |name: &str| folder.join(name).display().to_string();
    format!(
        "\n  pasted       {}\n  blended      {}\n  both         {}\n\nThe same by hand, with your own pictures if you like:\n  \
         npsolve blend {} {} --mask {} --at 420,6 -o {}\n",
        path(PASTE),
        path(BLEND),
        path(BESIDE),
        path(BACKGROUND.0),
        path(PATCH.0),
        path(MASK.0),
        path("mine.png"),
    )
}

/// The demo's scene.
pub fn scene() -> Result<Scene> {
    let read = |(name, bytes): (&str, &[u8])| decode_image(name, bytes, &ReadOptions::default());
    let names = [BACKGROUND.0, PATCH.0].map(str::to_owned);
    let mask = Some((MASK.0.to_owned(), read(MASK)?));
    let place = SceneArgs { at: Some(PLACE.into()), ..SceneArgs::default() };
    Scene::new(names, [read(BACKGROUND)?, read(PATCH)?], mask, &place)
}

fn pasted(scene: &Scene) -> Result<Vec<f32>> {
    let (background, patch) = (samples_of(&scene.background, 0)?, samples_of(&scene.patch, 0)?);
    let region = scene.region();
    let problem = Problem::<2, 3> {
        background: &background,
        patch: Patch::Samples { samples: &patch, offset: scene.offset },
        region: &region,
        guidance: Guidance::Patch,
        options: Options::default(),
    };
    Ok(solve_baseline(&problem, Baseline::Paste)?.samples.as_planar().to_vec())
}

fn side_by_side(left: &Image, right: &Image) -> Result<Image> {
    let (w, h) = (left.width(), left.height());
    let rows = |image: &Image| -> Vec<Vec<f32>> {
        image.as_planar().chunks(w).map(<[f32]>::to_vec).collect()
    };
    let data = rows(left).into_iter().zip(rows(right)).flat_map(|(a, b)| [a, b].concat()).collect();
    let mut image = Image::new(2 * w, h, left.channels(), data)?;
    (image.sample, image.transfer) = (left.sample, left.transfer);
    Ok(image)
}
