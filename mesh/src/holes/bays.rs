//! Bays of a boundary between two places on one line.

use nalgebra::Vector3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::edges_of;
use super::loops::{BoundaryEdge, boundary_loops};
use super::triangulate::Triangulation;
use crate::TriangleMesh;

/// Least cosine between a new triangle and the mean of the old ones around its bay: 26 degrees.
const LEAST_COSINE: f64 = 0.9;

/// Closes bays: parts of a boundary with at most `most_edges` edges that leave a line and come back to it at most `widest` further along. `line_of`
/// has the vertices on lines, and `is_same` says whether two vertices with their lines lie on one line as well. No vertex is added, no edge gets more
/// than two triangles, and new triangles lie in the surface around the bay. Returns the number of bays closed.
///
/// # Complexity
/// Linear in the mesh, and cubic in the edges of a bay.
pub(crate) fn close_bays(
    mesh: &mut TriangleMesh,
    line_of: &FxHashMap<u32, u32>,
    is_same: impl Fn(&TriangleMesh, [(u32, u32); 2]) -> bool,
    most_edges: usize,
    widest: f64,
) -> usize {
    let boundary = boundary_loops(&mesh.triangles);
    let mut is_boundary = vec![false; mesh.positions.len()];
    for edge in boundary.iter().flatten() {
        is_boundary[edge.ends[0] as usize] = true;
    }
    // New triangles have no edge elsewhere.
    let is_there = |ends: &[u32; 2]| ends.iter().all(|end| is_boundary[*end as usize]);
    let mut edges: FxHashSet<[u32; 2]> = FxHashSet::default();
    edges.extend(mesh.triangles.iter().flat_map(edges_of).filter(is_there));
    let mut closed = 0;
    for boundary in &boundary {
        let mut is_closed = vec![false; boundary.len()];
        for start in 0..boundary.len() {
            let Some(mut bay) = bay(
                boundary,
                start,
                line_of,
                |ends| is_same(mesh, ends),
                most_edges,
            ) else {
                continue;
            };
            let part = (start..start + bay.len()).map(|at| at % boundary.len());
            if part.clone().any(|at| is_closed[at]) {
                continue;
            }
            let ends = [bay[bay.len() - 1].ends[1], bay[0].ends[0]];
            let [from, to] = ends.map(|end| mesh.positions[end as usize]);
            let mouth = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            if (to - from).norm() > widest || edges.contains(&mouth) {
                continue;
            }
            let around: Vector3<f64> = bay
                .iter()
                .map(|edge| normal(mesh, &[edge.ends[0], edge.ends[1], edge.opposite]))
                .sum();
            let opposite = ends[0];
            bay.push(BoundaryEdge { ends, opposite });
            let Some(triangulation) = Triangulation::of_least_area(mesh, &bay, &edges) else {
                continue;
            };
            let triangles = triangulation.triangles();
            let is_along = |triangle: &[u32; 3]| {
                let normal = normal(mesh, triangle);
                normal.dot(&around) >= LEAST_COSINE * normal.norm() * around.norm()
            };
            if triangles.iter().all(is_along) {
                edges.extend(triangles.iter().flat_map(edges_of));
                mesh.triangles.extend(triangles);
                part.for_each(|at| is_closed[at] = true);
                closed += 1;
            }
        }
    }
    closed
}

/// The edges of the boundary from `start` on until it is on the same line again, with at least one vertex beside it; `None` where it does not
/// begin on a line, stays on it, or does not come back.
fn bay(
    boundary: &[BoundaryEdge],
    start: usize,
    line_of: &FxHashMap<u32, u32>,
    is_same: impl Fn([(u32, u32); 2]) -> bool,
    most_edges: usize,
) -> Option<Vec<BoundaryEdge>> {
    let first = boundary[start].ends[0];
    let line = line_of.get(&first)?;
    let mut bay = Vec::new();
    for step in 0..most_edges.min(boundary.len() - 1) {
        let edge = boundary[(start + step) % boundary.len()];
        bay.push(edge);
        let last = edge.ends[1];
        let other = line_of.get(&last);
        if other.is_some_and(|other| other == line || is_same([(first, *line), (last, *other)])) {
            return (bay.len() > 1).then_some(bay);
        }
    }
    None
}

fn normal(mesh: &TriangleMesh, triangle: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::edge_uses::for_each_edge;

    /// A strip of squares along x, of which one has no vertex at the upper side; the line is y = 1.
    fn strip(missing: u32) -> (TriangleMesh, FxHashMap<u32, u32>) {
        let mut mesh = TriangleMesh::default();
        for x in 0..5 {
            let at = |y| Point3::new(f64::from(x), y, 0.0);
            mesh.positions.extend([at(0.0), at(1.0)]);
        }
        mesh.positions[2 * missing as usize + 1].y = 0.4;
        for x in 0..4 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|corner| 2 * x + corner);
            mesh.triangles.extend([[a, c, b], [c, d, b]]);
        }
        let on_line = (0..5).filter(|x| *x != missing);
        (mesh, on_line.map(|x| (2 * x + 1, 7)).collect())
    }

    #[test]
    fn a_bay_is_closed_between_vertices_of_its_line() {
        let (mesh, line_of) = strip(2);
        let mut closed = mesh.clone();
        assert_eq!(close_bays(&mut closed, &line_of, |_, _| false, 4, 2.5), 1);
        assert_eq!(closed.triangles[..8], mesh.triangles);
        assert_eq!(closed.triangles.len(), 9);
        let added = normal(&closed, &closed.triangles[8]);
        assert!(added.z > 0.0, "{added}");
        assert_eq!(close_bays(&mut closed, &line_of, |_, _| false, 4, 2.5), 0);
    }

    #[test]
    fn a_bay_within_a_bay_is_closed_with_it() {
        // Vertices 3 and 7 of the upper side lie on another line within the bay between 1 and 9.
        let (mut mesh, mut line_of) = strip(2);
        for vertex in [3, 7] {
            mesh.positions[vertex as usize].y = 0.7;
            line_of.insert(vertex, 8);
        }
        assert_eq!(close_bays(&mut mesh, &line_of, |_, _| false, 4, 4.5), 1);
        assert_eq!(mesh.triangles.len(), 11);
        for_each_edge(&mesh.triangles, mesh.positions.len(), |_, corners| {
            assert!(corners.len() <= 2);
        });
    }

    #[test]
    fn wide_bays_and_those_between_two_lines_stay() {
        let (mesh, mut line_of) = strip(2);
        let mut same = mesh.clone();
        assert_eq!(close_bays(&mut same, &line_of, |_, _| false, 4, 1.5), 0);
        assert_eq!(close_bays(&mut same, &line_of, |_, _| false, 1, 2.5), 0);
        line_of.insert(7, 8);
        assert_eq!(close_bays(&mut same, &line_of, |_, _| false, 4, 2.5), 0);
        assert_eq!(same, mesh);
    }

    #[test]
    fn a_cape_is_no_bay() {
        let (mut mesh, line_of) = strip(2);
        mesh.positions[5].y = 1.6;
        assert_eq!(close_bays(&mut mesh, &line_of, |_, _| false, 4, 2.5), 0);
    }
}
