//! What the report says of each keyframe, and the progress bar.

use crate::progress::{Progress, Verbosity};
use crate::report::{KeyframeReport, MapPointReport};
use linecarve_engine::front_end::{FrontEndError, Keyframe, LineKeyframe};
use linecarve_engine::map::{Map, SurfaceChange};
use linecarve_engine::{KeyframeUpdate, Recording, Sink, SinkError};

/// Collects the reports of keyframes and shows progress.
pub(crate) struct KeyframeReports {
    /// One entry a keyframe, in the order of processing.
    pub(crate) reports: Vec<KeyframeReport>,
    /// What is wrong with keyframes that were left out.
    pub(crate) skipped: Vec<String>,
    /// Number of depth values that the camera cannot have measured.
    pub(crate) unmeasurable_depths: usize,
    progress: Option<Progress>,
}

impl KeyframeReports {
    /// Nothing yet, of `count` keyframes; the progress bar is named by a word such as `keyframes`.
    pub(crate) fn new(label: &'static str, count: usize, verbosity: Verbosity) -> Self {
        Self {
            reports: Vec::with_capacity(count),
            skipped: Vec::new(),
            unmeasurable_depths: 0,
            progress: Some(Progress::start(label, count, verbosity)),
        }
    }
}

impl Sink for KeyframeReports {
    fn update(
        &mut self,
        recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        if let Some(progress) = &mut self.progress {
            progress.step(|| progress_message(map, update));
        }
        self.unmeasurable_depths += update.keyframe.unmeasurable_depths();
        self.reports.push(keyframe_report(recording, map, update));
        Ok(())
    }

    fn skipped(&mut self, _number: usize, fault: &FrontEndError) {
        if let Some(progress) = &mut self.progress {
            progress.print(Verbosity::Verbose, &format!("left out: {fault}"));
            progress.step(String::new);
        }
        self.skipped.push(fault.to_string());
    }

    fn finished(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        _change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        if let Some(progress) = self.progress.take() {
            progress.finish();
        }
        Ok(())
    }
}

/// What a keyframe did, as the report tells it.
fn keyframe_report(recording: &Recording, map: &Map, update: &KeyframeUpdate) -> KeyframeReport {
    let carver = map.carver();
    let mut report = KeyframeReport {
        frame: recording.keyframe_name(update.number).to_owned(),
        index: recording.keyframes[update.number],
        clusters: update.map.clusters,
        new_points: update.map.new_points,
        observed_again: update.map.observed_again,
        rays: carver.ray_count(),
        cells: carver.tetrahedra().finite_cell_count(),
        triangles: carver.triangle_count(),
        changed_triangles: update.map.changed_triangles(),
        delay_keyframes: update.delay_keyframes,
        provisional_segments: map.provisional_segment_count(),
        map_points: update.map.features.map(|counts| MapPointReport {
            features: counts.features,
            observed_again: counts.observed_again,
            created: counts.created,
            removed: counts.removed,
            moved: update.map.moved_points,
            established: counts.established,
        }),
        milliseconds: update.times,
        ..KeyframeReport::default()
    };
    match &update.keyframe {
        Keyframe::Lines(keyframe) => {
            report.edge_chains = keyframe.edge_chains;
            report.edge_pixels = keyframe.edge_pixels;
            report.edge_depth_share = edge_depth_share(keyframe);
            report.segments = keyframe.segments.len();
        }
        Keyframe::Views(views) if views.len() > 1 => {
            report.frame = "all views".to_owned();
            report.index = views.end;
        }
        Keyframe::Features(_) | Keyframe::Views(_) => {}
    }
    report
}

fn edge_depth_share(keyframe: &LineKeyframe) -> f64 {
    match keyframe.edge_pixels {
        0 => 0.0,
        pixels => keyframe.edge_pixels_with_depth as f64 / pixels as f64,
    }
}

/// What stands beside the progress bar.
fn progress_message(map: &Map, update: &KeyframeUpdate) -> String {
    let triangles = match map.carver().is_deferred() {
        true => String::new(),
        false => format!(", {} triangles", map.carver().triangle_count()),
    };
    if let Some(segments) = map.segments() {
        let points = map.carver().point_count();
        let segments = segments.segment_count();
        return match points {
            0 => format!("{segments} segments"),
            points => format!("{segments} segments, {points} points{triangles}"),
        };
    }
    match &update.map.features {
        Some(counts) => format!(
            "{} features, {} points{triangles}",
            counts.features, counts.established
        ),
        None => format!("{} points{triangles}", map.carver().point_count()),
    }
}
