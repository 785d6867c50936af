//! The two runs of `linecarve compare`, one after the other so that their times can be compared.

use nalgebra::Point3;

use crate::commands::map_steps::{add_lines, add_points, carved_points, timed_surface};
use crate::commands::page::PageRecorder;
use crate::commands::picture::crosses;
use crate::commands::sequence::{Prepared, lens_warning};
use crate::compare::ComparedSurface;
use crate::pipeline::{
    self, Arrival, BackEnd, FrontEndError, PointBackEnd, PointFrontEndError, PointKeyframe,
    run_map_points,
};
use crate::progress::{Progress, Verbosity};
use crate::report::KeyframeReport;
use linecarve_mesh::LineSet;

/// Length of the crosses that mark points in pictures, as a share of the median depth.
const CROSS_SHARE: f64 = 0.006;

/// What a run leaves, in the frame of computation.
pub(super) struct ComparedRun {
    pub(super) surface: ComparedSurface,
    pub(super) recorder: PageRecorder,
    /// Segments and clusters, when it is made from lines.
    pub(super) lines: Option<(LineSet, LineSet)>,
    /// Points, when it is made from points.
    pub(super) points: Option<Vec<Point3<f64>>>,
    pub(super) warnings: Vec<String>,
    /// Why the surface is empty, when it is.
    pub(super) reason_for_nothing: Option<String>,
}

/// Keyframes that had to be left out.
struct LeftOut {
    label: &'static str,
    count: usize,
    first: Option<String>,
}

impl LeftOut {
    fn new(label: &'static str) -> Self {
        Self {
            label,
            count: 0,
            first: None,
        }
    }

    fn note(&mut self, error: &dyn std::error::Error, progress: &Progress) {
        self.count += 1;
        progress.say(Verbosity::Verbose, &format!("left out: {error}"));
        self.first.get_or_insert_with(|| error.to_string());
    }

    /// The warning about them.
    ///
    /// # Errors
    /// When there is no keyframe left.
    fn warnings(self, chosen: usize) -> anyhow::Result<Vec<String>> {
        let Self {
            label,
            count,
            first,
        } = self;
        let Some(first) = first else {
            return Ok(Vec::new());
        };
        anyhow::ensure!(
            count < chosen,
            "{label}: {chosen} of {chosen} keyframes cannot be used; first: {first}"
        );
        Ok(vec![format!(
            "{label}: {count} of {chosen} keyframes were left out; first: {first}"
        )])
    }
}

/// The surface from lines.
pub(super) fn run_lines(prepared: &Prepared, verbosity: Verbosity) -> anyhow::Result<ComparedRun> {
    let label = "3D lines";
    let mut progress = Progress::start(label, prepared.keyframes.len(), verbosity);
    let mut map = BackEnd::new(
        &prepared.options,
        prepared.sequence.color_camera(),
        prepared.depth.noise(),
        prepared.median_depth,
    )?;
    let mut recorder = PageRecorder::new();
    let mut reports: Vec<KeyframeReport> = Vec::new();
    let mut left_out = LeftOut::new(label);
    let mut last = 0;
    pipeline::run(
        &prepared.sequence,
        &prepared.depth,
        &prepared.keyframes,
        prepared.options.extract(),
        None,
        false,
        |number, arrival| -> anyhow::Result<()> {
            let Arrival::Last(keyframe) = arrival else {
                return Ok(());
            };
            let mut keyframe = match keyframe {
                Ok(keyframe) => keyframe,
                Err(error) if FrontEndError::is_limited_to_frame(&error) => {
                    left_out.note(&error, &progress);
                    progress.step(String::new);
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            };
            keyframe.world_from_camera.translation.vector -= prepared.origin;
            let mut report = add_lines(&mut map, &keyframe, &prepared.sequence)?;
            let surface = timed_surface(&mut report, || map.surface());
            recorder.push(number, &keyframe, map.segments(), &surface);
            last = number;
            reports.push(report);
            progress.step(|| format!("{} segments", map.segments().segment_count()));
            Ok(())
        },
    )?;
    progress.finish();
    let warnings = left_out.warnings(prepared.keyframes.len())?;
    let mesh = map.surface();
    recorder.finish(last, map.segments(), &mesh);
    let (segments, clusters) = (map.segments().segments(), map.segments().clusters());
    let reason = format!(
        "{} segments of {} keyframes enclose no occupied space that a ray has left",
        segments.lines.len(),
        reports.len()
    );
    Ok(ComparedRun {
        reason_for_nothing: mesh.is_empty().then_some(reason),
        surface: ComparedSurface {
            name: "lines",
            label,
            elements_name: "segments",
            elements: segments.lines.len(),
            mesh,
            marks: clusters.clone(),
            keyframes: reports,
        },
        recorder,
        lines: Some((segments, clusters)),
        points: None,
        warnings,
    })
}

/// The surface from map points.
pub(super) fn run_points(prepared: &Prepared, verbosity: Verbosity) -> anyhow::Result<ComparedRun> {
    let label = "map points";
    let sequence = &prepared.sequence;
    let mut progress = Progress::start(label, prepared.keyframes.len(), verbosity);
    let mut map = PointBackEnd::new(&prepared.options, sequence, Some(prepared.median_depth))?;
    let mut recorder = PageRecorder::new();
    let mut reports: Vec<KeyframeReport> = Vec::new();
    let mut left_out = LeftOut::new(label);
    let mut last = 0;
    let consume = |number: usize, keyframe: Result<PointKeyframe, PointFrontEndError>| {
        let mut keyframe = match keyframe {
            Ok(keyframe) => keyframe,
            Err(error) if error.is_limited_to_frame() => {
                left_out.note(&error, &progress);
                progress.step(String::new);
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        keyframe.world_from_camera.translation.vector -= prepared.origin;
        let (_, mut report) = add_points(&mut map, &keyframe, sequence)?;
        let surface = timed_surface(&mut report, || map.surface());
        recorder.push_points(number, &carved_points(map.carver()), &surface);
        last = number;
        reports.push(report);
        progress.step(|| format!("{} points", map.carver().point_count()));
        anyhow::Ok(())
    };
    run_map_points(
        sequence,
        &prepared.keyframes,
        &prepared.options.map_points,
        None,
        consume,
    )?;
    progress.finish();
    let mut warnings = left_out.warnings(prepared.keyframes.len())?;
    map.finish()?;
    warnings.extend(map.map().lens().k1().map(lens_warning));
    let mesh = map.surface();
    let points = carved_points(map.carver());
    recorder.finish_points(last, &points, &mesh);
    let reason = format!(
        "{} points of {} keyframes enclose no occupied space that a ray has left",
        points.len(),
        reports.len()
    );
    Ok(ComparedRun {
        reason_for_nothing: mesh.is_empty().then_some(reason),
        surface: ComparedSurface {
            name: "map-points",
            label,
            elements_name: "points",
            elements: points.len(),
            mesh,
            marks: crosses(&points, CROSS_SHARE * prepared.median_depth),
            keyframes: reports,
        },
        recorder,
        lines: None,
        points: Some(points),
        warnings,
    })
}
