//! What a page holds, and how it is told to the viewer.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

use super::encode::{Positions, push_number, text};
use super::history::SurfaceHistory;
use super::images::KeyframeImage;
use super::life_spans::LifeSpans;
use linecarve_mesh::render::View;

/// Everything on a page. Lengths are in units of the poses, in the frame in which the histories were recorded.
#[derive(Debug, Clone)]
pub struct Page {
    /// The heading.
    pub title: String,
    /// A line beside the heading.
    pub subtitle: String,
    /// The program and its version.
    pub generator: String,
    /// Upward direction of the scene.
    pub up: Vector3<f64>,
    /// Median depth of the scene.
    pub median_depth: f64,
    /// The camera of the keyframes, for frustums and for the view of a keyframe.
    pub camera: PageCamera,
    /// The view from outside.
    pub outside: OutsideView,
    /// All keyframes of the run, also those that yielded nothing.
    pub keyframes: Vec<PageKeyframe>,
    /// One surface, or two beside each other.
    pub surfaces: Vec<PageSurface>,
    /// Colours of distances, when surfaces have errors.
    pub error_scale: Option<ErrorScale>,
    /// Tables, in order.
    pub tables: Vec<PageTable>,
    /// Curves over keyframes.
    pub count_plots: Vec<CountPlot>,
    /// Names and values about the run.
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

/// From where a page shows the scene at first.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct OutsideView {
    /// The eye.
    eye: [f64; 3],
    /// What it looks at.
    target: [f64; 3],
    /// Vertical angle of view in radians.
    vertical: f64,
    /// Width over height for which that holds the whole scene.
    aspect: f64,
}

impl OutsideView {
    /// The place and lens of `view`, turning around a point at distance `distance` in its middle.
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

/// A keyframe's name and place.
#[derive(Debug, Clone, Serialize)]
pub struct PageKeyframe {
    name: String,
    position: [f64; 3],
    /// Quaternion, x y z w.
    rotation: [f64; 4],
}

impl PageKeyframe {
    /// The keyframe of a frame called `name`.
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
    /// A word that names it, such as `lines`.
    pub name: &'static str,
    /// What stands above it.
    pub label: String,
    /// The surface over keyframes.
    pub history: SurfaceHistory,
    /// For each triangle of the history its distance to the ground truth as a share of the colour scale, 0 to 255.
    pub errors: Option<Vec<u8>>,
    /// Milliseconds of each stage and keyframe.
    pub timing: Vec<StageTiming>,
}

/// Milliseconds of a stage.
#[derive(Debug, Clone, Serialize)]
pub struct StageTiming {
    /// The stage.
    pub name: &'static str,
    /// One entry a keyframe of the page; `None` for a keyframe that was left out.
    pub milliseconds: Vec<Option<f64>>,
}

/// Colours of distances to the ground truth.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorScale {
    /// What the colours say, unit included.
    pub label: String,
    /// sRGB colours, evenly spaced from zero to the end of the scale.
    pub colors: Vec<[u8; 3]>,
    /// Places on the scale, 0 to 1, and what stands there.
    pub ticks: Vec<(f64, String)>,
}

/// A table; cells are text.
#[derive(Debug, Clone, Serialize)]
pub struct PageTable {
    /// What stands above it.
    pub title: String,
    /// Headings; the first is that of the row names.
    pub columns: Vec<String>,
    /// Rows, each as long as the headings.
    pub rows: Vec<Vec<String>>,
    /// What stands below it.
    pub note: String,
}

/// Curves over keyframes.
#[derive(Debug, Clone, Serialize)]
pub struct CountPlot {
    /// What stands above it.
    pub title: String,
    /// The curves.
    pub series: Vec<Series>,
}

/// A curve over keyframes.
#[derive(Debug, Clone, Serialize)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// One value a keyframe of the page; `None` for a keyframe that was left out.
    pub values: Vec<Option<f64>>,
}

/// The page as the viewer reads it.
#[derive(Serialize)]
pub(super) struct PageData<'a> {
    format: u32,
    title: &'a str,
    subtitle: &'a str,
    generator: &'a str,
    up: [f64; 3],
    median_depth: f64,
    /// Length of the drawn frustums.
    frustum: f64,
    /// Distance within which everything lies.
    radius: f64,
    camera: PageCamera,
    outside: OutsideView,
    keyframes: &'a [PageKeyframe],
    surfaces: Vec<SurfaceData<'a>>,
    error_scale: &'a Option<ErrorScale>,
    tables: &'a [PageTable],
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
    errors: Option<String>,
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
    data: String,
}

#[derive(Serialize)]
struct LinesData {
    name: &'static str,
    color: &'static str,
    born: Vec<u32>,
    life: String,
    ends: Positions,
}

#[derive(Serialize)]
struct PointsData {
    color: &'static str,
    born: Vec<u32>,
    life: String,
    places: Positions,
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
            count_plots: &page.count_plots,
            facts: &page.facts,
            warnings: &page.warnings,
            images: &page.images,
        }
    }
}

/// Distance from the middle of the path within which path, vertices and the view from outside lie.
fn radius(page: &Page) -> f64 {
    let middle: Vector3<f64> = page
        .keyframes
        .iter()
        .map(|keyframe| Vector3::from(keyframe.position))
        .sum::<Vector3<f64>>()
        / page.keyframes.len().max(1) as f64;
    let places = page
        .surfaces
        .iter()
        .flat_map(|surface| surface.history.positions())
        .map(|vertex| vertex.coords)
        .chain(page.keyframes.iter().map(|k| Vector3::from(k.position)))
        .chain([Vector3::from(page.outside.eye)]);
    let farthest = places
        .map(|place| (place - middle).norm())
        .filter(|distance| distance.is_finite())
        .fold(0.0, f64::max);
    if farthest > 0.0 { farthest } else { 1.0 }
}

impl<'a> SurfaceData<'a> {
    fn new(surface: &'a PageSurface) -> Self {
        let history = &surface.history;
        let (vertices, triangles) = triangles_of(history);
        let (segments, until) = history.segments();
        let mut lines = vec![LinesData {
            name: "segments",
            color: "#de5828",
            born: steps(until),
            // Segments stay.
            life: text(&vec![0; segments.len()]),
            ends: Positions::new(segments.as_flattened()),
        }];
        lines.push(LinesData {
            name: "clusters",
            color: "#2060c8",
            born: history.clusters.births(),
            life: life_of(&history.clusters),
            ends: Positions::new(&history.cluster_ends()),
        });
        lines.retain(|set| !set.born.iter().all(|many| *many == 0));
        Self {
            name: surface.name,
            label: &surface.label,
            states: history.keyframes(),
            vertex_counts: history.vertex_counts(),
            vertices,
            triangles,
            errors: surface.errors.as_deref().map(text),
            lines,
            points: (!history.points.records().is_empty()).then(|| PointsData {
                color: "#2060c8",
                born: history.points.births(),
                life: life_of(&history.points),
                places: Positions::new(&history.point_positions()),
            }),
            timing: TimingData {
                stages: &surface.timing,
            },
        }
    }
}

/// How many states each element stays, 0 for good.
fn life_of<T: Copy + Ord>(spans: &LifeSpans<T>) -> String {
    let mut life = Vec::new();
    for (_, span) in spans.records() {
        push_number(&mut life, span.death.map_or(0, |death| death - span.birth));
    }
    text(&life)
}

/// The differences of a running total.
fn steps(until: &[u32]) -> Vec<u32> {
    let before = std::iter::once(0).chain(until.iter().copied());
    until
        .iter()
        .zip(before)
        .map(|(now, before)| now - before)
        .collect()
}

/// Vertices in use, and the triangles: of each the first corner after that of the one before, the other two after the
/// first, and the number of states it stays, 0 for good.
fn triangles_of(history: &SurfaceHistory) -> (Positions, TrianglesData) {
    let records = history.triangles.records();
    let mut used = vec![false; history.positions().len()];
    for corner in records.iter().flat_map(|(corners, _)| corners) {
        used[*corner as usize] = true;
    }
    let mut rank = Vec::with_capacity(used.len());
    let mut vertices = Vec::new();
    for (position, used) in history.positions().iter().zip(used) {
        rank.push(vertices.len() as u32);
        if used {
            vertices.push(*position);
        }
    }
    let mut data = Vec::with_capacity(8 * records.len());
    let (mut state, mut last) = (0, 0);
    for (corners, span) in records {
        if span.birth != state {
            (state, last) = (span.birth, 0);
        }
        let [a, b, c] = corners.map(|corner| rank[corner as usize]);
        push_number(&mut data, a - last);
        push_number(&mut data, b - a);
        push_number(&mut data, c - a);
        push_number(&mut data, span.death.map_or(0, |death| death - span.birth));
        last = a;
    }
    let triangles = TrianglesData {
        count: records.len(),
        born: history.triangles.births(),
        data: text(&data),
    };
    (Positions::new(&vertices), triangles)
}
