//! One keyframe more in a map, and what the report says of it: what every command that makes a surface does.

use std::time::Instant;

use linecarve_carving::Carver;
use nalgebra::{Point3, Vector3};

use crate::commands::output::{OutputFolder, surface_part};
use crate::commands::run_report::keyframe_report;
use crate::mesh::{TriangleMesh, write_glb};
use crate::pipeline::{
    BackEnd, BackEndError, Keyframe, PointBackEnd, PointBackEndError, PointKeyframe, PointUpdate,
};
use crate::report::{KeyframeReport, MapPointReport, ResultSummary, milliseconds};
use crate::sequence::Sequence;

/// Folder of the surfaces after each keyframe.
pub(super) const GROWTH: &str = "keyframes";

/// Joins a keyframe with segments to the map.
pub(super) fn add_lines(
    map: &mut BackEnd,
    keyframe: &Keyframe,
    sequence: &Sequence,
) -> Result<KeyframeReport, BackEndError> {
    let mut report = keyframe_report(keyframe, sequence);
    let update = map.push(keyframe)?;
    report.clusters = map.segments().cluster_count();
    report.new_points = update.new_points;
    report.observed_again = update.observed_again;
    report.changed_triangles = update.changed_triangles;
    note_carver(&mut report, map.carver());
    report.milliseconds.cluster = milliseconds(update.clustering);
    report.milliseconds.points = milliseconds(update.matching);
    report.milliseconds.carve = milliseconds(update.carving);
    report.milliseconds.support = milliseconds(update.support);
    Ok(report)
}

/// Joins a keyframe with features to the map.
pub(super) fn add_points(
    map: &mut PointBackEnd,
    keyframe: &PointKeyframe,
    sequence: &Sequence,
) -> Result<(PointUpdate, KeyframeReport), PointBackEndError> {
    let update = map.push(keyframe)?;
    let counts = update.counts;
    let mut report = KeyframeReport {
        frame: sequence.frames()[keyframe.frame].name.clone(),
        index: keyframe.frame,
        new_points: update.added,
        observed_again: counts.observed_again,
        changed_triangles: update.changed_triangles,
        map_points: Some(MapPointReport {
            features: counts.features,
            observed_again: counts.observed_again,
            created: counts.created,
            removed: counts.removed,
            moved: update.moved,
            established: counts.established,
        }),
        milliseconds: keyframe.times,
        ..KeyframeReport::default()
    };
    note_carver(&mut report, map.carver());
    report.milliseconds.points = milliseconds(update.matching);
    report.milliseconds.carve = milliseconds(update.carving);
    Ok((update, report))
}

fn note_carver(report: &mut KeyframeReport, carver: &Carver) {
    report.rays = carver.ray_count();
    report.cells = carver.tetrahedra().finite_cell_count();
    report.triangles = carver.triangle_count();
}

/// What the carver and the surface hold at the end.
pub(super) fn note_result(result: &mut ResultSummary, carver: &Carver, mesh: &TriangleMesh) {
    result.points = carver.point_count();
    result.rays = carver.ray_count();
    result.cells = carver.tetrahedra().finite_cell_count();
    result.vertices = mesh.positions.len();
    result.triangles = mesh.triangles.len();
}

/// The surface as it stands after a keyframe.
pub(super) fn timed_surface(
    report: &mut KeyframeReport,
    surface: impl FnOnce() -> TriangleMesh,
) -> TriangleMesh {
    let start = Instant::now();
    let surface = surface();
    report.milliseconds.surface = milliseconds(start.elapsed());
    surface
}

/// Writes the surface as it stood after keyframe `number` of those that could be used.
pub(super) fn write_growth(
    output: &mut OutputFolder,
    number: usize,
    mut surface: TriangleMesh,
    origin: &Vector3<f64>,
    report: &mut KeyframeReport,
) -> anyhow::Result<()> {
    let start = Instant::now();
    surface.translate(origin);
    let path = output.file(&format!("{GROWTH}/{number:06}.glb"));
    write_glb(&path, &[surface_part(&surface)], origin)?;
    report.milliseconds.write = milliseconds(start.elapsed());
    Ok(())
}

/// Positions of the points that are carved, in the order of their ids.
pub(super) fn carved_points(carver: &Carver) -> Vec<Point3<f64>> {
    carver
        .points()
        .filter_map(|point| carver.point(point))
        .collect()
}
