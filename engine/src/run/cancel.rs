//! Cancellation at keyframe boundaries: by a request or a memory limit. Results so far are saved.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::memory::{MemoryLimit, resident_mb};

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
    /// How to continue the run, or to start again without a checkpoint, as for a model.
    pub fn remedy(&self, has_checkpoint: bool) -> &'static str {
        match (self, has_checkpoint) {
            (Self::Requested, true) => "continue with --resume",
            (Self::Requested, false) => "repeat the command to start again",
            (Self::Memory { .. }, true) => {
                "continue with --resume and a higher --memory-limit, or start again with fewer keyframes (--every, \
                 --min-translation, --min-rotation)"
            }
            (Self::Memory { .. }, false) => {
                "start again with a higher --memory-limit or without one"
            }
        }
    }
}

/// A memory limit cannot be held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("this system does not report memory use")]
pub struct UnknownMemory;

/// Checked before each keyframe.
#[derive(Debug, Clone, Default)]
pub struct CancelToken {
    limit: Option<MemoryLimit>,
    /// Set by [`CancelToken::cancel`] of any clone.
    is_cancelled: Arc<AtomicBool>,
    /// Set by others than holders of the token, such as a handler of signals.
    request: Option<&'static AtomicBool>,
}

impl CancelToken {
    /// A token for a memory limit and [`cancel`](Self::cancel).
    ///
    /// # Errors
    /// When a limit is given and the system does not report memory use.
    pub fn with_limit(limit: Option<MemoryLimit>) -> Result<Self, UnknownMemory> {
        if limit.is_some() && resident_mb().is_none() {
            return Err(UnknownMemory);
        }
        Ok(Self {
            limit,
            ..Self::default()
        })
    }

    /// The token, which is also cancelled once `request` is set.
    pub fn cancelled_by(mut self, request: &'static AtomicBool) -> Self {
        self.request = Some(request);
        self
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
        let is_set = |flag: &AtomicBool| flag.load(Ordering::SeqCst);
        if is_set(&self.is_cancelled) || self.request.is_some_and(is_set) {
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
