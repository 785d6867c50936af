//! The `linecarve-lab` program: parses the command line, runs a command, turns its outcome into an exit status.

mod cli;
mod commands;

use std::process::ExitCode;

use clap::Parser;
use linecarve::commands::Outcome;

#[global_allocator]
static ALLOCATOR: linecarve::allocator::Mappings = linecarve::allocator::Mappings;

fn main() -> ExitCode {
    // As the program does: what is measured here is measured of it.
    linecarve::allocator::set_up(false);
    match commands::run(cli::Cli::parse()) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Negative(reason)) => {
            eprintln!("linecarve-lab: {reason}");
            ExitCode::from(1)
        }
        Err(error) => {
            eprintln!("linecarve-lab: {}", linecarve::error_text(&error));
            ExitCode::from(2)
        }
    }
}
