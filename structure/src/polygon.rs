//! Polygons with holes: rings of border vertices, checked and triangulated.

use nalgebra::Point3;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use crate::plane::Plane;
use crate::surface::Surface;

/// The rings of each component: vertices along its border, triangles to the left, only those that `is_corner`.
///
/// # Complexity
/// Linear in the triangles, where few of them meet at a vertex.
pub(crate) fn rings(
    surface: &Surface,
    component: &[u32],
    count: usize,
    is_corner: &[bool],
) -> Vec<Vec<Vec<u32>>> {
    let inside = |triangle: usize, edge: usize| {
        let across = surface.across[triangle][edge];
        across.filter(|it| component[*it as usize] == component[triangle])
    };
    let mut is_used = vec![[false; 3]; surface.triangles.len()];
    let mut rings = vec![Vec::new(); count];
    for first in 0..surface.triangles.len() {
        for first_edge in 0..3 {
            let own = component[first] as usize;
            if own >= count || is_used[first][first_edge] || inside(first, first_edge).is_some() {
                continue;
            }
            let (mut triangle, mut edge) = (first, first_edge);
            let mut ring = Vec::new();
            while !is_used[triangle][edge] {
                is_used[triangle][edge] = true;
                ring.push(surface.triangles[triangle][edge]);
                // The next border edge around the end of this one, inside the component.
                edge = (edge + 1) % 3;
                while let Some(other) = inside(triangle, edge) {
                    let vertex = surface.triangles[triangle][edge];
                    triangle = other as usize;
                    let at = surface.triangles[triangle]
                        .iter()
                        .position(|it| *it == vertex);
                    edge = at.unwrap_or(0);
                }
            }
            ring.retain(|it| is_corner[*it as usize]);
            rings[own].push(ring);
        }
    }
    rings
}

/// Twice the area that a ring encloses, counter-clockwise positive.
pub(crate) fn doubled_area(ring: &[[f64; 2]]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    ring.iter()
        .zip(next)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum()
}

/// Rings with their triangles.
#[derive(Debug)]
pub(crate) struct Filled {
    /// The outer ring first, then holes. Indices of vertices.
    pub(crate) rings: Vec<Vec<u32>>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// Triangulates the inside of rings. `is_hole` is asked whether a ring with twice this area is a hole; else it is closed.
///
/// # Errors
/// Where rings cross or touch themselves or each other, or turn the wrong way: the vertices there.
///
/// # Complexity
/// Quadratic in the corners, with a small factor.
pub(crate) fn fill(
    rings: &[Vec<u32>],
    positions: &[Point3<f64>],
    plane: &Plane,
    is_hole: impl Fn(&[u32], f64) -> bool,
) -> Result<Filled, Vec<u32>> {
    let axes = plane.axes();
    let flat = |it: &u32| plane.coordinates(&positions[*it as usize], &axes);
    // The largest ring is the outer one.
    let mut areas: Vec<(f64, &Vec<u32>)> = rings.iter().map(|it| (area(it, flat), it)).collect();
    areas.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    let is_hole = |it: &(f64, &Vec<u32>)| it.1.len() >= 3 && is_hole(it.1, -it.0);
    let mut kept: Vec<(f64, &Vec<u32>)> = areas.iter().take(1).copied().collect();
    kept.extend(areas.iter().skip(1).copied().filter(is_hole));
    let mut faults: Vec<u32> = Vec::new();
    for (index, (area, ring)) in kept.iter().enumerate() {
        if (index == 0) != (*area > 0.0) || *area == 0.0 {
            faults.extend(*ring);
        }
    }
    let rings: Vec<Vec<u32>> = kept.into_iter().map(|it| it.1.clone()).collect();
    let mut sides: Vec<[u32; 2]> = Vec::new();
    for ring in &rings {
        let next = ring.iter().cycle().skip(1);
        sides.extend(ring.iter().zip(next).map(|(a, b)| [*a, *b]));
    }
    faults.extend(crossing_sides(&sides, flat));
    faults.extend(crossing_at_vertices(&rings, flat));
    if !faults.is_empty() {
        faults.sort_unstable();
        faults.dedup();
        return Err(faults);
    }
    let outside = stray_holes(&rings, flat);
    if !outside.is_empty() {
        return Err(outside);
    }
    let triangles = triangulate(&sides, flat).ok_or_else(|| rings.concat())?;
    Ok(Filled { rings, triangles })
}

/// Twice the area that a ring encloses.
fn area(ring: &[u32], flat: impl Fn(&u32) -> [f64; 2]) -> f64 {
    doubled_area(&ring.iter().map(flat).collect::<Vec<_>>())
}

/// The vertices of sides that cross, touch or repeat each other, ascending.
fn crossing_sides(sides: &[[u32; 2]], flat: impl Fn(&u32) -> [f64; 2]) -> Vec<u32> {
    let ends: Vec<[[f64; 2]; 2]> = sides
        .iter()
        .map(|it| [flat(&it[0]), flat(&it[1])])
        .collect();
    let mut order: Vec<usize> = (0..sides.len()).collect();
    let low = |it: &usize| ends[*it][0][0].min(ends[*it][1][0]);
    let high = |it: &usize| ends[*it][0][0].max(ends[*it][1][0]);
    order.sort_by(|a, b| low(a).total_cmp(&low(b)).then(a.cmp(b)));
    let mut found = Vec::new();
    for (rank, one) in order.iter().enumerate() {
        let beside = order[rank + 1..].iter();
        for other in beside.take_while(|it| low(it) <= high(one)) {
            if meets(&sides[*one], &sides[*other], &ends[*one], &ends[*other]) {
                found.extend(sides[*one].iter().chain(&sides[*other]));
            }
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}

/// The vertices where rings cross themselves or each other in a common vertex, with the vertices beside them.
fn crossing_at_vertices(rings: &[Vec<u32>], flat: impl Fn(&u32) -> [f64; 2]) -> Vec<u32> {
    // A vertex with the ones before and after it.
    let mut passes: Vec<[u32; 3]> = Vec::new();
    for ring in rings {
        let count = ring.len();
        passes.extend((0..count).map(|it| [0, count - 1, 1].map(|by| ring[(it + by) % count])));
    }
    passes.sort_unstable();
    let angle = |at: &u32, to: &u32| {
        let [a, b] = [flat(at), flat(to)];
        (b[1] - a[1]).atan2(b[0] - a[0])
    };
    let mut found = Vec::new();
    for same in passes
        .chunk_by(|a, b| a[0] == b[0])
        .filter(|it| it.len() > 1)
    {
        for [at, before, after] in same {
            // The inside lies between the way on and the way back, counter-clockwise.
            let from = angle(at, after);
            let sector = |to: &u32| (angle(at, to) - from).rem_euclid(std::f64::consts::TAU);
            let width = sector(before);
            let others = same.iter().filter(|it| it[1] != *before || it[2] != *after);
            let is_crossed = |it: &[u32; 3]| {
                it[1..]
                    .iter()
                    .any(|it| sector(it) > 0.0 && sector(it) < width)
            };
            for other in others.filter(|it| is_crossed(it)) {
                found.extend([*at, *before, *after, other[1], other[2]]);
            }
        }
    }
    found
}

/// Whether two sides have a point in common other than a vertex of both.
fn meets(one: &[u32; 2], other: &[u32; 2], a: &[[f64; 2]; 2], b: &[[f64; 2]; 2]) -> bool {
    let overlaps = |axis: usize| {
        let range =
            |it: &[[f64; 2]; 2]| (it[0][axis].min(it[1][axis]), it[0][axis].max(it[1][axis]));
        let (one, other) = (range(a), range(b));
        one.0 <= other.1 && other.0 <= one.1
    };
    if !(overlaps(0) && overlaps(1)) {
        return false;
    }
    let turn = |p: &[f64; 2], q: &[f64; 2], r: &[f64; 2]| {
        let value = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        value.partial_cmp(&0.0).map_or(0, |it| it as i32)
    };
    let shared = one.iter().filter(|it| other.contains(it)).count();
    if shared == 2 {
        return true;
    }
    if shared == 1 {
        // Both leave the common vertex in one direction, or one is a point.
        let common = one.iter().position(|it| other.contains(it)).unwrap_or(0);
        let at = other.iter().position(|it| *it == one[common]).unwrap_or(0);
        let (from, p, q) = (a[common], a[1 - common], b[1 - at]);
        let along = (p[0] - from[0]) * (q[0] - from[0]) + (p[1] - from[1]) * (q[1] - from[1]);
        return turn(&from, &p, &q) == 0 && along >= 0.0;
    }
    let [c, d] = [turn(&a[0], &a[1], &b[0]), turn(&a[0], &a[1], &b[1])];
    let [e, f] = [turn(&b[0], &b[1], &a[0]), turn(&b[0], &b[1], &a[1])];
    c * d <= 0 && e * f <= 0
}

/// The vertices of holes that lie outside the first ring, or inside another hole.
fn stray_holes(rings: &[Vec<u32>], flat: impl Fn(&u32) -> [f64; 2]) -> Vec<u32> {
    let contains = |ring: &[u32], [x, y]: [f64; 2]| {
        let next = ring.iter().cycle().skip(1);
        let sides = ring.iter().zip(next).map(|(a, b)| [flat(a), flat(b)]);
        let crossed = sides.filter(|[a, b]| {
            (a[1] > y) != (b[1] > y) && x < (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) + a[0]
        });
        crossed.count() % 2 == 1
    };
    let mut found = Vec::new();
    for (index, hole) in rings.iter().enumerate().skip(1) {
        // A vertex that no other ring has.
        let own = |it: &&u32| rings.iter().filter(|ring| ring.contains(it)).count() == 1;
        let Some(at) = hole.iter().find(own).map(&flat) else {
            continue;
        };
        let others = rings.iter().enumerate().skip(1);
        let is_nested = others
            .filter(|it| it.0 != index)
            .any(|it| contains(it.1, at));
        if is_nested || !contains(&rings[0], at) {
            found.extend(hole);
        }
    }
    found
}

/// The constrained Delaunay triangulation of what lies to the left of sides, which do not cross; `None` when they do.
fn triangulate(sides: &[[u32; 2]], flat: impl Fn(&u32) -> [f64; 2]) -> Option<Vec<[u32; 3]>> {
    let mut vertices: Vec<u32> = sides.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut plan: ConstrainedDelaunayTriangulation<Point2<f64>> = Default::default();
    let mut handles = Vec::with_capacity(vertices.len());
    for vertex in &vertices {
        // `spade` refuses very small values.
        let [x, y] = flat(vertex).map(|it| if it.abs() < 1e-100 { 0.0 } else { it });
        handles.push(plan.insert(Point2::new(x, y)).ok()?);
    }
    if plan.num_vertices() != vertices.len() {
        return None;
    }
    let handle = |vertex: &u32| handles[vertices.binary_search(vertex).unwrap_or(0)];
    for [a, b] in sides {
        let [from, to] = [handle(a), handle(b)];
        if from == to || !plan.can_add_constraint(from, to) {
            return None;
        }
        plan.add_constraint(from, to);
        // A vertex on the side would split it.
        plan.get_edge_from_neighbors(from, to)?;
    }
    // Faces to the left of sides, and all that no side separates from them.
    let mut is_inside = vec![false; plan.num_all_faces()];
    let mut stack = Vec::new();
    for [a, b] in sides {
        let edge = plan.get_edge_from_neighbors(handle(a), handle(b))?;
        stack.push(edge.face().fix());
    }
    let mut triangles = Vec::new();
    while let Some(face) = stack.pop() {
        if std::mem::replace(&mut is_inside[face.index()], true) {
            continue;
        }
        // Beyond the hull: rings are not nested.
        let inner = plan.face(face).as_inner()?;
        let mut triangle = inner.vertices().map(|it| vertices[it.fix().index()]);
        let least = (0..3).min_by_key(|it| triangle[*it]).unwrap_or(0);
        triangle.rotate_left(least);
        triangles.push(triangle);
        for edge in inner.adjacent_edges() {
            if !edge.is_constraint_edge() {
                stack.push(edge.rev().face().fix());
            }
        }
    }
    // What lies to the right of sides is outside.
    for [a, b] in sides {
        let edge = plan.get_edge_from_neighbors(handle(a), handle(b))?;
        if is_inside[edge.rev().face().fix().index()] {
            return None;
        }
    }
    triangles.sort_unstable();
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn square(side: f64, first: u32) -> (Vec<Point3<f64>>, Vec<u32>) {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corners = corners.map(|[x, y]| Point3::new(side * x, side * y, 0.0));
        (corners.to_vec(), (first..first + 4).collect())
    }

    fn ground() -> Plane {
        Plane::new(Vector3::z(), Point3::origin())
    }

    fn area(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
        let doubled = triangles.iter().map(|it| {
            let [a, b, c] = it.map(|corner| positions[corner as usize]);
            (b - a).cross(&(c - a)).z
        });
        0.5 * doubled.sum::<f64>()
    }

    #[test]
    fn a_square_with_a_hole_has_the_area_between() {
        let (mut positions, outer) = square(2.0, 0);
        let (inner, mut hole) = square(0.5, 4);
        positions.extend(inner);
        let axes = ground().axes();
        let ring: Vec<[f64; 2]> = outer
            .iter()
            .map(|it| ground().coordinates(&positions[*it as usize], &axes))
            .collect();
        assert!(doubled_area(&ring) > 0.0);
        hole.reverse();
        let filled = fill(
            &[hole.clone(), outer.clone()],
            &positions,
            &ground(),
            |_, _| true,
        )
        .unwrap();
        assert_eq!(filled.rings, [outer.clone(), hole.clone()]);
        assert_eq!(filled.triangles.len(), 8);
        assert!((area(&positions, &filled.triangles) - 15.0).abs() < 1e-12);
        // A hole that turns like the outer ring, and one that leaves it.
        hole.reverse();
        assert!(
            fill(
                &[outer.clone(), hole.clone()],
                &positions,
                &ground(),
                |_, _| true
            )
            .is_err()
        );
        hole.reverse();
        positions[4].x = -3.0;
        assert_eq!(
            fill(&[outer, hole], &positions, &ground(), |_, _| true).unwrap_err(),
            [0, 3, 4, 5, 7]
        );
    }

    #[test]
    fn a_ring_that_crosses_itself_is_refused() {
        let (positions, mut ring) = square(1.0, 0);
        ring.swap(1, 2);
        assert!(fill(&[ring], &positions, &ground(), |_, _| true).is_err());
    }
}
