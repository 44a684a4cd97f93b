//! The command line of npsolve: gradient-domain blending of pictures.
//!
//! Exit codes: 0 done; 1 a file or its content is wrong, or the work failed; 2 the command line is
//! wrong.

mod args;
mod blend;
mod channels;
mod compare;
mod console;
mod demo;
mod field_file;
mod field_kind;
mod field_words;
mod files;
mod fit;
mod inspect;
mod kind;
mod large;
mod layers;
mod mask;
mod neural;
mod outcome;
mod picture_kind;
mod problem_layers;
mod progress;
mod render;
mod report;
mod reproduce;
mod scene;
mod shapes;
mod signals;
mod solve;
mod value_domain;
mod values;

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};

use crate::args::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let checked = match &cli.command {
        Command::Blend(args) => args.solve.check(args.objective),
        Command::Fit(args) => args.check(),
        _ => Ok(()),
    };
    if let Err(message) = checked {
        Cli::command().error(ErrorKind::ArgumentConflict, message).exit();
    }
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console::error(&format!("{error:#}"));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(threads))
            .build_global()
            .context("cannot start the threads; choose a smaller --threads")?;
    }
    match &cli.command {
        Command::Blend(args) => blend::run(args, cli.quiet),
        Command::Compare(args) => compare::run(args, cli.quiet),
        Command::Fit(args) => fit::run(args, cli.quiet),
        Command::Render(args) => render::run(args, cli.quiet),
        Command::Inspect(args) => inspect::run(args),
        Command::Demo(args) => demo::run(args, cli.quiet),
        Command::Reproduce(args) => reproduce::run(args, cli.quiet),
    }
}
