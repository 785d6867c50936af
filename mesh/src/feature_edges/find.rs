//! Classification of mesh edges.

use nalgebra::Point3;

use super::dihedral::{Side, dihedral_angle};
use super::known_lines::KnownLines;
use super::options::{FeatureOptions, FeatureOptionsError};
use super::unique_positions::UniquePositions;
use crate::TriangleMesh;

/// Kind of a feature edge, the strongest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EdgeKind {
    /// The surface bends by at least the crease angle.
    Crease,
    /// The edge follows a known line, below the crease angle or at a boundary.
    AlongLine,
    /// The surface ends at the edge, which follows no known line.
    Boundary,
}

/// A mesh edge that is an edge of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeatureEdge {
    /// The two vertices. Where several vertices have the same position, one pair represents all.
    pub ends: [u32; 2],
    /// Its kind.
    pub kind: EdgeKind,
}

/// The feature edges of a mesh, each once.
pub struct FeatureEdges {
    unique: UniquePositions,
    /// Ascending.
    ends_by_position: Vec<[u32; 2]>,
    /// Parallel to `ends_by_position`.
    edges: Vec<FeatureEdge>,
}

/// A triangle at an edge between two positions.
struct Use {
    /// Positions in ascending order.
    ends: [u32; 2],
    triangle: u32,
    vertices: [u32; 2],
    side: Side,
}

impl FeatureEdges {
    /// Finds the feature edges. Triangles share an edge where their corners have equal coordinates, whether they
    /// share vertices or not.
    ///
    /// `lines` are the ends of known lines in the frame of the mesh. Triangles with invalid, non-finite or
    /// coinciding corners are ignored, and so are lines that are not finite.
    ///
    /// # Errors
    /// When an option is out of range.
    ///
    /// # Complexity
    /// O(n log n) for n triangles and lines, as long as few lines are close to each other.
    pub fn find(
        mesh: &TriangleMesh,
        lines: &[[Point3<f64>; 2]],
        options: &FeatureOptions,
    ) -> Result<Self, FeatureOptionsError> {
        options.validate()?;
        let unique = UniquePositions::new(&mesh.positions);
        let known = KnownLines::new(lines, options.line_distance);
        let mut uses = uses(mesh, &unique);
        uses.sort_unstable_by_key(|at| (at.ends, at.triangle));
        let mut found = Self {
            unique,
            ends_by_position: Vec::new(),
            edges: Vec::new(),
        };
        let mut sides = Vec::new();
        for at_edge in uses.chunk_by(|a, b| a.ends == b.ends) {
            sides.clear();
            sides.extend(at_edge.iter().map(|at| at.side));
            let vertices = at_edge[0].vertices;
            let [p, q] = vertices.map(|vertex| mesh.positions[vertex as usize]);
            if let Some(kind) = kind(&mut sides, [&p, &q], &known, options) {
                found.ends_by_position.push(at_edge[0].ends);
                found.edges.push(FeatureEdge {
                    ends: vertices,
                    kind,
                });
            }
        }
        Ok(found)
    }

    /// All feature edges, ordered by the positions of their ends: the lower end first, by x, then y, then z.
    pub fn edges(&self) -> &[FeatureEdge] {
        &self.edges
    }

    /// Kind of the edge between the positions of two vertices; `None` when it is no feature edge.
    ///
    /// # Panics
    /// When a vertex index is out of range.
    pub fn kind(&self, a: u32, b: u32) -> Option<EdgeKind> {
        let (a, b) = (self.unique.of(a), self.unique.of(b));
        let index = self.ends_by_position.binary_search(&[a.min(b), a.max(b)]);
        index.ok().map(|index| self.edges[index].kind)
    }
}

/// All triangles at all edges.
fn uses(mesh: &TriangleMesh, unique: &UniquePositions) -> Vec<Use> {
    let mut uses = Vec::with_capacity(3 * mesh.triangles.len());
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let [Some(a), Some(b), Some(c)] = corners.map(|c| mesh.positions.get(c as usize)) else {
            continue;
        };
        let doubled_area = (b - a).cross(&(c - a));
        let at = corners.map(|corner| unique.of(corner));
        if !doubled_area.iter().all(|v| v.is_finite()) || (0..3).any(|k| at[k] == at[(k + 1) % 3]) {
            continue;
        }
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let is_forward = at[from] < at[to];
            let (low, high) = if is_forward { (from, to) } else { (to, from) };
            uses.push(Use {
                ends: [at[low], at[high]],
                triangle: triangle as u32,
                vertices: [corners[low], corners[high]],
                side: Side {
                    doubled_area,
                    is_forward,
                },
            });
        }
    }
    uses
}

fn kind(
    sides: &mut Vec<Side>,
    [p, q]: [&Point3<f64>; 2],
    known: &KnownLines,
    options: &FeatureOptions,
) -> Option<EdgeKind> {
    if sides.len() == 1 {
        let is_along = known.run_along(p, q);
        return Some(if is_along {
            EdgeKind::AlongLine
        } else {
            EdgeKind::Boundary
        });
    }
    let angle = dihedral_angle(sides, (q - p).norm(), options.min_height);
    if angle >= options.crease_angle_rad {
        Some(EdgeKind::Crease)
    } else if angle >= options.line_crease_angle_rad && known.run_along(p, q) {
        Some(EdgeKind::AlongLine)
    } else {
        None
    }
}

#[cfg(test)]
mod tests;
