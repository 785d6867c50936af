//! The part of a shape that keyframes observed.
//!
//! A closed carved surface also spans space that no camera has seen and that the ground truth does not cover. The
//! shape is divided into pieces. A piece is observed if its centre lies in front of, or slightly behind, the measured
//! surface of some depth image. Wrong surfaces in observed free space therefore remain and reduce accuracy.

use linecarve_lines::camera::Camera;
use linecarve_lines::image::Plane;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::{Shape, ShapeKind};

/// Maximum number of pieces.
const MAX_PIECES: usize = 100_000_000;

/// Criteria for an observed piece, in units of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ObservedShapeOptions {
    /// Maximum depth that is used.
    pub max_depth: f64,
    /// Maximum distance of a piece behind the measured surface.
    pub max_distance_behind: f64,
    /// Maximum edge length of a piece.
    pub max_edge_length: f64,
}

impl ObservedShapeOptions {
    /// Defaults for a scene of the given median depth: 2.5 times that depth, a tenth of it behind the surface,
    /// pieces of a fifth of that tenth.
    pub fn at_depth(median_depth: f64) -> Self {
        Self {
            max_depth: 2.5 * median_depth,
            max_distance_behind: 0.1 * median_depth,
            max_edge_length: 0.02 * median_depth,
        }
    }
}

/// Why a shape cannot be cut into pieces.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ObservedShapeError {
    /// An option is not a positive length.
    #[error("the limits of what counts as observed must be positive lengths, not {0}")]
    Options(f64),
    /// There would be too many pieces.
    #[error(
        "edges of {edge} would divide the shape into more than {MAX_PIECES} pieces: allow longer ones"
    )]
    Pieces {
        /// The longest edge allowed.
        edge: f64,
    },
}

/// Accumulates observations view by view.
pub struct ObservedShapeBuilder {
    options: ObservedShapeOptions,
    /// Corners of the pieces: three for a triangle, two for a line (the last repeated), one for a point
    /// (repeated).
    pieces: Vec<[Point3<f64>; 3]>,
    is_seen: Vec<bool>,
    vertices: Vec<Point3<f64>>,
    is_vertex_seen: Vec<bool>,
    kind: ShapeKind,
    /// Total area, length or number of points.
    total: f64,
    keyframes: usize,
}

/// The observed part of a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedShape {
    /// The observed pieces.
    pub shape: Shape,
    /// Whether each vertex of the original shape was observed.
    pub vertices: Vec<bool>,
    /// Observed share of the area (for lines: length; for clouds: points).
    pub share: f64,
    /// Number of views.
    pub keyframes: usize,
}

impl ObservedShapeBuilder {
    /// Divides a shape into pieces. Parts out of reach of cameras at `camera_centers` are not divided; they count as
    /// unobserved.
    ///
    /// # Errors
    /// When an option is out of range or there would be too many pieces.
    pub fn new(
        shape: &Shape,
        camera_centers: &[Point3<f64>],
        options: &ObservedShapeOptions,
    ) -> Result<Self, ObservedShapeError> {
        for length in [
            options.max_depth,
            options.max_distance_behind,
            options.max_edge_length,
        ] {
            if !(length > 0.0 && length.is_finite()) {
                return Err(ObservedShapeError::Options(length));
            }
        }
        let reach = options.max_depth + options.max_distance_behind;
        let mut cutter = Cutter {
            low: Point3::from(
                camera_centers
                    .iter()
                    .fold([f64::INFINITY; 3].into(), inf)
                    .coords
                    .add_scalar(-reach),
            ),
            high: Point3::from(
                camera_centers
                    .iter()
                    .fold([f64::NEG_INFINITY; 3].into(), sup)
                    .coords
                    .add_scalar(reach),
            ),
            edge: options.max_edge_length,
            pieces: Vec::new(),
        };
        let at = |index: u32| shape.positions[index as usize];
        let kind = shape.kind();
        let mut total = 0.0;
        match kind {
            ShapeKind::Mesh => {
                for triangle in &shape.triangles {
                    let corners = triangle.map(at);
                    total += weight(kind, &corners);
                    cutter.cut(corners)?;
                }
            }
            ShapeKind::Lines => {
                for [a, b] in &shape.lines {
                    let corners = [at(*a), at(*b), at(*b)];
                    total += weight(kind, &corners);
                    cutter.cut(corners)?;
                }
            }
            ShapeKind::Cloud | ShapeKind::Empty => {
                for point in &shape.positions {
                    total += 1.0;
                    cutter.cut([*point; 3])?;
                }
            }
        }
        Ok(Self {
            options: *options,
            is_seen: vec![false; cutter.pieces.len()],
            pieces: cutter.pieces,
            is_vertex_seen: vec![false; shape.positions.len()],
            vertices: shape.positions.clone(),
            kind,
            total,
            keyframes: 0,
        })
    }

    /// Adds a view; `depth` is z in units of the poses, not positive where unknown.
    pub fn add_view(
        &mut self,
        camera: &Camera,
        world_from_camera: &Isometry3<f64>,
        depth: &Plane<f32>,
    ) {
        let view = DepthView {
            camera,
            camera_from_world: world_from_camera.inverse(),
            depth,
            options: &self.options,
        };
        self.keyframes += 1;
        self.is_seen
            .par_iter_mut()
            .zip(&self.pieces)
            .with_min_len(1024)
            .for_each(|(is_seen, [a, b, c])| {
                *is_seen = *is_seen
                    || view.sees(&match self.kind {
                        ShapeKind::Lines => nalgebra::center(a, b),
                        _ => Point3::from((a.coords + b.coords + c.coords) / 3.0),
                    });
            });
        self.is_vertex_seen
            .par_iter_mut()
            .zip(&self.vertices)
            .with_min_len(1024)
            .for_each(|(is_seen, vertex)| *is_seen = *is_seen || view.sees(vertex));
    }

    /// The part observed by all views together.
    pub fn finish(self) -> ObservedShape {
        let mut shape = Shape::default();
        let mut seen = 0.0;
        for (corners, _) in self.pieces.iter().zip(&self.is_seen).filter(|(_, s)| **s) {
            seen += weight(self.kind, corners);
            let first = shape.positions.len() as u32;
            match self.kind {
                ShapeKind::Mesh => {
                    shape.positions.extend(corners);
                    shape.triangles.push([first, first + 1, first + 2]);
                }
                ShapeKind::Lines => {
                    shape.positions.extend(&corners[..2]);
                    shape.lines.push([first, first + 1]);
                }
                ShapeKind::Cloud | ShapeKind::Empty => shape.positions.push(corners[0]),
            }
        }
        ObservedShape {
            shape,
            vertices: self.is_vertex_seen,
            share: if self.total > 0.0 {
                seen / self.total
            } else {
                0.0
            },
            keyframes: self.keyframes,
        }
    }
}

fn inf(low: Point3<f64>, point: &Point3<f64>) -> Point3<f64> {
    low.inf(point)
}

fn sup(high: Point3<f64>, point: &Point3<f64>) -> Point3<f64> {
    high.sup(point)
}

/// Area, length or number of points.
fn weight(kind: ShapeKind, [a, b, c]: &[Point3<f64>; 3]) -> f64 {
    match kind {
        ShapeKind::Mesh => 0.5 * (b - a).cross(&(c - a)).norm(),
        ShapeKind::Lines => (b - a).norm(),
        ShapeKind::Cloud | ShapeKind::Empty => 1.0,
    }
}

struct DepthView<'a> {
    camera: &'a Camera,
    camera_from_world: Isometry3<f64>,
    depth: &'a Plane<f32>,
    options: &'a ObservedShapeOptions,
}

impl DepthView<'_> {
    fn sees(&self, point: &Point3<f64>) -> bool {
        let in_camera = self.camera_from_world * point;
        if in_camera.z <= 0.0
            || in_camera.z >= self.options.max_depth + self.options.max_distance_behind
        {
            return false;
        }
        let Some(pixel) = self.camera.project(&in_camera) else {
            return false;
        };
        let (x, y) = (pixel.x.round(), pixel.y.round());
        let (width, height) = (self.depth.width(), self.depth.height());
        if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64) {
            return false;
        }
        let depth = f64::from(self.depth.samples()[y as usize * width + x as usize]);
        depth > 0.0
            && depth <= self.options.max_depth
            && in_camera.z < depth + self.options.max_distance_behind
    }
}

/// Bisects triangles at their longest edge.
struct Cutter {
    low: Point3<f64>,
    high: Point3<f64>,
    edge: f64,
    pieces: Vec<[Point3<f64>; 3]>,
}

impl Cutter {
    fn cut(&mut self, whole: [Point3<f64>; 3]) -> Result<(), ObservedShapeError> {
        let mut open = vec![whole];
        while let Some([a, b, c]) = open.pop() {
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            if (0..3).any(|axis| high[axis] < self.low[axis] || low[axis] > self.high[axis]) {
                continue;
            }
            let lengths = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
            let longest = (0..3).fold(0, |best, at| {
                if lengths[at] > lengths[best] {
                    at
                } else {
                    best
                }
            });
            if lengths[longest] <= self.edge {
                if self.pieces.len() == MAX_PIECES {
                    return Err(ObservedShapeError::Pieces { edge: self.edge });
                }
                self.pieces.push([a, b, c]);
                continue;
            }
            // Rotates the longest edge to the front. A line is a triangle with a repeated last corner;
            // its halves are lines.
            let [p, q, r] = match longest {
                0 => [a, b, c],
                1 => [b, c, a],
                _ => [c, a, b],
            };
            let middle = nalgebra::center(&p, &q);
            if c == b {
                open.extend([
                    [a, middle_of(a, b), middle_of(a, b)],
                    [middle_of(a, b), b, b],
                ]);
            } else {
                open.extend([[p, middle, r], [middle, q, r]]);
            }
        }
        Ok(())
    }
}

fn middle_of(a: Point3<f64>, b: Point3<f64>) -> Point3<f64> {
    nalgebra::center(&a, &b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at the origin that looks at a wall at z = 2, its right half unknown.
    fn look_at_wall(shape: &Shape) -> ObservedShape {
        let camera = Camera::pinhole(50.0, 50.0, 49.5, 49.5).unwrap();
        let samples = (0..100 * 100)
            .map(|i| if i % 100 < 50 { 2.0 } else { 0.0 })
            .collect();
        let depth = Plane::new(100, 100, samples).unwrap();
        let options = ObservedShapeOptions {
            max_depth: 4.0,
            max_distance_behind: 0.2,
            max_edge_length: 0.02,
        };
        let camera_centers = [Point3::origin()];
        let mut observer = ObservedShapeBuilder::new(shape, &camera_centers, &options).unwrap();
        observer.add_view(&camera, &Isometry3::identity(), &depth);
        observer.finish()
    }

    fn square(z: f64) -> Shape {
        Shape {
            positions: [
                [-1.0, -1.0, z],
                [1.0, -1.0, z],
                [1.0, 1.0, z],
                [-1.0, 1.0, z],
            ]
            .map(Point3::from)
            .to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Shape::default()
        }
    }

    #[test]
    fn what_lies_in_front_or_shortly_behind_counts_where_depth_is_known() {
        for (z, expected) in [
            (1.9, 0.5),
            (2.1, 0.5),
            (2.3, 0.0),
            (-2.0, 0.0),
            (100.0, 0.0),
        ] {
            let observed = look_at_wall(&square(z));
            assert!(
                (observed.share - expected).abs() < 0.01,
                "{z}: {}",
                observed.share
            );
            assert!(observed.shape.positions.iter().all(|p| p.x < 0.03));
            assert_eq!(observed.vertices[0], expected > 0.0);
            assert!(!observed.vertices[1]);
            assert_eq!(observed.shape.validate(), Ok(()));
        }
    }

    #[test]
    fn lines_and_clouds_are_cut_likewise() {
        let lines = Shape {
            positions: vec![Point3::new(-1.0, 0.0, 2.0), Point3::new(1.0, 0.0, 2.0)],
            lines: vec![[0, 1]],
            ..Shape::default()
        };
        let observed = look_at_wall(&lines);
        assert!((observed.share - 0.5).abs() < 0.02, "{}", observed.share);
        assert_eq!(observed.shape.kind(), ShapeKind::Lines);
        let cloud = Shape {
            lines: Vec::new(),
            ..lines
        };
        let observed = look_at_wall(&cloud);
        assert_eq!(observed.share, 0.5);
        assert_eq!(observed.shape.positions.len(), 1);
        assert_eq!(look_at_wall(&Shape::default()).share, 0.0);
    }

    #[test]
    fn limits_must_be_lengths() {
        let options = ObservedShapeOptions {
            max_edge_length: 0.0,
            ..ObservedShapeOptions::at_depth(2.0)
        };
        assert!(ObservedShapeBuilder::new(&square(2.0), &[Point3::origin()], &options).is_err());
    }
}
