//! Classification of mesh edges.

use nalgebra::{Point3, Vector3};

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
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Use {
    /// The higher position; uses are listed by the lower one.
    high: u32,
    triangle: u32,
    /// The corner from which the edge runs in the triangle.
    from: u32,
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
        let (begins, mut uses) = uses(mesh, &unique);
        let mut ends_by_position = Vec::new();
        let mut edges = Vec::new();
        let mut sides = Vec::new();
        for (low, bounds) in (0_u32..).zip(begins.windows(2)) {
            let at_low = &mut uses[bounds[0] as usize..bounds[1] as usize];
            at_low.sort_unstable();
            for at_edge in at_low.chunk_by(|a, b| a.high == b.high) {
                sides.clear();
                sides.extend(at_edge.iter().filter_map(|at| {
                    let corners = &mesh.triangles[at.triangle as usize];
                    Some(Side {
                        doubled_area: doubled_area(mesh, corners)?,
                        is_forward: unique.of(corners[at.from as usize]) == low,
                    })
                }));
                let first = &at_edge[0];
                let corners = mesh.triangles[first.triangle as usize];
                let mut ends = [0, 1].map(|k| corners[(first.from as usize + k) % 3]);
                if unique.of(ends[0]) != low {
                    ends.reverse();
                }
                let [p, q] = ends.map(|vertex| mesh.positions[vertex as usize]);
                if let Some(kind) = kind(&mut sides, [&p, &q], &known, options) {
                    ends_by_position.push([low, first.high]);
                    edges.push(FeatureEdge { ends, kind });
                }
            }
        }
        Ok(Self {
            unique,
            ends_by_position,
            edges,
        })
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

/// All triangles at all edges: for each position where its uses begin, and the uses by their lower position.
fn uses(mesh: &TriangleMesh, unique: &UniquePositions) -> (Vec<u32>, Vec<Use>) {
    let valid = || {
        (0_u32..)
            .zip(&mesh.triangles)
            .filter_map(|(triangle, corners)| {
                let doubled_area = doubled_area(mesh, corners)?;
                let at = corners.map(|corner| unique.of(corner));
                let is_valid = doubled_area.iter().all(|v| v.is_finite())
                    && (0..3).all(|k| at[k] != at[(k + 1) % 3]);
                is_valid.then_some((triangle, at))
            })
    };
    let mut begins = vec![0; unique.len() + 1];
    for (_, at) in valid() {
        for k in 0..3 {
            begins[at[k].min(at[(k + 1) % 3]) as usize + 1] += 1;
        }
    }
    for position in 1..begins.len() {
        begins[position] += begins[position - 1];
    }
    let mut places = begins.clone();
    let total = begins.last().copied().unwrap_or(0);
    let mut uses = vec![Use::default(); total as usize];
    for (triangle, at) in valid() {
        for k in 0..3 {
            let (p, q) = (at[k], at[(k + 1) % 3]);
            let place = &mut places[p.min(q) as usize];
            uses[*place as usize] = Use {
                high: p.max(q),
                triangle,
                from: k as u32,
            };
            *place += 1;
        }
    }
    (begins, uses)
}

/// Twice the area of a triangle along its normal; `None` for corners that do not exist.
fn doubled_area(mesh: &TriangleMesh, corners: &[u32; 3]) -> Option<Vector3<f64>> {
    let [a, b, c] = corners.map(|corner| mesh.positions.get(corner as usize));
    let (a, b, c) = (a?, b?, c?);
    Some((b - a).cross(&(c - a)))
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
