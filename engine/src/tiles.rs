//! A model or a sequence in tiles: what goes into a plan, its tasks, and the mesh that comes of it.

mod cloud;
mod error;
mod median;
mod project;
mod selection;
mod sequence;
mod slurm;
mod spill;
mod task;
#[cfg(test)]
mod tests;
mod whole;

use std::path::{Path, PathBuf};

use linecarve_carving::ExportOptions;
use linecarve_mesh::{StreamedMesh, TriangleMesh, write_mesh_ply, write_streamed_mesh_ply};
use linecarve_tiles::{MergedMesh, TilesError, Work, merged_mesh, merged_surface};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub use error::ProjectError;
pub use project::{Project, carry_out_all};
pub use selection::up_of_views;
pub use sequence::{KEYFRAMES_OF_TASK, SequencePlan};
pub use slurm::slurm_script;
pub use task::{Task, TaskStage};
pub use whole::{PointMesh, mesh_points};

use crate::map::{ModelCounts, close_all_holes};
use crate::options::{HoleFilling, Options};
use crate::recording::{Input, SourceChoice};
use selection::Opened;

/// Points of a tile when the number of tiles is not given.
const POINTS_OF_TILE: usize = 1_000_000;

/// What happens to the merged mesh.
#[derive(Serialize, Deserialize)]
struct Finish {
    /// Added to all coordinates.
    origin: [f64; 3],
    closes_holes: bool,
    /// How the mesh of a dense cloud is exported, whose points decide on triangles and vertices.
    dense: Option<ExportOptions>,
}

impl Finish {
    fn text(
        origin: [f64; 3],
        options: &Options,
        dense: Option<ExportOptions>,
    ) -> Result<String, ProjectError> {
        Ok(serde_json::to_string(&Self {
            origin,
            closes_holes: options.surface.holes == HoleFilling::All,
            dense,
        })?)
    }
}

/// How a plan is made; the mesh depends on nothing of it.
#[derive(Clone, Copy, Debug)]
pub struct Split {
    /// Number of tiles; `None` for one for each million points.
    pub tiles: Option<usize>,
    /// See [`PlanOptions::halo`](linecarve_tiles::PlanOptions::halo).
    pub halo: u32,
    /// Keyframes of one task of the front end.
    pub keyframes_of_task: usize,
}

/// What was planned.
pub enum Planned {
    /// The tiles of a model, and the numbers of its carved and rejected points.
    Model(Box<Work>, ModelCounts),
    /// The keyframes of a sequence; its tiles follow with the intake.
    Sequence(Box<SequencePlan>),
}

/// Plans the points and views of a model, or the keyframes of a sequence, as `reconstruct --final-only` carves them. A dense cloud of
/// COLMAP is read point by point, other models as a whole.
///
/// # Errors
/// When the input has no points with views and no images with poses, the options ask for a simplified mesh, or the plan cannot be made.
pub fn plan(
    input: &Input,
    options: Options,
    split: Split,
    folder: &Path,
) -> Result<Planned, ProjectError> {
    if options.simplify.tolerance.is_some() {
        return Err(ProjectError::Simplified);
    }
    let open = &input.open;
    let is_plain = open.layout.is_none() && open.poses.is_none() && open.calibration.is_none();
    // Others are refused below.
    let is_plain =
        is_plain && input.source == SourceChoice::MapPoints && input.selection.given.is_empty();
    let cloud = match is_plain {
        true => input.dense_cloud()?,
        false => None,
    };
    Ok(match Opened::new(input, cloud.as_ref(), options, folder)? {
        Opened::Points(points) => {
            ensure_no_sequence(folder)?;
            let counts = points.counts;
            Planned::Model(Box::new(points.plan(split, folder)?), counts)
        }
        Opened::Recording(recording) => {
            let plan = SequencePlan::create(&recording, input, split, folder)?;
            Planned::Sequence(Box::new(plan))
        }
    })
}

/// Refuses the folder of a sequence.
fn ensure_no_sequence(folder: &Path) -> Result<(), ProjectError> {
    match SequencePlan::open(folder)? {
        Some(_) => {
            let path = folder.to_owned();
            Err(TilesError::Planned { path }.into())
        }
        None => Ok(()),
    }
}

/// Writes `mesh.ply` of a plan whose stages are done; returns its path and the number of its triangles. The mesh passes through
/// memory in blocks, unless its holes have to be closed.
///
/// # Errors
/// When the merged mesh is damaged or the file cannot be written.
pub fn write_mesh(project: &Project) -> Result<(PathBuf, usize), ProjectError> {
    let work = project.work()?;
    let path = work.folder().join("mesh.ply");
    if let Some(mesh) = project.surface()? {
        write_mesh_ply(&path, &mesh)?;
        return Ok((path, mesh.triangles.len()));
    }
    let finish: Finish = serde_json::from_str(&work.plan().caller)?;
    let origin: Vector3<f64> = finish.origin.into();
    if finish.closes_holes || finish.dense.is_some() {
        let mut mesh = match &finish.dense {
            Some(export) => {
                let surface = cloud::read_surface(work.folder())?;
                surface.surface_of(&merged_surface(work)?, export)
            }
            None => {
                let merged = merged_mesh(work)?;
                TriangleMesh {
                    positions: merged.vertices,
                    triangles: merged.triangles,
                    colors: None,
                }
            }
        };
        if finish.closes_holes {
            close_all_holes(&mut mesh);
        }
        mesh.translate(&origin);
        write_mesh_ply(&path, &mesh)?;
        return Ok((path, mesh.triangles.len()));
    }
    let merged = MergedMesh::open(work)?;
    let wrong = |error: TilesError| std::io::Error::other(error);
    let positions = merged.vertices().map(|position| position.map_err(wrong));
    let mesh = StreamedMesh {
        counts: [merged.vertex_count(), merged.triangle_count()],
        bounds: merged.bounds().map(|ends| ends.map(|end| end + origin)),
        vertices: positions.map(|position| position.map(|position| position + origin)),
        triangles: merged.triangles().map(|triangle| triangle.map_err(wrong)),
    };
    write_streamed_mesh_ply(&path, mesh)?;
    Ok((path, merged.triangle_count()))
}
