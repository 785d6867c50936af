//! `report.json`: parameters, results and stage times of a run.

pub(crate) mod growth_delta;
pub mod page;

use std::path::Path;

use linecarve_lines::camera::CameraCorrection;
use linecarve_mesh::texture::TextureSummary;
use serde::Serialize;

use linecarve_mesh::files::{WriteError, write_atomically};

use linecarve_engine::front_end::{ClassSummary, LayerSummary, PoseSummary};
pub use linecarve_engine::run::StageTimes;

/// The report of a run. Counts and parameters are reproducible; durations and memory are not.
#[derive(Debug, Clone, Serialize)]
pub struct Report<P: Serialize> {
    /// `linecarve <version>`.
    pub generator: String,
    /// The command that ran: `reconstruct` or `lines`.
    pub command: &'static str,
    /// Source of the surface: `lines` or `map-points`.
    pub from: &'static str,
    /// The input.
    pub sequence: SequenceSummary,
    /// The published system whose parameters the run has; the configuration does not tell all of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<&'static str>,
    /// The configuration of the run; as TOML it is a `--config` that repeats the run.
    pub parameters: P,
    /// One entry per keyframe, in the order of processing.
    pub keyframes: Vec<KeyframeReport>,
    /// The result.
    pub result: ResultSummary,
    /// Warnings, in order.
    pub warnings: Vec<String>,
    /// Sums over the run.
    pub timing: TimingSummary,
}

/// The input.
#[derive(Debug, Clone, Serialize)]
pub struct SequenceSummary {
    /// Name of the folder.
    pub name: String,
    /// The detected layout.
    pub layout: String,
    /// Number of frames with poses.
    pub frames: usize,
    /// Number of selected keyframes.
    pub keyframes: usize,
    /// Number of keyframes with unusable images.
    pub skipped: usize,
    /// Source of depth.
    pub depth: &'static str,
    /// Median scene depth in units of the poses, the length scale for all thresholds.
    pub median_depth: f64,
    /// Origin subtracted from coordinates during the computation; outputs have it added again.
    pub origin: [f64; 3],
    /// Up in the frame of the poses; GLB files have it as y.
    pub up: [f64; 3],
    /// Difference of poses and images, when it was estimated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<PoseSummary>,
    /// How the depth images of keyframes agree with each other, when they were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layers: Option<LayerSummary>,
    /// What each class of confidence of depth images is worth.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub confidence: Vec<ClassSummary>,
}

/// Counts and durations of one keyframe.
#[derive(Debug, Clone, Default, Serialize)]
pub struct KeyframeReport {
    /// Name of the frame in the sequence.
    pub frame: String,
    /// Position of the frame in the sequence.
    pub index: usize,
    /// Number of edge chains in the image.
    pub edge_chains: usize,
    /// Number of pixels on edge chains.
    pub edge_pixels: usize,
    /// Share of these pixels with a depth.
    pub edge_depth_share: f64,
    /// Number of 3D segments.
    pub segments: usize,
    /// Number of clusters of sufficient size so far.
    pub clusters: usize,
    /// Number of points added.
    pub new_points: usize,
    /// Number of existing points observed again.
    pub observed_again: usize,
    /// Visibility rays so far.
    pub rays: usize,
    /// Tetrahedra so far; 0 when the surface is carved at the end.
    pub cells: usize,
    /// Number of triangles after this keyframe, before filtering for export; 0 when the surface is carved at the end.
    pub triangles: usize,
    /// Number of triangles added and removed; 0 when the surface is carved at the end.
    pub changed_triangles: usize,
    /// With depth from neighbours: number of later keyframes until this one was in the surface.
    #[serde(rename = "awaited", skip_serializing_if = "Option::is_none")]
    pub delay_keyframes: Option<usize>,
    /// Number of provisional segments in the surface.
    #[serde(skip_serializing_if = "is_zero")]
    pub provisional_segments: usize,
    /// Counts of features, when the surface is made from map points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map_points: Option<MapPointReport>,
    /// Milliseconds of each stage.
    pub milliseconds: StageTimes,
}

/// Whether a count is omitted.
#[allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands over references"
)]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Feature counts of one keyframe.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct MapPointReport {
    /// Number of features.
    pub features: usize,
    /// Features matched with existing points.
    pub observed_again: usize,
    /// Points triangulated from this keyframe. They are carved once enough keyframes observe them.
    pub created: usize,
    /// Points removed.
    pub removed: usize,
    /// Carved points that moved.
    pub moved: usize,
    /// Carved points in the map.
    pub established: usize,
}

/// The result.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ResultSummary {
    /// What the surface is made of: `carved`.
    pub surface: &'static str,
    /// Number of 3D segments.
    pub segments: usize,
    /// Number of clusters of sufficient size.
    pub clusters: usize,
    /// Number of points in the tetrahedralisation.
    pub points: usize,
    /// Visibility rays.
    pub rays: usize,
    /// Tetrahedra.
    pub cells: usize,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Feature edges of the mesh, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feature_edges: Option<FeatureEdgeSummary>,
    /// The texture of the mesh, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureSummary>,
    /// Milliseconds for carving after the last keyframe, where no keyframe includes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carving_milliseconds: Option<f64>,
    /// Milliseconds for the final surface extraction, where no keyframe includes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_milliseconds: Option<f64>,
    /// RMS reprojection error of points, in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reprojection_rms_px: Option<f64>,
    /// How the camera that the points belong to differs from the given one.
    #[serde(flatten)]
    pub camera_correction: Option<CameraCorrection>,
    /// Files written, relative to the output folder.
    pub files: Vec<String>,
}

/// Feature edges of the mesh, as in `feature-edges.*`; without boundary edges.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FeatureEdgeSummary {
    /// Edges with a large dihedral angle.
    pub creases: usize,
    /// Other edges along known lines.
    pub along_lines: usize,
    /// Total length of the creases, in units of the poses.
    pub creases_length: f64,
    /// Total length of the other edges, in units of the poses.
    pub along_lines_length: f64,
}

/// Sums over the run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TimingSummary {
    /// Mean milliseconds per keyframe and stage.
    pub mean_milliseconds: StageTimes,
    /// Seconds from the start of the command to the report.
    pub seconds: f64,
    /// Number of keyframes loaded from the checkpoint of an interrupted run (`--resume`).
    #[serde(skip_serializing_if = "is_zero")]
    pub resumed_keyframes: usize,
    /// Peak resident memory in MB, where the system reports it.
    pub peak_memory_mb: Option<f64>,
}

/// Writes a report as indented JSON.
///
/// # Errors
/// When the file cannot be written.
pub fn write_report<P: Serialize>(path: &Path, report: &Report<P>) -> Result<(), WriteError> {
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, report).map_err(std::io::Error::other)?;
        out.write_all(b"\n")
    })
}
