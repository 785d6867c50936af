//! Vertices on 3D line segments. A grid rounds edges by up to a cube, and its surface ends anywhere in the last one. Where the images show a
//! segment along an edge or a boundary of the surface, the vertices belong there.

use std::iter::successors;

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;

use super::corners::move_to_corners;
use super::grid::Corner;
use super::lips::join_lips;
use crate::TriangleMesh;
use crate::edge_uses::for_each_edge;
use crate::flat_vertices;
use crate::holes::close_bays;

/// Vertices of a boundary move to segments at most this many sides away: depth ends up to two cubes before an edge that few views see.
const REACH_SIDES: f64 = 2.5;
/// The same for moves into the surface: the other boundary of a narrow strip stays where it is.
const INWARD_REACH_SIDES: f64 = 0.75;
/// Cubes around that of a vertex in which segments are looked for, on either side.
const REACH_CUBES: usize = 2;
/// Least cosine between a boundary and a segment along it: 60 degrees, as boundaries follow the grid in steps.
pub(super) const LEAST_COSINE: f64 = 0.5;
/// Share of the vertices along a segment that lie on an edge or a boundary. Segments with fewer are texture.
const LEAST_SHARE: f64 = 0.3;
/// Least doubled area of a triangle with two edges on the boundary over the sum of its squared sides.
const LEAST_EAR: f64 = 1e-3;
/// How often vertices beside those on segments move to the mean of their neighbours.
const UNROUNDING_ROUNDS: usize = 3;

/// The part of a segment in a cube.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub(super) segment: u32,
    /// Share of the segment before the middle of the part.
    share: f64,
}

impl Part {
    pub(super) fn middle(&self, segments: &[[Point3<f64>; 2]]) -> Point3<f64> {
        let [from, to] = segments[self.segment as usize];
        from + self.share * (to - from)
    }
}

/// Bays of the boundary between vertices on one line are closed up to this width, in sides.
const WIDEST_BAY_SIDES: f64 = 4.0;
/// Most edges of such a bay.
const LARGEST_BAY_EDGES: usize = 12;
/// Vertices on two segments are on one line if each lies this close to the other's, in sides.
const SAME_LINE_SIDES: f64 = 0.25;

/// Moves vertices of a surface with cubes of this side onto segments: the vertex of each cube that a segment crosses to the middle of the part in
/// that cube, and vertices of boundaries to the nearest point of a segment along them, or to the corner of two. Their neighbours follow. Where a boundary leaves a segment and comes back to it soon,
/// the surface is continued up to the segment; where two boundaries lie on one segment, they are joined. Of several segments in a cube the longest counts. Segments
/// on flat surfaces do not count.
///
/// # Complexity
/// Expected linear in vertices, triangles and crossed cubes, and O(n log n) for the edges.
pub(super) fn snap(mesh: &mut TriangleMesh, segments: &[[Point3<f64>; 2]], side: f64) {
    // Made anew: those of the outlines would be the peak of memory if they were kept up to here.
    let parts = parts_by_cube(segments, side);
    if parts.is_empty() {
        return;
    }
    // The vertex of each cube that is nearest to its part.
    let mut vertices: FxHashMap<Corner, (f64, u32)> = FxHashMap::default();
    for (vertex, position) in (0..).zip(&mesh.positions) {
        let Some(cube) = Corner::below(position, side) else {
            continue;
        };
        if let Some(part) = parts.get(&cube) {
            let found = ((part.middle(segments) - position).norm_squared(), vertex);
            let nearest = vertices.entry(cube).or_insert(found);
            if found.0 < nearest.0 {
                *nearest = found;
            }
        }
    }
    let open = open_corners(mesh);
    let boundary = boundary(mesh, &open);
    let is_flat = flat_vertices(mesh);
    let mut counts = vec![[0_u32; 2]; segments.len()];
    for (cube, (_, vertex)) in &vertices {
        let is_plain = is_flat[*vertex as usize] && !boundary.contains_key(vertex);
        counts[parts[cube].segment as usize][usize::from(is_plain)] += 1;
    }
    let mut segment_of = FxHashMap::default();
    // How far vertices of the boundary move along the normals of the surface.
    let mut away: FxHashMap<u32, f64> = FxHashMap::default();
    for (cube, (_, vertex)) in &vertices {
        let part = parts[cube];
        let [edge, plain] = counts[part.segment as usize].map(f64::from);
        if edge >= LEAST_SHARE * (edge + plain) {
            let position = &mut mesh.positions[*vertex as usize];
            let middle = part.middle(segments);
            if let Some(rim) = boundary.get(vertex) {
                away.insert(*vertex, rim.normal().dot(&(middle - *position)));
            }
            *position = middle;
            segment_of.insert(*vertex, part.segment);
        }
    }
    for (vertex, rim) in &boundary {
        if segment_of.contains_key(vertex) {
            continue;
        }
        let position = &mut mesh.positions[*vertex as usize];
        if let Some((nearest, segment)) = rim.nearest_along(position, segments, &parts, side) {
            away.insert(*vertex, rim.normal().dot(&(nearest - *position)));
            *position = nearest;
            segment_of.insert(*vertex, segment);
        }
    }
    move_to_corners(mesh, &open, segments, &mut segment_of, side);
    unround(mesh, &segment_of, &boundary);
    remove_flattened_ears(mesh, &open);
    let apart = |mesh: &TriangleMesh, vertex: u32, segment: u32| {
        let [from, to] = segments[segment as usize];
        let along = (to - from).normalize();
        let offset = mesh.positions[vertex as usize] - from;
        (offset - along.dot(&offset) * along).norm()
    };
    let is_same = |mesh: &TriangleMesh, [(a, line), (b, other)]: [(u32, u32); 2]| {
        let reach = SAME_LINE_SIDES * side;
        apart(mesh, b, line) <= reach && apart(mesh, a, other) <= reach
    };
    close_bays(
        mesh,
        &segment_of,
        is_same,
        LARGEST_BAY_EDGES,
        WIDEST_BAY_SIDES * side,
    );
    join_lips(mesh, segments, &segment_of, &away, side);
}

/// The part of the longest segment in each cube that segments cross.
pub(super) fn parts_by_cube(segments: &[[Point3<f64>; 2]], side: f64) -> FxHashMap<Corner, Part> {
    let squared_length = |segment: u32| {
        let [from, to] = &segments[segment as usize];
        (to - from).norm_squared()
    };
    let mut parts: FxHashMap<Corner, Part> = FxHashMap::default();
    let mut cuts = Vec::new();
    for (segment, ends) in (0..).zip(segments) {
        // Far away, or not finite.
        if ends.iter().any(|end| Corner::below(end, side).is_none()) {
            continue;
        }
        let [from, to] = ends;
        let along = to - from;
        cuts.clear();
        cuts.extend([0.0, 1.0]);
        for axis in 0..3 {
            let (low, high) = (from[axis].min(to[axis]), from[axis].max(to[axis]));
            let planes = (low / side).ceil() as i64..=(high / side).floor() as i64;
            let cut = |plane| (plane as f64 * side - from[axis]) / along[axis];
            cuts.extend(planes.map(cut).filter(|cut| (0.0..=1.0).contains(cut)));
        }
        cuts.sort_unstable_by(f64::total_cmp);
        for pair in cuts.windows(2).filter(|pair| pair[0] < pair[1]) {
            let share = 0.5 * (pair[0] + pair[1]);
            let Some(cube) = Corner::below(&(from + share * along), side) else {
                continue;
            };
            let part = Part { segment, share };
            let longest = parts.entry(cube).or_insert(part);
            if squared_length(longest.segment) < squared_length(segment) {
                *longest = part;
            }
        }
    }
    parts
}

/// The boundary at a vertex.
#[derive(Default)]
pub(super) struct Rim {
    /// Along the boundary.
    pub(super) along: Vector3<f64>,
    /// Away from the surface.
    outward: Vector3<f64>,
}

/// The corners where edges with one triangle begin.
pub(super) fn open_corners(mesh: &TriangleMesh) -> Vec<u32> {
    let mut open = Vec::new();
    for_each_edge(&mesh.triangles, mesh.positions.len(), |_, corners| {
        if let &[corner] = corners {
            open.push(corner);
        }
    });
    open
}

/// The vertices on edges with one triangle, which begin at `open` corners.
pub(super) fn boundary(mesh: &TriangleMesh, open: &[u32]) -> FxHashMap<u32, Rim> {
    let mut boundary: FxHashMap<u32, Rim> = FxHashMap::default();
    for &corner in open {
        let corners = mesh.triangles[corner as usize / 3];
        // The triangle from the corner where the edge begins: it lies to the left of the edge.
        let vertices = [0, 1, 2].map(|step| corners[(corner as usize + step) % 3]);
        let [from, to, opposite] = vertices.map(|vertex| mesh.positions[vertex as usize]);
        let along = to - from;
        let outward = along.cross(&along.cross(&(opposite - from)));
        for end in &vertices[..2] {
            let rim = boundary.entry(*end).or_default();
            rim.along += along;
            rim.outward += outward.try_normalize(0.0).unwrap_or_default();
        }
    }
    boundary
}

/// Removes triangles of the boundary that lost their area, with all corners on a segment. Edges with one triangle begin at `open` corners.
fn remove_flattened_ears(mesh: &mut TriangleMesh, open: &[u32]) {
    let mut open_edges = vec![0_u8; mesh.triangles.len()];
    for corner in open {
        open_edges[*corner as usize / 3] += 1;
    }
    let positions = &mesh.positions;
    let mut open_edges = open_edges.into_iter();
    mesh.triangles.retain(|triangle| {
        let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
        let squares = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
        let is_ear = open_edges.next().is_some_and(|count| count >= 2);
        !is_ear || (b - a).cross(&(c - a)).norm() > LEAST_EAR * squares
    });
}

/// Moves the vertices beside those on segments, which the grid has rounded with the edge, to the mean of their neighbours, again and again. Vertices
/// on segments and of the boundary stay, so that the surface on either side of an edge leads straight to it.
fn unround(
    mesh: &mut TriangleMesh,
    segment_of: &FxHashMap<u32, u32>,
    boundary: &FxHashMap<u32, Rim>,
) {
    let mut sums: FxHashMap<u32, (Vector3<f64>, f64)> = FxHashMap::default();
    for triangle in &mesh.triangles {
        if !triangle.iter().any(|it| segment_of.contains_key(it)) {
            continue;
        }
        for vertex in triangle {
            if !segment_of.contains_key(vertex) && !boundary.contains_key(vertex) {
                sums.insert(*vertex, (Vector3::zeros(), 0.0));
            }
        }
    }
    let is_around = |triangle: &&[u32; 3]| triangle.iter().any(|it| sums.contains_key(it));
    let around: Vec<[u32; 3]> = mesh.triangles.iter().filter(is_around).copied().collect();
    for _ in 0..UNROUNDING_ROUNDS {
        sums.values_mut()
            .for_each(|sum| *sum = (Vector3::zeros(), 0.0));
        for triangle in &around {
            let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize].coords);
            for (vertex, others) in triangle.iter().zip([b + c, c + a, a + b]) {
                if let Some((sum, count)) = sums.get_mut(vertex) {
                    *sum += others;
                    *count += 2.0;
                }
            }
        }
        for (vertex, (sum, count)) in &sums {
            mesh.positions[*vertex as usize] = Point3::from(sum / *count);
        }
    }
}

impl Rim {
    /// The unit normal of the surface; zero where it has none.
    fn normal(&self) -> Vector3<f64> {
        let normal = self.outward.cross(&self.along);
        normal.try_normalize(0.0).unwrap_or_default()
    }

    /// The nearest point on segments along the boundary that cross the cubes around a position of it, and its segment; `None` without one in reach.
    fn nearest_along(
        &self,
        position: &Point3<f64>,
        segments: &[[Point3<f64>; 2]],
        parts: &FxHashMap<Corner, Part>,
        side: f64,
    ) -> Option<(Point3<f64>, u32)> {
        let cube = Corner::below(position, side)?;
        let mut nearest = None;
        let mut least = (REACH_SIDES * side).powi(2);
        let row = |axis, corner: Corner| {
            let start = (0..REACH_CUBES).fold(corner, |corner, _| corner.previous(axis));
            successors(Some(start), move |corner| Some(corner.next(axis))).take(2 * REACH_CUBES + 1)
        };
        let around = row(0, cube)
            .flat_map(|it| row(1, it))
            .flat_map(|it| row(2, it));
        for part in around.filter_map(|cube| parts.get(&cube)) {
            let [from, to] = segments[part.segment as usize];
            let along = to - from;
            let share = (position - from).dot(&along) / along.norm_squared();
            let foot = from + share * along;
            let moved = foot - position;
            let inward = -moved.dot(&self.outward);
            if (0.0..=1.0).contains(&share)
                && self.along.dot(&along).abs() >= LEAST_COSINE * self.along.norm() * along.norm()
                && inward <= INWARD_REACH_SIDES * side * self.outward.norm()
                && moved.norm_squared() < least
            {
                (least, nearest) = (moved.norm_squared(), Some((foot, part.segment)));
            }
        }
        nearest
    }
}
