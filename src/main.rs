//! The `linecarve` program: parses the command line, runs a command, turns its outcome into an exit status.

#![warn(clippy::print_stderr)]

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use linecarve::allocator::{self, Mappings};
use linecarve::cli::Cli;
use linecarve::commands::{self, Outcome};
use linecarve::{error_text, process};

#[global_allocator]
static ALLOCATOR: Mappings = Mappings;

fn main() -> ExitCode {
    // clap ends the process itself on bad usage, with status 2, and on --help and --version, with status 0.
    let cli = Cli::parse();
    allocator::set_up(cli.has_limited_addresses());
    process::set_up();
    match commands::run(&cli) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Negative(reason)) => {
            say(&reason);
            ExitCode::from(1)
        }
        Err(error) => {
            say(&error_text(&error));
            ExitCode::from(2)
        }
    }
}

/// A last line on standard error, where it can be written.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "linecarve: {text}");
}
