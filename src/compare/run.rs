//! One of the runs of a comparison.

use anyhow::ensure;
use linecarve_mesh::LineSet;
use nalgebra::Point3;

use super::result::ComparedSurface;
use crate::progress::Verbosity;
use crate::sinks::{KeyframeReports, PageRecorder, crosses};
use linecarve_engine::front_end::unmeasurable_warning;
use linecarve_engine::run::CancelToken;
use linecarve_engine::{Reconstruction, Recording, RunOptions, Sink, Source, camera_warning};

/// Length of the crosses that mark points in pictures, as a share of the median depth.
const CROSS_SHARE: f64 = 0.006;

/// What a run leaves, in the frame of computation.
pub(crate) struct ComparedRun {
    pub(crate) surface: ComparedSurface,
    pub(crate) recorder: PageRecorder,
    /// Segments and clusters, when the map is made of lines.
    pub(crate) lines: Option<(LineSet, LineSet)>,
    /// Points, when the map is made of points.
    pub(crate) points: Option<Vec<Point3<f64>>>,
    pub(crate) warnings: Vec<String>,
    /// Why the surface is empty, when it is.
    pub(crate) reason_for_nothing: Option<String>,
}

/// Reconstructs a recording, and gives it back.
///
/// # Errors
/// As [`Reconstruction::run`].
pub(crate) fn compared_run(
    recording: Recording,
    verbosity: Verbosity,
) -> anyhow::Result<(ComparedRun, Recording)> {
    let count = recording.keyframes.len();
    let (name, label, elements_name) = match &recording.source {
        Source::Sensor { .. } | Source::SemiDense(_) => ("lines", "3D lines", "segments"),
        Source::MapPoints { .. } | Source::Model(_) => ("map-points", "map points", "points"),
    };
    let mut run = Reconstruction::new(recording, RunOptions::default())?;
    let mut recorder = PageRecorder::new();
    let mut keyframes = KeyframeReports::new(label, count, verbosity);
    let sinks: &mut [&mut dyn Sink] = &mut [&mut recorder, &mut keyframes];
    run.run(CancelToken::default(), sinks)?;
    let mut warnings = Vec::new();
    if let Some(first) = keyframes.skipped.first() {
        let skipped = keyframes.skipped.len();
        ensure!(
            skipped < count,
            "{label}: {count} of {count} keyframes cannot be used; first: {first}"
        );
        warnings.push(format!(
            "{label}: {skipped} of {count} keyframes were left out; first: {first}"
        ));
    }
    warnings.extend(unmeasurable_warning(keyframes.unmeasurable_depths));
    let map = run.map();
    let correction = map
        .feature_points()
        .and_then(|points| points.lens().correction());
    let given = run.recording().sequence.stored_color_camera();
    warnings.extend(correction.and_then(|found| camera_warning(given, &found)));
    let mesh = map.final_surface();
    recorder.finish(&run, &mesh);
    let lines = map
        .segments()
        .map(|segments| (segments.segments(), segments.clusters()));
    let points = lines.is_none().then(|| map.points());
    let (elements, marks) = match (&lines, &points) {
        (Some((segments, clusters)), _) => (segments.lines.len(), clusters.clone()),
        (None, Some(points)) => {
            let length = CROSS_SHARE * map.median_depth().unwrap_or(0.0);
            (points.len(), crosses(points, length))
        }
        (None, None) => (0, LineSet::default()),
    };
    let reason = format!(
        "{elements} {elements_name} of {} keyframes enclose no occupied space that a ray has left",
        keyframes.reports.len()
    );
    let compared = ComparedRun {
        reason_for_nothing: mesh.is_empty().then_some(reason),
        surface: ComparedSurface {
            name,
            label,
            elements_name,
            elements,
            carved: map.carved_counts(),
            mesh,
            marks,
            keyframes: keyframes.reports,
        },
        recorder,
        lines,
        points,
        warnings,
    };
    Ok((compared, run.into_recording()))
}
