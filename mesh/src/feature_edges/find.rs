//! The kinds of the edges of a mesh.

use nalgebra::Point3;

use super::known_lines::KnownLines;
use super::options::{FeatureOptions, FeatureOptionsError};
use super::places::Places;
use super::turn::{Side, turn};
use crate::TriangleMesh;

/// Why an edge of a mesh is an edge of the scene, the strongest reason first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EdgeKind {
    /// The surface turns there, along a known line or not.
    Crease,
    /// It runs along a known line, with a turn that is no crease, or as a rim.
    AlongLine,
    /// The surface ends there, along no known line.
    Boundary,
}

/// An edge of a mesh that is an edge of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeatureEdge {
    /// The vertices at its ends, which a triangle joins. Where other vertices lie at the same places, one pair stands for all.
    pub ends: [u32; 2],
    /// Why it is one.
    pub kind: EdgeKind,
}

/// The edges of a mesh that are edges of the scene, each once.
pub struct FeatureEdges {
    places: Places,
    /// Ascending.
    ends_by_place: Vec<[u32; 2]>,
    /// As long as `ends_by_place`.
    edges: Vec<FeatureEdge>,
}

/// A triangle at an edge between two places.
struct Use {
    /// The lower place first.
    ends: [u32; 2],
    triangle: u32,
    vertices: [u32; 2],
    side: Side,
}

impl FeatureEdges {
    /// Finds them, by place: triangles meet in an edge where their corners have equal coordinates, whether they share vertices or not.
    ///
    /// `lines` are those that are known, by their ends, in the frame of the mesh. Triangles that name a vertex which is not there
    /// or not finite, or two corners at one place, count as if they were not there, and so do lines that are not finite.
    ///
    /// # Errors
    /// When an option is out of range.
    ///
    /// # Complexity
    /// O(n log n) for n triangles and lines, as long as few lines lie beside each other.
    pub fn find(
        mesh: &TriangleMesh,
        lines: &[[Point3<f64>; 2]],
        options: &FeatureOptions,
    ) -> Result<Self, FeatureOptionsError> {
        options.validate()?;
        let places = Places::new(&mesh.positions);
        let known = KnownLines::new(lines, options.line_distance);
        let mut uses = uses(mesh, &places);
        uses.sort_unstable_by_key(|at| (at.ends, at.triangle));
        let mut found = Self {
            places,
            ends_by_place: Vec::new(),
            edges: Vec::new(),
        };
        let mut sides = Vec::new();
        for at_edge in uses.chunk_by(|a, b| a.ends == b.ends) {
            sides.clear();
            sides.extend(at_edge.iter().map(|at| at.side));
            let vertices = at_edge[0].vertices;
            let [p, q] = vertices.map(|vertex| mesh.positions[vertex as usize]);
            if let Some(kind) = kind(&mut sides, [&p, &q], &known, options) {
                found.ends_by_place.push(at_edge[0].ends);
                found.edges.push(FeatureEdge {
                    ends: vertices,
                    kind,
                });
            }
        }
        Ok(found)
    }

    /// All of them, in ascending order of the positions of their ends: the lower first, by x, then y, then z.
    pub fn edges(&self) -> &[FeatureEdge] {
        &self.edges
    }

    /// What the edge between the places of two vertices is, `None` when it is none of them.
    ///
    /// # Panics
    /// When the mesh has no such vertices.
    pub fn kind(&self, a: u32, b: u32) -> Option<EdgeKind> {
        let (a, b) = (self.places.of(a), self.places.of(b));
        let index = self.ends_by_place.binary_search(&[a.min(b), a.max(b)]);
        index.ok().map(|index| self.edges[index].kind)
    }
}

/// What stands at each edge, triangle by triangle.
fn uses(mesh: &TriangleMesh, places: &Places) -> Vec<Use> {
    let mut uses = Vec::with_capacity(3 * mesh.triangles.len());
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let [Some(a), Some(b), Some(c)] = corners.map(|c| mesh.positions.get(c as usize)) else {
            continue;
        };
        let doubled_area = (b - a).cross(&(c - a));
        let at = corners.map(|corner| places.of(corner));
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
    let turn = turn(sides, (q - p).norm(), options.min_height);
    if turn >= options.crease_angle_rad {
        Some(EdgeKind::Crease)
    } else if turn >= options.line_crease_angle_rad && known.run_along(p, q) {
        Some(EdgeKind::AlongLine)
    } else {
        None
    }
}

#[cfg(test)]
mod tests;
