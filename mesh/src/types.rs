//! Triangle meshes and line sets.

use nalgebra::{Point3, Vector3};

/// A triangle mesh. Frame and unit are those of the poses; triangles are counter-clockwise seen from the side that is
/// free of matter.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub positions: Vec<Point3<f64>>,
    /// Indices into `positions`, three a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// sRGB colour of each vertex, when known; then as long as `positions`.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// A set of straight lines between points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LineSet {
    /// End points.
    pub points: Vec<Point3<f64>>,
    /// Indices into `points`, two a line.
    pub lines: Vec<[u32; 2]>,
    /// sRGB colour of each point, when known; then as long as `points`.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// What makes a mesh or line set impossible to write.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A coordinate is infinite or not a number.
    #[error("vertex {index} is not finite: {position:?}")]
    NotFinite {
        /// Which vertex, counted from 0.
        index: usize,
        /// Where it lies.
        position: [f64; 3],
    },
    /// An element names a vertex that is not there.
    #[error("element {element} names vertex {vertex}, there are {count}")]
    OutOfRange {
        /// Which triangle or line, counted from 0.
        element: usize,
        /// The vertex that it names.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// Not one colour for each vertex.
    #[error("{colors} colours for {vertices} vertices")]
    Colors {
        /// Number of colours.
        colors: usize,
        /// Number of vertices.
        vertices: usize,
    },
}

impl TriangleMesh {
    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Checks what every writer relies on.
    ///
    /// # Errors
    /// The first fault found.
    pub fn validate(&self) -> Result<(), GeometryError> {
        validate(&self.positions, &self.triangles, self.colors.as_deref())
    }

    /// Length of the diagonal of the bounding box of its vertices; 0 of nothing.
    pub fn diagonal(&self) -> f64 {
        diagonal(&self.positions)
    }

    /// Moves every vertex.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        for position in &mut self.positions {
            *position += shift;
        }
    }
}

impl LineSet {
    /// A line set of separate segments, each with two points of its own.
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

    /// Whether there is no line.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Checks what every writer relies on.
    ///
    /// # Errors
    /// The first fault found.
    pub fn validate(&self) -> Result<(), GeometryError> {
        validate(&self.points, &self.lines, self.colors.as_deref())
    }

    /// Moves every point.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        for point in &mut self.points {
            *point += shift;
        }
    }
}

pub(super) fn validate<const N: usize>(
    points: &[Point3<f64>],
    elements: &[[u32; N]],
    colors: Option<&[[u8; 3]]>,
) -> Result<(), GeometryError> {
    let count = points.len();
    for (index, point) in points.iter().enumerate() {
        // The comparison is false for what is not a number; larger values would become infinite as f32.
        let storable = |coordinate: &f64| coordinate.abs() <= f64::from(f32::MAX);
        if !point.coords.iter().all(storable) {
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

/// That every element names one of `count` vertices.
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

/// Smallest and largest coordinates, `None` of nothing.
pub(super) fn bounds(points: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *points.first()?;
    Some(points.iter().fold((first, first), |(low, high), point| {
        (low.inf(point), high.sup(point))
    }))
}

/// Length of the diagonal of the bounding box; 0 of nothing.
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
