//! The ground truth of the tables: a mesh or a cloud, in the frame of the poses.

use std::path::Path;

use nalgebra::{Point3, Similarity3, Vector3};
use serde::Serialize;
use thiserror::Error;

use linecarve_mesh::evaluate::{IcpOptions, NearestPointIndex, register};
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{ReadError, Shape, TriangleMesh, read_geometry};

/// Why there is no ground truth.
#[derive(Debug, Error)]
pub enum TruthError {
    /// The file cannot be read as a mesh or cloud.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A file of COLMAP cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// The reason.
        source: std::io::Error,
    },
    /// A line of `points3D.txt` is wrong.
    #[error(
        "{path}, line {line}: a point of COLMAP is an id and three finite coordinates, and more numbers"
    )]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
    },
    /// `points3D.bin` ends too early or holds a coordinate that is not finite.
    #[error(
        "{path}: damaged at point {point} of {count}; write the model again with COLMAP's model_converter"
    )]
    Damaged {
        /// The file.
        path: String,
        /// The point, from 1.
        point: u64,
        /// The number that the file names.
        count: u64,
    },
    /// There is nothing to measure distances to.
    #[error(
        "{path}: it has neither triangles with an area nor points; a mesh or a cloud of the true surface is needed"
    )]
    Empty {
        /// The file.
        path: String,
    },
    /// Lines are no surface.
    #[error(
        "{path}: it holds lines and no triangles; a mesh or a cloud of the true surface is needed"
    )]
    Lines {
        /// The file.
        path: String,
    },
    /// Nothing to align.
    #[error(
        "the ground truth cannot be aligned: the keyframes gave {points} points with a depth; align it beforehand and leave --align out"
    )]
    NothingToAlign {
        /// Number of points.
        points: usize,
    },
}

/// Reads a mesh, a cloud, or the points of a COLMAP model (`points3D.txt`, `points3D.bin`).
///
/// # Errors
/// When the file cannot be read, or holds no surface.
pub fn read_truth(path: &Path) -> Result<Shape, TruthError> {
    let name = || path.display().to_string();
    let shape = match path.file_name().and_then(|name| name.to_str()) {
        Some("points3D.txt") => cloud(points_of_text(&read(path)?, &name())?),
        Some("points3D.bin") => cloud(points_of_binary(&read(path)?, &name())?),
        _ => read_geometry(path)?,
    };
    if shape.triangles.is_empty() && !shape.lines.is_empty() {
        return Err(TruthError::Lines { path: name() });
    }
    if shape.positions.is_empty() {
        return Err(TruthError::Empty { path: name() });
    }
    Ok(shape)
}

fn read(path: &Path) -> Result<Vec<u8>, TruthError> {
    std::fs::read(path).map_err(|source| TruthError::Io {
        path: path.display().to_string(),
        source,
    })
}

fn cloud(positions: Vec<Point3<f64>>) -> Shape {
    Shape {
        positions,
        ..Shape::default()
    }
}

fn points_of_text(bytes: &[u8], path: &str) -> Result<Vec<Point3<f64>>, TruthError> {
    let text = String::from_utf8_lossy(bytes);
    let mut points = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.split_whitespace();
        let is_id = words.next().is_some_and(|id| id.parse::<u64>().is_ok());
        let numbers: Vec<f64> = words.take(3).filter_map(|word| word.parse().ok()).collect();
        match numbers[..] {
            [x, y, z] if is_id && numbers.iter().all(|number| number.is_finite()) => {
                points.push(Point3::new(x, y, z));
            }
            _ => {
                return Err(TruthError::Line {
                    path: path.to_owned(),
                    line: index + 1,
                });
            }
        }
    }
    Ok(points)
}

fn points_of_binary(bytes: &[u8], path: &str) -> Result<Vec<Point3<f64>>, TruthError> {
    let eight =
        |at: usize| -> Option<[u8; 8]> { bytes.get(at..at.checked_add(8)?)?.try_into().ok() };
    let damaged = |point, count| TruthError::Damaged {
        path: path.to_owned(),
        point,
        count,
    };
    let count = eight(0).map(u64::from_le_bytes).ok_or(damaged(1, 0))?;
    let mut points = Vec::new();
    let mut at = 8;
    for point in 1..=count {
        // Id, three coordinates, colour, error, and a track of two numbers for each image.
        let coordinate = |axis: usize| eight(at + 8 + 8 * axis).map(f64::from_le_bytes);
        let track = eight(at + 43).map(u64::from_le_bytes);
        let next = track
            .and_then(|track| {
                usize::try_from(track)
                    .ok()?
                    .checked_mul(8)?
                    .checked_add(at + 51)
            })
            .filter(|next| *next <= bytes.len());
        match (coordinate(0), coordinate(1), coordinate(2), next) {
            (Some(x), Some(y), Some(z), Some(next))
                if [x, y, z].iter().all(|value| value.is_finite()) =>
            {
                points.push(Point3::new(x, y, z));
                at = next;
            }
            _ => return Err(damaged(point, count)),
        }
    }
    Ok(points)
}

/// A ground truth in the frame of the poses.
pub struct Truth {
    index: NearestPointIndex,
    /// The surface that hides lines; empty for a cloud, which hides nothing.
    occluder: RayScene,
    /// Units of the ground truth in a unit of the poses.
    scale: f64,
    elements: usize,
}

impl Truth {
    /// Moves a shape to the frame of the poses; `truth_from_poses` maps from there to the frame of the shape.
    pub fn new(mut shape: Shape, truth_from_poses: &Similarity3<f64>) -> Self {
        if *truth_from_poses != Similarity3::identity() {
            shape.transform(&truth_from_poses.inverse().to_homogeneous());
        }
        let index = NearestPointIndex::new(&shape);
        let points = shape.positions.len();
        let mesh = match index.is_mesh() {
            true => shape.into_mesh(),
            false => TriangleMesh::default(),
        };
        let occluder = RayScene::new(&mesh);
        Self {
            elements: match index.is_mesh() {
                true => occluder.triangle_count(),
                false => points,
            },
            index,
            occluder,
            scale: truth_from_poses.scaling(),
        }
    }

    /// Distance of a point to the nearest triangle of a mesh or the nearest point of a cloud, in units of the ground truth.
    pub fn distance(&self, point: &Point3<f64>) -> Option<f64> {
        Some(self.scale * self.index.nearest(point)?.distance)
    }

    /// The surface that hides lines.
    pub fn occluder(&self) -> &RayScene {
        &self.occluder
    }

    /// Whether distances are to triangles.
    pub fn is_mesh(&self) -> bool {
        self.index.is_mesh()
    }

    /// Number of triangles of a mesh, of points of a cloud.
    pub fn elements(&self) -> usize {
        self.elements
    }
}

/// The transformation from the frame of the poses to that of the ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TruthAlignment {
    /// `se3` (scale kept) or `sim3`.
    pub method: &'static str,
    /// What it was estimated on.
    pub estimated_on: String,
    /// Units of the ground truth in a unit of the poses.
    pub scale: f64,
    /// `point_in_truth = truth_from_poses * point`, row by row.
    pub truth_from_poses: [[f64; 4]; 4],
    /// Root mean square distance of the nearest pairs used, in units of the ground truth.
    pub rms: f64,
    /// Number of them.
    pub pairs: usize,
    /// Whether the search converged with a small residual. A false place can have one, too.
    pub is_reliable: bool,
}

/// Estimates the transformation by trimmed ICP from a cloud of the keyframes' depth to the ground truth.
///
/// Without a `start` the search begins at the identity and where size and centre of both are the same, and the better result is
/// taken. Samples are seeded: the same input gives the same transformation.
///
/// # Errors
/// When there is nothing to align.
pub fn align(
    points: &[Point3<f64>],
    truth: &Shape,
    with_scale: bool,
    start: Option<Similarity3<f64>>,
) -> Result<(Similarity3<f64>, TruthAlignment), TruthError> {
    let shape = cloud(points.to_vec());
    // Pairs of points without normals slide slowly: far more steps than a mesh needs.
    let mut options = IcpOptions::default();
    options.with_scale = with_scale;
    options.max_iterations = 500;
    let starts = match start {
        Some(start) => vec![start],
        None => vec![
            Similarity3::identity(),
            centered(points, &truth.positions, with_scale),
        ],
    };
    let best = starts
        .iter()
        .filter_map(|start| register(&shape, truth, start, &options))
        .min_by(|a, b| a.rms.total_cmp(&b.rms))
        .ok_or(TruthError::NothingToAlign {
            points: points.len(),
        })?;
    let matrix = best.truth_from_shape.to_homogeneous();
    let report = TruthAlignment {
        method: if with_scale { "sim3" } else { "se3" },
        estimated_on: format!("the {} points of the keyframes", points.len()),
        scale: best.truth_from_shape.scaling(),
        truth_from_poses: std::array::from_fn(|row| {
            std::array::from_fn(|column| matrix[(row, column)])
        }),
        rms: best.rms,
        pairs: best.pairs,
        is_reliable: best.has_converged && best.rms <= 0.02 * truth.diagonal(),
    };
    Ok((best.truth_from_shape, report))
}

/// Without rotation: equal medians, and with scale equal median distances from them, which outliers do not change.
fn centered(points: &[Point3<f64>], truth: &[Point3<f64>], with_scale: bool) -> Similarity3<f64> {
    let moments = |points: &[Point3<f64>]| {
        let axis = |axis: usize| median(points.iter().map(|point| point[axis]).collect());
        let center = Vector3::new(axis(0), axis(1), axis(2));
        let spread = points.iter().map(|point| (point.coords - center).norm());
        (center, median(spread.collect()))
    };
    let ((center, spread), (truth_center, truth_spread)) = (moments(points), moments(truth));
    let scale = match with_scale && spread > 0.0 && truth_spread > 0.0 {
        true => truth_spread / spread,
        false => 1.0,
    };
    let translation = truth_center - center * scale;
    Similarity3::from_parts(
        translation.into(),
        nalgebra::UnitQuaternion::identity(),
        scale,
    )
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    match values.is_empty() {
        true => 0.0,
        false => *values.select_nth_unstable_by(middle, f64::total_cmp).1,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Points scattered over a floor and two walls. On a regular grid nearest pairs would hold each other in false places.
    fn points() -> Vec<Point3<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut at = |high: f64| high * random.random::<f64>();
        let mut points = Vec::new();
        for _ in 0..1500 {
            points.push(Point3::new(at(3.0), at(2.0), 0.0));
            points.push(Point3::new(at(3.0), 0.0, at(1.2)));
            points.push(Point3::new(0.0, at(1.5), at(1.0)));
        }
        points
    }

    #[test]
    fn the_alignment_is_found_and_distances_have_the_unit_of_the_truth() {
        let moved = Similarity3::from_isometry(
            Isometry3::new(
                Vector3::new(0.3, -0.2, 0.1),
                Vector3::new(0.05, -0.03, 0.08),
            ),
            2.0,
        );
        let truth = cloud(points().iter().map(|point| moved * point).collect());
        let (found, report) = align(&points(), &truth, true, None).unwrap();
        assert!(report.is_reliable, "{report:?}");
        assert!((report.scale - 2.0).abs() < 1e-3, "{report:?}");
        for point in points().iter().step_by(97) {
            assert!((found * point - moved * point).norm() < 5e-3);
        }
        let truth = Truth::new(truth, &moved);
        assert!(!truth.is_mesh());
        // Half a unit below a point of the floor in the frame of the poses is one of the ground truth.
        let below = points()[0] - Vector3::new(0.0, 0.0, 0.5);
        assert!((truth.distance(&below).unwrap() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_rigid_alignment_keeps_the_scale() {
        let moved = Isometry3::new(Vector3::new(0.2, 0.1, 0.0), Vector3::new(0.0, 0.0, 0.05));
        let truth = cloud(points().iter().map(|point| moved * point).collect());
        let (_, report) = align(&points(), &truth, false, None).unwrap();
        assert_eq!(report.scale, 1.0);
        assert!(report.rms < 5e-3, "{report:?}");
        assert!(align(&[], &truth, false, None).is_err());
    }

    #[test]
    fn points_of_colmap_as_text_and_binary() {
        let text = b"# points\n\n7 1.5 -2 3e-1 0 0 0 0.4 1 2\n8 0 0 1 0 0 0 0.1\n";
        let points = points_of_text(text, "p").unwrap();
        assert_eq!(points[0], Point3::new(1.5, -2.0, 0.3));
        for bad in ["x 1 2 3", "1 2 3", "1 nan 2 3"] {
            let error = points_of_text(format!("# a\n{bad}\n").as_bytes(), "p").unwrap_err();
            assert!(error.to_string().contains("line 2"), "{error}");
        }
        let mut binary = 2_u64.to_le_bytes().to_vec();
        for point in &points {
            binary.extend(9_u64.to_le_bytes());
            binary.extend(point.iter().flat_map(|value| value.to_le_bytes()));
            binary.extend([1, 2, 3]);
            binary.extend(0.5_f64.to_le_bytes());
            binary.extend(1_u64.to_le_bytes());
            binary.extend([0; 8]);
        }
        assert_eq!(points_of_binary(&binary, "p").unwrap(), points);
        for end in [0, 7, 8, 40, binary.len() - 1] {
            assert!(points_of_binary(&binary[..end], "p").is_err(), "{end}");
        }
    }
}
