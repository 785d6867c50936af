//! Content of a geometry file in any format.

use nalgebra::{Matrix4, Point3};

use super::types::{
    GeometryError, LineSet, TriangleMesh, bounds, diagonal, validate, validate_indices,
};

/// Kind of a [`Shape`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeKind {
    /// Triangles, and perhaps lines.
    Mesh,
    /// Lines without triangles.
    Lines,
    /// Points only.
    Cloud,
    /// Nothing.
    Empty,
}

/// Points, and triangles and lines between them: the common form of meshes, line sets and point clouds.
///
/// Frame and unit are those of the file; for glTF written by this program, those of the poses.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shape {
    /// Points in file order, including those without elements.
    pub positions: Vec<Point3<f64>>,
    /// Indices into `positions`, three per triangle. Polygons are triangulated, convex ones as fans.
    pub triangles: Vec<[u32; 3]>,
    /// Indices into `positions`, two per line. Polylines are split.
    pub lines: Vec<[u32; 2]>,
    /// sRGB colour of each point, if the file has colours.
    pub colors: Option<Vec<[u8; 3]>>,
}

impl Shape {
    /// Kind of the shape.
    pub fn kind(&self) -> ShapeKind {
        if !self.triangles.is_empty() {
            ShapeKind::Mesh
        } else if !self.lines.is_empty() {
            ShapeKind::Lines
        } else if !self.positions.is_empty() {
            ShapeKind::Cloud
        } else {
            ShapeKind::Empty
        }
    }

    /// Smallest and largest coordinates; `None` without points.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        bounds(&self.positions)
    }

    /// Length of the bounding box diagonal; 0 without points.
    pub fn diagonal(&self) -> f64 {
        diagonal(&self.positions)
    }

    /// Applies an affine transform to every point.
    pub fn transform(&mut self, target_from_shape: &Matrix4<f64>) {
        for position in &mut self.positions {
            *position = target_from_shape.transform_point(position);
        }
    }

    /// Converts to a mesh without lines.
    pub fn into_mesh(self) -> TriangleMesh {
        TriangleMesh {
            positions: self.positions,
            triangles: self.triangles,
            colors: self.colors,
        }
    }

    /// Converts to a line set without triangles.
    pub fn into_lines(self) -> LineSet {
        LineSet {
            points: self.positions,
            lines: self.lines,
            colors: self.colors,
        }
    }

    /// Checks that coordinates are finite and indices in range.
    ///
    /// # Errors
    /// The first non-finite point, the first index out of range, or a wrong number of colours.
    pub fn validate(&self) -> Result<(), GeometryError> {
        validate(&self.positions, &self.triangles, self.colors.as_deref())?;
        validate_indices(self.positions.len(), &self.lines)
    }

    /// Appends another shape. Colours are kept if both shapes have them or the other has no points.
    pub fn append(&mut self, other: Self) {
        let first = self.positions.len() as u32;
        self.colors = match (self.colors.take(), other.colors) {
            (Some(mut own), Some(more)) => {
                own.extend(more);
                Some(own)
            }
            (None, Some(more)) if self.positions.is_empty() => Some(more),
            (Some(own), None) if other.positions.is_empty() => Some(own),
            _ => None,
        };
        self.positions.extend(other.positions);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|i| first + i)));
        self.lines
            .extend(other.lines.iter().map(|l| l.map(|i| first + i)));
    }
}

impl From<TriangleMesh> for Shape {
    fn from(mesh: TriangleMesh) -> Self {
        Self {
            positions: mesh.positions,
            triangles: mesh.triangles,
            lines: Vec::new(),
            colors: mesh.colors,
        }
    }
}

impl From<LineSet> for Shape {
    fn from(set: LineSet) -> Self {
        Self {
            positions: set.points,
            triangles: Vec::new(),
            lines: set.lines,
            colors: set.colors,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elements_decide_the_kind() {
        let mut shape = Shape::default();
        assert_eq!(shape.kind(), ShapeKind::Empty);
        assert_eq!(shape.diagonal(), 0.0);
        shape.positions = vec![Point3::origin(), Point3::new(3.0, 4.0, 0.0)];
        assert_eq!(shape.kind(), ShapeKind::Cloud);
        assert_eq!(shape.diagonal(), 5.0);
        shape.lines.push([0, 1]);
        assert_eq!(shape.kind(), ShapeKind::Lines);
        shape.triangles.push([0, 1, 1]);
        assert_eq!(shape.kind(), ShapeKind::Mesh);
        assert_eq!(shape.validate(), Ok(()));
        shape.lines.push([0, 2]);
        assert!(shape.validate().is_err());
    }

    #[test]
    fn appended_elements_name_their_own_points() {
        let part = Shape {
            positions: vec![Point3::origin(); 3],
            triangles: vec![[0, 1, 2]],
            lines: vec![[1, 2]],
            colors: Some(vec![[1; 3]; 3]),
        };
        let mut whole = Shape::default();
        whole.append(part.clone());
        assert_eq!(whole, part);
        whole.append(part);
        assert_eq!(whole.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(whole.lines, [[1, 2], [4, 5]]);
        assert_eq!(whole.colors.as_ref().map(Vec::len), Some(6));
        whole.append(Shape {
            positions: vec![Point3::origin()],
            ..Shape::default()
        });
        assert_eq!(whole.colors, None);
        assert_eq!(whole.validate(), Ok(()));
    }
}
