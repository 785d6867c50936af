//! Ctrl-C ends a run at the next keyframe boundary; what is done by then is saved.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

/// Set once and for all: a program runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Ends a run early; what came before is valid.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub(super) struct Interrupted;

/// From now on Ctrl-C and the usual signals to end are remembered; a second one ends the program at once, leaving files
/// whole all the same.
pub(super) fn watch() -> anyhow::Result<()> {
    let handler = || {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            // The status of a program that Ctrl-C has ended.
            std::process::exit(130);
        }
        eprintln!("ending after this keyframe; once more to end at once");
    };
    match ctrlc::set_handler(handler) {
        Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(()),
        Err(error) => Err(error).context("cannot watch for Ctrl-C"),
    }
}

/// To be asked between keyframes.
///
/// # Errors
/// When the run is to end.
pub(super) fn check() -> Result<(), Interrupted> {
    if REQUESTED.load(Ordering::SeqCst) {
        Err(Interrupted)
    } else {
        Ok(())
    }
}

/// Whether a loop over keyframes came to its end; `false` when it was interrupted.
///
/// # Errors
/// Any other fault of the loop.
pub(super) fn is_complete(outcome: anyhow::Result<()>) -> anyhow::Result<bool> {
    match outcome {
        Ok(()) => Ok(true),
        Err(error) if error.is::<Interrupted>() => Ok(false),
        Err(error) => Err(error),
    }
}
