//! The planes of a mesh, a floor plan and what they measure, as files.

use linecarve_carving::{Carver, Location};
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{GltfFrame, TriangleMesh};
use linecarve_structure::{
    Plan, Structure, StructureOptions, StructureSummary, structure, write_dxf, write_ifc,
    write_json, write_structure_glb, write_structure_obj, write_svg, write_usda,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::output_folder::OutputFolder;

/// Positions on the polygons that are looked up in the carved space.
const SAMPLES: usize = 50_000;

/// A mesh to be taken apart, in the frame of the poses.
pub(crate) struct StructureInput<'a> {
    pub(crate) mesh: &'a TriangleMesh,
    /// Known straight edges.
    pub(crate) segments: &'a [[Point3<f64>; 2]],
    /// Frame of the GLB file.
    pub(crate) frame: GltfFrame,
    /// The carved space, and the origin that is subtracted from positions in it.
    pub(crate) carved: Option<(&'a Carver, Vector3<f64>)>,
    pub(crate) options: StructureOptions,
}

/// Writes `structure.*` and `plan.svg`.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write_structure(
    input: &StructureInput<'_>,
    output: &mut OutputFolder,
) -> anyhow::Result<StructureSummary> {
    let found = structure(input.mesh, input.segments, &input.options);
    let plan = Plan::new(&found);
    let free = input
        .carved
        .map(|(carver, origin)| free_share(&found, input.mesh, carver, &origin));
    let summary = StructureSummary::new(&found, plan.as_ref(), free);
    write_structure_glb(&output.file("structure.glb")?, &found, input.frame)?;
    output.file("structure.mtl")?;
    write_structure_obj(&output.file("structure.obj")?, &found)?;
    write_dxf(&output.file("structure.dxf")?, &found)?;
    write_ifc(&output.file("structure.ifc")?, &found)?;
    write_usda(&output.file("structure.usda")?, &found)?;
    write_svg(&output.file("plan.svg")?, &found, plan.as_ref())?;
    write_json(&output.file("structure.json")?, &summary)?;
    Ok(summary)
}

/// The share of the area of polygons that lies in free cells, and further from the mesh than vertices may move.
fn free_share(
    structure: &Structure,
    mesh: &TriangleMesh,
    carver: &Carver,
    origin: &Vector3<f64>,
) -> f64 {
    let mut mesh = mesh.clone();
    mesh.translate(&-origin);
    let scene = RayScene::new(&mesh);
    let samples = structure.samples(SAMPLES);
    let is_free = |sample: &&Point3<f64>| {
        let at = **sample - origin;
        if scene.closest(&at, structure.tolerance).is_some() {
            return false;
        }
        match carver.tetrahedra().locate(&at, None) {
            Ok(Location::InCell(cell)) => carver.is_free(cell),
            _ => false,
        }
    };
    let free = samples.par_iter().filter(is_free).count();
    free as f64 / samples.len().max(1) as f64
}
