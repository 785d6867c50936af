//! The content of a page, and its JSON for the viewer.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

use super::element_history::Lifetime;
use super::encode::{Base64, Positions, push_number};
use super::history::{SurfaceHistory, ranks};
use super::images::KeyframeImage;
use super::texture::PageTexture;
use linecarve_mesh::render::View;

/// The content of a page. Lengths are in units of the poses, in the frame of the recorded histories.
#[derive(Debug, Clone)]
pub struct Page {
    /// The heading.
    pub title: String,
    /// Text beside the heading.
    pub subtitle: String,
    /// Name and version of the program.
    pub generator: String,
    /// Upward direction of the scene.
    pub up: Vector3<f64>,
    /// Median depth of the scene.
    pub median_depth: f64,
    /// Camera of the keyframes, for frustums and keyframe views.
    pub camera: PageCamera,
    /// The initial view of the scene.
    pub outside: OutsideView,
    /// All keyframes of the run, skipped ones included.
    pub keyframes: Vec<PageKeyframe>,
    /// One or two surfaces, shown side by side.
    pub surfaces: Vec<PageSurface>,
    /// Colour scale of the errors, when surfaces have errors.
    pub error_scale: Option<ErrorScale>,
    /// Tables, in order.
    pub tables: Vec<PageTable>,
    /// Planes of the surface, where they were looked for.
    pub structure: Option<PageStructure>,
    /// Plots over keyframes.
    pub count_plots: Vec<CountPlot>,
    /// Names and values of the run.
    pub facts: Vec<(String, String)>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Images of keyframes, ascending.
    pub images: Vec<KeyframeImage>,
}

/// A pinhole camera as the viewer draws it.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PageCamera {
    /// Focal length in pixels, horizontally.
    pub fx: f64,
    /// Focal length in pixels, vertically.
    pub fy: f64,
    /// Principal point; the centre of the top-left pixel is (0, 0).
    pub cx: f64,
    /// Principal point, vertically.
    pub cy: f64,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
}

/// The initial view of a page.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct OutsideView {
    /// Camera position.
    eye: [f64; 3],
    /// Centre of rotation.
    target: [f64; 3],
    /// Vertical field of view in radians.
    vertical: f64,
    /// Aspect ratio for which the view holds the whole scene.
    aspect: f64,
}

impl OutsideView {
    /// The camera of `view`, rotating around the point at `distance` on its axis.
    pub fn new(view: &View, distance: f64) -> Self {
        let eye = Point3::from(view.world_from_camera.translation.vector);
        let target = eye + view.world_from_camera.rotation * Vector3::z() * distance;
        let half = 0.5 * f64::from(view.height) / view.camera.fy();
        Self {
            eye: eye.coords.into(),
            target: target.coords.into(),
            vertical: 2.0 * half.atan(),
            aspect: f64::from(view.width) / f64::from(view.height.max(1)),
        }
    }
}

/// Name and pose of a keyframe.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PageKeyframe {
    name: String,
    position: [f64; 3],
    /// Quaternion, x y z w.
    rotation: [f64; 4],
}

impl PageKeyframe {
    /// A keyframe of the frame `name`.
    pub fn new(name: &str, world_from_camera: &Isometry3<f64>) -> Self {
        Self {
            name: name.to_owned(),
            position: world_from_camera.translation.vector.into(),
            rotation: world_from_camera.rotation.coords.into(),
        }
    }
}

/// A surface on the page.
#[derive(Debug, Clone)]
pub struct PageSurface {
    /// Short name, such as `lines`.
    pub name: &'static str,
    /// Title.
    pub label: String,
    /// The surface over the keyframes.
    pub history: SurfaceHistory,
    /// Error of each triangle of the history, 0 to 255 on the error scale.
    pub errors: Option<Vec<u8>>,
    /// The final mesh with its texture.
    pub texture: Option<PageTexture>,
    /// Milliseconds of each stage and keyframe.
    pub timing: Vec<StageTiming>,
}

/// Milliseconds of a stage.
#[derive(Debug, Clone, Serialize)]
pub struct StageTiming {
    /// Name of the stage.
    pub name: &'static str,
    /// One entry per keyframe of the page; `None` for a skipped one.
    pub milliseconds: Vec<Option<f64>>,
}

/// Colour scale of distances to the ground truth.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorScale {
    /// Label with unit.
    pub label: String,
    /// sRGB colours, evenly spaced from zero to the end of the scale.
    pub colors: Vec<[u8; 3]>,
    /// Ticks: position on the scale, 0 to 1, and label.
    pub ticks: Vec<(f64, String)>,
}

/// A table of text cells.
#[derive(Debug, Clone, Serialize)]
pub struct PageTable {
    /// Title.
    pub title: String,
    /// Column headings; the first is that of the row names.
    pub columns: Vec<String>,
    /// Rows, as long as the headings.
    pub rows: Vec<Vec<String>>,
    /// Note below the table.
    pub note: String,
}

/// Planes of the surface: a tab of the page.
#[derive(Debug, Clone, Serialize)]
pub struct PageStructure {
    /// The floor plan, as SVG.
    pub plan: String,
    /// Tables beside it.
    pub tables: Vec<PageTable>,
}

/// Plots over keyframes.
#[derive(Debug, Clone, Serialize)]
pub struct CountPlot {
    /// Title.
    pub title: String,
    /// The curves.
    pub series: Vec<Series>,
}

/// A curve over keyframes.
#[derive(Debug, Clone, Serialize)]
pub struct Series {
    /// Name of the curve.
    pub name: String,
    /// One value per keyframe of the page; `None` for a skipped one.
    pub values: Vec<Option<f64>>,
}

/// The JSON of a page.
#[derive(Serialize)]
pub(super) struct PageData<'a> {
    format: u32,
    title: &'a str,
    subtitle: &'a str,
    generator: &'a str,
    up: [f64; 3],
    median_depth: f64,
    /// Length of drawn frustums.
    frustum: f64,
    /// Radius around the middle of the camera path that holds everything.
    radius: f64,
    camera: PageCamera,
    outside: OutsideView,
    keyframes: &'a [PageKeyframe],
    surfaces: Vec<SurfaceData<'a>>,
    error_scale: &'a Option<ErrorScale>,
    tables: &'a [PageTable],
    structure: &'a Option<PageStructure>,
    count_plots: &'a [CountPlot],
    facts: &'a [(String, String)],
    warnings: &'a [String],
    images: &'a [KeyframeImage],
}

#[derive(Serialize)]
struct SurfaceData<'a> {
    name: &'a str,
    label: &'a str,
    states: &'a [u32],
    vertex_counts: &'a [u32],
    vertices: Positions,
    triangles: TrianglesData,
    errors: Option<Base64>,
    texture: &'a Option<PageTexture>,
    lines: Vec<LinesData>,
    points: Option<PointsData>,
    timing: TimingData<'a>,
}

#[derive(Serialize)]
struct TimingData<'a> {
    stages: &'a [StageTiming],
}

#[derive(Serialize)]
struct TrianglesData {
    count: usize,
    born: Vec<u32>,
    data: Base64,
}

#[derive(Serialize)]
struct LinesData {
    name: &'static str,
    color: &'static str,
    born: Vec<u32>,
    life: Base64,
    ends: Positions,
}

#[derive(Serialize)]
struct PointsData {
    color: &'static str,
    born: Vec<u32>,
    life: Base64,
    #[serde(rename = "places")]
    positions: Positions,
}

impl<'a> PageData<'a> {
    pub(super) fn new(page: &'a Page) -> Self {
        let frustum = 0.12 * page.median_depth;
        Self {
            format: 1,
            title: &page.title,
            subtitle: &page.subtitle,
            generator: &page.generator,
            up: page.up.into(),
            median_depth: page.median_depth,
            frustum,
            radius: radius(page),
            camera: page.camera,
            outside: page.outside,
            keyframes: &page.keyframes,
            surfaces: page.surfaces.iter().map(SurfaceData::new).collect(),
            error_scale: &page.error_scale,
            tables: &page.tables,
            structure: &page.structure,
            count_plots: &page.count_plots,
            facts: &page.facts,
            warnings: &page.warnings,
            images: &page.images,
        }
    }
}

/// Radius around the middle of the camera path that holds all vertices and cameras.
fn radius(page: &Page) -> f64 {
    let middle: Vector3<f64> = page
        .keyframes
        .iter()
        .map(|keyframe| Vector3::from(keyframe.position))
        .sum::<Vector3<f64>>()
        / page.keyframes.len().max(1) as f64;
    let positions = page
        .surfaces
        .iter()
        .flat_map(|surface| surface.history.positions())
        .map(|vertex| vertex.coords)
        .chain(page.keyframes.iter().map(|k| Vector3::from(k.position)))
        .chain([Vector3::from(page.outside.eye)]);
    let farthest = positions
        .map(|position| (position - middle).norm())
        .filter(|distance| distance.is_finite())
        .fold(0.0, f64::max);
    if farthest > 0.0 { farthest } else { 1.0 }
}

impl<'a> SurfaceData<'a> {
    fn new(surface: &'a PageSurface) -> Self {
        let history = &surface.history;
        let (vertices, triangles) = triangles_of(history);
        let mut lines = vec![LinesData {
            name: "segments",
            color: "#de5828",
            born: increments(history.segments_until()),
            // Segments are never removed.
            life: Base64(vec![0; history.segment_count()]),
            ends: Positions::new(history.segment_ends()),
        }];
        lines.push(LinesData {
            name: "clusters",
            color: "#2060c8",
            born: history.clusters.added_counts(),
            life: encode_lifetimes(history.clusters.records()),
            ends: Positions::new(history.cluster_ends()),
        });
        lines.retain(|set| !set.born.iter().all(|many| *many == 0));
        Self {
            name: surface.name,
            label: &surface.label,
            states: history.keyframes(),
            vertex_counts: history.vertex_counts(),
            vertices,
            triangles,
            errors: surface.errors.clone().map(Base64),
            texture: &surface.texture,
            lines,
            points: (!history.points.records().is_empty()).then(|| PointsData {
                color: "#2060c8",
                born: history.points.added_counts(),
                life: encode_lifetimes(history.points.records()),
                positions: Positions::new(history.point_positions()),
            }),
            timing: TimingData {
                stages: &surface.timing,
            },
        }
    }
}

/// Number of states of each element, 0 for unlimited.
fn encode_lifetimes<T>(records: &[(T, Lifetime)]) -> Base64 {
    let mut life = Vec::new();
    for (_, lifetime) in records {
        push_number(&mut life, lifetime.state_count());
    }
    Base64(life)
}

/// Increments of a running total.
fn increments(until: &[u32]) -> Vec<u32> {
    let before = std::iter::once(0).chain(until.iter().copied());
    until
        .iter()
        .zip(before)
        .map(|(now, before)| now - before)
        .collect()
}

/// Used vertices and delta-coded triangles: the first corner relative to that of the previous triangle, the other two
/// relative to the first, and the number of states, 0 for unlimited.
fn triangles_of(history: &SurfaceHistory) -> (Positions, TrianglesData) {
    let records = history.triangles.records();
    let used = history.used_vertices();
    let rank = ranks(&used);
    let mut data = Vec::with_capacity(8 * records.len());
    let (mut state, mut last) = (0, 0);
    for (corners, lifetime) in records {
        if lifetime.first_state != state {
            (state, last) = (lifetime.first_state, 0);
        }
        let [a, b, c] = corners.map(|corner| rank[corner as usize]);
        push_number(&mut data, a - last);
        push_number(&mut data, b - a);
        push_number(&mut data, c - a);
        push_number(&mut data, lifetime.state_count());
        last = a;
    }
    let triangles = TrianglesData {
        count: records.len(),
        born: history.triangles.added_counts(),
        data: Base64(data),
    };
    let vertices = history.positions().zip(&used);
    let vertices = vertices.filter_map(|(position, used)| used.then_some(position));
    (Positions::new(vertices), triangles)
}
