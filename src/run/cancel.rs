//! Ends a run at the next keyframe: on Ctrl-C, or when it holds more memory than it may. What is done by then is saved.

use std::sync::atomic::{AtomicBool, Ordering};

use super::memory::{MemoryLimit, held_mb};

/// Set once: a program runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Why a run ended before its last keyframe. What came before is valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Cancelled {
    /// By the user, or by the system that shuts down.
    #[error("interrupted")]
    Requested,
    /// The memory limit is exceeded.
    #[error("it holds {held_mb:.0} MB, more than the {limit_mb:.0} MB of --memory-limit")]
    Memory {
        /// Memory in use, in MB.
        held_mb: f64,
        /// The limit, in MB.
        limit_mb: f64,
    },
}

impl Cancelled {
    /// How to continue a run that keeps a checkpoint.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Requested => "--resume goes on",
            Self::Memory { .. } => {
                "--resume with a higher --memory-limit goes on, or begin anew with fewer keyframes (--every, \
                 --min-translation, --min-rotation)"
            }
        }
    }

    /// How to continue a run without a checkpoint, since it reads a model and not images.
    pub fn remedy_without_checkpoint(&self) -> &'static str {
        match self {
            Self::Requested => "the same command begins anew",
            Self::Memory { .. } => {
                "a higher --memory-limit, or none, takes the other views as well"
            }
        }
    }
}

/// Why a run cannot be watched.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The system does not tell how much memory a process holds.
    #[error(
        "--memory-limit: this system does not tell how much memory a program holds; leave the option out"
    )]
    Memory,
    /// Signals cannot be handled.
    #[error("cannot watch for Ctrl-C: {0}")]
    Signals(#[from] ctrlc::Error),
}

/// Asked before each keyframe whether the run is to end.
#[derive(Debug, Clone, Copy, Default)]
pub struct CancelToken {
    limit: Option<MemoryLimit>,
}

impl CancelToken {
    /// A token that reacts to Ctrl-C and the usual signals to end, and to a memory limit. A second signal ends the program at
    /// once; files stay whole all the same.
    ///
    /// # Errors
    /// When signals cannot be handled, or there is a limit and the system does not tell the memory in use.
    pub fn watch(limit: Option<MemoryLimit>) -> Result<Self, WatchError> {
        if limit.is_some() && held_mb().is_none() {
            return Err(WatchError::Memory);
        }
        let handler = || {
            if REQUESTED.swap(true, Ordering::SeqCst) {
                // The status of a program that Ctrl-C has ended.
                std::process::exit(130);
            }
            eprintln!("ending after this keyframe; once more to end at once");
        };
        match ctrlc::set_handler(handler) {
            Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(Self { limit }),
            Err(error) => Err(error.into()),
        }
    }

    /// Asked before each keyframe, of which `done` are complete; a memory limit leaves at least one.
    ///
    /// # Errors
    /// When the run is to end.
    pub fn check(self, done: usize) -> Result<(), Cancelled> {
        if REQUESTED.load(Ordering::SeqCst) {
            return Err(Cancelled::Requested);
        }
        match (self.limit, held_mb()) {
            (Some(MemoryLimit { megabytes }), Some(held_mb)) if done > 0 && held_mb > megabytes => {
                Err(Cancelled::Memory {
                    held_mb,
                    limit_mb: megabytes,
                })
            }
            _ => Ok(()),
        }
    }
}
