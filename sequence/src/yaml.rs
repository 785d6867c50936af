//! YAML as written by OpenCV and by SLAM systems.

use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::SequenceError;
use super::text::TextFile;

/// A matrix of OpenCV's file storage or of EuRoC, row-major.
#[derive(Debug, Deserialize)]
pub(super) struct Matrix {
    rows: Option<usize>,
    cols: Option<usize>,
    data: Vec<f64>,
}

impl Matrix {
    /// The matrix as 4 rows of 4.
    pub(super) fn rows_of_four(&self) -> Result<[[f64; 4]; 4], String> {
        let is_square = self.rows.unwrap_or(4) == 4 && self.cols.unwrap_or(4) == 4;
        if !is_square || self.data.len() != 16 {
            return Err(format!(
                "has {} numbers, expected 4 rows of 4",
                self.data.len()
            ));
        }
        let mut rows = [[0.0; 4]; 4];
        for (slot, value) in rows.iter_mut().flatten().zip(&self.data) {
            *slot = *value;
        }
        Ok(rows)
    }
}

/// Parses a YAML file. OpenCV's invalid head line `%YAML:1.0` and its matrix tag are ignored.
///
/// # Errors
/// If the text is not YAML or lacks a required key; the message names the line.
pub(super) fn parse<T: DeserializeOwned>(file: &TextFile, path: &Path) -> Result<T, SequenceError> {
    // Keeps line numbers for error messages.
    let text: String = file
        .text()
        .lines()
        .map(|line| {
            if line.starts_with("%YAML") {
                "\n".to_owned()
            } else {
                line.replace("!!opencv-matrix", "").replace('\t', "  ") + "\n"
            }
        })
        .collect();
    serde_saphyr::from_str(&text).map_err(|error| SequenceError::Content {
        path: path.to_owned(),
        problem: error.to_string(),
    })
}
