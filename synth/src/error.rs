//! Errors of writing.

use std::path::PathBuf;

use image::ImageError;
use linecarve_mesh::MeshFileError;
use linecarve_mesh::files::WriteError;

use super::options::SynthOptionsError;

/// Why a sequence could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// An option is out of its range.
    #[error(transparent)]
    Options(#[from] SynthOptionsError),
    /// The folder is not empty.
    #[error("{} is not empty: name a new folder or empty this one, so that no frame of another sequence remains in it", folder.display())]
    NotEmpty {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder cannot be made or read.
    #[error("cannot use folder {}: {source} (check that it may be written)", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Error of the encoder.
        source: ImageError,
    },
    /// A file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A mesh could not be written.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}
