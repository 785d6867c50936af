//! Tables in documents, with their provenance.

use std::path::Path;

use anyhow::Context;
use linecarve_lab::document::{empty_section, with_section};
use linecarve_lab::provenance::Provenance;
use serde::Serialize;

use super::{print_json, print_text};
use crate::cli::OutputArgs;

/// Prints a table, or its rows as JSON, and writes it with its provenance to the section `name` of the document asked for.
pub(super) fn publish(
    name: &str,
    table: &str,
    rows: &impl Serialize,
    output: &OutputArgs,
) -> anyhow::Result<()> {
    if let Some(path) = &output.write {
        let provenance = Provenance::new(command(), output.date.as_deref());
        write_section(path, name, &format!("{}\n{table}", provenance.markdown()))?;
    }
    match output.json {
        true => print_json(rows),
        false => print_text(table),
    }
}

/// Replaces a section of a document; a missing document is made of the section alone.
pub(super) fn write_section(path: &Path, name: &str, section: &str) -> anyhow::Result<()> {
    let text = match path.exists() {
        true => std::fs::read_to_string(path)
            .with_context(|| format!("cannot read {}", path.display()))?,
        false => empty_section(name),
    };
    let text = with_section(&text, name, section).with_context(|| {
        format!(
            "{}: the markers <!-- {name}:begin --> and <!-- {name}:end --> are missing",
            path.display()
        )
    })?;
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// The command line, with paths relative to the working folder and `$LINECARVE_DATA` for the folder of the recordings.
fn command() -> String {
    let data = std::env::var("LINECARVE_DATA").unwrap_or_default();
    let here = std::env::current_dir().unwrap_or_default();
    let mut words = vec!["linecarve-lab".to_owned()];
    for mut argument in std::env::args().skip(1) {
        if !data.is_empty() {
            argument = argument.replace(data.trim_end_matches('/'), "$LINECARVE_DATA");
        }
        argument = argument.replace(&format!("{}/", here.display()), "");
        words.push(match argument.contains([' ', ';']) {
            true => format!("'{argument}'"),
            false => argument,
        });
    }
    words.join(" ")
}
