//! The lines between regions.

use nalgebra::Point3;

use super::edges::{Neighbors, ends};
use super::regions::Regions;

/// A line of border edges between the same regions, from junction to junction or round.
pub(super) struct Border {
    /// Its vertices from end to end; of a round one the first is repeated at the end.
    pub(super) vertices: Vec<u32>,
    /// Positions in `vertices` that stay when it is simplified, first and last included.
    pub(super) kept: Vec<u32>,
}

/// All borders of a mesh.
pub(super) struct Borders {
    pub(super) borders: Vec<Border>,
    /// The borders of each region, each with whether the region runs through it backwards. A region on both sides has it
    /// twice.
    pub(super) of_region: Vec<Vec<(u32, bool)>>,
}

/// A border edge, by the lower and the higher of its vertices.
struct BorderEdge {
    low: u32,
    high: u32,
    /// Regions that run through it upwards, then those that run downwards: what must be equal along a border.
    sides: [Vec<u32>; 2],
}

impl BorderEdge {
    /// Regions that run through it away from one of its vertices, then those that run towards it.
    fn sides_from(&self, vertex: u32) -> [&[u32]; 2] {
        let [up, down] = &self.sides;
        if vertex == self.low {
            [up, down]
        } else {
            [down, up]
        }
    }
}

/// Finds the borders and the vertices that they can do without: those nearer than `reach` to the straight line between the
/// vertices that stay.
pub(super) fn find(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    neighbors: &Neighbors,
    regions: &Regions,
    reach: f64,
) -> Borders {
    let edges = border_edges(triangles, neighbors, regions);
    // Edges at each vertex.
    let mut at_vertex: Vec<(u32, u32)> = edges
        .iter()
        .enumerate()
        .flat_map(|(index, edge)| [(edge.low, index as u32), (edge.high, index as u32)])
        .collect();
    at_vertex.sort_unstable();
    let edges_at = |vertex: u32| {
        let from = at_vertex.partition_point(|(v, _)| *v < vertex);
        let to = at_vertex.partition_point(|(v, _)| *v <= vertex);
        &at_vertex[from..to]
    };
    // The edge that goes on at a vertex where nothing but one border passes.
    let next_edge = |arrived_by: u32, vertex: u32| -> Option<u32> {
        let [(_, a), (_, b)] = *edges_at(vertex) else {
            return None;
        };
        let other = if a == arrived_by { b } else { a };
        let [ahead, behind] = edges[other as usize].sides_from(vertex);
        let [back_ahead, back_behind] = edges[arrived_by as usize].sides_from(vertex);
        (ahead == back_behind && behind == back_ahead).then_some(other)
    };
    let mut is_taken = vec![false; edges.len()];
    let mut found = Borders {
        borders: Vec::new(),
        of_region: vec![Vec::new(); regions.planes.len()],
    };
    let mut walk = |start: u32, first: u32, is_taken: &mut Vec<bool>| {
        let mut vertices = vec![start];
        let (mut vertex, mut edge) = (start, first);
        loop {
            is_taken[edge as usize] = true;
            let BorderEdge { low, high, .. } = edges[edge as usize];
            vertex = if vertex == low { high } else { low };
            vertices.push(vertex);
            match next_edge(edge, vertex) {
                Some(next) if !is_taken[next as usize] => edge = next,
                _ => break,
            }
        }
        let name = found.borders.len() as u32;
        let [forward, backward] = edges[first as usize].sides_from(start);
        for region in forward {
            found.of_region[*region as usize].push((name, false));
        }
        for region in backward {
            found.of_region[*region as usize].push((name, true));
        }
        let kept = needed(positions, &vertices, reach);
        found.borders.push(Border { vertices, kept });
    };
    // From junctions first; what is left goes round.
    for (index, edge) in edges.iter().enumerate() {
        for start in [edge.low, edge.high] {
            if !is_taken[index] && next_edge(index as u32, start).is_none() {
                walk(start, index as u32, &mut is_taken);
            }
        }
    }
    for (index, edge) in edges.iter().enumerate() {
        if !is_taken[index] {
            walk(edge.low, index as u32, &mut is_taken);
        }
    }
    found
}

fn border_edges(
    triangles: &[[u32; 3]],
    neighbors: &Neighbors,
    regions: &Regions,
) -> Vec<BorderEdge> {
    let mut uses: Vec<(u32, u32, bool, u32)> = (0..3 * triangles.len() as u32)
        .filter(|edge| {
            let own = regions.of[*edge as usize / 3];
            neighbors
                .across(*edge)
                .is_none_or(|other| regions.of[other as usize] != own)
        })
        .map(|edge| {
            let (from, to) = ends(triangles, edge);
            let region = regions.of[edge as usize / 3];
            (from.min(to), from.max(to), from > to, region)
        })
        .collect();
    uses.sort_unstable();
    uses.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .map(|group| {
            let side = |is_downward| {
                group
                    .iter()
                    .filter(|u| u.2 == is_downward)
                    .map(|u| u.3)
                    .collect()
            };
            BorderEdge {
                low: group[0].0,
                high: group[0].1,
                sides: [side(false), side(true)],
            }
        })
        .collect()
}

/// The positions in a line of vertices that stay.
///
/// # Reference
/// D. Douglas and T. Peucker, *Algorithms for the reduction of the number of points required to represent a digitized
/// line*, Cartographica 10(2), 1973. *Differs from the paper*: distances go to the segment, not to its line; a round
/// line is parted at the vertex farthest from its start and keeps at least a triangle.
fn needed(positions: &[Point3<f64>], vertices: &[u32], reach: f64) -> Vec<u32> {
    let at = |index: usize| positions[vertices[index] as usize];
    let last = vertices.len() - 1;
    let mut stays = vec![false; vertices.len()];
    stays[0] = true;
    stays[last] = true;
    let mut open = Vec::new();
    if vertices[0] == vertices[last] && last >= 3 {
        let farthest = farthest_from(&at, 0, last, |p| (p - at(0)).norm_squared());
        stays[farthest.0] = true;
        let (a, b) = (at(0), at(farthest.0));
        let aside = (1..last)
            .filter(|index| *index != farthest.0)
            .map(|index| (index, to_segment(&at(index), &a, &b)))
            .max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)));
        if let Some((third, _)) = aside {
            stays[third] = true;
        }
        let mut fixed: Vec<usize> = (0..=last).filter(|index| stays[*index]).collect();
        fixed.dedup();
        open.extend(fixed.windows(2).map(|pair| (pair[0], pair[1])));
    } else {
        open.push((0, last));
    }
    while let Some((from, to)) = open.pop() {
        if to - from < 2 {
            continue;
        }
        let (a, b) = (at(from), at(to));
        let (index, distance) = farthest_from(&at, from, to, |p| to_segment(p, &a, &b));
        if distance > reach * reach {
            stays[index] = true;
            open.extend([(from, index), (index, to)]);
        }
    }
    (0..=last as u32)
        .filter(|index| stays[*index as usize])
        .collect()
}

/// The vertex strictly between two positions whose measure is largest, the first of equals.
fn farthest_from(
    at: &impl Fn(usize) -> Point3<f64>,
    from: usize,
    to: usize,
    measure: impl Fn(&Point3<f64>) -> f64,
) -> (usize, f64) {
    let mut best = (from + 1, f64::NEG_INFINITY);
    for index in from + 1..to {
        let value = measure(&at(index));
        if value > best.1 {
            best = (index, value);
        }
    }
    best
}

/// Squared distance of a point from a segment.
fn to_segment(point: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let along = b - a;
    let length = along.norm_squared();
    let t = if length > 0.0 {
        ((point - a).dot(&along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (point - (a + along * t)).norm_squared()
}
