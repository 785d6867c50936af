//! The commands, one file each.

mod ablation;
mod agreement;
mod benchmarks;
mod cost;
mod depth;
mod flatness;
mod lines;
mod lines_output;
mod measure;
mod published;
mod race;
mod results;
mod rivals;
mod scored_run;
mod sources;
mod starts;
mod tables;
mod texture;

use anyhow::Context;
use linecarve::commands::Outcome;
use linecarve::progress::Verbosity;
use serde::Serialize;

use crate::cli::{Cli, Command};

/// Runs the command that `cli` names.
///
/// # Errors
/// On bad input or options, or when an output cannot be written.
pub(crate) fn run(cli: Cli) -> anyhow::Result<Outcome> {
    let verbosity = match (cli.quiet, cli.verbose) {
        (true, _) => Verbosity::Quiet,
        (false, 0) => Verbosity::Normal,
        (false, _) => Verbosity::Verbose,
    };
    let reports_times = match &cli.command {
        Command::Tables(_)
        | Command::Figure(_)
        | Command::Agreement(_)
        | Command::Lines(_)
        | Command::Depth(_)
        | Command::Flatness(_)
        | Command::Starts(_) => false,
        Command::Ablation(_)
        | Command::Benchmarks(_)
        | Command::Cost(_)
        | Command::Measure(_)
        | Command::Race(_)
        | Command::Texture(_) => true,
    };
    let threads = cli.threads.or(reports_times.then_some(1));
    // `lines` may pass on to the product, which starts the threads itself.
    if !matches!(cli.command, Command::Lines(_)) {
        start_threads(threads)?;
    }
    match cli.command {
        Command::Tables(args) => tables::run(&args, verbosity),
        Command::Agreement(args) => agreement::run(&args),
        Command::Figure(args) => tables::figure::run(&args, verbosity),
        Command::Lines(args) => lines::run(args, threads, verbosity),
        Command::Ablation(args) => ablation::run(&args, verbosity),
        Command::Benchmarks(args) => benchmarks::run(&args, threads, verbosity),
        Command::Cost(args) => cost::run(&args, threads),
        Command::Measure(args) => measure::run(&args),
        Command::Race(args) => race::run(&args, threads),
        Command::Depth(args) => depth::run(&args),
        Command::Flatness(args) => flatness::run(&args),
        Command::Starts(args) => starts::run(&args, verbosity),
        Command::Texture(args) => texture::run(&args),
    }
}

fn start_threads(threads: Option<usize>) -> anyhow::Result<()> {
    let Some(threads) = threads else {
        return Ok(());
    };
    anyhow::ensure!(threads > 0, "--threads 0: at least one thread is needed");
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .context("cannot start the worker threads")
}

/// A JSON value on standard output.
fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print_text(&format!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Text on standard output. A reader that closes the pipe, as `head` does, is no error.
fn print_text(text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot write to standard output"),
    }
}

/// F at the thresholds, as tables show them; a dash for those not known.
fn scores(f: &[f64]) -> String {
    let score = |f: &f64| match f.is_nan() {
        true => "-".to_owned(),
        false => format!("{f:.3}"),
    };
    f.iter().map(score).collect::<Vec<_>>().join(" / ")
}
