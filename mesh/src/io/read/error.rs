//! Why a geometry file cannot be read.

use std::path::{Path, PathBuf};

use crate::types::GeometryError;

/// Why a geometry file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Neither name nor content identify the format.
    #[error(
        "{}: the format is not known; PLY, OBJ, STL, glTF/GLB, and .xyz/.txt/.csv with rows `x y z` are read",
        path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The content is not valid in its format.
    #[error("{}: not a readable {format} file: {message}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The expected format.
        format: &'static str,
        /// The fault, with its line in text formats.
        message: String,
    },
    /// A coordinate is not finite or an index out of range.
    #[error("{}: {fault}; repair the file, or write it again from its source", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// The fault.
        fault: GeometryError,
    },
}

impl ReadError {
    /// Wraps the message of a format's parser.
    pub(super) fn content(path: &Path, format: &'static str) -> impl FnOnce(String) -> Self {
        let path = path.to_owned();
        move |message| Self::Content {
            path,
            format,
            message,
        }
    }
}
