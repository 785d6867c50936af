//! What ends a run at the next keyframe boundary: Ctrl-C, or more memory than it may hold. What is done by then is saved.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

use crate::memory::{MemoryLimit, held_mb};

/// Set once and for all: a program runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Ends a run early; what came before is valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum Interrupted {
    /// The user, or the system that is going down.
    #[error("interrupted")]
    Requested,
    /// The next keyframe would hold more still.
    #[error("it holds {held_mb:.0} MB, more than the {limit_mb:.0} MB of --memory-limit")]
    Memory { held_mb: f64, limit_mb: f64 },
}

impl Interrupted {
    /// How to go on with a run that keeps what its keyframes yield.
    pub(super) fn remedy(&self) -> &'static str {
        match self {
            Self::Requested => "--resume goes on",
            Self::Memory { .. } => {
                "--resume with a higher --memory-limit goes on, or begin anew with fewer keyframes (--every, \
                 --min-translation, --min-rotation)"
            }
        }
    }

    /// What to do about a run that keeps nothing, since it reads a model and not images.
    pub(super) fn remedy_for_model(&self) -> &'static str {
        match self {
            Self::Requested => "the same command begins anew",
            Self::Memory { .. } => {
                "a higher --memory-limit, or none, takes the other views as well"
            }
        }
    }
}

/// What a run asks between keyframes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Boundary {
    limit: Option<MemoryLimit>,
}

impl Boundary {
    /// From now on Ctrl-C and the usual signals to end are remembered; a second one ends the program at once, leaving
    /// files whole all the same.
    ///
    /// # Errors
    /// When signals cannot be watched, or there is a limit and no way to tell what is held.
    pub(super) fn watch(limit: Option<MemoryLimit>) -> anyhow::Result<Self> {
        anyhow::ensure!(
            limit.is_none() || held_mb().is_some(),
            "--memory-limit: this system does not tell how much memory a program holds; leave the option out"
        );
        let handler = || {
            if REQUESTED.swap(true, Ordering::SeqCst) {
                // The status of a program that Ctrl-C has ended.
                std::process::exit(130);
            }
            eprintln!("ending after this keyframe; once more to end at once");
        };
        match ctrlc::set_handler(handler) {
            Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(Self { limit }),
            Err(error) => Err(error).context("cannot watch for Ctrl-C"),
        }
    }

    /// To be asked before each keyframe; `done` is the number of those before, of which a limit leaves one at least.
    ///
    /// # Errors
    /// When the run is to end.
    pub(super) fn check(self, done: usize) -> Result<(), Interrupted> {
        if REQUESTED.load(Ordering::SeqCst) {
            return Err(Interrupted::Requested);
        }
        match (self.limit, held_mb()) {
            (Some(MemoryLimit { megabytes }), Some(held_mb)) if done > 0 && held_mb > megabytes => {
                Err(Interrupted::Memory {
                    held_mb,
                    limit_mb: megabytes,
                })
            }
            _ => Ok(()),
        }
    }
}

/// What ended a loop over keyframes early; `None` when it came to its end.
///
/// # Errors
/// Any other fault of the loop.
pub(super) fn early_end(outcome: anyhow::Result<()>) -> anyhow::Result<Option<Interrupted>> {
    match outcome {
        Ok(()) => Ok(None),
        Err(error) => error.downcast().map(Some),
    }
}
