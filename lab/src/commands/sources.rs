//! Where the quoted figures of a table come from.

use std::fmt;

/// The sources of a table, each with a number.
#[derive(Debug, Default)]
pub(super) struct Sources<'a>(Vec<&'a str>);

impl<'a> Sources<'a> {
    /// A name, with the number of its source if it has one.
    pub(super) fn marked(&mut self, name: &str, source: Option<&'a str>) -> String {
        let Some(source) = source else {
            return name.to_owned();
        };
        let known = self.0.iter().position(|known| *known == source);
        let at = known.unwrap_or_else(|| {
            self.0.push(source);
            self.0.len() - 1
        });
        format!("{name} [{}]", at + 1)
    }
}

/// The list below the table.
impl fmt::Display for Sources<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, source) in self.0.iter().enumerate() {
            write!(f, "\n[{}] {source}.\n", at + 1)?;
        }
        Ok(())
    }
}
