//! Triangle meshes and line sets.

use nalgebra::{Point3, Vector3};

/// A triangle mesh. Frame and unit are those of the poses. Triangles are counter-clockwise as seen from free space.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub positions: Vec<Point3<f64>>,
    /// Indices into `positions`, three per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// sRGB colour of each vertex, if known.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// A set of straight line segments.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LineSet {
    /// End points.
    pub points: Vec<Point3<f64>>,
    /// Indices into `points`, two per line.
    pub lines: Vec<[u32; 2]>,
    /// sRGB colour of each point, if known.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// Why a mesh or line set is not valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A coordinate is infinite or not a number.
    #[error("vertex {index} is not finite: {position:?}")]
    NotFinite {
        /// Index of the vertex, from 0.
        index: usize,
        /// Its coordinates.
        position: [f64; 3],
    },
    /// An element refers to a vertex that does not exist.
    #[error("element {element} refers to vertex {vertex}, but there are {count}")]
    OutOfRange {
        /// Index of the triangle or line, from 0.
        element: usize,
        /// The vertex index.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// The numbers of colours and vertices differ.
    #[error("{colors} colours for {vertices} vertices")]
    Colors {
        /// Number of colours.
        colors: usize,
        /// Number of vertices.
        vertices: usize,
    },
}

impl TriangleMesh {
    /// Whether the mesh has no triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Checks that coordinates are finite and indices in range.
    ///
    /// # Errors
    /// The first fault.
    pub fn validate(&self) -> Result<(), GeometryError> {
        validate(&self.positions, &self.triangles, self.colors.as_deref())
    }

    /// Length of the bounding box diagonal of the vertices; 0 without vertices.
    pub fn diagonal(&self) -> f64 {
        diagonal(&self.positions)
    }

    /// Translates every vertex.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        for position in &mut self.positions {
            *position += shift;
        }
    }
}

impl LineSet {
    /// Smallest and largest coordinates; `None` without points.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        bounds(&self.points)
    }

    /// A line set of separate segments with two points each.
    pub fn from_segments(segments: impl IntoIterator<Item = [Point3<f64>; 2]>) -> Self {
        let points: Vec<_> = segments.into_iter().flatten().collect();
        let lines = (0..points.len() as u32 / 2)
            .map(|line| [2 * line, 2 * line + 1])
            .collect();
        Self {
            points,
            lines,
            colors: None,
        }
    }

    /// Whether the set has no lines.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Checks that coordinates are finite and indices in range.
    ///
    /// # Errors
    /// The first fault.
    pub fn validate(&self) -> Result<(), GeometryError> {
        validate(&self.points, &self.lines, self.colors.as_deref())
    }

    /// Translates every point.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        for point in &mut self.points {
            *point += shift;
        }
    }
}

/// Whether coordinates are finite, in single precision as well.
pub(super) fn is_storable(point: &Point3<f64>) -> bool {
    // False for NaN; larger values would overflow `f32`.
    point.iter().all(|it| it.abs() <= f64::from(f32::MAX))
}

pub(super) fn validate<const N: usize>(
    points: &[Point3<f64>],
    elements: &[[u32; N]],
    colors: Option<&[[u8; 3]]>,
) -> Result<(), GeometryError> {
    let count = points.len();
    for (index, point) in points.iter().enumerate() {
        if !is_storable(point) {
            let position = point.coords.into();
            return Err(GeometryError::NotFinite { index, position });
        }
    }
    validate_indices(count, elements)?;
    match colors {
        Some(colors) if colors.len() != count => Err(GeometryError::Colors {
            colors: colors.len(),
            vertices: count,
        }),
        _ => Ok(()),
    }
}

/// Checks that every element refers to one of `count` vertices.
pub(super) fn validate_indices<const N: usize>(
    count: usize,
    elements: &[[u32; N]],
) -> Result<(), GeometryError> {
    for (element, vertices) in elements.iter().enumerate() {
        if let Some(&vertex) = vertices.iter().find(|vertex| **vertex as usize >= count) {
            return Err(GeometryError::OutOfRange {
                element,
                vertex,
                count,
            });
        }
    }
    Ok(())
}

/// Smallest and largest coordinates; `None` without points.
pub(super) fn bounds(points: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *points.first()?;
    Some(points.iter().fold((first, first), |(low, high), point| {
        (low.inf(point), high.sup(point))
    }))
}

/// Length of the bounding box diagonal; 0 without points.
pub(super) fn diagonal(points: &[Point3<f64>]) -> f64 {
    bounds(points).map_or(0.0, |(low, high)| (high - low).norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_found_with_their_place() {
        let mut mesh = TriangleMesh {
            positions: vec![Point3::origin(); 3],
            triangles: vec![[0, 1, 2]],
            colors: None,
        };
        assert_eq!(mesh.validate(), Ok(()));
        mesh.triangles.push([0, 1, 3]);
        assert_eq!(
            mesh.validate(),
            Err(GeometryError::OutOfRange {
                element: 1,
                vertex: 3,
                count: 3
            })
        );
        mesh.triangles.pop();
        mesh.colors = Some(vec![[0; 3]; 2]);
        assert_eq!(
            mesh.validate(),
            Err(GeometryError::Colors {
                colors: 2,
                vertices: 3
            })
        );
        mesh.colors = None;
        mesh.positions[1].y = f64::NAN;
        assert!(matches!(
            mesh.validate(),
            Err(GeometryError::NotFinite { index: 1, .. })
        ));
        mesh.positions[1].y = 1e300;
        assert!(mesh.validate().is_err());
    }

    #[test]
    fn segments_become_two_points_and_one_line_each() {
        let set = LineSet::from_segments([
            [Point3::origin(), Point3::new(1.0, 0.0, 0.0)],
            [Point3::origin(), Point3::new(0.0, 1.0, 0.0)],
        ]);
        assert_eq!(set.lines, [[0, 1], [2, 3]]);
        assert_eq!(set.points.len(), 4);
    }
}
