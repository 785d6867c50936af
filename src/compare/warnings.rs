//! Warnings of a comparison.

use crate::progress::Verbosity;
use crate::standard_error::say;

/// Warnings, each said once, when it arises.
pub(crate) struct Warnings {
    pub(crate) list: Vec<String>,
    verbosity: Verbosity,
}

impl Warnings {
    pub(crate) fn new(verbosity: Verbosity) -> Self {
        Self {
            list: Vec::new(),
            verbosity,
        }
    }

    pub(crate) fn extend(&mut self, warnings: impl IntoIterator<Item = String>) {
        for warning in warnings {
            if self.list.contains(&warning) {
                continue;
            }
            if self.verbosity > Verbosity::Quiet {
                say!("warning: {warning}");
            }
            self.list.push(warning);
        }
    }
}
