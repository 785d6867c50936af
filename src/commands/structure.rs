//! `linecarve structure`: planes, straight edges and a floor plan.

use std::path::{Path, PathBuf};

use anyhow::Context;
use linecarve_engine::run::CancelToken;
use linecarve_engine::video::is_video;
use linecarve_engine::{Reconstruction, Recording, RunOptions};
use linecarve_mesh::{GltfFrame, Shape, ShapeKind, far_origin, read_geometry};
use linecarve_structure::{StructureOptions, StructureSummary, measured_text};
use nalgebra::{Point3, Vector3};

use crate::cli::StructureArgs;
use crate::commands::Outcome;
use crate::commands::input::{base_options, input, keyframe_options};
use crate::commands::unused::refuse_unused;
use crate::progress::Verbosity;
use crate::sinks::{
    OutputFolder, StructureInput, final_mesh, keep_structure_inputs, line_ends, print_object,
    print_text, write_structure,
};

/// Formats of the mesh and of the clusters of a run, the exact ones first.
const FORMATS: [&str; 3] = ["ply", "glb", "obj"];

pub(super) fn run(args: &StructureArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let path = &args.input.sequence;
    let summary = match mesh_file(path) {
        Some(mesh) => of_file(&mesh, args)?,
        None => of_sequence(args, verbosity)?,
    };
    let Some(summary) = summary else {
        return Ok(Outcome::Negative(format!(
            "{}: the mesh is empty",
            path.display()
        )));
    };
    match args.json {
        true => print_object(&summary)?,
        false => print_text(&text(&summary))?,
    }
    Ok(match summary.polygons {
        0 => Outcome::Negative(format!("{}: no plane was found", path.display())),
        _ => Outcome::Done,
    })
}

/// The mesh that a path names: a file of a mesh, or that of a run.
fn mesh_file(path: &Path) -> Option<PathBuf> {
    if path.join("report.json").is_file() {
        return run_file(path, "mesh");
    }
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    let is_mesh = ["glb", "gltf", "obj", "ply", "stl"].contains(&extension.as_str());
    (path.is_file() && is_mesh).then(|| path.to_owned())
}

/// A file of a run in the first format that it has.
fn run_file(folder: &Path, name: &str) -> Option<PathBuf> {
    let files = FORMATS.map(|extension| folder.join(format!("{name}.{extension}")));
    files.into_iter().find(|file| file.is_file())
}

fn of_file(file: &Path, args: &StructureArgs) -> anyhow::Result<Option<StructureSummary>> {
    let reason = format!("{} is a mesh, and no sequence", file.display());
    refuse_unused(&args.given_of_sequences(), &reason)?;
    let shape = read_geometry(file)?;
    anyhow::ensure!(
        matches!(shape.kind(), ShapeKind::Mesh | ShapeKind::Empty),
        "{} has no triangles, and planes are those of a mesh: make one of its points with linecarve mesh",
        file.display()
    );
    let mesh = shape.into_mesh();
    let of_run = file
        .parent()
        .and_then(|folder| run_file(folder, "clusters"));
    let is_run = args.input.sequence.is_dir();
    let lines = args.lines.clone().or(of_run.filter(|_| is_run));
    let segments = match lines {
        Some(lines) => segments_of(&read_geometry(&lines)?),
        None => Vec::new(),
    };
    if mesh.triangles.is_empty() {
        return Ok(None);
    }
    let up = args
        .up
        .or_else(|| reported_up(file))
        .unwrap_or([0.0, -1.0, 0.0])
        .into();
    let mut output = OutputFolder::create(&args.out, &[])?;
    let inputs: Vec<&Path> = [file].into_iter().chain(args.lines.as_deref()).collect();
    keep_structure_inputs(&output, &inputs)?;
    let input = StructureInput {
        mesh: &mesh,
        segments: &segments,
        frame: GltfFrame::upright(far_origin(&mesh.positions), &up),
        carved: None,
        options: options(args, up),
    };
    write_structure(&input, &mut output).map(|it| Some(it.0))
}

fn of_sequence(
    args: &StructureArgs,
    verbosity: Verbosity,
) -> anyhow::Result<Option<StructureSummary>> {
    let path = &args.input.sequence;
    anyhow::ensure!(
        !is_video(path),
        "{}: reconstruct the video first, and give the folder of the run",
        path.display()
    );
    let mut output = OutputFolder::create(&args.out, &[path])?;
    let files = args.input.files().chain(args.lines.as_deref());
    let files: Vec<&Path> = files.chain(args.config.as_deref()).collect();
    keep_structure_inputs(&output, &files)?;
    let mut parameters = base_options(None, args.config.as_deref(), &[])?;
    keyframe_options(&args.selection, &mut parameters);
    let mut input = input(&args.input, &args.selection, args.depth.into(), verbosity);
    input.up = args.up;
    let recording = Recording::open(&input, parameters)?;
    let mut settings = RunOptions::default();
    settings.is_at_once = true;
    let mut run = Reconstruction::new(recording, settings)?;
    run.run(CancelToken::default(), &mut [])?;
    let mesh = final_mesh(&run)?;
    if mesh.is_empty() {
        return Ok(None);
    }
    let clusters = run.clusters();
    let mut segments = line_ends(&clusters.points, &clusters.lines);
    if let Some(lines) = &args.lines {
        segments = segments_of(&read_geometry(lines)?);
    }
    let recording = run.recording();
    let frame = recording.gltf_frame();
    let input = StructureInput {
        mesh: &mesh,
        segments: &segments,
        frame,
        carved: Some((run.map().carver(), recording.origin)),
        options: options(args, frame.up()),
    };
    let (summary, _) = write_structure(&input, &mut output).context("--out")?;
    Ok(Some(summary))
}

fn options(args: &StructureArgs, up: Vector3<f64>) -> StructureOptions {
    let mut options = StructureOptions::default();
    options.up = up;
    options.most_polygons = args.most_polygons;
    options
}

fn segments_of(shape: &Shape) -> Vec<[Point3<f64>; 2]> {
    line_ends(&shape.positions, &shape.lines)
}

/// Up, as the report of the run beside a mesh says.
fn reported_up(mesh: &Path) -> Option<[f64; 3]> {
    let text = std::fs::read(mesh.with_file_name("report.json")).ok()?;
    let report: serde_json::Value = serde_json::from_slice(&text).ok()?;
    serde_json::from_value(report.pointer("/sequence/up")?.clone()).ok()
}

/// The summary for people.
fn text(summary: &StructureSummary) -> String {
    let mut text = format!(
        "{} polygons on {} planes, {:.2} of {:.2} square units; {} triangles on no plane\n",
        summary.polygons,
        summary.planes.len(),
        summary.polygon_area,
        summary.mesh_area,
        summary.rest_triangles
    );
    if let Some(share) = summary.free_share {
        text += &format!("{:.3} % of the polygons lie in free space\n", 100.0 * share);
    }
    for distance in summary.distances.iter().filter(|it| it.facing) {
        let [one, other] = distance.planes.map(|it| &summary.planes[it as usize].name);
        let value = measured_text(distance.value, distance.sigma);
        text += &format!("{one} to {other}: {value}\n");
    }
    text
}
