//! The command line: every option with its help.

mod field;
mod reproduce;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use poisson_loss::{Objective, Options};
use signal_io::SampleType;

use crate::field_kind::FieldKind;
use crate::kind::SignalKind;
use crate::problem_layers::ProblemLayer;
use crate::values::{self, Coordinate, GuidanceName, Place, Shape, Size};

pub use field::{DEFAULT_SEED, FitArgs, RenderArgs};
pub use reproduce::{Figure, ReproduceArgs};

/// Blends pictures, sound, volumes, videos and light fields in the gradient domain: the patch's structure, the
/// background's light.
#[derive(Debug, Parser)]
#[command(name = "npsolve", version, propagate_version = true, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done; 1 a file or its content is wrong, or the work failed; \
    2 the command line is wrong.\nFirst steps: npsolve demo, then npsolve blend --help."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use; results never depend on it [default: all cores].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print nothing but errors (and what --json asks for).
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Blend a patch into a background.
    #[command(after_help = "Examples:\n  \
        npsolve blend beach.jpg bird.png --at 420,60 -o out.png\n  \
        npsolve blend beach.jpg bird.jpg --mask bird_mask.png --center 500,130 -o out.png\n  \
        npsolve blend wall.png letters.png --at 20,40 --guidance strongest -o out.png\n  \
        npsolve blend sky.exr plane.exr --at 649.5,10 --length 4 --keep 12 -o out.exr\n  \
        npsolve blend sky.png plane.png --mask m.png --at 9,9 -o out.png --metrics out.json\n  \
        npsolve blend speech.wav music.flac --from 1 --to 3.5 --at 3 -o spliced.wav\n  \
        npsolve blend atlas.nii.gz head.nii.gz --region ellipsoid:30,70,50:14,18,14 -o out.nii.gz\n  \
        npsolve blend sky.safetensors plane.safetensors --mask m.png --at 9,9 -o out.safetensors\n  \
        npsolve blend sky.png plane.png --at 9,9 --field siren --budget 60s -o out.safetensors\n  \
        npsolve blend scan.tif overlay.tif --mask m.png --max-memory 4G -o out.tif")]
    Blend(BlendArgs),
    /// Run every solver and baseline on one problem, or on a list of scenes.
    #[command(after_help = "Examples:\n  \
        npsolve compare sky.png plane.png --mask plane_mask.png --at 649,10\n  \
        npsolve compare sky.png plane.png --mask plane_mask.png --at 649,10 -o comparison\n  \
        npsolve compare sky.png plane.png --at 649,10 --other opencv.png --csv table.csv\n  \
        npsolve compare --manifest data/manifest.json -o tables")]
    Compare(CompareArgs),
    /// Fit a signal with a network: a field with values and gradients at any point.
    #[command(after_help = "Examples:\n  \
        npsolve fit photo.jpg -o photo.safetensors\n  \
        npsolve fit photo.jpg -o photo.safetensors --budget 2s\n  \
        npsolve fit photo.jpg -o photo.safetensors --target-psnr 40 --table-rows 131072\n  \
        npsolve fit photo.jpg -o small.safetensors --field siren --width 64 --steps 5000\n  \
        npsolve fit photo.jpg -o small.safetensors --resume\n  \
        npsolve fit scan.nii.gz -o scan.safetensors --budget 60s")]
    Fit(FitArgs),
    /// Make a picture of a field or signal, at any size; its gradient; or the signal itself at another scale.
    #[command(after_help = "Examples:\n  \
        npsolve render photo.safetensors -o photo.png\n  \
        npsolve render photo.safetensors -o large.png --scale 4\n  \
        npsolve render photo.safetensors -o eye.png --crop 120.5,80,32,24 --size 1280x960\n  \
        npsolve render photo.jpg -o small.png --size 300x200\n  \
        npsolve render photo.safetensors --gradient slopes.exr\n  \
        npsolve render views.npy -o between.png --view 1.5,2\n  \
        npsolve render speech.safetensors -o speech.wav --scale 2")]
    Render(RenderArgs),
    /// Say what is in pictures and fields: size, channels, range; pieces, holes and radius of masks;
    /// kind, numbers and state of networks.
    #[command(after_help = "Examples:\n  \
        npsolve inspect photo.jpg mask.png\n  \
        npsolve inspect photo.safetensors\n  \
        npsolve inspect --json scan.exr")]
    Inspect(InspectArgs),
    /// Blend two built-in pictures, or signals of another kind, and say what happened.
    #[command(after_help = "Examples:\n  \
        npsolve demo\n  \
        npsolve demo --kind audio\n  \
        npsolve demo --kind lightfield -o /tmp/npsolve-demo")]
    Demo(DemoArgs),
    /// Make the tables and figures of the paper again, every result measured alike.
    #[command(after_help = "Examples:\n  \
        npsolve reproduce table1 --quick\n  \
        npsolve reproduce table1 --manifest scenes.json --scenes board,letters -o tables\n  \
        npsolve reproduce ablation --size 256\n\n\
        Full runs train networks for minutes to hours; docs/reproduction.md has measured times.")]
    Reproduce(ReproduceArgs),
}

/// `npsolve blend`
#[derive(Debug, Args)]
pub struct BlendArgs {
    /// The picture or field to paste into; the result has its size, channels, alpha, profile and depth.
    pub background: PathBuf,
    /// The picture or field to paste.
    pub patch: PathBuf,
    /// The result; the extension says the format: safetensors for a field; png, jpg, tif, webp, pgm, ppm, pam, pfm, hdr, exr, npy.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub scene: SceneArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub solve: SolveArgs,
    /// What is minimised: screened (default; free boundary with a length), paper (as published), or
    /// dirichlet (fixed boundary, classical Poisson editing).
    #[arg(long, value_enum, default_value = "screened", help_heading = "Blending")]
    pub objective: ObjectiveName,
    /// What the result is made of: spline (the exact solution), or a network that is trained to be it
    /// [default: spline; the background's own network where it is one; grid if OUT is a .safetensors file].
    #[arg(long, value_enum, value_name = "KIND", help_heading = "Field")]
    pub field: Option<BlendField>,
    /// Stop training after this time: 5s, 500ms, 2m; a plain number is seconds.
    #[arg(long, value_name = "TIME", help_heading = "Field", value_parser = values::duration)]
    #[arg(allow_hyphen_values = true)]
    pub budget: Option<std::time::Duration>,
    /// Stop training after this many steps [default: 2000; none with --budget].
    #[arg(long, value_name = "N", help_heading = "Field", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    /// Most rows of a table per level, a power of two, for a smaller grid or hash; without it a grid holds
    /// the exact solution from the beginning.
    #[arg(long, value_name = "N", help_heading = "Field", value_parser = values::power_of_two)]
    pub table_rows: Option<usize>,
    /// Blend pictures that are larger than memory: take at most this much, as 4G or 500M. They are solved in blocks, with
    /// hidden scratch files beside OUT (about 16 bytes per channel and pixel). PNG, TIFF, npy and PFM are read and
    /// written by rows. Ctrl-C keeps what is done: the same command goes on from there.
    #[arg(long, value_name = "SIZE", help_heading = "Large pictures", value_parser = values::bytes)]
    pub max_memory: Option<u64>,
    /// Number type of the result [default: the background's, if the format has it].
    #[arg(long, value_enum)]
    pub depth: Option<Depth>,
    /// Write more of the problem into further layers of an .exr result, with commas; in the values that are blended.
    #[arg(long, value_enum, value_name = "LAYERS", value_delimiter = ',')]
    pub with: Vec<ProblemLayer>,
    /// Write the metrics to a JSON file.
    #[arg(long, value_name = "FILE.json")]
    pub metrics: Option<PathBuf>,
    /// Print the metrics as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
    /// Overwrite existing files.
    #[arg(long)]
    pub force: bool,
}

/// What is blended where.
#[derive(Debug, Clone, Default, Args)]
pub struct SceneArgs {
    /// What the files are [default: what their names and contents say].
    #[arg(long, value_enum, help_heading = "Scene")]
    pub kind: Option<SignalKind>,
    /// Which part of the patch to paste: white yes, black no, grey softly. A picture of the patch's
    /// size (a volume for volumes; for videos and light fields one picture for all frames or views, or as
    /// many); its alpha where it is not opaque, else its luminance [default: the patch's alpha, else all of it].
    #[arg(long, value_name = "MASK", help_heading = "Scene")]
    pub mask: Option<PathBuf>,
    /// Which part of the patch to paste, as a shape: box:X0,Y0,Z0:X1,Y1,Z1 (without the samples at X1) or
    /// ellipsoid:CX,CY,CZ:RX,RY,RZ. In samples of the patch; with mm behind every number in a volume's own
    /// millimetres. Without the last coordinates: all of these axes. For volumes also a closed mesh, FILE.glb, whose
    /// numbers are the patch's millimetres (FILE.glb:m metres, FILE.glb:smp voxels).
    #[arg(long, value_name = "SHAPE", help_heading = "Scene", value_parser = values::shape)]
    #[arg(allow_hyphen_values = true, conflicts_with = "mask")]
    pub region: Option<Shape>,
    /// Where the patch's first sample goes in the background: X,Y of its top-left pixel; seconds of sound, or samples
    /// with smp; voxels, or millimetres with mm. Fractions and positions outside are fine. Required unless
    /// both have one size (then 0,0) or are volumes (then their own coordinates decide).
    #[arg(long, value_name = "X,Y", help_heading = "Scene", allow_hyphen_values = true)]
    #[arg(value_parser = values::place, conflicts_with = "center")]
    pub at: Option<Place>,
    /// Where the patch's centre goes: its sample (width/2, height/2), rounded down. The centre of
    /// the patch, not of the mask.
    #[arg(long, value_name = "X,Y", help_heading = "Scene", allow_hyphen_values = true)]
    #[arg(value_parser = values::place)]
    pub center: Option<Place>,
    /// Begin of the part of the patch to take, in seconds of sound, or samples with smp [default: 0].
    #[arg(long, value_name = "TIME", help_heading = "Scene")]
    pub from: Option<Coordinate>,
    /// End of the part of the patch to take [default: the patch's end].
    #[arg(long, value_name = "TIME", help_heading = "Scene")]
    pub to: Option<Coordinate>,
    /// Layers of OpenEXR pictures to blend, with commas; main are the channels of no layer. The others are copied from
    /// the background [default: those that both have; for a patch without layers the first].
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Scene")]
    pub layers: Vec<String>,
    /// Turn RGB pictures into grey (Rec. 709 weights on the values as they are stored).
    #[arg(long, help_heading = "Scene")]
    pub gray: bool,
    /// The values to blend: stored (as in the background's file), linear (proportional to light), srgb, log
    /// (ratios instead of differences), normalize (0 to 1 over the background's range) [default: log for pictures of
    /// light beyond 1, normalize for volumes, else stored].
    #[arg(long, value_enum, help_heading = "Scene")]
    pub domain: Option<ValueDomain>,
    /// Stretch the patch's values to the background's range before blending.
    #[arg(long, help_heading = "Scene")]
    pub match_range: bool,
    /// Blend sound as it is (waveform: joins without clicks), or its spectrogram (sounds through each other).
    #[arg(long, value_enum, default_value = "waveform", help_heading = "Scene")]
    pub mode: AudioMode,
    /// Pixels that one frame of a video counts as.
    #[arg(long, value_name = "PX", default_value = "1", help_heading = "Scene", value_parser = values::positive)]
    pub time_pitch: f32,
    /// The files are pictures of lenslets with this many pixels across and down below each lens.
    #[arg(long, value_name = "UxV", help_heading = "Scene", value_parser = values::size)]
    pub lenslet: Option<Size>,
    /// Pixels that one step of a light field's camera counts as: about how far it moves the picture.
    #[arg(long, value_name = "PX", default_value = "0.8", help_heading = "Scene", value_parser = values::positive)]
    pub angular_pitch: f32,
}

/// How it is blended.
#[derive(Debug, Clone, Args)]
pub struct SolveArgs {
    /// The gradient to follow inside: patch, strongest (of both; strongest:channel and
    /// strongest:component decide more finely), sum, mix:MU,PHI (background's and patch's factor),
    /// monochrome (the patch's luminance).
    #[arg(long, default_value = "patch", help_heading = "Blending", value_parser = values::guidance)]
    pub guidance: GuidanceName,
    /// How far the background may give way, in pixels [default: 0.04 of the region's inradius, at least 2].
    #[arg(long, value_name = "PX", help_heading = "Blending", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    pub length: Option<f32>,
    /// Keep the patch's own colours deeper inside than this many pixels; wants a mask that fits the object
    /// closely, or its surroundings are kept as well [default: do not].
    #[arg(long, value_name = "PX", help_heading = "Blending", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    pub keep: Option<f32>,
    /// Colour weight of the paper's objective; useful from 1 to 10 [default: 3].
    #[arg(long, value_name = "WEIGHT", help_heading = "Blending", allow_hyphen_values = true)]
    #[arg(value_parser = values::positive)]
    pub lambda: Option<f32>,
    /// Let the colour weight grow with the distance from the region: locks the far background.
    #[arg(long, help_heading = "Blending")]
    pub ramp: bool,
    /// Ten times the colour weight next to the region: the background is nearly untouched.
    #[arg(long, help_heading = "Blending")]
    pub band: bool,
    /// Fade the guidance over this many pixels inside the edge: for masks that cut through an object.
    #[arg(long, value_name = "PX", default_value = "0", help_heading = "Blending")]
    #[arg(allow_hyphen_values = true, value_parser = values::not_negative)]
    pub feather: f32,
    /// Relative residual to stop at [default: 1e-4 for 8-bit results, where less is invisible; else 1e-6].
    #[arg(long, value_name = "T", help_heading = "Blending", allow_hyphen_values = true)]
    #[arg(value_parser = values::tolerance)]
    pub tolerance: Option<f32>,
}

/// `npsolve compare`
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The signal to paste into.
    #[arg(required_unless_present = "manifest")]
    pub background: Option<PathBuf>,
    /// The signal to paste.
    #[arg(required_unless_present = "manifest")]
    pub patch: Option<PathBuf>,
    /// Scenes to compare on: a JSON file with a list "blend_2d" of name, background, patch, masks,
    /// offset and guidance, or lists blend_1d, blend_3d, blend_4d of other signals; paths are relative to the file.
    #[arg(long, value_name = "FILE")]
    #[arg(conflicts_with_all = ["background", "patch", "mask", "at", "center", "other"])]
    pub manifest: Option<PathBuf>,
    /// Folder for results, pictures of their differences and a contact sheet; made if missing. Of sound only the part
    /// around the patch.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Other people's results of the same size, as further rows.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub other: Vec<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub scene: SceneArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub solve: SolveArgs,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
    /// Write the table to a CSV file.
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
    /// Overwrite existing files.
    #[arg(long)]
    pub force: bool,
}

/// `npsolve inspect`
#[derive(Debug, Args)]
pub struct InspectArgs {
    /// Pictures and fields.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// What the files are [default: what their names and contents say].
    #[arg(long, value_enum)]
    pub kind: Option<SignalKind>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `npsolve demo`
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// What to blend: the built-in pictures, or a signal of another kind that is made on the spot.
    #[arg(long, value_enum, default_value = "image")]
    pub kind: SignalKind,
    /// Folder for the results; made if missing, those of an earlier demo are overwritten.
    #[arg(short, long, value_name = "DIR", default_value = "npsolve-demo")]
    pub output: PathBuf,
}

/// `--objective`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum ObjectiveName {
    Screened,
    Paper,
    Dirichlet,
}

/// `--field` of a blend
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum BlendField {
    Spline,
    Grid,
    Siren,
    Diner,
    Hash,
    Fourier,
}

impl BlendField {
    /// The kind of network; none for the spline.
    pub fn kind(self) -> Option<FieldKind> {
        match self {
            Self::Spline => None,
            Self::Grid => Some(FieldKind::Grid),
            Self::Siren => Some(FieldKind::Siren),
            Self::Diner => Some(FieldKind::Diner),
            Self::Hash => Some(FieldKind::Hash),
            Self::Fourier => Some(FieldKind::Fourier),
        }
    }
}

/// `--domain`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum ValueDomain {
    Stored,
    Linear,
    Srgb,
    Log,
    Normalize,
}

/// `--mode`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
#[allow(missing_docs)]
pub enum AudioMode {
    #[default]
    Waveform,
    Spectrogram,
}

/// `--depth`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum Depth {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
    #[value(name = "24")]
    TwentyFour,
    F16,
    F32,
}

impl Depth {
    /// The number type of pictures; they have no 24 bits.
    pub fn sample_type(self) -> anyhow::Result<SampleType> {
        Ok(match self {
            Self::Eight => SampleType::U8,
            Self::Sixteen => SampleType::U16,
            Self::TwentyFour => {
                anyhow::bail!("24 bits are for sound; take --depth 8, 16, f16 or f32")
            }
            Self::F16 => SampleType::F16,
            Self::F32 => SampleType::F32,
        })
    }
}

/// Geometric middle of the paper objective's useful band, 1 to 10.
pub const DEFAULT_LAMBDA: f32 = 3.0;

impl SolveArgs {
    /// The solver's options.
    pub fn options(&self, objective: ObjectiveName, default_tolerance: f32) -> Options {
        let objective = match objective {
            ObjectiveName::Screened => Objective::Screened { length: self.length, keep: self.keep },
            ObjectiveName::Paper => {
                Objective::Paper { lambda: self.lambda.unwrap_or(DEFAULT_LAMBDA) }
            }
            ObjectiveName::Dirichlet => Objective::Dirichlet,
        };
        Options {
            ramp: self.ramp,
            band: self.band,
            feather: self.feather,
            tolerance: self.tolerance.unwrap_or(default_tolerance),
            ..Options::with_objective(objective)
        }
    }

    /// An option that the chosen objective does not have, as a message.
    pub fn check(&self, objective: ObjectiveName) -> Result<(), String> {
        let screened = objective == ObjectiveName::Screened;
        let unused = |option: &str, of: &str| {
            Err(format!("{option} belongs to --objective {of}; leave one of the two out"))
        };
        match self {
            Self { length: Some(_), .. } if !screened => unused("--length", "screened"),
            Self { keep: Some(_), .. } if !screened => unused("--keep", "screened"),
            Self { lambda: Some(_), .. } if objective != ObjectiveName::Paper => {
                unused("--lambda", "paper")
            }
            Self { ramp, band, .. }
                if (*ramp || *band) && objective == ObjectiveName::Dirichlet =>
            {
                unused("--ramp and --band", "screened and paper")
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        super::Cli::command().debug_assert();
    }
}
