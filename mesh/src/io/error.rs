//! Why a mesh file could not be written.

use std::path::{Path, PathBuf};

use crate::files::WriteError;
use crate::texture::TextureError;
use crate::types::GeometryError;

/// Why a mesh file could not be written. The file is then as it was before.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The geometry is not valid.
    #[error("{}: cannot be written: {fault}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// The fault.
        fault: GeometryError,
    },
    /// The texture does not fit the mesh.
    #[error("{}: cannot be written: {fault}", path.display())]
    Texture {
        /// The file.
        path: PathBuf,
        /// The fault.
        fault: TextureError,
    },
    /// The geometry is too large for the format.
    #[error("{}: {bytes} bytes of geometry are more than a GLB file of 4 GiB can hold; write PLY", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Size of the geometry.
        bytes: usize,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl MeshFileError {
    /// Wraps a validation error of the texture for `path`.
    pub(super) fn texture(path: &Path) -> impl FnOnce(TextureError) -> Self + '_ {
        move |fault| Self::Texture {
            path: path.to_owned(),
            fault,
        }
    }

    /// Wraps a validation error of the geometry for `path`.
    pub(super) fn geometry(path: &Path) -> impl FnOnce(GeometryError) -> Self + '_ {
        move |fault| Self::Geometry {
            path: path.to_owned(),
            fault,
        }
    }
}
