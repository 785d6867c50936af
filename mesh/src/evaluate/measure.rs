//! Evaluation of a shape against a ground truth.

use nalgebra::{Point3, Similarity3};

use super::align::align;
use super::nearest_point::NearestPointIndex;
use super::observed_shape::ObservedShape;
use super::options::{EvaluationOptions, EvaluationOptionsError, Region};
use super::result::{Evaluation, ObservedSummary, ShapeSummary, ThresholdScore};
use super::samples::{sample_cloud, sample_lines, sample_surface};
use super::statistics::{DistanceStatistics, share_below};
use crate::{GeometryError, Shape, ShapeKind};

/// Ratio of sizes from which different units are assumed.
const OTHER_UNITS: f64 = 10.0;

/// Why an evaluation is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] EvaluationOptionsError),
    /// The shape or the ground truth is not valid.
    #[error("{which}: {fault}")]
    Geometry {
        /// `the shape` or `the ground truth`.
        which: &'static str,
        /// What is wrong.
        fault: GeometryError,
    },
    /// The step is too small for the lines.
    #[error(
        "step {step}: it gives {samples:.0} samples along the lines; give at least {least:.2e}"
    )]
    Samples {
        /// The distance between samples.
        step: f64,
        /// How many samples it gives.
        samples: f64,
        /// Which distance can be used.
        least: f64,
    },
    /// The shape has no point.
    #[error("there is nothing to evaluate: the shape has no points")]
    Empty,
    /// The ground truth is neither a mesh nor a cloud.
    #[error("the ground truth holds {0}: a mesh or a point cloud is needed")]
    GroundTruth(&'static str),
}

/// Evaluates a mesh, a line set or a cloud against a mesh or a cloud.
///
/// Both shapes are sampled: triangles uniformly by area, lines at equal steps, clouds by their points. Samples
/// outside the region are ignored. The distance of a sample is that to the exact nearest point of the other shape. A
/// cloud represents its surface only by its points, so distances to it are upper bounds.
///
/// # Errors
/// When an option is out of range, one of the shapes is not valid, the shape is empty, or the ground truth neither a mesh
/// nor a cloud.
///
/// # Complexity
/// O((n + s) log n) for n elements and s samples; memory for both shapes, once more when they are aligned.
///
/// ```
/// use linecarve_mesh::evaluate::{EvaluationOptions, evaluate};
/// use linecarve_mesh::Shape;
/// use nalgebra::Point3;
///
/// let wall = |z| Shape {
///     positions: vec![Point3::new(0.0, 0.0, z), Point3::new(4.0, 0.0, z), Point3::new(0.0, 3.0, z)],
///     triangles: vec![[0, 1, 2]],
///     ..Shape::default()
/// };
/// let mut options = EvaluationOptions::default();
/// (options.region_margin, options.samples) = (0.1, 1000);
/// let evaluation = evaluate(&wall(0.03), &wall(0.0), &options)?;
/// assert!((evaluation.accuracy.unwrap().mean - 0.03).abs() < 1e-12);
/// assert_eq!((evaluation.at[0].f, evaluation.at[1].f), (Some(0.0), Some(1.0)));
/// # Ok::<(), linecarve_mesh::evaluate::EvaluationError>(())
/// ```
pub fn evaluate(
    shape: &Shape,
    ground_truth: &Shape,
    options: &EvaluationOptions,
) -> Result<Evaluation, EvaluationError> {
    evaluate_observed(shape, None, ground_truth, options)
}

/// [`evaluate`], limited to the observed part of the shape: other parts count neither for accuracy nor for
/// completeness.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_observed(
    shape: &Shape,
    observed: Option<&ObservedShape>,
    ground_truth: &Shape,
    options: &EvaluationOptions,
) -> Result<Evaluation, EvaluationError> {
    options.validate()?;
    let check = |which, shape: &Shape| {
        shape
            .validate()
            .map_err(|fault| EvaluationError::Geometry { which, fault })
    };
    check("the shape", shape)?;
    check("the ground truth", ground_truth)?;
    if shape.kind() == ShapeKind::Empty {
        return Err(EvaluationError::Empty);
    }
    match ground_truth.kind() {
        ShapeKind::Mesh | ShapeKind::Cloud => {}
        ShapeKind::Lines => return Err(EvaluationError::GroundTruth("lines and no triangle")),
        ShapeKind::Empty => return Err(EvaluationError::GroundTruth("nothing")),
    }

    let mut warnings = Vec::new();
    let counted = observed.map_or(shape, |observed| &observed.shape);
    let (truth_from_shape, alignment, doubt) =
        align(counted, ground_truth, &options.alignment, options.seed);
    warnings.extend(doubt);
    warnings.extend(unit_warning(shape, ground_truth, &truth_from_shape));

    let kind = shape.kind();
    let moved = moved(counted, &truth_from_shape);
    let counted = moved.as_ref().unwrap_or(counted);
    let region = region_box(ground_truth, options);
    let inside = |point: &Point3<f64>| {
        region.is_none_or(|(low, high)| {
            (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]))
        })
    };

    let covers = kind != ShapeKind::Lines;
    let (truth, surface) = rayon::join(
        || NearestPointIndex::new(ground_truth),
        || covers.then(|| NearestPointIndex::new(counted)),
    );
    if kind == ShapeKind::Lines {
        check_step(counted, options.step())?;
    }
    let drawn = drawn_points(counted, kind, options);
    let drawn_count = drawn.len();
    let scored: Vec<_> = drawn.into_iter().filter(inside).collect();
    let accuracy = truth.distances(&scored);

    let completeness = surface.map(|surface| {
        let points: Vec<_> =
            drawn_points(ground_truth, ground_truth.kind(), &with_other_seed(options))
                .into_iter()
                .filter(inside)
                .collect();
        surface.distances(&points)
    });

    let vertices: Vec<_> = sample_cloud(
        &observed_vertices(shape, observed),
        most_vertices(kind, options.samples),
        options.seed.wrapping_add(2),
    )
    .iter()
    .map(|vertex| truth_from_shape * vertex)
    .filter(inside)
    .collect();
    let at_vertices = truth.distances(&vertices);

    if scored.is_empty() {
        warnings.push(
            "no point of the shape lies in the region of interest: are both in one frame? (--align, --roi none)"
                .to_owned(),
        );
    } else if (scored.len() as f64) < 0.1 * drawn_count as f64 {
        warnings.push(format!(
            "only {} of {drawn_count} points of the shape lie in the region of interest",
            scored.len()
        ));
    }
    if kind == ShapeKind::Mesh && drawn_count == 0 {
        warnings.push("the triangles of the shape have no area".to_owned());
    }

    let at = options
        .thresholds
        .iter()
        .map(|&threshold| score(threshold, &accuracy, completeness.as_deref(), &at_vertices))
        .collect();
    Ok(Evaluation {
        shape: ShapeSummary::new(shape),
        ground_truth: ShapeSummary::new(ground_truth),
        alignment,
        region: region.map(|(low, high)| [low.coords.into(), high.coords.into()]),
        observed: observed.map(|observed| ObservedSummary {
            keyframes: observed.keyframes,
            share: observed.share,
        }),
        seed: options.seed,
        drawn: drawn_count,
        outside_region: drawn_count - scored.len(),
        accuracy: DistanceStatistics::from_distances(&accuracy),
        completeness: completeness.as_deref().and_then(finite_statistics),
        at,
        vertices: DistanceStatistics::from_distances(&at_vertices),
        warnings,
    })
}

/// Maximum number of vertices to measure. For lines and clouds they are the measure; for a mesh a subset suffices.
fn most_vertices(kind: ShapeKind, samples: usize) -> usize {
    match kind {
        ShapeKind::Mesh => samples.div_ceil(8),
        ShapeKind::Lines | ShapeKind::Cloud | ShapeKind::Empty => samples,
    }
}

/// Statistics; `None` without a reference, because JSON has no infinity.
fn finite_statistics(distances: &[f64]) -> Option<DistanceStatistics> {
    DistanceStatistics::from_distances(distances).filter(|statistics| statistics.max.is_finite())
}

fn with_other_seed(options: &EvaluationOptions) -> EvaluationOptions {
    EvaluationOptions {
        seed: options.seed.wrapping_add(1),
        ..options.clone()
    }
}

fn score(
    threshold: f64,
    accuracy: &[f64],
    completeness: Option<&[f64]>,
    at_vertices: &[f64],
) -> ThresholdScore {
    let precision = share_below(accuracy, threshold);
    let recall = completeness.map(|distances| share_below(distances, threshold));
    ThresholdScore {
        threshold,
        precision,
        recall,
        f: recall.map(|recall| {
            if precision + recall > 0.0 {
                2.0 * precision * recall / (precision + recall)
            } else {
                0.0
            }
        }),
        vertex_precision: share_below(at_vertices, threshold),
    }
}

fn unit_warning(shape: &Shape, truth: &Shape, applied: &Similarity3<f64>) -> Option<String> {
    let (size, truth_size) = (shape.diagonal() * applied.scaling(), truth.diagonal());
    let ratio = size / truth_size;
    if truth_size > 0.0 && size > 0.0 && !(1.0 / OTHER_UNITS..OTHER_UNITS).contains(&ratio) {
        return Some(format!(
            "the shape measures {size:.4} from corner to corner, the ground truth {truth_size:.4}: are their units the \
             same? (evaluate --align sim3 finds a scale)"
        ));
    }
    None
}

fn moved(shape: &Shape, by: &Similarity3<f64>) -> Option<Shape> {
    (*by != Similarity3::identity()).then(|| {
        let mut shape = shape.clone();
        for position in &mut shape.positions {
            *position = by * *position;
        }
        shape
    })
}

fn region_box(truth: &Shape, options: &EvaluationOptions) -> Option<(Point3<f64>, Point3<f64>)> {
    let (low, high) = match options.region {
        Region::Everywhere => return None,
        Region::GroundTruth => truth.bounds()?,
        Region::Box { low, high } => (low, high),
    };
    let margin = nalgebra::Vector3::repeat(options.region_margin);
    Some((low - margin, high + margin))
}

/// Refuses a step that gives more samples than an evaluation can take.
fn check_step(lines: &Shape, step: f64) -> Result<(), EvaluationError> {
    /// Largest number of samples: some minutes.
    const MOST_SAMPLES: f64 = 2e7;
    let ends = lines.lines.iter();
    let length: f64 = ends
        .map(|line| line.map(|end| lines.positions[end as usize]))
        .map(|[a, b]| (b - a).norm())
        .sum();
    let samples = length / step;
    match samples > MOST_SAMPLES {
        true => Err(EvaluationError::Samples {
            step,
            samples,
            least: 1.01 * length / MOST_SAMPLES,
        }),
        false => Ok(()),
    }
}

/// Samples of a shape by its kind.
fn drawn_points(shape: &Shape, kind: ShapeKind, options: &EvaluationOptions) -> Vec<Point3<f64>> {
    match kind {
        ShapeKind::Mesh => sample_surface(shape, options.samples, options.seed)
            .into_iter()
            .map(|(point, _)| point)
            .collect(),
        ShapeKind::Lines => sample_lines(shape, options.step()),
        ShapeKind::Cloud | ShapeKind::Empty => {
            sample_cloud(&shape.positions, options.samples, options.seed)
        }
    }
}

/// Vertices in use (all of a cloud) that were observed.
fn observed_vertices(shape: &Shape, observed: Option<&ObservedShape>) -> Vec<Point3<f64>> {
    let mut counts = match shape.kind() {
        ShapeKind::Cloud | ShapeKind::Empty => vec![true; shape.positions.len()],
        ShapeKind::Mesh | ShapeKind::Lines => {
            let mut is_used = vec![false; shape.positions.len()];
            let corners = shape.triangles.as_flattened().iter();
            for corner in corners.chain(shape.lines.as_flattened()) {
                is_used[*corner as usize] = true;
            }
            is_used
        }
    };
    if let Some(observed) = observed {
        for (counts, is_seen) in counts.iter_mut().zip(&observed.vertices) {
            *counts = *counts && *is_seen;
        }
    }
    shape
        .positions
        .iter()
        .zip(counts)
        .filter_map(|(position, counts)| counts.then_some(*position))
        .collect()
}

#[cfg(test)]
mod tests;
