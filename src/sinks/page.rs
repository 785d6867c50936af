//! The page of a run: what is recorded on the way, and what is put together at the end.

use std::collections::BTreeMap;

use anyhow::Context;
use linecarve_carving::MeshChange;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::page_run::PageRun;
use crate::report::page::{
    CountPlot, Elements, HistoryLimits, KeyframeImage, OutsideView, Page, PageKeyframe,
    PageSurface, Series, StageTiming, SurfaceHistory, keyframe_image,
};
use crate::report::{KeyframeReport, StageTimes};
use linecarve_engine::front_end::Keyframe;
use linecarve_engine::map::{Map, SurfaceChange};
use linecarve_engine::{KeyframeUpdate, Reconstruction, Recording, Sink, SinkError};
use linecarve_mesh::TriangleMesh;
use linecarve_mesh::render::{View, up_direction};

/// Size for which the view from outside is laid out.
const OUTSIDE_SIZE: (u32, u32) = (640, 480);

/// Follows a run for its page.
pub(crate) struct PageRecorder {
    /// The surface over keyframes.
    pub(crate) history: SurfaceHistory,
    /// Ends of the segments in the images of keyframes that have a state.
    segments_px: BTreeMap<u32, Vec<[[f64; 2]; 2]>>,
}

impl Sink for PageRecorder {
    fn wants_surface(&self) -> bool {
        true
    }

    fn update(
        &mut self,
        _recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        let (Some(surface), Some(change)) = (map.followed_surface(), &update.surface) else {
            return Ok(());
        };
        self.history.note(change);
        if !self.history.advance() {
            return Ok(());
        }
        let number = update.number;
        with_elements(map, |elements| {
            let position = |vertex: u32| surface.position(vertex);
            let vertices = surface.vertex_count();
            self.history.record(number, position, vertices, elements);
        });
        if let Keyframe::Lines(keyframe) = &update.keyframe {
            self.segments_px.insert(number as u32, keyframe.ends_px());
            let states = self.history.keyframes();
            if self.segments_px.len() > states.len() + 1 {
                self.segments_px
                    .retain(|keyframe, _| states.binary_search(keyframe).is_ok());
            }
        }
        Ok(())
    }

    fn finished(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        if let Some(change) = change {
            self.history.note(change);
        }
        Ok(())
    }
}

impl PageRecorder {
    pub(crate) fn new() -> Self {
        Self {
            history: SurfaceHistory::new(HistoryLimits::default()),
            segments_px: BTreeMap::new(),
        }
    }

    /// Records the end of the run; with the final mesh, when the surface was not followed.
    pub(crate) fn finish(&mut self, run: &Reconstruction, mesh: &TriangleMesh) {
        let last = run.numbers().last().copied().unwrap_or(0);
        with_elements(run.map(), |elements| match run.map().followed_surface() {
            Some(surface) => {
                let position = |vertex: u32| surface.position(vertex);
                let vertices = surface.vertex_count();
                self.history.finish(last, position, vertices, elements);
            }
            None => finish_with(&mut self.history, last, mesh, elements),
        });
    }

    /// Small images of the recorded keyframes, made in parallel; those that cannot be read any more are left out.
    pub(crate) fn images(&self, run: &PageRun<'_>) -> anyhow::Result<Vec<KeyframeImage>> {
        let wanted: Vec<(usize, &Vec<[[f64; 2]; 2]>)> = self
            .segments_px
            .iter()
            .map(|(keyframe, segments)| (*keyframe as usize, segments))
            .collect();
        let images: Result<Vec<Option<KeyframeImage>>, image::ImageError> = wanted
            .into_par_iter()
            .map(|(keyframe, segments)| {
                let frame = run.numbers[keyframe];
                let image = run.sequence.map(|sequence| sequence.load_color(frame));
                let Some(Ok(image)) = image else {
                    return Ok(None);
                };
                keyframe_image(keyframe, &image, segments).map(Some)
            })
            .collect();
        let images = images.context("the images of the page cannot be encoded")?;
        Ok(images.into_iter().flatten().collect())
    }
}

/// Records a mesh that was not followed as the last state.
fn finish_with(
    history: &mut SurfaceHistory,
    keyframe: usize,
    mesh: &TriangleMesh,
    elements: Elements<'_>,
) {
    history.note(&change_to(mesh));
    let position = |vertex: u32| mesh.positions[vertex as usize];
    history.finish(keyframe, position, mesh.positions.len(), elements);
}

/// A surface with its last state only, as of this keyframe.
pub(crate) fn last_surface(
    name: &'static str,
    label: &str,
    keyframe: usize,
    mesh: &TriangleMesh,
    elements: Elements<'_>,
) -> PageSurface {
    let mut recorder = PageRecorder::new();
    finish_with(&mut recorder.history, keyframe, mesh, elements);
    page_surface(name, label, recorder, &[], &[])
}

/// The change from nothing to a mesh.
fn change_to(mesh: &TriangleMesh) -> SurfaceChange {
    SurfaceChange {
        mesh: MeshChange {
            placed: (0..mesh.positions.len() as u32).collect(),
            added: mesh.triangles.clone(),
            ..MeshChange::default()
        },
        is_anew: true,
        ..SurfaceChange::default()
    }
}

/// Hands over what the map is made of.
pub(crate) fn with_elements(map: &Map, take: impl FnOnce(Elements<'_>)) {
    match map.segments() {
        Some(segments) => take(Elements {
            segments: &segments.ends().collect::<Vec<_>>(),
            clusters: Some(&segments.clusters()),
            points: &[],
        }),
        None => take(Elements {
            points: &map.points(),
            ..Elements::default()
        }),
    }
}

/// A page about keyframes, without surfaces yet; `mesh` is what the view from outside is to hold. The title is the name of the
/// recording, or the command without one.
pub(crate) fn page_of(run: &PageRun<'_>, command: &str, mesh: &TriangleMesh) -> Page {
    let poses = &run.poses;
    let mut title = command.to_owned();
    let mut facts = vec![("command".to_owned(), format!("linecarve {command}"))];
    if let Some(sequence) = run.sequence {
        let folder = sequence.folder();
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        title = name.to_string_lossy().into_owned();
        facts.push(("layout".to_owned(), sequence.layout().to_owned()));
        let frames = sequence.frames().len();
        facts.push(("frames".to_owned(), frames.to_string()));
    }
    facts.push(("keyframes".to_owned(), poses.len().to_string()));
    let depth = format!("{:.3} units of the poses", run.median_depth);
    facts.push(("median depth".to_owned(), depth));
    if run.origin.norm() > 0.0 {
        let [x, y, z]: [f64; 3] = run.origin.into();
        facts.push((
            "shown relative to".to_owned(),
            format!("({x}, {y}, {z}) of the poses"),
        ));
    }
    Page {
        title,
        subtitle: String::new(),
        generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
        up: up_direction(poses),
        median_depth: run.median_depth,
        camera: run.camera,
        outside: outside_view(mesh, poses, run.median_depth),
        keyframes: run
            .names
            .iter()
            .zip(poses)
            .map(|(name, pose)| PageKeyframe::new(name, pose))
            .collect(),
        surfaces: Vec::new(),
        error_scale: None,
        tables: Vec::new(),
        structure: None,
        count_plots: Vec::new(),
        facts,
        warnings: Vec::new(),
        images: Vec::new(),
    }
}

/// The view from outside on a surface that grows, fitted whenever the number of keyframes has doubled.
#[derive(Debug, Default)]
pub(crate) struct GrowingView {
    fitted_at: usize,
    view: Option<OutsideView>,
}

impl GrowingView {
    /// Fits the view to the surface after so many keyframes, when that is due; returns whether it did.
    pub(crate) fn fit(&mut self, keyframes: usize, map: Option<&Map>, run: &PageRun<'_>) -> bool {
        let surface = map.and_then(Map::followed_surface);
        let Some(surface) = surface.filter(|surface| surface.triangle_count() > 0) else {
            return false;
        };
        if keyframes < 2 * self.fitted_at {
            return false;
        }
        self.fitted_at = keyframes;
        let mesh = surface.to_mesh();
        self.view = Some(outside_view(&mesh, &run.poses, run.median_depth));
        true
    }

    /// Puts the view on a page.
    pub(crate) fn apply(&self, page: &mut Page) {
        page.outside = self.view.unwrap_or(page.outside);
    }
}

/// From outside and above; around the path of the camera when there is no surface.
fn outside_view(mesh: &TriangleMesh, poses: &[Isometry3<f64>], median_depth: f64) -> OutsideView {
    let view = View::dollhouse(mesh, poses, OUTSIDE_SIZE);
    outside_of(view, &mesh.positions, poses, median_depth)
}

/// From outside and above points; around the path of the camera when there are none.
pub(crate) fn outside_of_points(
    points: &[Point3<f64>],
    poses: &[Isometry3<f64>],
    median_depth: f64,
) -> OutsideView {
    let view = View::outside(points, poses, OUTSIDE_SIZE);
    outside_of(view, points, poses, median_depth)
}

fn outside_of(
    view: Option<View>,
    points: &[Point3<f64>],
    poses: &[Isometry3<f64>],
    median_depth: f64,
) -> OutsideView {
    let view =
        view.or_else(|| View::dollhouse(&around_path(poses, median_depth), poses, OUTSIDE_SIZE));
    let view = view.unwrap_or_else(|| View {
        camera: linecarve_lines::camera::Camera::pinhole(500.0, 500.0, 319.5, 239.5)
            .expect("a pinhole camera with positive focal lengths"),
        width: OUTSIDE_SIZE.0,
        height: OUTSIDE_SIZE.1,
        world_from_camera: poses.first().copied().unwrap_or_else(Isometry3::identity),
        up: up_direction(poses),
    });
    let eye = view.world_from_camera.translation.vector;
    let forward = view.world_from_camera.rotation * Vector3::z();
    // The middle of what is looked at: where the mean of the vertices lies along the view.
    let places: Vec<Point3<f64>> = if points.is_empty() {
        poses
            .iter()
            .map(|pose| Point3::from(pose.translation.vector))
            .collect()
    } else {
        points.to_vec()
    };
    let along: f64 = places
        .iter()
        .map(|place| (place.coords - eye).dot(&forward))
        .sum();
    let distance = along / places.len().max(1) as f64;
    OutsideView::new(
        &view,
        if distance > 0.0 {
            distance
        } else {
            median_depth
        },
    )
}

/// Triangles that reach a median depth beyond the path of the camera.
fn around_path(poses: &[Isometry3<f64>], median_depth: f64) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for pose in poses {
        for side in [-1.0, 1.0] {
            let first = mesh.positions.len() as u32;
            for axis in 0..3 {
                let mut place = Point3::from(pose.translation.vector);
                place[axis] += side * median_depth;
                mesh.positions.push(place);
            }
            mesh.triangles.push([first, first + 1, first + 2]);
        }
    }
    mesh
}

/// The milliseconds of each stage over the keyframes of the page; stages that took no time anywhere are left out.
fn stage_timing(chosen: &[usize], reports: &[KeyframeReport]) -> Vec<StageTiming> {
    type Stage = (&'static str, fn(&StageTimes) -> f64);
    let stages: [Stage; 11] = [
        ("load", |times| times.load),
        ("depth", |times| times.depth),
        ("edges", |times| times.edges),
        ("features", |times| times.features),
        ("fit", |times| times.fit),
        ("cluster", |times| times.cluster),
        ("points", |times| times.points),
        ("carve", |times| times.carve),
        ("support", |times| times.validation),
        ("surface", |times| times.surface),
        ("write", |times| times.write),
    ];
    stages
        .into_iter()
        .map(|(name, time)| StageTiming {
            name,
            milliseconds: over_keyframes(chosen, reports, |report| time(&report.milliseconds)),
        })
        .filter(|stage| stage.milliseconds.iter().flatten().any(|time| *time > 0.0))
        .collect()
}

/// A value for each keyframe of the page, `None` for those without a report.
fn over_keyframes(
    chosen: &[usize],
    reports: &[KeyframeReport],
    value: impl Fn(&KeyframeReport) -> f64,
) -> Vec<Option<f64>> {
    let by_frame: BTreeMap<usize, &KeyframeReport> = reports
        .iter()
        .map(|report| (report.index, report))
        .collect();
    chosen
        .iter()
        .map(|frame| by_frame.get(frame).map(|report| value(report)))
        .collect()
}

/// The surface of a run on its page.
pub(crate) fn page_surface(
    name: &'static str,
    label: &str,
    recorder: PageRecorder,
    chosen: &[usize],
    reports: &[KeyframeReport],
) -> PageSurface {
    PageSurface {
        name,
        label: label.to_owned(),
        history: recorder.history,
        errors: None,
        texture: None,
        timing: stage_timing(chosen, reports),
    }
}

/// Curves of what the map holds after each keyframe; none of what it did not hold before the end.
pub(crate) fn growth_plots(chosen: &[usize], runs: &[(&str, &[KeyframeReport])]) -> Vec<CountPlot> {
    type Count = (&'static str, fn(&KeyframeReport) -> f64);
    let counts: [Count; 2] = [
        ("triangles between free and occupied space", |report| {
            report.triangles as f64
        }),
        ("triangles that came and went with the keyframe", |report| {
            report.changed_triangles as f64
        }),
    ];
    counts
        .into_iter()
        .map(|(title, count)| CountPlot {
            title: title.to_owned(),
            series: runs
                .iter()
                .map(|(name, reports)| Series {
                    name: (*name).to_owned(),
                    values: over_keyframes(chosen, reports, count),
                })
                .collect(),
        })
        .filter(|plot: &CountPlot| {
            let mut values = plot.series.iter().flat_map(|series| &series.values);
            values.any(|value| value.is_some_and(|value| value > 0.0))
        })
        .collect()
}

/// `12 345` as people read it: groups of three digits, a thin space between.
pub(crate) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}
