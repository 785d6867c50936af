//! The table of results: ours and those of rivals.

use std::fmt::Write as _;

use serde::Serialize;

use super::sources::Sources;

/// A row of the table of results.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ResultRow {
    pub(super) sequence: String,
    pub(super) method: String,
    pub(super) keyframes: Option<usize>,
    pub(super) f: Vec<f64>,
    pub(super) vertices: Option<usize>,
    pub(super) milliseconds_per_keyframe: Option<f64>,
    pub(super) seconds: Option<f64>,
    pub(super) peak_memory_mb: Option<f64>,
    /// Origin of quoted figures.
    pub(super) source: Option<String>,
}

/// The table of results, with the sources of quoted figures below.
pub(super) fn table(rows: &[ResultRow]) -> Result<String, std::fmt::Error> {
    let mut text = String::from(
        "| sequence | program | keyframes | F at 2 / 5 / 10 cm | vertices | ms a keyframe | seconds | peak memory, MB |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    let number =
        |value: Option<f64>, digits: usize| or_dash(value.map(|v| format!("{v:.digits$}")));
    let mut sources = Sources::default();
    for row in rows {
        let method = sources.marked(&row.method, row.source.as_deref());
        writeln!(
            text,
            "| {} | {method} | {} | {} | {} | {} | {} | {} |",
            row.sequence,
            or_dash(row.keyframes.map(|n| n.to_string())),
            super::scores(&row.f),
            or_dash(row.vertices.map(|n| n.to_string())),
            number(row.milliseconds_per_keyframe, 0),
            number(row.seconds, 1),
            number(row.peak_memory_mb, 0),
        )?;
    }
    Ok(text + &sources.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_row_each_and_names_sources_once() {
        let row = |sequence: &str, source: Option<&str>| ResultRow {
            sequence: sequence.to_owned(),
            method: "program".to_owned(),
            keyframes: None,
            f: vec![f64::NAN, 0.61, f64::NAN],
            vertices: Some(1234),
            milliseconds_per_keyframe: None,
            seconds: Some(2.04),
            peak_memory_mb: None,
            source: source.map(str::to_owned),
        };
        let text = table(&[
            row("a", None),
            row("a", Some("a paper")),
            row("b", Some("a paper")),
        ])
        .unwrap();
        assert!(
            text.contains("| a | program | - | - / 0.610 / - | 1234 | - | 2.0 | - |"),
            "{text}"
        );
        assert_eq!(text.matches("program [1]").count(), 2);
        assert_eq!(text.matches("[1] a paper.").count(), 1);
    }
}
