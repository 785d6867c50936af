//! The planes of a mesh, a floor plan and what they measure, as files.

use std::path::Path;

use linecarve_carving::{Carver, Location};
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{GltfFrame, TriangleMesh};
use linecarve_structure::{
    Plan, Structure, StructureOptions, StructureSummary, deviation_text, measured_text, structure,
    svg, write_dxf, write_ifc, write_json, write_structure_glb, write_structure_obj, write_usda,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::output_file::{OutputFileError, check_outputs};
use super::output_folder::OutputFolder;
use crate::report::page::{PageStructure, PageTable};
use linecarve_mesh::files::write_atomically;

/// Positions on the polygons that are looked up in the carved space.
const SAMPLES: usize = 50_000;

/// Everything that is written.
const FILES: [&str; 8] = [
    "structure.glb",
    "structure.mtl",
    "structure.obj",
    "structure.dxf",
    "structure.ifc",
    "structure.usda",
    "plan.svg",
    "structure.json",
];

/// Refuses inputs that [`write_structure`] would overwrite in an output folder.
///
/// # Errors
/// When an input is one of its files.
pub(crate) fn keep_structure_inputs(
    output: &OutputFolder,
    inputs: &[&Path],
) -> Result<(), OutputFileError> {
    let files = FILES.map(|name| output.root().join(name));
    let files = files.each_ref().map(|file| ("--out", file.as_path()));
    check_outputs(&files, inputs)
}

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

/// Writes `structure.*` and `plan.svg`; returns the summary and the drawing of the plan.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write_structure(
    input: &StructureInput<'_>,
    output: &mut OutputFolder,
) -> anyhow::Result<(StructureSummary, String)> {
    let found = structure(input.mesh, input.segments, &input.options);
    let plan = Plan::new(&found);
    let free = input
        .carved
        .map(|(carver, origin)| free_share(&found, input.mesh, carver, &origin));
    let summary = StructureSummary::new(&found, plan.as_ref(), free);
    let drawing = svg(&found, plan.as_ref());
    write_structure_glb(&output.file("structure.glb")?, &found, input.frame)?;
    output.file("structure.mtl")?;
    write_structure_obj(&output.file("structure.obj")?, &found)?;
    write_dxf(&output.file("structure.dxf")?, &found)?;
    write_ifc(&output.file("structure.ifc")?, &found)?;
    write_usda(&output.file("structure.usda")?, &found)?;
    let plan = output.file("plan.svg")?;
    write_atomically(&plan, |out| out.write_all(drawing.as_bytes()))?;
    write_json(&output.file("structure.json")?, &summary)?;
    Ok((summary, drawing))
}

/// Plan, planes, distances and edges for the page.
pub(crate) fn page_structure(summary: &StructureSummary, plan: String) -> PageStructure {
    let planes = summary.planes.iter().map(|plane| {
        let [width, height] = plane.size;
        vec![
            plane.name.clone(),
            plane.polygons.to_string(),
            format!("{:.3}", plane.area),
            format!("{width:.3} × {height:.3}"),
            deviation_text(plane.rms),
            deviation_text(plane.sigma),
        ]
    });
    let names = |planes: [u32; 2]| planes.map(|it| summary.planes[it as usize].name.clone());
    let distances = summary.distances.iter().map(|it| {
        let [one, other] = names(it.planes);
        let facing = if it.facing { "yes" } else { "no" };
        let value = measured_text(it.value, it.sigma);
        vec![one, other, value, facing.to_owned()]
    });
    let edges = summary.edges.iter().map(|it| {
        let [one, other] = names(it.planes);
        vec![one, other, format!("{:.3}", it.length)]
    });
    let table = |title: &str, columns: &[&str], rows: Vec<Vec<String>>, note: &str| PageTable {
        title: title.to_owned(),
        columns: columns.iter().map(|it| (*it).to_owned()).collect(),
        rows,
        note: note.to_owned(),
    };
    PageStructure {
        plan,
        tables: vec![
            table(
                "Distances between parallel planes",
                &["plane", "and", "distance", "face each other"],
                distances.collect(),
                "± is the standard deviation.",
            ),
            table(
                "Planes",
                &["plane", "polygons", "area", "size", "RMS", "deviation"],
                planes.collect(),
                "Size: width along a level direction and height across it. RMS: distance of the vertices. Deviation: of the \
                 plane's position across itself.",
            ),
            table("Edges", &["plane", "and", "length"], edges.collect(), ""),
        ],
    }
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
