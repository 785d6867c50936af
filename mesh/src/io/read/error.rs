//! Why a geometry file is refused.

use std::path::{Path, PathBuf};

use crate::types::GeometryError;

/// Why a geometry file is refused.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Neither name nor content tell the format.
    #[error(
        "{}: the format is not known; PLY, OBJ, STL, glTF/GLB, and .xyz/.txt/.csv with rows `x y z` are read",
        path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The content breaks the rules of its format.
    #[error("{}: not a readable {format} file: {message}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The format that was expected.
        format: &'static str,
        /// What is wrong, with the line where the format has lines.
        message: String,
    },
    /// A vertex is not a number or an index out of range.
    #[error("{}: {fault}; repair the file, or write it again from its source", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: GeometryError,
    },
}

impl ReadError {
    /// For `Result::map_err` on the message of a format's parser.
    pub(super) fn content(path: &Path, format: &'static str) -> impl FnOnce(String) -> Self {
        let path = path.to_owned();
        move |message| Self::Content {
            path,
            format,
            message,
        }
    }
}
