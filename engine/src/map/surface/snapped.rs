//! Vertices on 3D segments. Windows of depth round edges, and the surface ends some pixels beside an outline: where a segment runs along an edge or
//! a boundary, the vertices belong there.

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Where normals differ by at least this angle, the surface has an edge: 30 degrees.
const EDGE_COSINE: f64 = 0.866;
/// Least cosine between an edge or a boundary and a segment along it: 60 degrees, as both are made of steps.
const LEAST_COSINE: f64 = 0.5;
/// Least cosine between the normals of a triangle before and after its corners move.
const LEAST_TURN_COSINE: f64 = 0.3;
/// How often vertices go back that turn triangles over.
const ROUNDS: usize = 2;

/// How many triangles away a vertex may be and still have an influence on the position of another one.
pub(super) const REACH: usize = ROUNDS + 1;

/// Moves vertices on edges and boundaries onto the segments along them. `segments` lists those near a position; vertices that are not `is_free`
/// stay.
///
/// A position depends on the triangles within [`REACH`] of its vertex alone.
///
/// # Complexity
/// Linear in the triangles, where few of them meet at a vertex, and few segments are near it.
pub(super) fn snapped(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    is_free: impl Fn(usize) -> bool + Sync,
    segments: impl Fn(&Point3<f64>) -> Vec<[Point3<f64>; 2]> + Sync,
) -> Vec<Point3<f64>> {
    let normals: Vec<Vector3<f64>> = triangles
        .par_iter()
        .map(|triangle| normal(triangle.map(|corner| positions[corner as usize])))
        .collect();
    let along = edges(positions, triangles, &normals);
    let targets: Vec<Option<Point3<f64>>> = along
        .par_iter()
        .enumerate()
        .map(|(vertex, along)| {
            let is_candidate = !along.is_empty() && is_free(vertex);
            is_candidate
                .then(|| nearest_along(&positions[vertex], along, segments(&positions[vertex])))
                .flatten()
        })
        .collect();
    let mut moved: Vec<Point3<f64>> = (positions.iter().zip(&targets))
        .map(|(position, target)| target.unwrap_or(*position))
        .collect();
    for _ in 0..ROUNDS {
        let is_over = |(triangle, before): (&[u32; 3], &Vector3<f64>)| {
            let after = normal(triangle.map(|corner| moved[corner as usize]));
            let farthest = (triangle.iter().copied())
                .map(|corner| (distance(positions, &moved, corner), corner))
                .filter(|(distance, _)| *distance > 0.0)
                .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            let (_, corner) = farthest?;
            let is_kept = after.dot(before) >= LEAST_TURN_COSINE * after.norm() * before.norm();
            (!is_kept).then_some(corner)
        };
        let returned: Vec<u32> = (triangles.par_iter().zip(&normals))
            .filter_map(is_over)
            .collect();
        for corner in returned {
            moved[corner as usize] = positions[corner as usize];
        }
    }
    moved
}

fn normal([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

fn distance(before: &[Point3<f64>], after: &[Point3<f64>], vertex: u32) -> f64 {
    (after[vertex as usize] - before[vertex as usize]).norm()
}

/// The directions of the edges and boundaries of the surface at each vertex.
fn edges(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    normals: &[Vector3<f64>],
) -> Vec<Vec<Unit<Vector3<f64>>>> {
    let mut beside: FxHashMap<[u32; 2], u32> = FxHashMap::default();
    for (number, [a, b, c]) in (0..).zip(triangles) {
        for edge in [[*a, *b], [*b, *c], [*c, *a]] {
            beside.insert(edge, number);
        }
    }
    let is_edge = |[from, to]: [u32; 2], number: usize| match beside.get(&[to, from]) {
        None => true,
        Some(other) => {
            let (one, other) = (&normals[number], &normals[*other as usize]);
            from < to && one.dot(other) < EDGE_COSINE * one.norm() * other.norm()
        }
    };
    let mut along = vec![Vec::new(); positions.len()];
    for (number, [a, b, c]) in triangles.iter().enumerate() {
        for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
            if !is_edge([from, to], number) {
                continue;
            }
            let between = positions[to as usize] - positions[from as usize];
            if let Some(direction) = Unit::try_new(between, 0.0) {
                along[from as usize].push(direction);
                along[to as usize].push(direction);
            }
        }
    }
    along
}

/// The nearest point on those of the segments that run along an edge; the first of equally near ones.
fn nearest_along(
    position: &Point3<f64>,
    edges: &[Unit<Vector3<f64>>],
    segments: Vec<[Point3<f64>; 2]>,
) -> Option<Point3<f64>> {
    let mut nearest: Option<(f64, Point3<f64>)> = None;
    for [from, to] in segments {
        let along = to - from;
        let is_along =
            |edge: &Unit<Vector3<f64>>| edge.dot(&along).abs() >= LEAST_COSINE * along.norm();
        if !edges.iter().any(is_along) {
            continue;
        }
        let foot = nearest_point(position, [from, to]);
        let squared = (foot - position).norm_squared();
        if nearest.is_none_or(|(least, _)| squared < least) {
            nearest = Some((squared, foot));
        }
    }
    nearest.map(|(_, foot)| foot)
}

/// The point of a segment that is nearest to a position.
pub(in crate::map) fn nearest_point(
    position: &Point3<f64>,
    [from, to]: [Point3<f64>; 2],
) -> Point3<f64> {
    let along = to - from;
    let share = (position - from).dot(&along) / along.norm_squared();
    from + share.clamp(0.0, 1.0) * along
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

    const X_AXIS: [Point3<f64>; 2] = [Point3::new(-1.0, 0.0, 0.0), Point3::new(9.0, 0.0, 0.0)];

    #[test]
    fn an_edge_moves_onto_the_segment_along_it_and_the_rest_stays() {
        let off = [[0.05, -0.02], [-0.04, 0.03], [0.02, 0.05], [0.0, -0.06]];
        let (positions, triangles) = wedge(&off);
        let near = |at: &Point3<f64>| {
            let is_near = (nearest_point(at, X_AXIS) - at).norm() < 0.2;
            Vec::from_iter(is_near.then_some(X_AXIS))
        };
        let moved = snapped(&positions, &triangles, |_| true, near);
        for (vertex, (before, after)) in positions.iter().zip(&moved).enumerate() {
            match vertex % 3 {
                1 => assert_eq!(*after, Point3::new(before.x, 0.0, 0.0)),
                _ => assert_eq!(after, before),
            }
        }
        let held = snapped(&positions, &triangles, |vertex| vertex != 4, near);
        assert_eq!(held[4], positions[4]);
        assert_eq!(held[7], moved[7]);
    }

    #[test]
    fn segments_across_an_edge_and_in_a_plane_move_nothing() {
        let (positions, triangles) = wedge(&[[0.0, 0.0]; 4]);
        let across = [Point3::new(1.1, -1.0, 1.0), Point3::new(1.1, 1.0, -1.0)];
        let moved = snapped(&positions, &triangles, |_| true, |_| vec![across]);
        assert_eq!(moved[4], positions[4]);
        let flat: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
        let ring = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        let ring = ring.map(|[x, y]| Point3::new(x, y, 0.0));
        let beside = [Point3::new(-0.1, 0.1, 0.0), Point3::new(0.1, 0.1, 0.0)];
        let moved = snapped(&ring, &flat, |vertex| vertex == 0, |_| vec![beside]);
        assert_eq!(moved[0], ring[0]);
    }

    #[test]
    fn a_vertex_that_would_turn_a_triangle_over_stays() {
        let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        let beyond = [Point3::new(-5.0, -0.5, 0.0), Point3::new(5.0, -0.5, 0.0)];
        let moved = snapped(
            &positions,
            &[[0, 1, 2]],
            |vertex| vertex == 2,
            |_| vec![beyond],
        );
        assert_eq!(moved[2], positions[2]);
    }
}
