//! Topology of a mesh.

use std::collections::HashMap;

use serde::Serialize;

use crate::Shape;
use crate::disjoint_sets::DisjointSets;

/// Topology of a mesh. Vertices on boundary edges are merged where their coordinates are equal, so that formats that
/// duplicate vertices make no difference; triangles that lose a corner by this do not count. Closed parts that touch
/// stay separate. Non-manifold edges are cut open, and so are vertices where parts only touch: the result is a
/// manifold whose components and handles are counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Topology {
    /// Components connected by edges.
    pub components: usize,
    /// Edges with one triangle.
    pub boundary_edges: usize,
    /// Loops of boundary edges and of edges that were cut open.
    pub boundary_loops: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles have opposite orientations.
    pub inconsistent_edges: usize,
    /// Handles of all components; `None` for surfaces that cannot be oriented, such as a Moebius strip.
    pub genus: Option<u64>,
    /// Triangles without three different corners.
    pub degenerate_triangles: usize,
}

/// An edge of a triangle, from its corner `corner` to the next.
#[derive(Clone, Copy)]
struct Use {
    low: u32,
    high: u32,
    triangle: u32,
    corner: u32,
    is_ascending: bool,
}

impl Use {
    /// The triangle's corners at the lower and the higher vertex.
    fn corners(&self) -> [u32; 2] {
        let (from, to) = (
            3 * self.triangle + self.corner,
            3 * self.triangle + (self.corner + 1) % 3,
        );
        if self.is_ascending {
            [from, to]
        } else {
            [to, from]
        }
    }
}

impl Topology {
    /// Computes the topology of a valid shape.
    ///
    /// # Complexity
    /// O(n log n) for n triangles.
    pub fn new(shape: &Shape) -> Self {
        let welded = welded(shape);
        let triangles: Vec<[u32; 3]> = welded
            .iter()
            .copied()
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let uses = edge_uses(&triangles);
        let mut found = Self {
            degenerate_triangles: welded.len() - triangles.len(),
            ..Self::default()
        };
        let mut pieces = DisjointSets::new(triangles.len());
        // The corners that meet at one vertex of the surface.
        let mut corners = DisjointSets::new(3 * triangles.len());
        let mut edges = 0;
        let mut boundary: Vec<[u32; 2]> = Vec::new();
        for group in uses.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
            match group {
                [a, b] => {
                    edges += 1;
                    pieces.join(a.triangle, b.triangle);
                    let ([a_low, a_high], [b_low, b_high]) = (a.corners(), b.corners());
                    corners.join(a_low, b_low);
                    corners.join(a_high, b_high);
                    if a.is_ascending == b.is_ascending {
                        found.inconsistent_edges += 1;
                    }
                }
                cut => {
                    edges += cut.len();
                    boundary.extend(cut.iter().map(Use::corners));
                    if cut.len() == 1 {
                        found.boundary_edges += 1;
                    } else {
                        found.non_manifold_edges += 1;
                    }
                }
            }
        }
        found.components = pieces.count();
        // Boundary edges with a common vertex belong to one loop.
        let mut loops = DisjointSets::new(3 * triangles.len());
        for edge in &boundary {
            let [a, b] = edge.map(|corner| corners.find(corner));
            loops.join(a, b);
        }
        let mut names: Vec<u32> = boundary
            .iter()
            .map(|edge| {
                let vertex = corners.find(edge[0]);
                loops.find(vertex)
            })
            .collect();
        names.sort_unstable();
        names.dedup();
        found.boundary_loops = names.len();

        // Euler: vertices - edges + faces = 2 components - 2 genus - loops.
        let characteristic = corners.count() as i64 - edges as i64 + triangles.len() as i64;
        let handles = 2 * found.components as i64 - characteristic - found.boundary_loops as i64;
        found.genus = (handles % 2 == 0)
            .then(|| u64::try_from(handles / 2).ok())
            .flatten();
        found
    }
}

/// All triangles at all edges, grouped by edge.
fn edge_uses(triangles: &[[u32; 3]]) -> Vec<Use> {
    let mut uses: Vec<Use> = triangles
        .iter()
        .enumerate()
        .flat_map(|(triangle, corners)| {
            (0..3).map(move |k| {
                let (from, to) = (corners[k], corners[(k + 1) % 3]);
                Use {
                    low: from.min(to),
                    high: from.max(to),
                    triangle: triangle as u32,
                    corner: k as u32,
                    is_ascending: from < to,
                }
            })
        })
        .collect();
    uses.sort_unstable_by_key(|u| (u.low, u.high, u.triangle, u.corner));
    uses
}

/// The triangles after merging vertices on boundary edges that have equal coordinates.
fn welded(shape: &Shape) -> Vec<[u32; 3]> {
    let mut is_open = vec![false; shape.positions.len()];
    for group in edge_uses(&shape.triangles).chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        if let [alone] = group {
            is_open[alone.low as usize] = true;
            is_open[alone.high as usize] = true;
        }
    }
    // Never iterated: hash order cannot reach the output.
    let mut first = HashMap::new();
    let representative: Vec<u32> = shape
        .positions
        .iter()
        .zip(is_open)
        .enumerate()
        .map(|(index, (p, is_open))| {
            if !is_open {
                return index as u32;
            }
            // Adding zero turns -0 into 0.
            let key = [p.x, p.y, p.z].map(|value| (value + 0.0).to_bits());
            *first.entry(key).or_insert(index as u32)
        })
        .collect();
    shape
        .triangles
        .iter()
        .map(|triangle| triangle.map(|corner| representative[corner as usize]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// A grid that closes on itself in both directions: a torus.
    fn torus(rows: u32, columns: u32) -> Shape {
        let mut shape = Shape::default();
        for row in 0..rows {
            for column in 0..columns {
                let (u, v) = (
                    std::f64::consts::TAU * f64::from(row) / f64::from(rows),
                    std::f64::consts::TAU * f64::from(column) / f64::from(columns),
                );
                let r = 3.0 + u.cos();
                shape
                    .positions
                    .push(Point3::new(r * v.cos(), r * v.sin(), u.sin()));
                let at = |i: u32, j: u32| (i % rows) * columns + j % columns;
                let [a, b, c, d] = [
                    at(row, column),
                    at(row + 1, column),
                    at(row + 1, column + 1),
                    at(row, column + 1),
                ];
                shape.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        shape
    }

    fn tetrahedron() -> Shape {
        Shape {
            positions: [
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
            ]
            .map(Point3::from)
            .to_vec(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..Shape::default()
        }
    }

    #[test]
    fn spheres_tori_and_their_holes_are_counted() {
        let sphere = Topology::new(&tetrahedron());
        assert_eq!((sphere.components, sphere.genus), (1, Some(0)));
        assert_eq!(sphere.boundary_edges + sphere.inconsistent_edges, 0);

        let mut shape = torus(7, 9);
        assert_eq!(Topology::new(&shape).genus, Some(1));
        shape.triangles.remove(5);
        let open = Topology::new(&shape);
        assert_eq!(
            (open.genus, open.boundary_edges, open.boundary_loops),
            (Some(1), 3, 1)
        );

        shape.triangles[20].swap(0, 1);
        assert_eq!(Topology::new(&shape).inconsistent_edges, 3);
    }

    #[test]
    fn parts_that_touch_in_a_vertex_or_cross_in_an_edge_are_parted() {
        let mut shape = tetrahedron();
        let mut mirrored = tetrahedron();
        for position in &mut mirrored.positions {
            *position = -*position;
        }
        for triangle in &mut mirrored.triangles {
            triangle.swap(0, 1);
        }
        shape.append(mirrored);
        let touching = Topology::new(&shape);
        assert_eq!((touching.components, touching.genus), (2, Some(0)));

        // Three triangles along one edge.
        let book = Shape {
            positions: [
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, -1.0, 0.0],
                [0.0, 0.0, 1.0],
            ]
            .map(Point3::from)
            .to_vec(),
            triangles: vec![[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3]],
            ..Shape::default()
        };
        let found = Topology::new(&book);
        assert_eq!((found.components, found.non_manifold_edges), (3, 1));
        assert_eq!((found.degenerate_triangles, found.genus), (1, Some(0)));
    }

    #[test]
    fn separate_corners_are_joined_by_their_coordinates() {
        let closed = tetrahedron();
        let soup = Shape {
            positions: closed
                .triangles
                .as_flattened()
                .iter()
                .map(|corner| closed.positions[*corner as usize])
                .collect(),
            triangles: (0..4).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            ..Shape::default()
        };
        assert_eq!(Topology::new(&soup), Topology::new(&closed));
        assert_eq!(
            Topology::new(&Shape::default()),
            Topology {
                genus: Some(0),
                ..Topology::default()
            }
        );
    }

    #[test]
    fn closed_sheets_that_touch_along_an_edge_stay_apart() {
        // Two tetrahedra with an edge in the same place, each with vertices of its own.
        let mut shape = tetrahedron();
        let mut turned = tetrahedron();
        for position in &mut turned.positions {
            *position = Point3::new(position.x, -position.y, -position.z);
        }
        shape.append(turned);
        let found = Topology::new(&shape);
        assert_eq!((found.components, found.non_manifold_edges), (2, 0));
        assert_eq!((found.boundary_loops, found.genus), (0, Some(0)));
    }

    #[test]
    fn a_moebius_strip_has_no_genus() {
        let strip = Shape {
            positions: (0..5)
                .map(|i| Point3::new(f64::from(i), f64::from(i * i), f64::from(i * i * i)))
                .collect(),
            // The smallest one: five vertices, five triangles.
            triangles: (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect(),
            ..Shape::default()
        };
        assert_eq!(Topology::new(&strip).genus, None);
    }
}
