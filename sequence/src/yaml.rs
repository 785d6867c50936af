//! YAML as OpenCV and the SLAM systems built on it write it.

use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::SequenceError;
use super::text::TextFile;

/// A matrix of OpenCV's file storage or of EuRoC: rows, columns and all numbers row by row.
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
                "has {} numbers: 4 rows of 4 expected",
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

/// Reads a YAML file. The first line `%YAML:1.0`, which is not YAML, and the tag of OpenCV's matrices are passed over.
///
/// # Errors
/// When the text is not YAML or lacks something, naming the line.
pub(super) fn parse<T: DeserializeOwned>(file: &TextFile, path: &Path) -> Result<T, SequenceError> {
    // Lines keep their numbers.
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
