//! `report.json`: what a run was asked, what it did, and how long each stage took.

pub mod page;

use std::path::Path;

use serde::Serialize;

use linecarve_mesh::files::{WriteError, write_atomically};

use crate::front_end::PoseSummary;
pub use crate::run::StageTimes;

/// Everything that a run says about itself. Counts and parameters repeat from run to run; durations and memory do not.
#[derive(Debug, Clone, Serialize)]
pub struct Report<P: Serialize> {
    /// `linecarve <version>`.
    pub generator: String,
    /// The command that ran: `reconstruct` or `lines`.
    pub command: &'static str,
    /// What the surface is made from: `lines` or `map-points`.
    pub from: &'static str,
    /// What was read.
    pub sequence: SequenceSummary,
    /// The user configuration of the run; as TOML it is a `--config` that repeats the run.
    pub parameters: P,
    /// One entry a keyframe, in the order of processing.
    pub keyframes: Vec<KeyframeReport>,
    /// What came out at the end.
    pub result: ResultSummary,
    /// Warnings, in the order in which they arose.
    pub warnings: Vec<String>,
    /// Sums over the run.
    pub timing: TimingSummary,
}

/// What was read.
#[derive(Debug, Clone, Serialize)]
pub struct SequenceSummary {
    /// Name of the folder.
    pub name: String,
    /// The recognised layout.
    pub layout: String,
    /// Posed frames in it.
    pub frames: usize,
    /// Keyframes chosen.
    pub keyframes: usize,
    /// Keyframes whose images could not be used.
    pub skipped: usize,
    /// Whether depth images take part.
    pub depth: &'static str,
    /// Median depth of the scene in units of the poses: the unit of every parameter that is a share.
    pub median_depth: f64,
    /// Shift that was taken off all coordinates while computing, because they are large; outputs have it added again.
    pub origin: [f64; 3],
    /// How far poses and images are apart, when that was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<PoseSummary>,
}

/// Counts and durations of one keyframe.
#[derive(Debug, Clone, Default, Serialize)]
pub struct KeyframeReport {
    /// Name of the frame in the sequence.
    pub frame: String,
    /// Position of the frame in the sequence.
    pub index: usize,
    /// Edge chains in the image and pixels on them.
    pub edge_chains: usize,
    /// Pixels on edge chains.
    pub edge_pixels: usize,
    /// Share of those pixels that have a depth.
    pub edge_depth_share: f64,
    /// 3D segments found in this keyframe.
    pub segments: usize,
    /// Clusters of segments so far, those below the minimum size left out.
    pub clusters: usize,
    /// Points that this keyframe added to the tetrahedralisation.
    pub new_points: usize,
    /// Older points that it saw again.
    pub observed_again: usize,
    /// Visibility rays so far.
    pub rays: usize,
    /// Tetrahedra so far.
    pub cells: usize,
    /// Triangles between free and occupied space after this keyframe, those included that files leave out.
    pub triangles: usize,
    /// Triangles that came and went with this keyframe.
    pub changed_triangles: usize,
    /// With depth from neighbours: how many keyframes came after this one until it was in the surface for the first time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub awaited: Option<usize>,
    /// Segments in the surface after this keyframe whose depth will still be refined.
    #[serde(skip_serializing_if = "is_zero")]
    pub provisional_segments: usize,
    /// What became of features, when the surface is made from map points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map_points: Option<MapPointReport>,
    /// Milliseconds of each stage.
    pub milliseconds: StageTimes,
}

/// Whether a count is left out of the report.
#[allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands over references"
)]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Counts of one keyframe that is looked at for map points.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct MapPointReport {
    /// Features in the image.
    pub features: usize,
    /// Points that they are, seen before.
    pub observed_again: usize,
    /// Points tried for the first time; they are carved when enough keyframes see them.
    pub created: usize,
    /// Points given up.
    pub removed: usize,
    /// Carved points that moved.
    pub moved: usize,
    /// Points that are carved.
    pub established: usize,
}

/// What came out at the end.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ResultSummary {
    /// 3D segments of all keyframes.
    pub segments: usize,
    /// Clusters that are large enough.
    pub clusters: usize,
    /// Points in the tetrahedralisation.
    pub points: usize,
    /// Visibility rays.
    pub rays: usize,
    /// Tetrahedra.
    pub cells: usize,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Edges of the mesh that are edges of the scene, where there is a mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feature_edges: Option<FeatureEdgeSummary>,
    /// Milliseconds for the extraction of the final surface, where no keyframe has them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_milliseconds: Option<f64>,
    /// Root of the mean squared distance between points and their features in the images, in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reprojection_rms_px: Option<f64>,
    /// Radial distortion, `k1` of Brown's model, that points showed images of a supposed pinhole to have; points are free of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens_k1: Option<f64>,
    /// Files written, relative to the output folder.
    pub files: Vec<String>,
}

/// Edges of the mesh that are edges of the scene, as the files `feature-edges.*` hold them; rims are not among them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FeatureEdgeSummary {
    /// Edges at which the surface turns, along known lines or not.
    pub creases: usize,
    /// Other edges along known lines.
    pub along_lines: usize,
    /// Sum of the lengths of the creases, in units of the poses.
    pub creases_length: f64,
    /// Sum of the lengths of the others.
    pub along_lines_length: f64,
}

/// Sums over the run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TimingSummary {
    /// Mean milliseconds per keyframe and stage.
    pub mean_milliseconds: StageTimes,
    /// Seconds from the start of the command to the report.
    pub seconds: f64,
    /// Keyframes that were taken from an interrupted run (`--resume`) instead of being computed.
    #[serde(skip_serializing_if = "is_zero")]
    pub resumed_keyframes: usize,
    /// Largest resident memory of the process in MB, where the system tells.
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
