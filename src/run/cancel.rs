//! Cancellation at keyframe boundaries: by Ctrl-C or a memory limit. Results so far are saved.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::memory::{MemoryLimit, resident_mb};

/// Set by signals; process-wide, as a process runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// A run ended before its last keyframe. Results so far are valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Cancelled {
    /// Cancelled by the user or by a system shutdown.
    #[error("interrupted")]
    Requested,
    /// Memory use exceeds the limit.
    #[error("memory use is {resident_mb:.0} MB, more than the {limit_mb:.0} MB of --memory-limit")]
    Memory {
        /// Memory in use, in MB.
        resident_mb: f64,
        /// The limit, in MB.
        limit_mb: f64,
    },
}

impl Cancelled {
    /// How to continue a run with a checkpoint.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Requested => "continue with --resume",
            Self::Memory { .. } => {
                "continue with --resume and a higher --memory-limit, or start again with fewer keyframes (--every, \
                 --min-translation, --min-rotation)"
            }
        }
    }

    /// How to continue a run without a checkpoint, as for a model.
    pub fn remedy_without_checkpoint(&self) -> &'static str {
        match self {
            Self::Requested => "repeat the command to start again",
            Self::Memory { .. } => "start again with a higher --memory-limit or without one",
        }
    }
}

/// Cancellation is not available.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The system does not report memory use.
    #[error("--memory-limit is not supported: this system does not report memory use")]
    Memory,
    /// Nothing can end the work in between.
    #[error(
        "--memory-limit is checked between views, and a model without updates is carved at once: leave it out"
    )]
    AtOnce,
    /// Signal handlers cannot be installed.
    #[error("cannot install the handler for Ctrl-C: {0}")]
    Signals(#[from] ctrlc::Error),
}

/// Checked before each keyframe.
#[derive(Debug, Clone, Default)]
pub struct CancelToken {
    limit: Option<MemoryLimit>,
    /// Set by [`CancelToken::cancel`] of any clone.
    is_cancelled: Arc<AtomicBool>,
}

impl CancelToken {
    /// A token for Ctrl-C, termination signals and a memory limit. A second signal ends the program at once; written files
    /// stay complete.
    ///
    /// # Errors
    /// When signals cannot be handled, or a limit is given and the system does not report memory use.
    pub fn watch(limit: Option<MemoryLimit>) -> Result<Self, WatchError> {
        let token = Self::with_limit(limit)?;
        let handler = || {
            if REQUESTED.swap(true, Ordering::SeqCst) {
                // Exit status of a program ended by Ctrl-C.
                std::process::exit(130);
            }
            eprintln!("stopping after this keyframe; press Ctrl-C again to stop at once");
        };
        match ctrlc::set_handler(handler) {
            Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(token),
            Err(error) => Err(error.into()),
        }
    }

    /// A token for a memory limit and [`cancel`](Self::cancel), which leaves signals alone.
    ///
    /// # Errors
    /// When a limit is given and the system does not report memory use.
    pub fn with_limit(limit: Option<MemoryLimit>) -> Result<Self, WatchError> {
        if limit.is_some() && resident_mb().is_none() {
            return Err(WatchError::Memory);
        }
        Ok(Self {
            limit,
            ..Self::default()
        })
    }

    /// Ends the run that has a clone of this token, after the current keyframe.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::SeqCst);
    }

    /// Checks for cancellation with `done` keyframes complete. The memory limit allows at least one.
    ///
    /// # Errors
    /// When the run was cancelled.
    pub fn check(&self, done: usize) -> Result<(), Cancelled> {
        if REQUESTED.load(Ordering::SeqCst) || self.is_cancelled.load(Ordering::SeqCst) {
            return Err(Cancelled::Requested);
        }
        match (self.limit, resident_mb()) {
            (Some(MemoryLimit { megabytes }), Some(resident_mb))
                if done > 0 && resident_mb > megabytes =>
            {
                Err(Cancelled::Memory {
                    resident_mb,
                    limit_mb: megabytes,
                })
            }
            _ => Ok(()),
        }
    }
}
