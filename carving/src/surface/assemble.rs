//! An indexed mesh from triangles whose neighbours are known: components, and non-manifold edges and vertices.
//!
//! Triangles are connected with the neighbours that bound the same wedge of free space ([`across`](super::repair::across)); the
//! corners that remain connected around a vertex form one fan. Two edges of one fan may still have the same ends; all but one of
//! them are split at their midpoints.
//!
//! Nothing here knows tetrahedra: triangles may come from several parts of a scene.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::delta::rotate_smallest_first;
use super::extract::{ExportOptions, IndexedMesh};
use crate::buckets::Buckets;

/// No neighbour across an edge.
pub const NO_NEIGHBOR: u32 = u32::MAX;

/// Corners of a triangle by the ranks of their positions, the smallest first, counter-clockwise seen from free space.
pub type RankedTriangle = [u32; 3];

/// Triangles with the neighbours across their edges.
#[derive(Clone, Debug, Default)]
pub struct RankedSurface {
    /// Positions in lexicographic order; their indices are ranks.
    pub positions: Vec<[f64; 3]>,
    /// Triangles in increasing order, each once.
    pub triangles: Vec<RankedTriangle>,
    /// For each triangle the triangles across its edges, which start at the corner of the same index; [`NO_NEIGHBOR`] at a
    /// border. Neighbours name each other. Not looked at without repair and components.
    pub neighbors: Vec<[u32; 3]>,
}

/// The triangles to be exported and their connectivity.
struct SurfacePatch {
    triangles: Vec<RankedTriangle>,
    /// For each corner the copy of its vertex; all 0 without repair.
    copies: Vec<[u32; 3]>,
    /// For each edge, which starts at the corner of the same index, a number that it shares with the edge of the
    /// neighbouring triangle only.
    edges: Vec<[u32; 3]>,
}

impl SurfacePatch {
    /// Drops triangles; `is_kept` has an entry for each.
    fn keep(&mut self, is_kept: &[bool]) {
        fn keep<T>(list: &mut Vec<T>, is_kept: &[bool]) {
            let mut is_kept = is_kept.iter();
            list.retain(|_| is_kept.next().copied().unwrap_or(false));
        }
        keep(&mut self.triangles, is_kept);
        keep(&mut self.copies, is_kept);
        keep(&mut self.edges, is_kept);
    }
}

/// Disjoint sets with the smallest member as representative.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn find(&mut self, mut member: u32) -> u32 {
        while self.0[member as usize] != member {
            let parent = self.0[member as usize];
            self.0[member as usize] = self.0[parent as usize];
            member = parent;
        }
        member
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        let (low, high) = (a.min(b), a.max(b));
        self.0[high as usize] = low;
    }
}

/// The mesh of the triangles that are wanted and belong to a component that is large enough; `is_wanted` has an entry for each
/// triangle. Also returns for each vertex of the mesh the rank of its position, `None` for the midpoints of split edges. The
/// filter of long edges is not applied here.
pub fn assemble(
    surface: &RankedSurface,
    is_wanted: &[bool],
    options: &ExportOptions,
) -> (IndexedMesh, Vec<Option<u32>>) {
    let filled = options.fill_gaps.then(|| without_gaps(surface, is_wanted));
    let is_wanted = filled.as_deref().unwrap_or(is_wanted);
    let mut patch = split_into_manifold(surface, is_wanted, options);
    let ranks = patch.triangles.iter().flatten().copied();
    let corners = ranks.zip(patch.copies.iter().flatten().copied());
    let corners = Buckets::new(surface.positions.len(), corners);
    let mut mesh = IndexedMesh {
        vertices: corners
            .iter()
            .map(|(rank, _)| Point3::from(surface.positions[rank as usize]))
            .collect(),
        triangles: Vec::with_capacity(patch.triangles.len()),
    };
    let index = |rank: u32, copy: u32| {
        let number = corners.number(rank, copy);
        number.expect("every corner has been listed")
    };
    let triangles = patch.triangles.iter().zip(&patch.copies);
    mesh.triangles.extend(
        triangles.map(|(triangle, copies)| [0, 1, 2].map(|k| index(triangle[k], copies[k]))),
    );
    (patch.triangles, patch.copies) = (Vec::new(), Vec::new());
    let mut ranks: Vec<Option<u32>> = corners.iter().map(|(rank, _)| Some(rank)).collect();
    if options.manifold {
        split_repeated_edges(&mut mesh, &patch.edges);
        ranks.resize(mesh.vertices.len(), None);
    }
    for triangle in &mut mesh.triangles {
        *triangle = rotate_smallest_first(*triangle);
    }
    mesh.triangles.sort_unstable();
    (mesh, ranks)
}

/// The wanted triangles, and those whose neighbours across all edges are wanted.
fn without_gaps(surface: &RankedSurface, is_wanted: &[bool]) -> Vec<bool> {
    let is_neighbor_wanted =
        |neighbor: &u32| is_wanted.get(*neighbor as usize).copied() == Some(true);
    (surface.neighbors.iter().zip(is_wanted))
        .map(|(neighbors, is_wanted)| *is_wanted || neighbors.iter().all(is_neighbor_wanted))
        .collect()
}

/// Drops small components and unwanted triangles, and assigns copies of vertices. Components are those of all triangles, the
/// unwanted included.
fn split_into_manifold(
    surface: &RankedSurface,
    is_wanted: &[bool],
    options: &ExportOptions,
) -> SurfacePatch {
    let triangles = &surface.triangles;
    let mut patch = SurfacePatch {
        triangles: triangles.clone(),
        copies: vec![[0; 3]; triangles.len()],
        edges: (0..triangles.len() as u32)
            .map(|index| [3 * index, 3 * index + 1, 3 * index + 2])
            .collect(),
    };
    if !options.needs_neighbors() {
        patch.keep(is_wanted);
        return patch;
    }
    let connected = connect(surface, |index| is_wanted[index as usize]);
    patch.edges = connected.edges;
    if options.manifold {
        patch.copies = connected.fans;
    }
    let components = connected.components;
    let mut sizes = vec![0usize; triangles.len()];
    for &component in &components {
        sizes[component as usize] += 1;
    }
    let is_kept: Vec<bool> = components
        .iter()
        .zip(is_wanted)
        .map(|(&component, is_wanted)| {
            *is_wanted && sizes[component as usize] >= options.minimum_component
        })
        .collect();
    drop((components, sizes));
    patch.keep(&is_kept);
    patch
}

/// How the triangles of a surface are connected, and their corners around each vertex.
#[derive(Clone, Debug, Default)]
pub struct Connectivity {
    /// For each corner its fan: the smallest `3 * triangle + corner` of the corners connected around the vertex.
    pub fans: Vec<[u32; 3]>,
    /// For each edge, which starts at the corner of the same index, the smaller `3 * triangle + edge` of the two that meet there.
    pub edges: Vec<[u32; 3]>,
    /// For each triangle the smallest triangle of its component.
    pub components: Vec<u32>,
}

/// Connects triangles with their neighbours: all of them to components, the wanted ones also to fans and edges.
pub fn connect(surface: &RankedSurface, is_wanted: impl Fn(u32) -> bool) -> Connectivity {
    let triangles = &surface.triangles;
    let mut components = Sets::new(triangles.len());
    let mut fans = Sets::new(3 * triangles.len());
    let mut edges: Vec<[u32; 3]> = (0..triangles.len() as u32)
        .map(|index| [3 * index, 3 * index + 1, 3 * index + 2])
        .collect();
    for (index, (triangle, neighbors)) in (0u32..).zip(triangles.iter().zip(&surface.neighbors)) {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let other = neighbors[k];
            if other == NO_NEIGHBOR {
                continue;
            }
            components.unite(index, other);
            if !(is_wanted(index) && is_wanted(other)) {
                continue;
            }
            let corner_of = |vertex: u32| {
                let corner = triangles[other as usize].iter().position(|&v| v == vertex);
                3 * other + corner.expect("neighbours share the edge") as u32
            };
            let edge = &mut edges[index as usize][k];
            *edge = corner_of(b).min(*edge);
            for (corner, vertex) in [(k, a), ((k + 1) % 3, b)] {
                fans.unite(3 * index + corner as u32, corner_of(vertex));
            }
        }
    }
    let all = 0..triangles.len() as u32;
    Connectivity {
        fans: (all.clone())
            .map(|index| [0, 1, 2].map(|k| fans.find(3 * index + k)))
            .collect(),
        edges,
        components: all.map(|index| components.find(index)).collect(),
    }
}

/// Splits edges at their midpoints where several of different number have the same ends, all but the first.
fn split_repeated_edges(mesh: &mut IndexedMesh, edges: &[[u32; 3]]) {
    let ends = (mesh.triangles.iter().zip(edges)).flat_map(|(triangle, numbers)| {
        [0, 1, 2].map(|k| {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            (a.min(b), (a.max(b), numbers[k]))
        })
    });
    let ends = Buckets::new(mesh.vertices.len(), ends);
    let mut midpoints: FxHashMap<u32, u32> = FxHashMap::default();
    for a in 0..mesh.vertices.len() as u32 {
        for pair in ends.of(a).windows(2) {
            let ((b, _), (c, number)) = (pair[0], pair[1]);
            if b == c {
                let middle =
                    nalgebra::center(&mesh.vertices[a as usize], &mesh.vertices[b as usize]);
                midpoints.insert(number, mesh.vertices.len() as u32);
                mesh.vertices.push(middle);
            }
        }
    }
    if midpoints.is_empty() {
        return;
    }
    let whole = std::mem::take(&mut mesh.triangles);
    for (triangle, numbers) in whole.into_iter().zip(edges) {
        let middle = numbers.map(|number| midpoints.get(&number).copied());
        // Vertices are sorted by position.
        let first = (0..3).min_by_key(|&k| triangle[k]).unwrap_or(0);
        cut_at_midpoints(triangle, middle, first, &mut mesh.triangles);
    }
}

/// Appends the parts of a triangle whose edges have the given vertices in their middle; the triangle itself when there are none.
///
/// `first` is the corner at the lexicographically smallest position: which parts two midpoints make must not depend on ids.
pub fn cut_at_midpoints(
    triangle: [u32; 3],
    middle: [Option<u32>; 3],
    first: usize,
    parts: &mut Vec<[u32; 3]>,
) {
    if middle == [None; 3] {
        parts.push(triangle);
        return;
    }
    // The boundary of the triangle with its midpoints, cut into ears at the midpoints.
    let mut boundary: Vec<(u32, bool)> = Vec::with_capacity(6);
    for k in [first, (first + 1) % 3, (first + 2) % 3] {
        boundary.push((triangle[k], false));
        boundary.extend(middle[k].map(|m| (m, true)));
    }
    while boundary.len() > 3 {
        // A corner between two other vertices of which one is a midpoint makes a triangle with them.
        let n = boundary.len();
        let ear = (0..n)
            .find(|&k| !boundary[k].1 && (boundary[(k + 1) % n].1 || boundary[(k + n - 1) % n].1));
        let Some(ear) = ear else { break };
        let [before, at, after] = [(ear + n - 1) % n, ear, (ear + 1) % n].map(|k| boundary[k].0);
        parts.push([before, at, after]);
        boundary.remove(ear);
    }
    parts.push([boundary[0].0, boundary[1].0, boundary[2].0]);
}
