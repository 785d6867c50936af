//! The `linecarve` program: parses the command line, runs a command, turns its outcome into an exit status.

use std::process::ExitCode;

use clap::Parser;
use linecarve::allocator;
use linecarve::cli::Cli;
use linecarve::commands::{self, Outcome};
use linecarve::error_text;

fn main() -> ExitCode {
    allocator::set_up();
    // clap ends the process itself on bad usage, with status 2, and on --help and --version, with status 0.
    let cli = Cli::parse();
    match commands::run(&cli) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Negative(reason)) => {
            eprintln!("linecarve: {reason}");
            ExitCode::from(1)
        }
        Err(error) => {
            eprintln!("linecarve: {}", error_text(&error));
            ExitCode::from(2)
        }
    }
}
