//! `structure.json`: planes, distances, angles.

use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use serde::Serialize;

use crate::plan::{Opening, Plan};
use crate::structure::Structure;
use crate::{Angle, Distance, Kind};

#[derive(Serialize)]
struct Summary<'a> {
    generator: &'static str,
    polygons: usize,
    corners: usize,
    holes: usize,
    polygon_area: f64,
    rest_triangles: usize,
    rest_area: f64,
    mesh_area: f64,
    noise: f64,
    up: [f64; 3],
    main_directions: Option<[[f64; 3]; 3]>,
    upright_from_original: [[f64; 3]; 3],
    planes: Vec<PlaneSummary>,
    distances: &'a [Distance],
    angles: &'a [Angle],
    section_height: Option<f64>,
    openings: &'a [Opening],
}

#[derive(Serialize)]
struct PlaneSummary {
    name: String,
    kind: Kind,
    polygons: usize,
    normal: [f64; 3],
    offset: f64,
    center: [f64; 3],
    area: f64,
    rms: f64,
    sigma: f64,
    aligned: bool,
}

/// Writes the planes of a structure and what was measured between them, in the frame of the mesh.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json(path: &Path, structure: &Structure, plan: Option<&Plan>) -> Result<(), WriteError> {
    let mut counts = vec![0; structure.planes.len()];
    structure.polygons.iter().for_each(|it| counts[it.plane as usize] += 1);
    let planes = structure.planes.iter().zip(&counts).enumerate();
    let rotation = structure.upright_from_original();
    let rings = || structure.polygons.iter().flat_map(|it| &it.rings);
    let summary = Summary {
        generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")),
        polygons: structure.polygons.len(),
        corners: rings().map(Vec::len).sum(),
        holes: rings().count() - structure.polygons.len(),
        polygon_area: structure.planes.iter().map(|it| it.area).sum(),
        rest_triangles: structure.rest.len(),
        rest_area: structure.area_of(&structure.rest),
        mesh_area: structure.mesh_area,
        noise: structure.noise,
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
        distances: &structure.distances,
        angles: &structure.angles,
        section_height: plan.map(|it| it.height),
        openings: plan.map_or(&[], |it| &it.openings),
    };
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, &summary)?;
        writeln!(out)
    })
}
