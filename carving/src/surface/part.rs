//! Parts of triangles: what is exported where a surface ends inside a triangle.

use nalgebra::Point3;

/// A part of a triangle: the triangles between a point inside it and some of its edges.
///
/// An edge counts only if the triangle across it is exported as a whole. Where [neighbours are not looked
/// for](super::ExportOptions::needs_neighbors), parts are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrianglePart {
    /// Barycentric weights of the point, by corner; their sum is the unit. All are positive.
    pub weights: [u8; 3],
    /// Whether the edge that starts at the corner of the same index is kept; one or two are.
    pub edges: [bool; 3],
}

/// What a vertex of an exported mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VertexOrigin<V> {
    /// A copy of a vertex of the carved surface.
    Vertex(V),
    /// The point inside a triangle of which a part is exported.
    Inside {
        /// Corners of the triangle.
        corners: [V; 3],
        /// What is exported of it.
        part: TrianglePart,
    },
    /// The midpoint of an edge that was split.
    Middle,
}

impl TrianglePart {
    /// The same part of the triangle whose corners begin with what was corner `first`.
    #[must_use]
    pub fn rotated(mut self, first: usize) -> Self {
        self.weights.rotate_left(first);
        self.edges.rotate_left(first);
        self
    }

    /// Whether a corner is an end of a kept edge.
    pub fn has_corner(&self, corner: usize) -> bool {
        self.edges[corner] || self.edges[(corner + 2) % 3]
    }

    /// The part beside those edges for which `is_kept`; `None` without any.
    pub(super) fn beside(mut self, is_kept: impl Fn(usize) -> bool) -> Option<Self> {
        for (k, edge) in self.edges.iter_mut().enumerate() {
            *edge &= is_kept(k);
        }
        self.edges.contains(&true).then_some(self)
    }

    /// The point inside. It does not depend on which corner comes first.
    pub fn point(&self, corners: &[Point3<f64>; 3]) -> Point3<f64> {
        let order = |a: &usize, b: &usize| {
            let pairs = corners[*a].iter().zip(corners[*b].iter());
            let orders = pairs.map(|(a, b)| a.total_cmp(b));
            orders.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        };
        let first = (0..3).min_by(order).unwrap_or(0);
        let unit = self
            .weights
            .iter()
            .map(|weight| f64::from(*weight))
            .sum::<f64>();
        let weighted = |k: usize| corners[k].coords * (f64::from(self.weights[k]) / unit);
        let at = [first, (first + 1) % 3, (first + 2) % 3].map(weighted);
        Point3::from(at[0] + at[1] + at[2])
    }
}

impl<V> VertexOrigin<V> {
    /// The vertex of the carved surface that it copies.
    pub fn vertex(self) -> Option<V> {
        match self {
            Self::Vertex(vertex) => Some(vertex),
            Self::Inside { .. } | Self::Middle => None,
        }
    }

    /// The same with other names for vertices.
    pub fn map<W>(self, name: impl Fn(V) -> W) -> VertexOrigin<W> {
        match self {
            Self::Vertex(vertex) => VertexOrigin::Vertex(name(vertex)),
            Self::Inside { corners, part } => VertexOrigin::Inside {
                corners: corners.map(name),
                part,
            },
            Self::Middle => VertexOrigin::Middle,
        }
    }
}
