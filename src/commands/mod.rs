//! The commands, one file each: they read options, run the library and print; the work itself is elsewhere.

mod compare;
mod convert;
mod convert_geometry;
mod diff;
mod evaluate;
mod evaluate_trajectory;

mod heat_map;
mod info;
pub mod input;
mod lines;
mod mesh;
mod observed;
mod reconstruct;
mod render;
mod render_view;
mod simplify;
mod stream;
mod stream_lines;
mod structure;
mod synth;
mod tiles;
mod tiles_state;
mod track;
mod unused;
mod view;

pub use reconstruct::reconstruct;

use anyhow::Context;

use crate::cli::{Cli, Command};
use crate::progress::Verbosity;

/// How a command that ran to its end came out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It has a result.
    Done,
    /// It ran, but the result is empty or negative, for this reason.
    Negative(String),
}

/// Runs the command that `cli` names.
///
/// # Errors
/// On bad input or options, or when an output cannot be written; the chain of messages names the file and the remedy.
pub fn run(cli: &Cli) -> anyhow::Result<Outcome> {
    let verbosity = match (cli.quiet, cli.verbose) {
        (true, _) => Verbosity::Quiet,
        (false, 0) => Verbosity::Normal,
        (false, _) => Verbosity::Verbose,
    };
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot start the worker threads")?;
    }
    match &cli.command {
        Command::Reconstruct(args) => reconstruct::run(args, verbosity),
        Command::Track(args) => track::run(args, verbosity),
        Command::Lines(args) => lines::run(args, verbosity),
        Command::Stream(args) => stream::run(args, verbosity),
        Command::Info(args) => info::run(args, verbosity),
        Command::Synth(args) => synth::run(args, verbosity),
        Command::Render(args) => render::run(args),
        Command::Evaluate(args) => evaluate::run(args, verbosity),
        Command::Diff(args) => diff::run(args),
        Command::Convert(args) => convert::run(args, verbosity),
        Command::Compare(args) => compare::run(args, verbosity),
        Command::View(args) => view::run(args, verbosity),
        Command::Mesh(args) => mesh::run(args, verbosity),
        Command::Simplify(args) => simplify::run(args),
        Command::Structure(args) => structure::run(args, verbosity),
        Command::Tiles(args) => tiles::run(args, verbosity),
    }
}
