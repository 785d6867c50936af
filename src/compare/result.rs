//! What is compared, and the numbers.

use serde::Serialize;

use crate::report::{KeyframeReport, StageTimes};
use linecarve_engine::map::CarvedCounts;
use linecarve_mesh::evaluate::{Evaluation, ShapeSummary};
use linecarve_mesh::{LineSet, TriangleMesh};

/// A surface at the end of its run, in the frame of computation.
#[derive(Debug, Clone)]
pub struct ComparedSurface {
    /// A word that names it and its folder, such as `lines`.
    pub name: &'static str,
    /// What stands above it in pictures.
    pub label: &'static str,
    /// What it is made from, in the plural: `segments` or `points`.
    pub elements_name: &'static str,
    /// How many of them there are.
    pub elements: usize,
    /// What was carved.
    pub carved: CarvedCounts,
    /// The surface.
    pub mesh: TriangleMesh,
    /// Drawn over it.
    pub marks: LineSet,
    /// What each keyframe did.
    pub keyframes: Vec<KeyframeReport>,
}

/// The numbers of a comparison, as they stand in `compare.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// `linecarve <version>`.
    pub generator: String,
    /// The published system whose parameters the runs have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<&'static str>,
    /// Name of the sequence's folder.
    pub sequence: String,
    /// Its layout.
    pub layout: String,
    /// Posed frames in it.
    pub frames: usize,
    /// Names of the keyframes, the same for all surfaces.
    pub keyframes: Vec<String>,
    /// Median depth of the scene in units of the poses.
    pub median_depth: f64,
    /// What the surfaces are measured against.
    pub ground_truth: Option<GroundTruthSummary>,
    /// One entry a surface.
    pub surfaces: Vec<SurfaceSummary>,
    /// Warnings, in the order in which they arose.
    pub warnings: Vec<String>,
    /// Files written, relative to the output folder.
    pub files: Vec<String>,
}

/// What surfaces are measured against.
#[derive(Debug, Clone, Serialize)]
pub struct GroundTruthSummary {
    /// Name of its file.
    pub file: String,
    /// What it holds.
    pub shape: ShapeSummary,
}

/// A surface in numbers.
#[derive(Debug, Clone, Serialize)]
pub struct SurfaceSummary {
    /// A word that names it and its folder.
    pub name: &'static str,
    /// What it is made from.
    pub made_from: &'static str,
    /// How many of them there are.
    pub elements: usize,
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
    /// Keyframes that could be used.
    pub keyframes: usize,
    /// Mean milliseconds a keyframe, writing files left out.
    pub milliseconds_per_keyframe: f64,
    /// ... of each stage.
    pub mean_milliseconds: StageTimes,
    /// Why there is no surface, when it is empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason_for_nothing: Option<String>,
    /// How near it comes to the ground truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evaluation: Option<Evaluation>,
}

impl SurfaceSummary {
    /// The counts and times of a surface.
    pub fn of(surface: &ComparedSurface) -> Self {
        let mut sum = StageTimes::default();
        for keyframe in &surface.keyframes {
            sum.add(&keyframe.milliseconds);
        }
        let mean = sum.divided_by(surface.keyframes.len());
        Self {
            name: surface.name,
            made_from: surface.elements_name,
            elements: surface.elements,
            points: surface.carved.points,
            rays: surface.carved.rays,
            cells: surface.carved.cells,
            vertices: surface.mesh.positions.len(),
            triangles: surface.mesh.triangles.len(),
            keyframes: surface.keyframes.len(),
            milliseconds_per_keyframe: ((mean.total() - mean.write) * 1e3).round() / 1e3,
            mean_milliseconds: mean,
            reason_for_nothing: None,
            evaluation: None,
        }
    }
}
