//! Comparison of two meshes.

use nalgebra::{Point3, Vector3};

use super::distances::{Other, farthest_vertex, to_other, used_positions};
use super::options::{Check, DiffOptions};
use super::orientation::flipped;
use super::result::{CheckOutcome, ComparedMesh, Difference, MeshLocation, OneSidedDistances};
use super::topology::Topology;
use crate::evaluate::ShapeSummary;
use crate::{GeometryError, Shape, ShapeKind};

/// Why two shapes cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DiffError {
    /// A shape is not valid.
    #[error("the {which} mesh: {fault}")]
    Geometry {
        /// `expected` or `actual`.
        which: &'static str,
        /// What is wrong.
        fault: GeometryError,
    },
    /// A shape is not a mesh.
    #[error("the {which} file holds {found} but no triangles: only meshes can be compared")]
    NoMesh {
        /// `expected` or `actual`.
        which: &'static str,
        /// Kind of the shape.
        found: &'static str,
    },
    /// An option is out of range.
    #[error("{0}")]
    Options(&'static str),
}

/// Compares two meshes. Either may be empty; two empty meshes are equal.
///
/// Distances to the other surface are exact, and 0 on triangles that both meshes have. They are measured at samples
/// uniform by area, at every vertex in use and at the centre of every triangle; the largest in both directions is the
/// Hausdorff distance on these points. Triangles without area have no distance. The order of vertices and triangles
/// and vertices without triangles make no difference.
///
/// # Errors
/// When a shape is not valid or not a mesh, or an option is out of range.
///
/// # Complexity
/// O((n + s) log n) for n triangles and s samples.
///
/// ```
/// use linecarve_mesh::diff::{DiffOptions, Tolerance, compare};
/// use linecarve_mesh::Shape;
/// use nalgebra::Point3;
///
/// let wall = |z| Shape {
///     positions: vec![Point3::new(0.0, 0.0, z), Point3::new(4.0, 0.0, z), Point3::new(0.0, 3.0, z)],
///     triangles: vec![[0, 1, 2]],
///     ..Shape::default()
/// };
/// let mut options = DiffOptions::default();
/// options.tolerance = Tolerance::Length(0.01);
/// assert!(compare(&wall(0.0), &wall(0.005), &options)?.is_same);
/// let difference = compare(&wall(0.0), &wall(0.03), &options)?;
/// assert!((difference.worst.unwrap().distance - 0.03).abs() < 1e-12);
/// # Ok::<(), linecarve_mesh::diff::DiffError>(())
/// ```
pub fn compare(
    expected: &Shape,
    actual: &Shape,
    options: &DiffOptions,
) -> Result<Difference, DiffError> {
    for (which, shape) in [("expected", expected), ("actual", actual)] {
        shape
            .validate()
            .map_err(|fault| DiffError::Geometry { which, fault })?;
        let found = match shape.kind() {
            ShapeKind::Mesh | ShapeKind::Empty => continue,
            ShapeKind::Lines => "lines",
            ShapeKind::Cloud => "points",
        };
        return Err(DiffError::NoMesh { which, found });
    }
    if !(1..=1_000_000_000).contains(&options.samples) {
        return Err(DiffError::Options(
            "samples: give a number from 1 to 1000000000",
        ));
    }
    let bounds = [expected, actual].map(used_bounds);
    let diagonal = bounds[0].map_or(0.0, |[low, high]| (high - low).norm());
    let tolerance = options.tolerance.length(diagonal);
    if !(tolerance >= 0.0 && tolerance.is_finite()) {
        return Err(DiffError::Options("the tolerance is not a length"));
    }
    let tolerance = tolerance.max(rounding(expected).max(rounding(actual)));

    let (expected_surface, actual_surface) = (Other::new(expected), Other::new(actual));
    let measure = |mesh, on, other, seed| to_other(mesh, on, other, options.samples, seed);
    let from_expected = measure(
        expected,
        ComparedMesh::Expected,
        &actual_surface,
        options.seed,
    );
    let from_actual = measure(
        actual,
        ComparedMesh::Actual,
        &expected_surface,
        options.seed.wrapping_add(1),
    );
    let worst = farther(
        from_expected.map(|(_, location)| location),
        from_actual.map(|(_, location)| location),
    );
    let has_same_counts = used_positions(expected).len() == used_positions(actual).len()
        && expected.triangles.len() == actual.triangles.len();
    let worst_vertex = if has_same_counts {
        farther(
            farthest_vertex(expected, ComparedMesh::Expected, actual),
            farthest_vertex(actual, ComparedMesh::Actual, expected),
        )
    } else {
        None
    };
    let (flipped_here, worst_here) = flipped(
        expected,
        ComparedMesh::Expected,
        &actual_surface.index,
        tolerance,
    );
    let (flipped_there, worst_there) = flipped(
        actual,
        ComparedMesh::Actual,
        &expected_surface.index,
        tolerance,
    );

    let mut difference = Difference {
        is_same: true,
        checks: Vec::new(),
        tolerance,
        expected: ShapeSummary::new(expected),
        actual: ShapeSummary::new(actual),
        from_expected: from_expected.map(|(summary, _)| summary),
        from_actual: from_actual.map(|(summary, _)| summary),
        worst,
        worst_vertex,
        bounds: bounds.map(|corners| corners.map(|c| c.map(|corner| corner.coords.into()))),
        flipped_triangles: flipped_here + flipped_there,
        worst_flipped: worst_here.or(worst_there),
        topology: [Topology::new(expected), Topology::new(actual)],
    };
    let mut checks = options.checks.clone();
    checks.sort_unstable();
    checks.dedup();
    for check in checks {
        let (passed, message) = judge(check, &difference, &bounds);
        difference.is_same &= passed;
        difference.checks.push(CheckOutcome {
            check,
            passed,
            message,
        });
    }
    Ok(difference)
}

/// Tolerance for rounding: a billionth of the largest coordinate. Nearest points of slivers are off by a few
/// trillionths; single-precision files round a hundred times more coarsely.
fn rounding(shape: &Shape) -> f64 {
    let largest = shape.positions.iter().map(|p| p.coords.amax());
    1e-9 * largest.fold(0.0, f64::max)
}

/// The location with the larger distance, the first one of equals.
fn farther(a: Option<MeshLocation>, b: Option<MeshLocation>) -> Option<MeshLocation> {
    match (a, b) {
        (Some(a), Some(b)) if b.distance > a.distance => Some(b),
        (Some(a), _) => Some(a),
        (None, b) => b,
    }
}

/// Bounding box of the vertices that triangles use.
fn used_bounds(shape: &Shape) -> Option<[Point3<f64>; 2]> {
    let used = Shape {
        positions: used_positions(shape),
        ..Shape::default()
    };
    used.bounds().map(|(low, high)| [low, high])
}

fn judge(
    check: Check,
    found: &Difference,
    bounds: &[Option<[Point3<f64>; 2]>; 2],
) -> (bool, String) {
    match check {
        Check::Distance => judge_distance(found),
        Check::Bounds => judge_bounds(found, bounds),
        Check::Vertices => match &found.worst_vertex {
            None => (
                true,
                "not comparable: the counts of vertices or triangles differ".to_owned(),
            ),
            Some(location) => (
                location.distance <= found.tolerance,
                format!("up to {} apart, at {location}", length(location.distance)),
            ),
        },
        Check::Orientation => match &found.worst_flipped {
            None => (true, "all triangles have the same orientation".to_owned()),
            Some(location) => (
                false,
                format!(
                    "{} triangles have the opposite orientation, the largest at {location}",
                    found.flipped_triangles
                ),
            ),
        },
        Check::Topology => judge_topology(&found.topology),
        Check::Counts => {
            let (a, b) = (&found.expected, &found.actual);
            (
                (a.vertices, a.triangles) == (b.vertices, b.triangles),
                format!(
                    "expected {} vertices and {} triangles, found {} and {}",
                    a.vertices, a.triangles, b.vertices, b.triangles
                ),
            )
        }
    }
}

fn judge_distance(found: &Difference) -> (bool, String) {
    let (Some(a), Some(b), Some(worst)) = (found.from_expected, found.from_actual, &found.worst)
    else {
        let is_empty = |facts: &ShapeSummary| facts.triangles == 0;
        return match (is_empty(&found.expected), is_empty(&found.actual)) {
            (true, true) => (true, "both meshes are empty".to_owned()),
            (true, false) => (false, "an empty mesh was expected".to_owned()),
            (false, true) => (false, "the actual mesh is empty".to_owned()),
            (false, false) => (
                false,
                "the triangles of one of the meshes have no area".to_owned(),
            ),
        };
    };
    let summary =
        |side: OneSidedDistances| format!("mean {}, 95 % {}", length(side.mean), length(side.p95));
    (
        worst.distance <= found.tolerance,
        format!(
            "up to {} apart, at {worst}; from expected {}; from actual {}",
            length(worst.distance),
            summary(a),
            summary(b)
        ),
    )
}

fn judge_bounds(found: &Difference, bounds: &[Option<[Point3<f64>; 2]>; 2]) -> (bool, String) {
    match bounds {
        [Some([low, high]), Some([other_low, other_high])] => {
            let offset = |a: &Point3<f64>, b: &Point3<f64>| -> Vector3<f64> { b - a };
            let (low, high) = (offset(low, other_low), offset(high, other_high));
            (
                low.amax().max(high.amax()) <= found.tolerance,
                format!(
                    "corners moved by ({}) and ({})",
                    low.map(length_number)
                        .iter()
                        .cloned()
                        .collect::<Vec<_>>()
                        .join(", "),
                    high.map(length_number)
                        .iter()
                        .cloned()
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            )
        }
        [None, None] => (true, "both meshes are empty".to_owned()),
        _ => (false, "one of the meshes is empty".to_owned()),
    }
}

fn judge_topology([a, b]: &[Topology; 2]) -> (bool, String) {
    let facts = |t: &Topology| {
        [
            ("components", t.components),
            ("boundary edges", t.boundary_edges),
            ("boundary loops", t.boundary_loops),
            ("non-manifold edges", t.non_manifold_edges),
            ("inconsistently oriented edges", t.inconsistent_edges),
        ]
    };
    let mut changes: Vec<String> = facts(a)
        .iter()
        .zip(facts(b))
        .filter(|((_, expected), (_, actual))| expected != actual)
        .map(|((name, expected), (_, actual))| {
            format!("{name}: {expected} expected, {actual} found")
        })
        .collect();
    if a.genus != b.genus {
        let words = |genus: Option<u64>| genus.map_or("none".to_owned(), |g| g.to_string());
        changes.push(format!(
            "handles: {} expected, {} found",
            words(a.genus),
            words(b.genus)
        ));
    }
    if changes.is_empty() {
        (
            true,
            format!(
                "{} components, {} boundary edges in {} loops",
                a.components, a.boundary_edges, a.boundary_loops
            ),
        )
    } else {
        (false, changes.join("; "))
    }
}

fn length(value: f64) -> String {
    format!("{value:.6}")
}

fn length_number(value: f64) -> String {
    // Adding zero turns -0 into 0.
    format!("{:.6}", value + 0.0)
}

#[cfg(test)]
mod tests;
