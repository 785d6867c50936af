//! What a reader put up with, counted, so that nothing is left out silently.

use std::fmt;

use serde::Serialize;

/// Something that was left out or assumed, with a count and the first names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// What happened, completing "3 of 120 …".
    pub what: String,
    /// How many were affected, of how many; `None` for a statement about the whole sequence.
    pub count: Option<(usize, usize)>,
    /// The first of those affected.
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

/// Counts one kind of thing that is put up with.
#[derive(Debug, Clone, Default)]
pub(super) struct WarningCounter {
    count: usize,
    examples: Vec<String>,
}

impl WarningCounter {
    const EXAMPLES: usize = 3;

    /// One more, with its name.
    pub(super) fn add(&mut self, name: impl Into<String>) {
        self.count += 1;
        if self.examples.len() < Self::EXAMPLES {
            self.examples.push(name.into());
        }
    }

    /// How many so far.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The first name.
    pub(super) fn first(&self) -> Option<&str> {
        self.examples.first().map(String::as_str)
    }

    /// The warning, when there was any.
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
    fn a_tally_reads_as_a_sentence() {
        let mut tally = WarningCounter::default();
        assert_eq!(tally.clone().into_warning(5, "are bad"), None);
        for name in ["a", "b", "c", "d"] {
            tally.add(name);
        }
        let warning = tally.into_warning(5, "poses are bad").unwrap();
        assert_eq!(warning.to_string(), "4 of 5 poses are bad: a, b, c, …");
    }
}
