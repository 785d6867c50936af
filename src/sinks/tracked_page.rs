//! The page of tracking: live while frames are tracked, and as a file at the end.

use linecarve_lines::upper_median;
use linecarve_mesh::TriangleMesh;
use linecarve_sequence::Sequence;
use linecarve_tracking::{FramePose, MapSnapshot};
use nalgebra::{Isometry3, Point3, Vector3};

use super::page::{grouped, last_surface, outside_of_points, page_of};
use super::page_run::PageRun;
use crate::live::{ImagePace, KeyframeRow, LiveUpdate, LiveView};
use crate::report::page::{Elements, OutsideView, Page, keyframe_image};
use linecarve_engine::run::StageTimes;
use linecarve_engine::tracking::{FrameDone, TrackedSequence};

/// Keyframes whose scene depth is looked at, evenly chosen.
const DEPTH_KEYFRAMES: usize = 16;

/// Hands on to the live page how the map grows, at the pace of its images.
pub(crate) struct LiveTracking<'a> {
    view: LiveView,
    sequence: &'a Sequence,
    pace: ImagePace,
    /// Keyframes when the view from outside was last fitted.
    fitted_at: usize,
    outside: Option<OutsideView>,
    /// Of all frames since the page was last told.
    times: StageTimes,
}

impl<'a> LiveTracking<'a> {
    pub(crate) fn new(view: LiveView, sequence: &'a Sequence) -> Self {
        Self {
            view,
            sequence,
            pace: ImagePace::default(),
            fitted_at: 0,
            outside: None,
            times: StageTimes::default(),
        }
    }

    /// Takes a frame, and shows the map when that is due.
    pub(crate) fn update(&mut self, done: &FrameDone<'_>) {
        self.times.add(&done.times);
        if !self.pace.is_due() {
            return;
        }
        let mut map = done.tracker.snapshot();
        if let Some(turn) = done.turn {
            map.turn_camera(turn);
        }
        let newest = map.keyframes.len().saturating_sub(1);
        let image = self.sequence.load_color(done.number).ok();
        let image = image.and_then(|image| keyframe_image(newest, &image, &[]).ok());
        let times = std::mem::take(&mut self.times);
        let current = (!map.keyframes.is_empty()).then_some(KeyframeRow {
            keyframe: newest,
            triangles: 0,
            milliseconds: times,
        });
        self.publish(&map, |update| LiveUpdate {
            current,
            image,
            ..update
        });
    }

    /// Shows the end.
    pub(crate) fn finish(&mut self, tracked: &TrackedSequence) {
        self.fitted_at = 0;
        self.publish(&largest_submap(tracked), |update| update);
    }

    fn publish(&mut self, map: &MapSnapshot, with: impl FnOnce(LiveUpdate<'_>) -> LiveUpdate<'_>) {
        let mut scene = page_about(self.sequence, map);
        if map.keyframes.len() >= 2 * self.fitted_at {
            self.fitted_at = map.keyframes.len();
            self.outside = Some(scene.outside);
        }
        scene.outside = self.outside.unwrap_or(scene.outside);
        self.view.publish(&with(LiveUpdate {
            scene: Some(&scene),
            keyframes: Some(&scene.keyframes),
            elements: Some(Elements {
                points: &map.points,
                ..Elements::default()
            }),
            ..LiveUpdate::default()
        }));
    }
}

/// The page of the largest sub-map, after the last frame.
pub(crate) fn tracked_page(tracked: &TrackedSequence, sequence: &Sequence) -> Page {
    let map = largest_submap(tracked);
    let mut page = page_about(sequence, &map);
    page.subtitle = format!(
        "{} keyframes, {} points",
        map.keyframes.len(),
        grouped(map.points.len())
    );
    let frames = tracked.poses().count().to_string();
    page.facts.push(("frames with a pose".to_owned(), frames));
    let mode = tracked.mode.name().to_owned();
    page.facts.push(("mode".to_owned(), mode));
    let elements = Elements {
        points: &map.points,
        ..Elements::default()
    };
    let last = map.keyframes.len().saturating_sub(1);
    let nothing = TriangleMesh::default();
    page.surfaces = vec![last_surface("map", "Map", last, &nothing, elements)];
    page
}

/// Keyframes in the order of frames, and points, of the sub-map with most frames.
fn largest_submap(tracked: &TrackedSequence) -> MapSnapshot {
    let recording = &tracked.recording;
    let Some(submap) = recording.submaps.first() else {
        return MapSnapshot::default();
    };
    let pose_of = |frame: &u32| match &recording.poses[*frame as usize] {
        FramePose::Known {
            submap: 0,
            world_from_camera,
            ..
        } => Some((*frame, *world_from_camera)),
        _ => None,
    };
    let mut keyframes: Vec<_> = submap.keyframes.iter().filter_map(pose_of).collect();
    keyframes.sort_unstable_by_key(|(frame, _)| *frame);
    MapSnapshot {
        keyframes,
        points: submap.points.clone(),
    }
}

/// A page about a map, without surfaces.
fn page_about(sequence: &Sequence, map: &MapSnapshot) -> Page {
    let frames = sequence.frames();
    let keyframes = map.keyframes.iter();
    let (names, poses): (Vec<&str>, Vec<Isometry3<f64>>) = keyframes
        .map(|(frame, pose)| (frames[*frame as usize].name.as_str(), *pose))
        .unzip();
    let depth = median_depth(sequence, &poses, &map.points);
    let about = PageRun::of_poses(Some(sequence), None, poses, names, depth, Vector3::zeros());
    let mut page = page_of(&about, "track", &TriangleMesh::default());
    page.outside = outside_of_points(&map.points, &about.poses, about.median_depth);
    page
}

/// Median depth of the points that are in the images of some keyframes, whatever hides them.
fn median_depth(
    sequence: &Sequence,
    poses: &[Isometry3<f64>],
    points: &[Point3<f64>],
) -> Option<f64> {
    let (camera, size) = (sequence.color_camera(), sequence.color_size());
    let is_inside = |[x, y]: [f64; 2]| {
        (0.0..f64::from(size.width)).contains(&x) && (0.0..f64::from(size.height)).contains(&y)
    };
    let step = poses.len().div_ceil(DEPTH_KEYFRAMES).max(1);
    let mut depths: Vec<f64> = Vec::new();
    for pose in poses.iter().step_by(step) {
        let in_camera = points
            .iter()
            .map(|point| pose.inverse_transform_point(point));
        let seen = in_camera.filter(|point| {
            let projected = camera.project(point).map(Into::into);
            point.z > 0.0 && projected.is_some_and(is_inside)
        });
        depths.extend(seen.map(|point| point.z));
    }
    upper_median(&mut depths, f64::total_cmp)
}
