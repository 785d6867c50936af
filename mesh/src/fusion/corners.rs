//! Corners of boundaries, where two segments meet. Segments end before them, and the grid cuts them off.

use nalgebra::{Point3, center};
use rustc_hash::FxHashMap;

use crate::TriangleMesh;

/// A vertex moves at most so many sides to a corner.
const REACH_SIDES: f64 = 1.5;
/// Lines that pass each other at most this many sides apart meet.
const APART_SIDES: f64 = 0.5;
/// Largest cosine between the lines of a corner: 30 degrees.
const MOST_COSINE: f64 = 0.87;

/// Where the boundary passes from one segment to another, moves a vertex to the point at which their lines meet: the vertex between those on the
/// two, or else the nearer of them. Edges of the boundary begin at `open` corners; `segment_of` has the segments of vertices.
pub(super) fn move_to_corners(
    mesh: &mut TriangleMesh,
    open: &[u32],
    segments: &[[Point3<f64>; 2]],
    segment_of: &mut FxHashMap<u32, u32>,
    side: f64,
) {
    let vertex = |corner: u32| mesh.triangles[corner as usize / 3][corner as usize % 3];
    let after = |corner: u32| vertex(corner - corner % 3 + (corner + 1) % 3);
    let next: FxHashMap<u32, u32> = open.iter().map(|it| (vertex(*it), after(*it))).collect();
    let mut edges: Vec<(u32, u32)> = next.iter().map(|(from, to)| (*from, *to)).collect();
    edges.sort_unstable();
    let mut moved: Vec<(u32, Point3<f64>, u32)> = Vec::new();
    for (from, to) in edges {
        let (vertices, last) = match segment_of.contains_key(&to) {
            true => ([from, to], to),
            false => ([to, to], next.get(&to).copied().unwrap_or(to)),
        };
        let (Some(&first), Some(&second)) = (segment_of.get(&from), segment_of.get(&last)) else {
            continue;
        };
        let lines = [first, second].map(|segment| &segments[segment as usize]);
        let Some(corner) = corner(lines, APART_SIDES * side) else {
            continue;
        };
        let apart = |vertex: u32| (mesh.positions[vertex as usize] - corner).norm();
        let [a, b] = vertices;
        let nearer = if apart(b) < apart(a) { b } else { a };
        if apart(nearer) <= REACH_SIDES * side {
            moved.push((nearer, corner, first));
        }
    }
    for (vertex, corner, segment) in moved {
        mesh.positions[vertex as usize] = corner;
        segment_of.entry(vertex).or_insert(segment);
    }
}

/// The point nearest to the lines of two segments; `None` when they are about parallel, or pass each other further than `apart`.
fn corner([first, second]: [&[Point3<f64>; 2]; 2], apart: f64) -> Option<Point3<f64>> {
    let [u, v] = [first, second].map(|[from, to]| (to - from).normalize());
    let cosine = u.dot(&v);
    if cosine.abs() > MOST_COSINE {
        return None;
    }
    let offset = second[0] - first[0];
    let sine_squared = 1.0 - cosine * cosine;
    let on_first = first[0] + u * ((u - cosine * v).dot(&offset) / sine_squared);
    let on_second = second[0] + v * ((cosine * u - v).dot(&offset) / sine_squared);
    ((on_first - on_second).norm() <= apart).then(|| center(&on_first, &on_second))
}
