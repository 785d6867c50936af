//! `structure.json`: planes, distances, angles.

use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use nalgebra::Vector3;
use serde::Serialize;

use crate::plan::{Opening, Plan};
use crate::structure::{Structure, StructurePlane};
use crate::{Angle, Distance, Edge};

/// The planes of a structure and what was measured between them, in the frame of the mesh unless said otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StructureSummary {
    /// The program and its version.
    pub generator: &'static str,
    /// Number of polygons, corners of their rings, and holes.
    pub polygons: usize,
    /// Corners of all rings.
    pub corners: usize,
    /// Holes of all polygons.
    pub holes: usize,
    /// Area of the polygons.
    pub polygon_area: f64,
    /// Triangles on no plane.
    pub rest_triangles: usize,
    /// Their area.
    pub rest_area: f64,
    /// Area of the mesh.
    pub mesh_area: f64,
    /// Standard deviation of the mesh across its flat parts.
    pub noise: f64,
    /// Share of the area of polygons that lies in free space, more than a tolerance away from the mesh; `None` where it was not checked.
    pub free_share: Option<f64>,
    /// Up.
    pub up: Vector3<f64>,
    /// Main directions at right angles, the third one up.
    pub main_directions: Option<[Vector3<f64>; 3]>,
    /// Rotation into the frame of DXF, IFC, USD and the plan, by rows.
    pub upright_from_original: [[f64; 3]; 3],
    /// Added after that rotation; zero unless the mesh lies far from zero.
    pub upright_translation: Vector3<f64>,
    /// Planes, by descending area.
    pub planes: Vec<StructurePlane>,
    /// Distances between parallel planes.
    pub distances: Vec<Distance>,
    /// Where planes meet.
    pub edges: Vec<Edge>,
    /// Angles between planes.
    pub angles: Vec<Angle>,
    /// Height of the plan's section in the upright frame.
    pub section_height: Option<f64>,
    /// Openings in walls at that height.
    pub openings: Vec<Opening>,
}

impl StructureSummary {
    /// Sums up a structure; `free_share` is the share of its polygons in free space, where that was checked.
    pub fn new(structure: &Structure, plan: Option<&Plan>, free_share: Option<f64>) -> Self {
        let upright = structure.upright_from_original();
        let rings = || structure.polygons.iter().flat_map(|it| &it.rings);
        Self {
            generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")),
            polygons: structure.polygons.len(),
            corners: rings().map(Vec::len).sum(),
            holes: rings().count() - structure.polygons.len(),
            // The sum of nothing is -0.
            polygon_area: structure.planes.iter().map(|it| it.area).sum::<f64>() + 0.0,
            rest_triangles: structure.rest.len(),
            rest_area: structure.area_of(&structure.rest) + 0.0,
            mesh_area: structure.mesh_area,
            noise: structure.noise,
            free_share,
            up: structure.up,
            main_directions: structure.main_directions,
            upright_from_original: std::array::from_fn(|row| {
                std::array::from_fn(|column| upright.rotation[(row, column)])
            }),
            upright_translation: upright.translation.vector,
            planes: structure.planes.clone(),
            distances: structure.distances.clone(),
            edges: structure.edges.clone(),
            angles: structure.angles.clone(),
            section_height: plan.map(|it| it.height),
            openings: plan.map_or_else(Vec::new, |it| it.openings.clone()),
        }
    }
}

/// Writes a summary.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json(path: &Path, summary: &StructureSummary) -> Result<(), WriteError> {
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, summary)?;
        writeln!(out)
    })
}
