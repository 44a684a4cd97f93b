//! The command that makes the paper's tables and figures again.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// `npsolve reproduce`
#[derive(Debug, Args)]
pub struct ReproduceArgs {
    /// What to make.
    #[arg(value_enum)]
    pub figure: Figure,
    /// Scenes: a JSON file with a list "blend_2d", as for compare [default: ../shared/data/manifest.json
    /// where it exists, else the demo's pictures and generated ones].
    #[arg(long, value_name = "FILE")]
    pub manifest: Option<PathBuf>,
    /// Names of the scenes to take [default: the first five for table1, else the first].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Folder for tables and pictures; made if missing.
    #[arg(short, long, value_name = "DIR", default_value = "reproduction")]
    pub output: PathBuf,
    /// Steps of the paper's solver [default: 2500, as published; 30 with --quick].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    /// Shrink scenes to this many pixels on their longest side [default: as they are for table1, guidance and
    /// mask; 128 for lambda and ablation; 64 with --quick].
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(24..))]
    pub size: Option<u16>,
    /// Few steps on small scenes: everything in seconds, to see that it works.
    #[arg(long)]
    pub quick: bool,
    /// Overwrite existing files.
    #[arg(long)]
    pub force: bool,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
}

/// A table or figure of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Figure {
    /// Table 1: gradient and colour errors of every solver, for two kinds of guidance.
    Table1,
    /// The weight of the colour term, from 0.1 to 100, and screened lengths beside it.
    Lambda,
    /// Kinds of guidance: results and their gradients.
    Guidance,
    /// How tightly the mask fits the object.
    Mask,
    /// The colour term at the boundary alone, and other variants of the paper's solver.
    Ablation,
}

impl Figure {
    /// For file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Table1 => "table1",
            Self::Lambda => "lambda",
            Self::Guidance => "guidance",
            Self::Mask => "mask",
            Self::Ablation => "ablation",
        }
    }
}

impl ReproduceArgs {
    /// Steps of the paper's solver.
    pub fn steps(&self) -> u64 {
        self.steps.unwrap_or(if self.quick { 30 } else { 2500 })
    }

    /// Pixels on the longest side, if scenes are to be shrunk.
    pub fn longest(&self) -> Option<usize> {
        let small = matches!(self.figure, Figure::Lambda | Figure::Ablation).then_some(128);
        let usual = if self.quick { Some(64) } else { small };
        self.size.map(usize::from).or(usual)
    }
}
