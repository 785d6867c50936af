//! `structure.json`: planes, distances, angles.

use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use serde::Serialize;

use crate::plan::{Opening, Plan};
use crate::structure::Structure;
use crate::{Angle, Distance, Kind};

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
    pub up: [f64; 3],
    /// Main directions at right angles, the third one up.
    pub main_directions: Option<[[f64; 3]; 3]>,
    /// Rotation into the frame of DXF, IFC, USD and the plan, by rows.
    pub upright_from_original: [[f64; 3]; 3],
    /// Planes, by descending area.
    pub planes: Vec<PlaneSummary>,
    /// Distances between parallel planes.
    pub distances: Vec<Distance>,
    /// Angles between planes.
    pub angles: Vec<Angle>,
    /// Height of the plan's section in the upright frame.
    pub section_height: Option<f64>,
    /// Openings in walls at that height.
    pub openings: Vec<Opening>,
}

/// A plane as it stands in `structure.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlaneSummary {
    /// Its name in the other files.
    pub name: String,
    /// What it seems to be.
    pub kind: Kind,
    /// Number of its polygons.
    pub polygons: usize,
    /// Unit normal, towards free space.
    pub normal: [f64; 3],
    /// `normal · x` of positions on the plane.
    pub offset: f64,
    /// Where it was measured.
    pub center: [f64; 3],
    /// Area of its polygons.
    pub area: f64,
    /// Root mean square distance of vertices of the mesh.
    pub rms: f64,
    /// Standard deviation of the offset at the centre.
    pub sigma: f64,
    /// Whether the normal is a main direction.
    pub aligned: bool,
}

impl StructureSummary {
    /// Sums up a structure; `free_share` is the share of its polygons in free space, where that was checked.
    pub fn new(structure: &Structure, plan: Option<&Plan>, free_share: Option<f64>) -> Self {
        let mut counts = vec![0; structure.planes.len()];
        structure
            .polygons
            .iter()
            .for_each(|it| counts[it.plane as usize] += 1);
        let planes = structure.planes.iter().zip(&counts).enumerate();
        let rotation = structure.upright_from_original();
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
            up: structure.up.into(),
            main_directions: structure.main_directions.map(|it| it.map(Into::into)),
            upright_from_original: std::array::from_fn(|row| {
                std::array::from_fn(|column| rotation[(row, column)])
            }),
            planes: planes
                .map(|(number, (plane, polygons))| PlaneSummary {
                    name: structure.plane_name(number),
                    kind: plane.kind,
                    polygons: *polygons,
                    normal: plane.normal.into(),
                    offset: plane.offset,
                    center: plane.center.coords.into(),
                    area: plane.area,
                    rms: plane.rms,
                    sigma: plane.sigma,
                    aligned: plane.is_aligned,
                })
                .collect(),
            distances: structure.distances.clone(),
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
