//! Points with views carved in one process: the mesh alone, in as little memory as possible.

use std::path::Path;

use linecarve_mesh::TriangleMesh;
use nalgebra::Vector3;

use super::ProjectError;
use super::selection::{Opened, Selection};
use crate::map::{Map, ModelCounts};
use crate::options::Options;
use crate::recording::Input;

/// The mesh of points.
#[derive(Debug, Clone)]
pub struct PointMesh {
    /// In the frame of the poses. With colours where the points have some.
    pub mesh: TriangleMesh,
    /// Mean up direction of the views.
    pub up: Vector3<f64>,
    /// Numbers of carved and rejected points.
    pub counts: ModelCounts,
    /// Number of points that were carved, after points of a dense cloud were joined.
    pub carved: usize,
}

/// Carves the points of a model or of a dense cloud once. `None` when the input has no points with views.
///
/// The mesh is that of a [`Reconstruction`](crate::Reconstruction) of the same points. With `is_closed` it is watertight: nothing is left
/// out because it was not seen, and the surface goes on along the hull of the points.
///
/// A dense cloud of COLMAP, or with normals and cameras, is read point by point, with temporary files in `folder`.
///
/// # Errors
/// When the input cannot be read, a parameter is out of range, or a temporary file cannot be written.
pub fn mesh_points(
    input: &Input,
    options: Options,
    is_closed: bool,
    folder: &Path,
) -> Result<Option<PointMesh>, ProjectError> {
    let cloud = input.dense_cloud()?;
    match Opened::new(input, cloud.as_ref(), options, folder)? {
        Opened::Points(points) => points.mesh(is_closed, folder).map(Some),
        Opened::Recording(_) => Ok(None),
    }
}

impl Selection {
    /// Carves the points once.
    ///
    /// # Errors
    /// As [`mesh_points`].
    fn mesh(mut self, is_closed: bool, folder: &Path) -> Result<PointMesh, ProjectError> {
        let mut map = Map::of_points(&self.options, self.centers.clone(), self.median_depth)?;
        self.visit(folder, |points| Ok(map.add_points(points)?))?;
        map.carve_last(is_closed);
        let mut mesh = map.final_surface();
        mesh.translate(&self.origin);
        Ok(PointMesh {
            mesh,
            up: self.up,
            counts: self.counts,
            carved: map.carver().point_count(),
        })
    }
}

#[cfg(test)]
mod tests;
