//! Alignment of a shape with its ground truth.

use nalgebra::{Matrix4, Point3, Similarity3, UnitQuaternion, Vector3};

use super::icp::{IcpOptions, IcpResult, register};
use super::options::Alignment;
use super::result::AlignmentSummary;
use crate::Shape;

/// Offset between the seeds of alignment samples and of evaluation samples.
const OTHER_SEED: u64 = 0x5EED_A116;

/// Estimates the transform from the frame of `shape` to that of `truth`, with a warning when it is not reliable.
pub(super) fn align(
    shape: &Shape,
    truth: &Shape,
    alignment: &Alignment,
    seed: u64,
) -> (Similarity3<f64>, AlignmentSummary, Option<String>) {
    let options = |with_scale| IcpOptions {
        with_scale,
        seed: seed ^ OTHER_SEED,
        ..IcpOptions::default()
    };
    let (method, found) = match alignment {
        Alignment::None => return without_search("none", Similarity3::identity()),
        Alignment::Given(known) => return without_search("given", *known),
        Alignment::Icp { start } => ("icp", register(shape, truth, start, &options(false))),
        Alignment::Similarity { start } => {
            let options = options(true);
            let starts = match start {
                Some(start) => vec![*start],
                None => vec![Similarity3::identity(), same_size_and_center(shape, truth)],
            };
            let best = starts
                .iter()
                .filter_map(|start| register(shape, truth, start, &options))
                .min_by(|a, b| a.rms.total_cmp(&b.rms));
            ("similarity", best)
        }
    };
    let Some(IcpResult {
        truth_from_shape,
        pairs,
        rms,
        has_converged,
        ..
    }) = found
    else {
        let (identity, facts, _) = without_search("none", Similarity3::identity());
        let warning = "no samples to align: the shapes keep the frames of their files".to_owned();
        return (identity, facts, Some(warning));
    };
    let warning = if !has_converged {
        Some("the alignment did not converge: give a better start (--trajectories)".to_owned())
    } else if rms > 0.02 * truth.diagonal() {
        Some(format!(
            "after the alignment even the nearest pairs are {rms:.3} apart: it is probably at a false minimum; \
             give a better start (--trajectories)"
        ))
    } else {
        None
    };
    let facts = AlignmentSummary {
        method,
        truth_from_shape: rows(&truth_from_shape.to_homogeneous()),
        scale: truth_from_shape.scaling(),
        pairs: Some(pairs),
        rms: Some(rms),
        has_converged: Some(has_converged),
    };
    (truth_from_shape, facts, warning)
}

fn without_search(
    method: &'static str,
    known: Similarity3<f64>,
) -> (Similarity3<f64>, AlignmentSummary, Option<String>) {
    let facts = AlignmentSummary {
        method,
        truth_from_shape: rows(&known.to_homogeneous()),
        scale: known.scaling(),
        pairs: None,
        rms: None,
        has_converged: None,
    };
    (known, facts, None)
}

/// The transform without rotation that equalises mean and standard deviation of the points.
fn same_size_and_center(shape: &Shape, truth: &Shape) -> Similarity3<f64> {
    let moments = |points: &[Point3<f64>]| {
        let count = points.len().max(1) as f64;
        let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
        let spread = points
            .iter()
            .map(|p| (p.coords - mean).norm_squared())
            .sum::<f64>()
            / count;
        (mean, spread.sqrt())
    };
    let (mean, spread) = moments(&shape.positions);
    let (truth_mean, truth_spread) = moments(&truth.positions);
    let scale = if spread > 0.0 && truth_spread > 0.0 {
        truth_spread / spread
    } else {
        1.0
    };
    let translation = truth_mean - mean * scale;
    Similarity3::from_parts(translation.into(), UnitQuaternion::identity(), scale)
}

fn rows(matrix: &Matrix4<f64>) -> [[f64; 4]; 4] {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}
