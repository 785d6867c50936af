//! Why a mesh file could not be written.

use std::path::{Path, PathBuf};

use crate::files::WriteError;
use crate::types::GeometryError;

/// Why a mesh file could not be written. The file is then as it was before.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The geometry cannot be stored.
    #[error("{}: cannot be written: {fault}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong with the geometry.
        fault: GeometryError,
    },
    /// The geometry does not fit the format.
    #[error("{}: {bytes} bytes of geometry are more than a GLB file of 4 GiB can hold; write PLY", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Size of the geometry.
        bytes: usize,
    },
    /// The file system refused.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl MeshFileError {
    /// For `Result::map_err` on a validation of what goes to `path`.
    pub(super) fn geometry(path: &Path) -> impl FnOnce(GeometryError) -> Self + '_ {
        move |fault| Self::Geometry {
            path: path.to_owned(),
            fault,
        }
    }
}
