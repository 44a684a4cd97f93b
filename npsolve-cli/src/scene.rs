//! A problem from files: pictures with equal channels, a mask and a place.

use std::path::Path;

use anyhow::{Context, Result, bail};
use inr_core::{Network, RasterMask, Region, Samples, Translated};
use signal_io::{Image, Transfer};

use crate::args::{SceneArgs, ValueDomain};
use crate::field_file::{self, FieldFile};
use crate::files;
use crate::layers::{self, Chosen};
use crate::mask;
use crate::shapes::{self, InSamples};
use crate::solve::{Planes, Setup};
use crate::value_domain::{Mapping, match_range};

/// Everything a blend needs, checked: both pictures have the same colour channels in one encoding.
pub struct Scene {
    /// The colour channels of the background, in the values to blend.
    pub background: Image,
    /// From the background's own values to those to blend.
    pub mapping: Mapping,
    /// The background's own values, where those to blend are others.
    stored: Option<Vec<f32>>,
    /// The whole background, where only some of its layers are blended.
    whole: Option<Image>,
    /// The background's alpha, which the result gets.
    pub alpha: Option<Vec<f32>>,
    /// The colour channels of the patch.
    pub patch: Image,
    /// Which part of the patch takes part, in the patch's own pixels.
    pub mask: RasterMask<2>,
    /// Where the patch's first pixel goes.
    pub offset: [f32; 2],
    /// The names of both pictures, for messages.
    pub names: [String; 2],
    /// The checkpoints that background and patch came from, where their values are still the networks'.
    pub networks: [Option<Vec<u8>>; 2],
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Reads the files.
    pub fn read(background: &Path, patch: &Path, args: &SceneArgs) -> Result<Self> {
        let names = [background, patch].map(|p| p.display().to_string());
        let files = [FieldFile::read(background)?, FieldFile::read(patch)?];
        let bytes = files.each_ref().map(FieldFile::network_bytes);
        let [b, p] = files;
        let pictures = [b.into_picture(background)?, p.into_picture(patch)?];
        let planes = pictures.each_ref().map(|p| p.as_planar().to_vec());
        let mask = match &args.mask {
            Some(path) => Some((path.display().to_string(), files::read_any(path)?)),
            None => None,
        };
        let mut args = args.clone();
        if bytes.iter().any(Option::is_some) {
            // Networks are what they are; a conversion has to be asked for.
            args.domain = args.domain.or(Some(ValueDomain::Stored));
        }
        let mut scene = Self::new(names, pictures, mask, &args)?;
        // Conversions leave values that are no longer the networks'.
        let now = [scene.background.as_planar(), scene.patch.as_planar()];
        let kept: Vec<bool> = (0..2).map(|k| now[k] == planes[k]).collect();
        scene.networks = bytes;
        (0..2).filter(|k| !kept[*k]).for_each(|k| scene.networks[k] = None);
        Ok(scene)
    }

    /// Matches pictures that are in memory; `names` stand for them in messages.
    pub fn new(
        names: [String; 2],
        [background, patch]: [Image; 2],
        mask: Option<(String, Image)>,
        args: &SceneArgs,
    ) -> Result<Self> {
        let mut warnings = Vec::new();
        let (background, alpha) = background.split_alpha();
        let (patch, patch_alpha) = patch.split_alpha();
        let Chosen { mut background, mut patch, whole } =
            layers::choose(background, patch, &args.layers, &names)?;
        if args.gray && whole.is_some() {
            bail!("--gray would leave the other layers of {} in colour; leave it out", names[0]);
        }
        if args.gray {
            background = to_gray(&background, &names[0])?;
            patch = to_gray(&patch, &names[1])?;
        }
        let domain = args.domain.unwrap_or_else(|| usual_domain(&background));
        match_transfers(&mut background, &mut patch, domain, &names, &mut warnings);
        let mut patch = match_channels(&background, patch, &names)?;
        if args.match_range {
            match_range(patch.as_planar_mut(), background.as_planar());
        }
        let mapped = mapping(domain, background.as_planar(), patch.as_planar(), &names);
        // Nobody asked for the logarithm where it is only the usual choice.
        let mapping =
            if args.domain.is_none() { mapped.unwrap_or(Mapping::Identity) } else { mapped? };
        let stored = (mapping != Mapping::Identity).then(|| background.as_planar().to_vec());
        for image in [&mut background, &mut patch] {
            let values = mapping.forward(image.as_planar());
            image.as_planar_mut().copy_from_slice(&values);
        }
        let mask = match (&args.region, mask, patch_alpha) {
            (Some(shape), _, _) => shapes::mask(shape, patch.domain(), &InSamples)?,
            (None, Some((name, image)), _) => {
                mask::from_image(&image, &name, &patch, &mut warnings)?
            }
            (None, None, Some(alpha)) => mask::from_alpha(alpha, &names[1], &patch)?,
            (None, None, None) => RasterMask::new(patch.domain(), vec![1.0; patch.pixel_count()])?,
        };
        let sizes = [&background, &patch].map(|image| [image.width(), image.height()]);
        let offset = place(sizes, args, &names)?;
        let networks = [None, None];
        Ok(Self {
            background,
            mapping,
            stored,
            whole,
            alpha,
            patch,
            mask,
            offset,
            names,
            networks,
            warnings,
        })
    }

    /// Number of colour channels.
    pub fn channels(&self) -> usize {
        self.background.channels().len()
    }

    /// The region in the background's pixels.
    pub fn region(&self) -> Translated<&RasterMask<2>, 2> {
        Translated { region: &self.mask, offset: self.offset }
    }

    /// The problem; `region` is [`Scene::region`].
    pub fn setup<'a>(&'a self, region: &'a dyn Region<2>) -> Setup<'a, 2> {
        let planes =
            |image: &'a Image| Planes { domain: image.domain(), values: image.as_planar() };
        Setup {
            background: planes(&self.background),
            patch: planes(&self.patch),
            region,
            offset: self.offset,
            names: &self.names,
        }
    }

    /// The network of the background (0) or the patch (1), if it is one on the picture's own lattice.
    pub fn network<const C: usize>(&self, which: usize) -> Result<Option<Network<2, C>>> {
        let Some(bytes) = &self.networks[which] else { return Ok(None) };
        let checkpoint = field_file::checkpoint::<2, C>(Path::new(&self.names[which]), bytes)?;
        let image = if which == 0 { &self.background } else { &self.patch };
        Ok((checkpoint.domain == image.domain()).then_some(checkpoint.network))
    }

    /// Somebody else's result with this scene's channels and encoding.
    pub fn like_background(&self, path: &Path, gray: bool) -> Result<Image> {
        let name = path.display().to_string();
        let (mut image, _) = files::read(path)?.split_alpha();
        let (b, (w, h)) = (&self.background, (image.width(), image.height()));
        if (w, h) != (b.width(), b.height()) {
            let (bw, bh) = (b.width(), b.height());
            bail!("{name} is {w} x {h} pixels; a result has the background's {bw} x {bh}");
        }
        if gray {
            image = to_gray(&image, &name)?;
        }
        let image = image.to_transfer(b.transfer);
        let mut image = match_channels(b, image, &[self.names[0].clone(), name])?;
        let values = self.mapping.forward(image.as_planar());
        image.as_planar_mut().copy_from_slice(&values);
        Ok(image)
    }

    /// A picture of the background's kind with these blended planes, back in the background's values; if wanted with its alpha
    /// and its other layers.
    pub fn picture(&self, mut planes: Vec<f32>, with_alpha: bool) -> Result<Image> {
        let mut image = self.background.clone();
        if let Some(stored) = &self.stored {
            self.mapping.back(stored, self.background.as_planar(), &mut planes);
        }
        image.as_planar_mut().copy_from_slice(&planes);
        // Comparisons look at what was blended; results are whole.
        if let Some(whole) = self.whole.as_ref().filter(|_| with_alpha) {
            image = layers::put_back(whole, &image);
        }
        match &self.alpha {
            Some(alpha) if with_alpha => Ok(image.with_alpha(alpha)?),
            _ => Ok(image),
        }
    }
}

/// `C` channels of a picture from channel `first` on.
pub fn samples_of<const C: usize>(image: &Image, first: usize) -> Result<Samples<2, C>> {
    let n = image.pixel_count();
    let planes = &image.as_planar()[first * n..(first + C) * n];
    Ok(Samples::from_planar(image.domain(), planes.to_vec())?)
}

pub fn to_gray(image: &Image, name: &str) -> Result<Image> {
    image.to_gray().with_context(|| {
        let n = image.channels().len();
        format!("{name} has {n} colour channels; --gray works on 1 or 3, so leave it out")
    })
}

/// What `--domain` is when nothing is said: ratios for light beyond the range of screens.
fn usual_domain(background: &Image) -> ValueDomain {
    let values = background.as_planar();
    let is_light = background.transfer == Transfer::Linear && values.iter().all(|v| *v >= 0.0);
    match is_light && values.iter().any(|v| *v > 1.0) {
        true => ValueDomain::Log,
        false => ValueDomain::Stored,
    }
}

/// The change of values after both pictures have one encoding.
fn mapping(
    domain: ValueDomain,
    background: &[f32],
    patch: &[f32],
    names: &[String; 2],
) -> Result<Mapping> {
    Ok(match domain {
        ValueDomain::Stored | ValueDomain::Linear | ValueDomain::Srgb => Mapping::Identity,
        ValueDomain::Log => Mapping::log(background, patch, names)?,
        ValueDomain::Normalize => Mapping::range(background),
    })
}

/// Brings both pictures into the encoding to blend in.
pub fn match_transfers(
    background: &mut Image,
    patch: &mut Image,
    domain: ValueDomain,
    names: &[String; 2],
    warnings: &mut Vec<String>,
) {
    let wanted = match domain {
        ValueDomain::Linear | ValueDomain::Log => Transfer::Linear,
        ValueDomain::Srgb => Transfer::Srgb,
        ValueDomain::Stored | ValueDomain::Normalize => {
            if patch.transfer != background.transfer {
                // Only the label changes where one of the two is not specified.
                *patch = patch.to_transfer(background.transfer);
            }
            return;
        }
    };
    for (image, name) in [(&mut *background, &names[0]), (&mut *patch, &names[1])] {
        match image.transfer {
            Transfer::Unspecified => warnings.push(format!(
                "{name} does not say how its values relate to light; they are taken as {}",
                if wanted == Transfer::Linear { "linear" } else { "sRGB" }
            )),
            _ => *image = image.to_transfer(wanted),
        }
    }
}

/// Gives the patch the background's channels.
pub fn match_channels(background: &Image, patch: Image, names: &[String; 2]) -> Result<Image> {
    let wanted: Vec<&str> = background.channels().iter().map(String::as_str).collect();
    let (b, p) = (wanted.len(), patch.channels().len());
    if b == p {
        // Files may order their channels differently; channels without names stay as they are.
        return Ok(patch.select(&wanted).unwrap_or(patch));
    }
    match (b, p) {
        (3, 1) => Ok(patch.to_rgb()?),
        (1, 3) => bail!(
            "{} is grey and {} has 3 colour channels; add --gray to blend its luminance, \
             or convert the background to RGB",
            names[0],
            names[1]
        ),
        _ => bail!(
            "{} has {b} colour channels and {} has {p}; give both the same number",
            names[0],
            names[1]
        ),
    }
}

/// The offset of the patch, such that it meets the background; from the sizes of both.
pub fn place([b, p]: [[usize; 2]; 2], args: &SceneArgs, names: &[String; 2]) -> Result<[f32; 2]> {
    let sizes = || {
        let ([bw, bh], [pw, ph]) = (b, p);
        format!("{} is {bw} x {bh} pixels, {} {pw} x {ph}", names[0], names[1])
    };
    let pixels = |place| shapes::position::<2>(place, &InSamples).map(|at| at.map(|v| v as f32));
    let offset = match (&args.at, &args.center) {
        (Some(at), _) => pixels(at)?,
        (None, Some(center)) => {
            let center = pixels(center)?;
            std::array::from_fn(|d| center[d] - (p[d] / 2) as f32)
        }
        (None, None) if b == p => [0.0; 2],
        (None, None) => {
            bail!("{}: say where the patch goes with --at X,Y or --center X,Y", sizes())
        }
    };
    let meets =
        (0..2).all(|d| offset[d] <= b[d] as f32 - 0.5 && offset[d] + p[d] as f32 - 0.5 >= 0.0);
    if !meets {
        let [x, y] = offset;
        bail!(
            "the patch lies wholly outside the background: {}, and its top-left pixel goes to \
             {x},{y}; change --at or --center",
            sizes()
        );
    }
    Ok(offset)
}
