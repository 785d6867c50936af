//! Polygons with holes: rings of border vertices, checked and triangulated.

use nalgebra::Point3;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use crate::plane::Plane;
use crate::structure::sides;
use crate::surface::{Surface, rank, unique};

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
    sides(ring).map(|[a, b]| a[0] * b[1] - a[1] * b[0]).sum()
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
    faults.extend(crossing_at_vertices(&rings, flat));
    let triangles = triangulate(&rings, faults, flat).map_err(unique)?;
    Ok(Filled { rings, triangles })
}

/// Twice the area that a ring encloses.
fn area(ring: &[u32], flat: impl Fn(&u32) -> [f64; 2]) -> f64 {
    doubled_area(&ring.iter().map(flat).collect::<Vec<_>>())
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

/// The constrained Delaunay triangulation of what lies inside the first ring and outside the others.
///
/// # Errors
/// Vertices with known faults, those of sides that cross, touch or repeat each other, and of holes outside the first ring or inside another hole.
fn triangulate(
    rings: &[Vec<u32>],
    mut faults: Vec<u32>,
    flat: impl Fn(&u32) -> [f64; 2],
) -> Result<Vec<[u32; 3]>, Vec<u32>> {
    let vertices = unique(rings.concat());
    let mut plan: ConstrainedDelaunayTriangulation<Point2<f64>> = Default::default();
    let mut handles = Vec::with_capacity(vertices.len());
    let mut doubled = Vec::new();
    for vertex in &vertices {
        // `spade` refuses very small values.
        let [x, y] = flat(vertex).map(|it| if it.abs() < 1e-100 { 0.0 } else { it });
        let count = plan.num_vertices();
        handles.push(plan.insert(Point2::new(x, y)).map_err(|_| rings.concat())?);
        if plan.num_vertices() == count {
            doubled.push(*vertex);
        }
    }
    if !doubled.is_empty() {
        return Err([faults, doubled].concat());
    }
    let number = |it: FixedVertexHandle| vertices[it.index()];
    let handle = |vertex: u32| handles[rank(&vertices, &vertex) as usize];
    let all = || rings.iter().flat_map(|it| sides(it));
    for side in all() {
        let [from, to] = side.map(handle);
        let conflicts = plan.get_conflicting_edges_between_vertices(from, to);
        let conflicts = conflicts.flat_map(|it| it.vertices().map(|it| number(it.fix())));
        let conflicts: Vec<u32> = conflicts.collect();
        // A vertex on the side would split it.
        let is_new = conflicts.is_empty() && plan.add_constraint(from, to);
        if !is_new || plan.get_edge_from_neighbors(from, to).is_none() {
            faults.extend(side.iter().chain(&conflicts));
        }
    }
    if !faults.is_empty() {
        return Err(faults);
    }
    // Faces to the left of the outer ring, and all that no side separates from them.
    let left = |[a, b]: [u32; 2]| {
        let edge = plan.get_edge_from_neighbors(handle(a), handle(b));
        edge.map(|it| it.face().fix())
    };
    let mut is_inside = vec![false; plan.num_all_faces()];
    let mut stack: Vec<_> = rings
        .iter()
        .take(1)
        .flat_map(|it| sides(it))
        .filter_map(left)
        .collect();
    let mut triangles = Vec::new();
    while let Some(face) = stack.pop() {
        if std::mem::replace(&mut is_inside[face.index()], true) {
            continue;
        }
        let inner = plan.face(face).as_inner().ok_or_else(|| rings.concat())?;
        let mut triangle = inner.vertices().map(|it| number(it.fix()));
        let least = (0..3).min_by_key(|it| triangle[*it]).unwrap_or(0);
        triangle.rotate_left(least);
        triangles.push(triangle);
        for edge in inner.adjacent_edges() {
            if !edge.is_constraint_edge() {
                stack.push(edge.rev().face().fix());
            }
        }
    }
    // What lies to the left of sides is inside, and what lies to their right is outside.
    let is_inside = |side| left(side).is_some_and(|it| is_inside[it.index()]);
    let faults = all().filter(|[a, b]| !is_inside([*a, *b]) || is_inside([*b, *a]));
    let faults: Vec<u32> = faults.flatten().collect();
    triangles.sort_unstable();
    if faults.is_empty() {
        Ok(triangles)
    } else {
        Err(faults)
    }
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
