//! A region, triangulated anew between its borders.

use nalgebra::Point3;
use rustc_hash::FxHashMap;
use spade::handles::{DirectedEdgeHandle, FixedVertexHandle};
use spade::{CdtEdge, ConstrainedDelaunayTriangulation, Point2, Triangulation};

use super::regions::Plane;

/// Triangulates what lies to the left of directed border edges in a plane. `None` when the border cannot be one of a part
/// of the plane: edges cross or touch or fall together, or the areas do not agree. Vertices may fall together, as those do that
/// were split where sheets of the surface meet.
pub(super) fn triangulate(
    positions: &[Point3<f64>],
    plane: &Plane,
    border: &[(u32, u32)],
) -> Option<Vec<[u32; 3]>> {
    let mut names: Vec<u32> = border.iter().map(|(from, _)| *from).collect();
    names.extend(border.iter().map(|(_, to)| *to));
    names.sort_unstable();
    names.dedup();
    if names.len() < 3 {
        return None;
    }
    let [across, up] = plane.axes();
    let origin = positions[names[0] as usize];
    let flat: Vec<Point2<f64>> = names
        .iter()
        .map(|name| {
            let from_origin = positions[*name as usize] - origin;
            Point2::new(
                small_to_zero(from_origin.dot(&across)),
                small_to_zero(from_origin.dot(&up)),
            )
        })
        .collect();
    let place = |name: u32| names.binary_search(&name).ok();

    let mut cdt = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut handles: Vec<FixedVertexHandle> = Vec::with_capacity(flat.len());
    for point in &flat {
        handles.push(cdt.insert(*point).ok()?);
    }
    // By the handles of its ends, the name of the vertex from which a border edge runs.
    let mut start_of: FxHashMap<[FixedVertexHandle; 2], u32> = FxHashMap::default();
    for (from, to) in border {
        let ends = [handles[place(*from)?], handles[place(*to)?]];
        let [a, b] = ends;
        if a == b || start_of.insert(ends, *from).is_some() || !cdt.can_add_constraint(a, b) {
            return None;
        }
        cdt.add_constraint(a, b);
        // A vertex on the way parts the edge, which the other side of the border would not know.
        if !cdt.exists_constraint(a, b) {
            return None;
        }
    }

    // From the left sides of the border edges inwards.
    let mut is_inside = vec![false; cdt.num_all_faces()];
    let mut open = Vec::new();
    let mut doubled_area = 0.0;
    for (from, to) in border {
        let (a, b) = (flat[place(*from)?], flat[place(*to)?]);
        doubled_area += a.x * b.y - b.x * a.y;
        let edge = cdt.get_edge_from_neighbors(handles[place(*from)?], handles[place(*to)?])?;
        let face = edge.face().as_inner()?;
        if !std::mem::replace(&mut is_inside[face.index()], true) {
            open.push(face.fix());
        }
    }
    let mut triangles = Vec::new();
    let mut covered = 0.0;
    while let Some(face) = open.pop() {
        let face = cdt.face(face);
        let [a, b, c] = face.positions();
        covered += (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
        let [a, b, c] = face
            .adjacent_edges()
            .map(|edge| name_at_start(edge, &start_of));
        triangles.push([a?, b?, c?]);
        for edge in face.adjacent_edges() {
            if edge.is_constraint_edge() {
                continue;
            }
            // The border is closed: what lies inside never reaches the outer face.
            let other = edge.rev().face().as_inner()?;
            if !std::mem::replace(&mut is_inside[other.index()], true) {
                open.push(other.fix());
            }
        }
    }
    let agrees = (covered - doubled_area).abs() <= 1e-9 * covered.abs().max(doubled_area.abs());
    if !agrees || covered <= 0.0 {
        return None;
    }
    // In the order of their vertices, so that nothing depends on how the flood went.
    for triangle in &mut triangles {
        let least = (0..3).min_by_key(|k| triangle[*k]).unwrap_or(0);
        triangle.rotate_left(least);
    }
    triangles.sort_unstable();
    Some(triangles)
}

/// The name of the vertex from which the edge of an inner face runs. All vertices are on the border: around the vertex and
/// inside, one comes to a border edge that begins there.
fn name_at_start(
    edge: DirectedEdgeHandle<'_, Point2<f64>, (), CdtEdge<()>, ()>,
    start_of: &FxHashMap<[FixedVertexHandle; 2], u32>,
) -> Option<u32> {
    let mut turned = edge;
    loop {
        if turned.is_constraint_edge() {
            let ends = [turned.from(), turned.to()].map(|vertex| vertex.fix());
            return start_of.get(&ends).copied();
        }
        turned = turned.rev().next();
        if turned == edge {
            return None;
        }
    }
}

/// The triangulation refuses coordinates that are tiny and not zero.
fn small_to_zero(value: f64) -> f64 {
    if value.abs() < spade::MIN_ALLOWED_VALUE {
        0.0
    } else {
        value
    }
}
