//! Vertices on 3D segments. Windows of depth round the edges of a surface, and the surface ends some pixels beside an outline: where a segment runs
//! along an edge or a boundary, the vertices belong there.

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use crate::edge_uses::for_each_edge;

/// Where normals differ by at least this angle, the surface has an edge: 30 degrees.
const EDGE_COSINE: f64 = 0.866;
/// Least cosine between an edge or a boundary and a segment along it: 60 degrees, as edges and boundaries zigzag.
const LEAST_COSINE: f64 = 0.5;
/// Least cosine between the normals of a triangle before and after its corners move.
const LEAST_TURN_COSINE: f64 = 0.3;
/// How often vertices go back that turn triangles over.
const ROUNDS: usize = 2;

/// How many triangles away a vertex may be and still have an influence on where [`snap_to_segments`] moves another one.
pub const SNAP_REACH: usize = ROUNDS + 1;

/// Moves vertices on edges and boundaries onto the nearest segment along them within `reach`. `segments` calls its argument with all segments that may
/// be so near to a position, in any order. Vertices that are not `is_free` stay, and so do those that would turn a triangle over.
///
/// The result depends neither on the number of threads nor on the order of segments.
///
/// # Complexity
/// Linear in the triangles, where few of them meet at a vertex, and few segments are near it.
pub fn snap_to_segments(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    reach: f64,
    is_free: impl Fn(usize) -> bool + Sync,
    segments: impl Fn(&Point3<f64>, &mut dyn FnMut([Point3<f64>; 2])) + Sync,
) -> Vec<Point3<f64>> {
    let normals: Vec<Vector3<f64>> = triangles
        .par_iter()
        .map(|triangle| normal(triangle.map(|corner| positions[corner as usize])))
        .collect();
    let edges = edges(positions, triangles, &normals);
    let at_vertices: Vec<&[EdgeAt]> = edges.chunk_by(|a, b| a.0 == b.0).collect();
    let target = |edges: &&[EdgeAt]| {
        let vertex = edges[0].0 as usize;
        let position = &positions[vertex];
        let mut nearest: Option<(f64, Point3<f64>)> = None;
        if is_free(vertex) {
            segments(position, &mut |segment| {
                let near = foot_along(position, edges, segment).filter(|(far, _)| *far <= reach);
                nearest = nearer(nearest, near);
            });
        }
        nearest.map(|(_, foot)| (vertex, foot))
    };
    let targets: Vec<(usize, Point3<f64>)> = at_vertices.par_iter().filter_map(target).collect();
    let mut moved = positions.to_vec();
    for (vertex, foot) in targets {
        moved[vertex] = foot;
    }
    for _ in 0..ROUNDS {
        for corner in turning_corners(positions, &moved, triangles, &normals) {
            moved[corner as usize] = positions[corner as usize];
        }
    }
    moved
}

/// Of each triangle that is turned over, the corner that moved most.
fn turning_corners(
    before: &[Point3<f64>],
    after: &[Point3<f64>],
    triangles: &[[u32; 3]],
    normals: &[Vector3<f64>],
) -> Vec<u32> {
    let length = |corner: u32| (after[corner as usize] - before[corner as usize]).norm();
    let corner = |(triangle, normal_before): (&[u32; 3], &Vector3<f64>)| {
        let moved = triangle.iter().map(|corner| (length(*corner), *corner));
        let (_, farthest) = moved
            .filter(|(length, _)| *length > 0.0)
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        let normal_after = normal(triangle.map(|corner| after[corner as usize]));
        let least = LEAST_TURN_COSINE * normal_after.norm() * normal_before.norm();
        (normal_after.dot(normal_before) < least).then_some(farthest)
    };
    (triangles.par_iter().zip(normals))
        .filter_map(corner)
        .collect()
}

fn normal([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// A vertex on an edge or a boundary, and its direction.
type EdgeAt = (u32, Unit<Vector3<f64>>);

/// The edges and boundaries of the surface at each vertex, by vertex.
fn edges(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    normals: &[Vector3<f64>],
) -> Vec<EdgeAt> {
    let mut edges: Vec<EdgeAt> = Vec::new();
    for_each_edge(triangles, positions.len(), |ends, corners| {
        if let [one, other] = *corners {
            let [one, other] = [one, other].map(|corner| &normals[corner as usize / 3]);
            if one.dot(other) >= EDGE_COSINE * one.norm() * other.norm() {
                return;
            }
        }
        let [from, to] = ends.map(|end| positions[end as usize]);
        if let Some(along) = Unit::try_new(to - from, 0.0) {
            edges.extend(ends.map(|end| (end, along)));
        }
    });
    edges.sort_by_key(|(vertex, _)| *vertex);
    edges
}

/// The point of a segment that is nearest to a position, and its distance; `None` if the segment runs along none of the edges.
fn foot_along(
    position: &Point3<f64>,
    edges: &[EdgeAt],
    [from, to]: [Point3<f64>; 2],
) -> Option<(f64, Point3<f64>)> {
    let along = to - from;
    let least = LEAST_COSINE * along.norm();
    let is_along = edges
        .iter()
        .any(|(_, edge)| edge.dot(&along).abs() >= least);
    let share = (position - from).dot(&along) / along.norm_squared();
    let foot = from + share.clamp(0.0, 1.0) * along;
    is_along.then(|| ((foot - position).norm(), foot))
}

/// The nearer of two feet; of equally near ones that with the smaller coordinates.
fn nearer(
    one: Option<(f64, Point3<f64>)>,
    other: Option<(f64, Point3<f64>)>,
) -> Option<(f64, Point3<f64>)> {
    let key = |(far, foot): &(f64, Point3<f64>)| [*far, foot.x, foot.y, foot.z];
    match (one, other) {
        (Some(a), Some(b)) => Some(if key(&b) < key(&a) { b } else { a }),
        (one, other) => one.or(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two planes that meet along the x axis: `z = 0` for `y > 0`, and `y = 0` for `z < 0`. Vertices of the edge are off by these.
    fn wedge(off: &[[f64; 2]]) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        for (x, [y, z]) in off.iter().enumerate() {
            let x = x as f64;
            positions.push(Point3::new(x, 1.0, 0.0));
            positions.push(Point3::new(x, *y, *z));
            positions.push(Point3::new(x, 0.0, -1.0));
        }
        let mut triangles = Vec::new();
        for first in (0..off.len() as u32 - 1).map(|column| 3 * column) {
            for row in [first, first + 1] {
                triangles.push([row, row + 1, row + 3]);
                triangles.push([row + 1, row + 4, row + 3]);
            }
        }
        (positions, triangles)
    }

    /// Moves vertices onto one segment.
    fn snap(
        positions: &[Point3<f64>],
        triangles: &[[u32; 3]],
        reach: f64,
        is_free: impl Fn(usize) -> bool + Sync,
        segment: [Point3<f64>; 2],
    ) -> Vec<Point3<f64>> {
        snap_to_segments(positions, triangles, reach, is_free, |_, visit| {
            visit(segment);
        })
    }

    const X_AXIS: [Point3<f64>; 2] = [Point3::new(-1.0, 0.0, 0.0), Point3::new(9.0, 0.0, 0.0)];

    #[test]
    fn an_edge_moves_onto_the_segment_along_it_and_the_rest_stays() {
        let off = [[0.05, -0.02], [-0.04, 0.03], [0.02, 0.05], [0.0, -0.06]];
        let (positions, triangles) = wedge(&off);
        let moved = snap(&positions, &triangles, 0.2, |_| true, X_AXIS);
        for (vertex, (before, after)) in positions.iter().zip(&moved).enumerate() {
            match vertex % 3 {
                1 => assert_eq!(*after, Point3::new(before.x, 0.0, 0.0)),
                _ => assert_eq!(after, before),
            }
        }
        let held = snap(&positions, &triangles, 0.2, |vertex| vertex != 4, X_AXIS);
        assert_eq!(held[4], positions[4]);
        assert_eq!(held[7], moved[7]);
    }

    #[test]
    fn segments_across_an_edge_and_in_a_plane_move_nothing() {
        let (positions, triangles) = wedge(&[[0.0, 0.0]; 4]);
        let across = [Point3::new(1.1, -1.0, 1.0), Point3::new(1.1, 1.0, -1.0)];
        let moved = snap(&positions, &triangles, 0.2, |_| true, across);
        assert_eq!(moved[4], positions[4]);
        let flat: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
        let ring = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        let ring = ring.map(|[x, y]| Point3::new(x, y, 0.0));
        let beside = [Point3::new(-0.1, 0.1, 0.0), Point3::new(0.1, 0.1, 0.0)];
        let moved = snap(&ring, &flat, 0.2, |vertex| vertex == 0, beside);
        assert_eq!(moved[0], ring[0]);
    }

    #[test]
    fn a_vertex_that_would_turn_a_triangle_over_stays() {
        let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        let beyond = [Point3::new(-5.0, -0.5, 0.0), Point3::new(5.0, -0.5, 0.0)];
        let moved = snap(&positions, &[[0, 1, 2]], 2.0, |vertex| vertex == 2, beyond);
        assert_eq!(moved[2], positions[2]);
    }
}
