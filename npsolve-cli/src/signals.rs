//! Blends of sound, volumes, videos and light fields: what they have in common.

pub mod audio;
pub mod field;
pub mod light_field;
mod spectrogram;
pub mod video;
pub mod volume;

use std::path::Path;

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask, Region, Translated};
use poisson_loss::{Baseline, Objective, Options};
use signal_io::{Image, ReadOptions, SampleType};

use crate::args::{BlendArgs, SceneArgs, ValueDomain};
use crate::blend::{TOLERANCE, check_metrics};
use crate::channels::{Axes, Channels};
use crate::field_file::is_network_name;
use crate::kind::SignalKind;
use crate::progress::Progress;
use crate::solve::{Planes, Settings, Setup, Solution};
use crate::value_domain::{Mapping, match_range};
use crate::{files, mask};
use field::Notes;

/// Runs `npsolve blend` for a kind of signal that is not a picture.
pub fn blend(kind: SignalKind, args: &BlendArgs, quiet: bool) -> Result<()> {
    if args.field.is_some() || is_network_name(&args.output) {
        bail!(
            "--field and .safetensors results are for pictures; {} is blended exactly",
            kind.noun()
        );
    }
    if !args.scene.layers.is_empty() || !args.with.is_empty() {
        bail!("--layers and --with are for pictures; leave them out for {}", kind.noun());
    }
    if args.scene.center.is_some() {
        bail!("--center is for pictures; say where the first sample goes with --at");
    }
    check_metrics(args)?;
    match kind {
        SignalKind::Image => bail!("pictures have their own command"),
        SignalKind::Audio => audio::blend(args, quiet),
        SignalKind::Volume => volume::blend(args, quiet),
        SignalKind::Video => video::blend(args, quiet),
        SignalKind::Lightfield => light_field::blend(args, quiet),
    }
}

/// One plane of values after the other, on a lattice.
pub struct Plain<const D: usize> {
    /// The lattice.
    pub domain: Domain<D>,
    /// The planes.
    pub values: Vec<f32>,
}

/// A signal over `D` axes, as it is in its file.
pub trait Signal<const D: usize>: Sized {
    /// The values on their lattice, without alpha.
    fn plain(&self) -> Result<Plain<D>>;

    /// A signal like this one with other values.
    fn with_values(&self, values: &[f32]) -> Result<Self>;

    /// Writes it.
    fn save(&self, path: &Path, force: bool) -> Result<()>;

    /// What the names of files end in that hold such signals.
    fn ending(&self) -> &'static str;

    /// A picture of it through a sample; what is black and white is that of `like`.
    fn picture(&self, at: [usize; D], like: &Self) -> Result<Image>;

    /// What a network's file has to say so that the signal can be made of its values again.
    fn notes(&self) -> Notes;

    /// A signal of values on a lattice. Notes may be missing or damaged: what they should say is the usual then.
    fn from_values(
        notes: &Notes,
        domain: Domain<D>,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self>;

    /// Name and size in bytes of the number type of its file.
    fn number_type(&self) -> (&'static str, usize);
}

/// Two signals of one kind, and where one goes in the other.
pub struct Scene<S, const D: usize> {
    /// Both files.
    pub names: [String; 2],
    /// The signal that results are like.
    pub background: S,
    /// The blend.
    pub job: Job<D>,
    /// Where the patch's first sample goes, in samples.
    pub place: [f64; D],
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl<S, const D: usize> Scene<S, D> {
    /// Sizes of background and patch.
    pub fn sizes(&self) -> [Vec<usize>; 2] {
        [&self.job.background, &self.job.patch].map(|p| p.domain.shape().to_vec())
    }
}

/// A blend of two signals with the same channels.
pub struct Job<const D: usize> {
    names: [String; 2],
    /// The background's values as they are stored.
    stored: Vec<f32>,
    background: Plain<D>,
    patch: Plain<D>,
    mask: RasterMask<D>,
    offset: [f32; D],
    /// From stored values to those that are blended.
    pub mapping: Mapping,
}

impl<const D: usize> Job<D> {
    /// A blend in the values that `domain` says; `offset` is in the units of both lattices.
    pub fn new(
        names: &[String; 2],
        background: Plain<D>,
        mut patch: Plain<D>,
        mask: RasterMask<D>,
        offset: [f32; D],
        domain: ValueDomain,
        args: &SceneArgs,
    ) -> Result<Self> {
        for (plain, name) in [(&background, &names[0]), (&patch, &names[1])] {
            check_finite(plain, name)?;
        }
        let channels = [&background, &patch].map(|p| p.values.len() / p.domain.len());
        if channels[0] != channels[1] {
            let [b, p] = channels;
            bail!(
                "{} has {b} channels and {} has {p}; give both the same number",
                names[0],
                names[1]
            );
        }
        if args.match_range {
            match_range(&mut patch.values, &background.values);
        }
        let mapping = match domain {
            ValueDomain::Stored => Mapping::Identity,
            ValueDomain::Linear | ValueDomain::Srgb => {
                bail!("--domain linear and srgb are for pictures; take stored, log or normalize")
            }
            ValueDomain::Log => Mapping::log(&background.values, &patch.values, names)?,
            ValueDomain::Normalize => Mapping::range(&background.values),
        };
        let stored = background.values;
        let background = Plain { domain: background.domain, values: mapping.forward(&stored) };
        let patch = Plain { domain: patch.domain, values: mapping.forward(&patch.values) };
        Ok(Self { names: names.clone(), stored, background, patch, mask, offset, mapping })
    }

    /// The region in the background's coordinates.
    pub fn region(&self) -> impl Region<D> + '_ {
        Translated { region: &self.mask, offset: self.offset }
    }

    /// Solves it; the planes are in stored values again.
    pub fn solve(&self, settings: &Settings, with_metrics: bool, quiet: bool) -> Result<Solution>
    where
        Axes<D>: Channels,
    {
        let region = self.region();
        let mut progress = Progress::new(quiet);
        let update = &mut |share| progress.update(share);
        let mut solution = self.setup(&region).solve(settings, with_metrics, update)?;
        self.to_stored(&mut solution.planes);
        Ok(solution)
    }

    /// What a plain copy looks like: the patch's values in the region, the background's elsewhere.
    pub fn paste(&self, settings: &Settings) -> Result<Vec<f32>>
    where
        Axes<D>: Channels,
    {
        let region = self.region();
        let mut planes = self.setup(&region).baseline(settings, Baseline::Paste)?;
        self.to_stored(&mut planes);
        Ok(planes)
    }

    /// Every picture (frame, view) blended for itself: what dimensions beyond the second are compared with. The patch's
    /// pictures go to the nearest whole picture.
    pub fn one_by_one(&self, settings: &Settings) -> Result<Vec<f32>> {
        let (b, p) = (&self.background.domain, &self.patch.domain);
        let flat = |d: &Domain<D>| Domain::unit([d.shape()[0], d.shape()[1]]);
        let (flat_b, flat_p) = (flat(b)?, flat(p)?);
        let channels = self.stored.len() / b.len();
        let mut planes = self.background.values.clone();
        for picture in 0..p.len() / flat_p.len() {
            let index = p.unflatten(picture * flat_p.len());
            let to: [f64; D] = std::array::from_fn(|d| {
                index[d] as f64 + f64::from(self.offset[d] / b.pitch()[d]).round()
            });
            if (2..D).any(|d| to[d] < 0.0 || to[d] >= b.shape()[d] as f64) {
                continue;
            }
            let target: usize = (2..D).map(|d| to[d] as usize * b.strides()[d]).sum();
            let part = |values: &[f32], n: usize, start: usize, len: usize| -> Vec<f32> {
                (0..channels).flat_map(|c| values[c * n + start..][..len].to_vec()).collect()
            };
            let source = picture * flat_p.len();
            let weights = self.mask.weights()[source..source + flat_p.len()].to_vec();
            if weights.iter().all(|w| *w == 0.0) {
                continue;
            }
            let background = part(&self.background.values, b.len(), target, flat_b.len());
            let patch = part(&self.patch.values, p.len(), source, flat_p.len());
            let mask = RasterMask::new(flat_p, weights)?;
            let offset = [self.offset[0], self.offset[1]];
            let setup = Setup {
                background: Planes { domain: flat_b, values: &background },
                patch: Planes { domain: flat_p, values: &patch },
                region: &Translated { region: &mask, offset },
                offset,
                names: &self.names,
            };
            let solved = setup.solve(settings, false, &mut |_| {})?.planes;
            for c in 0..channels {
                planes[c * b.len() + target..][..flat_b.len()]
                    .copy_from_slice(&solved[c * flat_b.len()..(c + 1) * flat_b.len()]);
            }
        }
        self.to_stored(&mut planes);
        Ok(planes)
    }

    /// From blended values to stored ones; the background's stay exactly what they were.
    pub fn to_stored(&self, planes: &mut [f32]) {
        self.mapping.back(&self.stored, &self.background.values, planes);
    }

    /// The sample in the middle of the region's box, in the background.
    pub fn middle(&self) -> [usize; D] {
        let (mask, b) = (self.mask.domain(), &self.background.domain);
        let (mut low, mut high) = ([usize::MAX; D], [0; D]);
        for (k, _) in self.mask.weights().iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let index = mask.unflatten(k);
            low = std::array::from_fn(|d| low[d].min(index[d]));
            high = std::array::from_fn(|d| high[d].max(index[d]));
        }
        std::array::from_fn(|d| {
            let middle = 0.5 * (low[d] as f32 + high[d] as f32) + self.offset[d] / b.pitch()[d];
            middle.clamp(0.0, (b.shape()[d] - 1) as f32) as usize
        })
    }

    /// The problem; `region` is [`Job::region`].
    pub fn setup<'a>(&'a self, region: &'a dyn Region<D>) -> Setup<'a, D> {
        let planes = |p: &'a Plain<D>| Planes { domain: p.domain, values: &p.values };
        Setup {
            background: planes(&self.background),
            patch: planes(&self.patch),
            region,
            offset: self.offset,
            names: &self.names,
        }
    }

    /// How much the correction that a blend adds to a copy changes from picture to picture along some axes (of 2 or
    /// more), as a root mean square over the samples that the copy changes: what differs from frame to frame
    /// flickers, what differs from view to view pulls the lines of epipolar slices apart.
    pub fn unsteadiness(
        &self,
        blended: &[f32],
        pasted: &[f32],
        axes: std::ops::Range<usize>,
    ) -> f64 {
        let shape = self.background.domain.shape();
        let inside = |k: usize| pasted[k] != self.stored[k];
        let correction = |k: usize| f64::from(blended[k]) - f64::from(pasted[k]);
        let (mut sum, mut count) = (0.0, 0usize);
        for axis in axes {
            let step: usize = shape[..axis].iter().product();
            for k in 0..blended.len() {
                if k / step % shape[axis] + 1 < shape[axis] && inside(k) && inside(k + step) {
                    sum += (correction(k + step) - correction(k)).powi(2);
                    count += 1;
                }
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }
}

/// Refuses values that are not finite.
pub fn check_finite<const D: usize>(plain: &Plain<D>, name: &str) -> Result<()> {
    let Some(k) = plain.values.iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let n = plain.domain.len();
    bail!(
        "{name} holds {} at sample {:?} of channel {}; replace such values first",
        plain.values[k],
        plain.domain.unflatten(k % n),
        k / n
    )
}

/// The solver's settings; lengths of the command line are in the units of the lattice.
fn settings(args: &BlendArgs) -> Settings {
    let options = args.solve.options(args.objective, TOLERANCE);
    Settings { guidance: args.solve.guidance, options }
}

/// The same with lengths that are in other units: `scale` of them are one unit of the lattice.
pub fn scaled(options: Options, scale: f32) -> Options {
    let scaled = |v: Option<f32>| v.map(|v| v * scale);
    let objective = match options.objective {
        Objective::Screened { length, keep } => {
            Objective::Screened { length: scaled(length), keep: scaled(keep) }
        }
        other => other,
    };
    Options { objective, feather: options.feather * scale, ..options }
}

/// Weights from a picture for every frame or view of `count` pictures below each other, or for all of them.
pub fn repeated_mask(path: &Path, width: usize, height: usize, count: usize) -> Result<Vec<f32>> {
    let name = path.display().to_string();
    let image =
        signal_io::read_image(path, &ReadOptions::default()).map_err(files::in_our_words)?;
    let weights = mask::weights_of(&image, &name)?;
    check_weights(&weights, &name)?;
    match (image.width(), image.height()) {
        (w, h) if (w, h) == (width, height) => Ok(weights.repeat(count)),
        (w, h) if (w, h) == (width, height * count) => Ok(weights),
        (w, h) => bail!(
            "the mask {name} is {w} x {h} pixels; the patch's pictures are {width} x {height}"
        ),
    }
}

/// Weights from 0 to 1, not all 0.
pub fn check_weights(weights: &[f32], name: &str) -> Result<()> {
    if let Some(bad) = weights.iter().find(|w| !(0.0..=1.0).contains(*w)) {
        bail!("the mask {name} holds {bad}; weights lie between 0 (out) and 1 (in)");
    }
    if weights.iter().all(|w| *w == 0.0) {
        bail!("the mask {name} is empty: nothing is to be pasted; paint what to paste white");
    }
    Ok(())
}

/// Name and size in bytes of a number type of pictures.
pub fn number_type(sample: SampleType) -> (&'static str, usize) {
    let bytes = match sample {
        SampleType::U8 => 1,
        SampleType::U16 | SampleType::F16 => 2,
        SampleType::F32 => 4,
    };
    (sample.name(), bytes)
}

/// The colour planes of pictures below each other, and the alpha plane.
pub fn split_alpha(strip: &Image) -> (Vec<f32>, Option<Vec<f32>>) {
    let colors = strip.channels().iter().enumerate().filter(|(_, name)| *name != "A");
    let values = colors.flat_map(|(c, _)| strip.plane(c).iter().copied()).collect();
    (values, strip.alpha().map(<[f32]>::to_vec))
}

/// New colours in pictures below each other.
pub fn with_colors(strip: &Image, values: &[f32]) -> Image {
    let mut out = strip.clone();
    let n = strip.pixel_count();
    let colors: Vec<usize> =
        (0..strip.channels().len()).filter(|c| strip.channels()[*c] != "A").collect();
    for (k, c) in colors.into_iter().enumerate() {
        out.as_planar_mut()[c * n..(c + 1) * n].copy_from_slice(&values[k * n..(k + 1) * n]);
    }
    out
}
