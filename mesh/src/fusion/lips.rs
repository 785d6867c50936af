//! Slits along segments. Where depth is missing beside a crease or a line on a surface, the boundaries on both sides of the gap move onto the segment and lie
//! on each other.

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::segments::{LEAST_COSINE, Rim, boundary, open_corners};
use super::sheets::separate;
use crate::TriangleMesh;
use crate::edge_uses::for_each_edge;

/// Vertices of two lips are joined this close to each other along their segment, in sides.
const REACH_SIDES: f64 = 0.75;
/// A boundary that moved further than this away from its own surface lies behind the segment, in sides.
const AWAY_SIDES: f64 = 0.75;

/// A vertex of a boundary on a segment.
struct Station {
    segment: u32,
    /// Distance from the start of the segment.
    along: f64,
    vertex: u32,
    /// Whether the boundary runs as the segment does.
    is_forwards: bool,
}

/// Joins boundaries that run along one segment in opposite directions: each vertex of one with the nearest of the other, which stays where it is. No
/// triangle is added; those that lose their area go.
///
/// `segment_of` has the segments of the vertices that lie on one, `away` how far vertices of the boundary moved there along the normals of their own
/// surface. Vertices are numbered anew.
///
/// # Complexity
/// O(n log n) in triangles.
pub(super) fn join_lips(
    mesh: &mut TriangleMesh,
    segments: &[[Point3<f64>; 2]],
    segment_of: &FxHashMap<u32, u32>,
    away: &FxHashMap<u32, f64>,
    side: f64,
) {
    let station = |(vertex, rim): (&u32, &Rim)| {
        let segment = *segment_of.get(vertex)?;
        let [from, to] = segments[segment as usize];
        let direction = (to - from).normalize();
        let cosine = rim.along.dot(&direction);
        let is_along = cosine != 0.0 && cosine.abs() >= LEAST_COSINE * rim.along.norm();
        let is_on_surface = away.get(vertex)?.abs() <= AWAY_SIDES * side;
        (is_along && is_on_surface).then(|| Station {
            segment,
            along: (mesh.positions[*vertex as usize] - from).dot(&direction),
            vertex: *vertex,
            is_forwards: cosine > 0.0,
        })
    };
    let mut stations: Vec<Station> = boundary(mesh, &open_corners(mesh))
        .iter()
        .filter_map(station)
        .collect();
    stations.sort_unstable_by(|a, b| {
        let by_place = a.along.total_cmp(&b.along).then(a.vertex.cmp(&b.vertex));
        a.segment.cmp(&b.segment).then(by_place)
    });
    let mut joined: FxHashMap<u32, u32> = FxHashMap::default();
    for along_one in stations.chunk_by(|a, b| a.segment == b.segment) {
        let (forwards, backwards): (Vec<&Station>, Vec<&Station>) =
            along_one.iter().partition(|it| it.is_forwards);
        for station in backwards {
            let after = forwards.partition_point(|it| it.along < station.along);
            let nearest = [after.checked_sub(1), Some(after)]
                .into_iter()
                .filter_map(|at| forwards.get(at?))
                .map(|it| ((it.along - station.along).abs(), it.vertex))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, vertex)) = nearest.filter(|(apart, _)| *apart <= REACH_SIDES * side) {
                joined.insert(station.vertex, vertex);
            }
        }
    }
    let triangles = without_overused_edges(mesh, &mut joined);
    if joined.is_empty() {
        return;
    }
    // A vertex at which fans of triangles meet has a copy for each.
    let positions = std::mem::take(&mut mesh.positions);
    (mesh.positions, mesh.triangles) = separate(positions, triangles, 1);
}

/// The triangles with joined vertices. Vertices are not joined where an edge would have more than two triangles, or two in the same direction, as
/// where three lips meet.
fn without_overused_edges(mesh: &TriangleMesh, joined: &mut FxHashMap<u32, u32>) -> Vec<[u32; 3]> {
    loop {
        let after = |corner: u32| joined.get(&corner).copied().unwrap_or(corner);
        let mut triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|it| it.map(after)).collect();
        triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        let from = |corner: u32| triangles[corner as usize / 3][corner as usize % 3];
        let mut overused: FxHashSet<u32> = FxHashSet::default();
        for_each_edge(&triangles, mesh.positions.len(), |ends, uses| {
            let is_fine = match uses {
                [_] => true,
                [a, b] => from(*a) != from(*b),
                _ => false,
            };
            if !is_fine {
                overused.extend(ends);
            }
        });
        let count = joined.len();
        joined.retain(|vertex, kept| !overused.contains(vertex) && !overused.contains(kept));
        if joined.len() == count {
            return triangles;
        }
    }
}
