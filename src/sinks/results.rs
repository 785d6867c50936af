//! Everything that a reconstruction writes at its end.

use std::time::Instant;

use anyhow::Context;
use linecarve_mesh::render::write_png;
use linecarve_mesh::texture::{EncodedTexture, TextureFormat};
use linecarve_mesh::{LineSet, TriangleMesh, write_glb, write_points_ply};
use nalgebra::Point3;

use super::feature_edges;
use super::output::{Format, write_poses};
use super::output_folder::OutputFolder;
use super::page::PageRecorder;
use super::picture::{crosses, draw_picture};
use super::report::RunLog;
use super::simplified::{line_ends, simplified};
use super::structure::{StructureInput, page_structure, write_structure};
use super::surface_files::SurfaceFiles;
use super::surface_page::write_surface_page;
use crate::progress::Verbosity;
use crate::report::page::PageStructure;
use linecarve_engine::run::milliseconds;
use linecarve_engine::texture::texture;
use linecarve_engine::{Reconstruction, camera_warning};
use linecarve_structure::StructureOptions;

/// What is written.
pub(crate) struct ResultSettings<'a> {
    /// Formats of meshes and lines.
    pub(crate) formats: &'a [Format],
    /// Format of the texture's image, when the mesh gets one.
    pub(crate) texture: Option<TextureFormat>,
    /// Whether the planes of the mesh are written.
    pub(crate) structure: bool,
    /// Whether `picture.png` is drawn.
    pub(crate) picture: bool,
    /// Number of the keyframe that the picture shows.
    pub(crate) richest: Option<usize>,
    pub(crate) verbosity: Verbosity,
}

/// Writes the results of a finished reconstruction and notes them in the report, which itself is not written yet. Returns the final mesh, in
/// the frame of the poses.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write_results(
    run: &Reconstruction,
    settings: &ResultSettings<'_>,
    page: Option<PageRecorder>,
    output: &mut OutputFolder,
    log: &mut RunLog,
) -> anyhow::Result<TriangleMesh> {
    let (recording, map) = (run.recording(), run.map());
    let clusters = map
        .segments()
        .map_or_else(LineSet::default, |segments| segments.clusters());
    let clusters = &clusters;
    let simplification = recording.options.simplify;
    let start = Instant::now();
    // In a worker thread, as the map before: it can use the memory that the carver gave back.
    let adjusted = rayon::scope(|_| map.final_surface());
    let mesh = simplified(adjusted, clusters, simplification)?;
    let extracted = milliseconds(start.elapsed());
    let edges = feature_edges::final_mesh_edges(&mesh, clusters, simplification.tolerance)?;

    log.set_median_depth(map.median_depth());
    let points = map.feature_points();
    let correction = points.and_then(|points| points.lens().correction());
    let given = recording.sequence.stored_color_camera();
    if let Some(warning) = correction.and_then(|found| camera_warning(given, &found)) {
        log.warn(warning);
    }
    let result = log.result();
    result.feature_edges = Some(feature_edges::summary(&edges));
    if let Some(segments) = map.segments() {
        result.segments = segments.segment_count();
        result.clusters = segments.cluster_count();
    }
    result.surface = "carved";
    let carved = map.carved_counts();
    result.points = carved.points;
    result.rays = carved.rays;
    result.cells = carved.cells;
    result.vertices = mesh.positions.len();
    result.triangles = mesh.triangles.len();
    result.surface_milliseconds = recording.source.model().map(|_| extracted);
    result.carving_milliseconds = map.final_carving().map(milliseconds);
    result.camera_correction = correction;
    result.reprojection_rms_px = points
        .map(|points| points.quality())
        .and_then(|quality| (quality.points > 0).then_some(quality.reprojection_rms_px));

    let texture = match settings.texture {
        Some(format) => encoded_texture(run, &mesh, format, log)?,
        None => None,
    };
    let structure = match settings.structure {
        true => Some(planes(run, &mesh, clusters, output)?),
        false => None,
    };
    if let Some(page) = page {
        let path = output.file("report.html")?;
        write_surface_page(&path, run, page, &mesh, texture.as_ref(), structure, log)?;
    }
    let cloud = cloud(run);
    if settings.picture {
        // Drawn before the origin is added again: ray casts want coordinates near zero.
        let marks = match &cloud {
            Some(cloud) => {
                let share = if recording.source.model().is_some() {
                    0.004
                } else {
                    0.006
                };
                crosses(&cloud.points, share * map.median_depth().unwrap_or(0.0))
            }
            None => clusters.clone(),
        };
        let picture = draw_picture(run, &mesh, &marks, settings.richest, settings.verbosity)
            .context("the picture could not be made (--no-picture leaves it out)")?;
        if let Some(picture) = picture {
            write_png(&output.file("picture.png")?, &picture)?;
        }
    }
    let origin = &recording.origin;
    if let Some(mut cloud) = cloud {
        cloud.translate(origin);
        let path = output.file("points.ply")?;
        write_points_ply(&path, &cloud.points, cloud.colors.as_deref())?;
    }
    if let Some(poses) = run.corrected_poses() {
        write_poses(output, &recording.sequence, poses.into_iter())?;
    }
    let lines = map.segments().map(|segments| segments.segments());
    let mut surface = SurfaceFiles {
        mesh,
        texture,
        lines: lines.map(|segments| (segments, clusters.clone())),
        edges: edges.lines,
    };
    surface.translate(origin);
    let frame = recording.gltf_frame();
    surface.write(output, "", settings.formats, &frame)?;
    if surface.lines.is_some() && settings.formats.contains(&Format::Glb) {
        let parts = surface.parts();
        write_glb(&output.file("scene.glb")?, &parts, frame)?;
    }
    Ok(surface.mesh)
}

/// Writes the planes of the mesh; returns them for the page.
fn planes(
    run: &Reconstruction,
    mesh: &TriangleMesh,
    clusters: &LineSet,
    output: &mut OutputFolder,
) -> anyhow::Result<PageStructure> {
    let origin = run.recording().origin;
    let (mut mesh, mut clusters) = (mesh.clone(), clusters.clone());
    mesh.translate(&origin);
    clusters.translate(&origin);
    let frame = run.recording().gltf_frame();
    let mut options = StructureOptions::default();
    options.up = frame.up();
    let input = StructureInput {
        mesh: &mesh,
        segments: &line_ends(&clusters.points, &clusters.lines),
        frame,
        carved: Some((run.map().carver(), origin)),
        options,
    };
    let (summary, plan) = write_structure(&input, output)?;
    Ok(page_structure(&summary, plan))
}

/// The texture of the mesh, noted in the report; `None` with a warning when there is none.
fn encoded_texture(
    run: &Reconstruction,
    mesh: &TriangleMesh,
    format: TextureFormat,
    log: &mut RunLog,
) -> anyhow::Result<Option<EncodedTexture>> {
    if mesh.is_empty() {
        return Ok(None);
    }
    let Some((texture, summary)) = texture(run, mesh) else {
        log.warn(
            "there is no texture, because no image of a keyframe can be read or the mesh has too many triangles (--simplify): the mesh has \
             vertex colours"
                .to_owned(),
        );
        return Ok(None);
    };
    log.result().texture = Some(summary);
    let texture = texture.encoded(format);
    texture.map(Some).context("the texture cannot be encoded")
}

/// The carved points with their colours, in the frame of computation; `None` when the map is made of lines.
fn cloud(run: &Reconstruction) -> Option<LineSet> {
    let map = run.map();
    let Some(points) = map.feature_points() else {
        return Some(cloud_of(map.carved_points()?));
    };
    let gray = |(position, value)| (position, Some([value; 3]));
    Some(cloud_of(points.carved_points().map(gray)))
}

/// Points with their colours, which are left out unless all have one.
fn cloud_of(points: impl Iterator<Item = (Point3<f64>, Option<[u8; 3]>)>) -> LineSet {
    let (points, colors): (Vec<_>, Vec<_>) = points.unzip();
    LineSet {
        points,
        lines: Vec::new(),
        colors: colors.into_iter().collect(),
    }
}
