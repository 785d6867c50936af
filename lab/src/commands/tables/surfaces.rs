//! Surfaces carved from the ends of segments, and their scores.

use linecarve::Recording;
use linecarve_lab::baselines::Method;
use linecarve_lab::tables::carved::{CellLabels, carve};
use linecarve_lab::tables::methods::MethodRun;
use linecarve_lab::tables::table::SurfaceRow;
use linecarve_mesh::Shape;
use linecarve_mesh::evaluate::{Alignment, EvaluationOptions, evaluate};
use nalgebra::{Point3, Similarity3};

use super::methods::median_depth;

/// Rows for the paper's and our segments, with all labels; `recording` has the poses that the runs used.
pub(super) fn score_all(
    recording: &Recording,
    frames: &[usize],
    runs: &[MethodRun],
    truth: &Shape,
    truth_from_poses: &Similarity3<f64>,
) -> anyhow::Result<Vec<SurfaceRow>> {
    let poses = recording.sequence.frames();
    let centers: Vec<Point3<f64>> = frames
        .iter()
        .map(|&frame| Point3::from(poses[frame].world_from_camera.translation.vector))
        .collect();
    let mut options = EvaluationOptions::default();
    options.alignment = Alignment::Given(*truth_from_poses);
    let methods = [Method::Paper, Method::EdgeAided].map(|method| method.to_string());
    let mut rows = Vec::new();
    for run in runs.iter().filter(|run| methods.contains(&run.name)) {
        for labels in CellLabels::ALL {
            let shape = carve(&run.segments, &centers, labels, median_depth(recording))?;
            let mut row = SurfaceRow {
                method: run.name.clone(),
                depth: run.depth,
                labels: labels.name(),
                vertices: shape.positions.len(),
                triangles: shape.triangles.len(),
                ..SurfaceRow::default()
            };
            if !shape.triangles.is_empty() {
                let scores = evaluate(&shape, truth, &options)?;
                row.accuracy = scores.accuracy.map(|distances| distances.mean);
                row.completeness = scores.completeness.map(|distances| distances.mean);
                row.thresholds = options.thresholds.clone();
                row.f = scores.at.iter().map(|at| at.f).collect();
            }
            rows.push(row);
        }
    }
    Ok(rows)
}
