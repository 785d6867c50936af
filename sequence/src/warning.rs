//! Non-fatal problems found while reading, with counts.

use std::fmt;

use serde::Serialize;

/// A non-fatal problem: something skipped or assumed, with a count and the first examples.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// What happened; completes "3 of 120 …" if there is a count.
    pub what: String,
    /// Number affected and total number; `None` for a statement about the whole sequence.
    pub count: Option<(usize, usize)>,
    /// Names of the first few affected.
    pub examples: Vec<String>,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((count, total)) = self.count {
            write!(f, "{count} of {total} ")?;
        }
        write!(f, "{}", self.what)?;
        if !self.examples.is_empty() {
            write!(f, ": {}", self.examples.join(", "))?;
            if self
                .count
                .is_some_and(|(count, _)| count > self.examples.len())
            {
                write!(f, ", …")?;
            }
        }
        Ok(())
    }
}

impl Warning {
    /// A statement about the whole sequence.
    pub fn statement(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            count: None,
            examples: Vec::new(),
        }
    }
}

/// Counts one kind of non-fatal problem.
#[derive(Debug, Clone, Default)]
pub(super) struct WarningCounter {
    count: usize,
    examples: Vec<String>,
}

impl WarningCounter {
    const EXAMPLES: usize = 3;

    /// Counts one more occurrence.
    pub(super) fn add(&mut self, name: impl Into<String>) {
        self.count += 1;
        if self.examples.len() < Self::EXAMPLES {
            self.examples.push(name.into());
        }
    }

    /// Number of occurrences so far.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The warning; `None` if nothing was counted.
    pub(super) fn into_warning(self, total: usize, what: &str) -> Option<Warning> {
        (self.count > 0).then(|| Warning {
            what: what.to_owned(),
            count: Some((self.count, total)),
            examples: self.examples,
        })
    }
}

/// A time in seconds with nine decimals.
pub(super) fn stamp_text(ns: i64) -> String {
    let magnitude = ns.unsigned_abs();
    let sign = if ns < 0 { "-" } else { "" };
    format!(
        "{sign}{}.{:09}",
        magnitude / 1_000_000_000,
        magnitude % 1_000_000_000
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counted_warning_reads_as_a_sentence() {
        let mut counter = WarningCounter::default();
        assert_eq!(counter.clone().into_warning(5, "are bad"), None);
        for name in ["a", "b", "c", "d"] {
            counter.add(name);
        }
        let warning = counter.into_warning(5, "poses are bad").unwrap();
        assert_eq!(warning.to_string(), "4 of 5 poses are bad: a, b, c, …");
    }
}
