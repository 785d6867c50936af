//! `linecarve info`: what a sequence holds and whether it agrees with itself.

use crate::cli::InfoArgs;
use crate::commands::Outcome;
use crate::commands::input::open;
use crate::progress::Verbosity;
use crate::sinks::{print_object, print_text};
use crate::text::sequence_text;
use linecarve_sequence::{InspectOptions, inspect};

pub(super) fn run(args: &InfoArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let sequence = open(&args.input)?;
    let facts = inspect(&sequence, &InspectOptions::default())?;
    if args.json {
        print_object(&facts)?;
    } else {
        print_text(&sequence_text(&facts))?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in &facts.warnings {
            eprintln!("warning: {warning}");
        }
    }
    Ok(Outcome::Done)
}
