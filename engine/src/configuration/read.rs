//! Reads a configuration file, and finds the line of a fault.

use std::ops::Range;
use std::path::Path;

use linecarve_mesh::files::read_regular;
use toml::de::{DeTable, DeValue};

use super::Configuration;
use super::error::ConfigurationError;
use super::nearest::{nearest, siblings};

/// A key of a file.
struct Entry {
    /// Table and name.
    path: String,
    /// Where the key stands, in bytes.
    key: Range<usize>,
    /// Where its value stands.
    value: Range<usize>,
    /// Whether the value is a table.
    is_table: bool,
}

impl Configuration {
    /// Reads a TOML file. Keys that it lacks have their defaults.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, has an unknown key, or a value out of range.
    pub fn read(path: &Path) -> Result<Self, ConfigurationError> {
        let text = read_regular(path)
            .and_then(|bytes| String::from_utf8(bytes).map_err(std::io::Error::other));
        let text = text.map_err(|source| ConfigurationError::Read {
            path: path.to_owned(),
            source,
        })?;
        parse(&text, path)
    }
}

/// The configuration that `text` holds, which stands in the file `path`.
pub(super) fn parse(text: &str, path: &Path) -> Result<Configuration, ConfigurationError> {
    let syntax = |error: &toml::de::Error| ConfigurationError::Syntax {
        path: path.to_owned(),
        line: error.span().map_or(1, |span| line(text, span.start)),
        problem: error.message().to_owned(),
    };
    let document = DeTable::parse(text).map_err(|error| syntax(&error))?;
    let mut entries = Vec::new();
    collect(document.get_ref(), "", &mut entries);
    // The table is sorted by name; the first fault of the file is told.
    entries.sort_by_key(|entry| entry.key.start);
    for entry in &entries {
        check_key(entry, text, path)?;
    }

    let configuration: Configuration = toml::from_str(text).map_err(|error| {
        let at = error.span().unwrap_or_default();
        let entry = entries
            .iter()
            .find(|entry| entry.value.start <= at.start && at.end <= entry.value.end);
        entry.map_or_else(|| syntax(&error), |entry| refused(entry, text, path))
    })?;
    configuration.check().map_err(|fault| {
        let entry = entries.iter().find(|entry| entry.path == fault.key.path);
        match entry {
            Some(entry) => refused(entry, text, path),
            // The defaults are in range, so that the key stands in the file.
            None => ConfigurationError::Value {
                path: path.to_owned(),
                line: 1,
                key: fault.key.path.to_owned(),
                value: fault.value.to_string(),
                expected: fault.key.values.text,
            },
        }
    })?;
    Ok(configuration)
}

/// The keys of a table and of the tables in it. A table that has no key and is none of ours counts as a key.
fn collect(table: &DeTable<'_>, prefix: &str, entries: &mut Vec<Entry>) {
    for (key, value) in table {
        let path = if prefix.is_empty() {
            key.get_ref().to_string()
        } else {
            format!("{prefix}.{}", key.get_ref())
        };
        match value.get_ref() {
            DeValue::Table(inner) if !is_key(&path) && (!inner.is_empty() || is_table(&path)) => {
                collect(inner, &path, entries);
            }
            _ => entries.push(Entry {
                path,
                key: key.span(),
                value: value.span(),
                is_table: value.get_ref().is_table(),
            }),
        }
    }
}

fn is_table(path: &str) -> bool {
    Configuration::tables()
        .iter()
        .any(|table| table.name == path)
}

fn is_key(path: &str) -> bool {
    expected(path).is_some()
}

/// The values that a key accepts.
fn expected(path: &str) -> Option<&'static str> {
    Configuration::tables()
        .iter()
        .flat_map(|table| table.keys)
        .find(|key| key.path == path)
        .map(|key| key.values.text)
}

/// Refuses what is no key.
fn check_key(entry: &Entry, text: &str, path: &Path) -> Result<(), ConfigurationError> {
    if is_key(&entry.path) {
        return if entry.is_table {
            Err(refused(entry, text, path))
        } else {
            Ok(())
        };
    }
    let line = line(text, entry.key.start);
    let (path, key) = (path.to_owned(), entry.path.clone());
    if is_table(&key) {
        return Err(ConfigurationError::Value {
            path,
            line,
            value: text[entry.value.clone()].to_owned(),
            key,
            expected: "a table",
        });
    }
    let nearest = nearest(&key);
    let siblings = siblings(&key);
    let remedy = match (nearest, siblings.is_empty()) {
        (Some(nearest), _) => format!("did you mean `{nearest}`?"),
        (None, false) => format!("the keys of this table are {}", siblings.join(", ")),
        (None, true) => "docs/configuration.md lists the keys".to_owned(),
    };
    Err(ConfigurationError::Unknown {
        path,
        line,
        key,
        nearest,
        remedy,
    })
}

/// The error of a key whose value is refused.
fn refused(entry: &Entry, text: &str, path: &Path) -> ConfigurationError {
    ConfigurationError::Value {
        path: path.to_owned(),
        line: line(text, entry.key.start),
        key: entry.path.clone(),
        value: text[entry.value.clone()].to_owned(),
        expected: expected(&entry.path).unwrap_or("another value"),
    }
}

/// The line of a byte.
fn line(text: &str, at: usize) -> usize {
    let before = text.as_bytes().iter().take(at);
    1 + before.filter(|byte| **byte == b'\n').count()
}
