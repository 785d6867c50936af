//! An indexed mesh from triangles whose neighbours are known: components, and non-manifold edges and vertices.
//!
//! Triangles are connected with the neighbours that bound the same wedge of free space ([`across`](super::repair::across)); the
//! corners that remain connected around a vertex form one fan. Two edges of one fan may still have the same ends; all but one of
//! them are split at their midpoints. Of some triangles a [part](TrianglePart) is exported: it has one or two of the edges.
//!
//! Nothing here knows tetrahedra: triangles may come from several parts of a scene.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::delta::rotate_smallest_first;
use super::extract::{ExportOptions, IndexedMesh};
use super::incremental::TriangleRole;
use super::part::{TrianglePart, VertexOrigin};
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
    /// What is exported of each: `None` for all of it.
    parts: Vec<Option<TrianglePart>>,
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
        keep(&mut self.parts, is_kept);
        keep(&mut self.copies, is_kept);
        keep(&mut self.edges, is_kept);
    }

    /// The corners in use, with their copies.
    fn corners(&self) -> impl Iterator<Item = (u32, u32)> + Clone + '_ {
        let triangles = self.triangles.iter().zip(&self.copies).zip(&self.parts);
        triangles.flat_map(|((triangle, copies), part)| {
            let is_used = move |k: &usize| part.is_none_or(|part| part.has_corner(*k));
            (0..3).filter(is_used).map(|k| (triangle[k], copies[k]))
        })
    }

    /// The points inside triangles of which a part is exported, as triangles, in lexicographic order.
    fn points_inside(&self, surface: &RankedSurface) -> Vec<(Point3<f64>, u32)> {
        let point = |(index, part): (u32, &Option<TrianglePart>)| {
            let corners = self.triangles[index as usize];
            let corners = corners.map(|rank| Point3::from(surface.positions[rank as usize]));
            Some((part.as_ref()?.point(&corners), index))
        };
        let mut points: Vec<_> = (0..).zip(&self.parts).filter_map(point).collect();
        points.sort_by(|(a, _), (b, _)| {
            let orders = a.iter().zip(b.iter()).map(|(a, b)| a.total_cmp(b));
            orders.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        });
        points
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

/// The mesh of the triangles that have a role in it and belong to a component that is large enough; `roles` has an entry for each
/// triangle: those that are ignored count for components as well. Also returns for each vertex of the mesh what it is, by ranks of
/// positions. The filter of long edges is not applied here.
pub fn assemble(
    surface: &RankedSurface,
    roles: &[TriangleRole],
    options: &ExportOptions,
) -> (IndexedMesh, Vec<VertexOrigin<u32>>) {
    let roles = joined_roles(surface, roles, options);
    let patch = split_into_manifold(surface, &roles, options);
    let corners = Buckets::new(surface.positions.len(), patch.corners());
    let mut origins: Vec<VertexOrigin<u32>> = corners
        .iter()
        .map(|(rank, _)| VertexOrigin::Vertex(rank))
        .collect();
    let mut mesh = IndexedMesh {
        vertices: corners
            .iter()
            .map(|(rank, _)| Point3::from(surface.positions[rank as usize]))
            .collect(),
        triangles: Vec::with_capacity(patch.triangles.len()),
    };
    let mut inside: Vec<u32> = vec![0; patch.triangles.len()];
    for (point, index) in patch.points_inside(surface) {
        inside[index as usize] = mesh.vertices.len() as u32;
        mesh.vertices.push(point);
        let (corners, part) = (patch.triangles[index as usize], patch.parts[index as usize]);
        origins.push(
            part.map_or(VertexOrigin::Middle, |part| VertexOrigin::Inside {
                corners,
                part,
            }),
        );
    }
    let index = |rank: u32, copy: u32| {
        let number = corners.number(rank, copy);
        number.expect("every corner has been listed")
    };
    let mut edges: Vec<[u32; 3]> = Vec::with_capacity(patch.triangles.len());
    // Edges of parts that end inside a triangle have numbers of their own.
    let mut spoke = 3 * surface.triangles.len() as u32;
    for (at, triangle) in patch.triangles.iter().enumerate() {
        let (copies, numbers) = (patch.copies[at], patch.edges[at]);
        let corner = |k: usize| index(triangle[k % 3], copies[k % 3]);
        let Some(part) = patch.parts[at] else {
            mesh.triangles.push([0, 1, 2].map(corner));
            edges.push(numbers);
            continue;
        };
        for k in (0..3).filter(|k| part.edges[*k]) {
            mesh.triangles.push([corner(k), corner(k + 1), inside[at]]);
            let [from, to] = [k, (k + 1) % 3].map(|k| spoke + k as u32);
            edges.push([numbers[k], to, from]);
        }
        spoke += 3;
    }
    if options.manifold {
        split_repeated_edges(&mut mesh, &edges);
        origins.resize(mesh.vertices.len(), VertexOrigin::Middle);
    }
    for triangle in &mut mesh.triangles {
        *triangle = rotate_smallest_first(*triangle);
    }
    mesh.triangles.sort_unstable();
    (mesh, origins)
}

/// The roles as those of the neighbours allow: gaps are filled, and parts have the edges with a whole triangle on the other side.
fn joined_roles(
    surface: &RankedSurface,
    roles: &[TriangleRole],
    options: &ExportOptions,
) -> Vec<TriangleRole> {
    if !options.needs_neighbors() {
        let alone = roles.iter().map(|role| role.beside_whole([false; 3]));
        return alone.collect();
    }
    let is_whole = |neighbor: u32| roles.get(neighbor as usize) == Some(&TriangleRole::Exported);
    (surface.neighbors.iter().zip(roles))
        .map(|(neighbors, role)| match neighbors.map(is_whole) {
            [true, true, true] if options.fill_gaps => TriangleRole::Exported,
            is_beside_whole => role.beside_whole(is_beside_whole),
        })
        .collect()
}

/// Drops small components and unwanted triangles, and assigns copies of vertices. Components are those of all triangles, the
/// unwanted included.
fn split_into_manifold(
    surface: &RankedSurface,
    roles: &[TriangleRole],
    options: &ExportOptions,
) -> SurfacePatch {
    let triangles = &surface.triangles;
    let mut patch = SurfacePatch {
        triangles: triangles.clone(),
        parts: roles.iter().map(TriangleRole::part).collect(),
        copies: vec![[0; 3]; triangles.len()],
        edges: (0..triangles.len() as u32)
            .map(|index| [3 * index, 3 * index + 1, 3 * index + 2])
            .collect(),
    };
    let is_wanted = roles.iter().map(TriangleRole::is_exported);
    if !options.needs_neighbors() {
        patch.keep(&is_wanted.collect::<Vec<_>>());
        return patch;
    }
    let mut connected = connect(surface, |index, edge| roles[index as usize].has_edge(edge));
    if patch.parts.iter().any(Option::is_some) {
        name_by_whole_triangles(surface, roles, &mut connected);
    }
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
            is_wanted && sizes[component as usize] >= options.minimum_component
        })
        .collect();
    drop((components, sizes));
    patch.keep(&is_kept);
    patch
}

/// Names fans and edges by their whole triangles alone; each has one. So names do not depend on corners that are not exported.
fn name_by_whole_triangles(
    surface: &RankedSurface,
    roles: &[TriangleRole],
    connected: &mut Connectivity,
) {
    let mut first = vec![u32::MAX; 3 * roles.len()];
    for (index, role) in roles.iter().enumerate() {
        for k in (0..3).filter(|_| *role == TriangleRole::Exported) {
            let first = &mut first[connected.fans[index][k] as usize];
            *first = (3 * index + k).min(*first as usize) as u32;
        }
    }
    for fan in connected.fans.iter_mut().flatten() {
        *fan = first[*fan as usize];
    }
    for (index, role) in roles.iter().enumerate() {
        let Some(part) = role.part() else { continue };
        for k in (0..3).filter(|k| part.edges[*k]) {
            let other = surface.neighbors[index][k] as usize;
            let end = surface.triangles[index][(k + 1) % 3];
            let corner = surface.triangles[other].iter().position(|it| *it == end);
            let corner = corner.expect("neighbours share the edge");
            let name = (3 * other + corner) as u32;
            connected.edges[index][k] = name;
            connected.edges[other][corner] = name;
        }
    }
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

/// Connects triangles with their neighbours: all of them to components, where both have the edge between them also to fans and edges.
/// `has_edge` says whether the edge that starts at a corner of a triangle is exported.
pub fn connect(surface: &RankedSurface, has_edge: impl Fn(u32, usize) -> bool) -> Connectivity {
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
            let corner_of = |vertex: u32| {
                let corner = triangles[other as usize].iter().position(|&v| v == vertex);
                3 * other + corner.expect("neighbours share the edge") as u32
            };
            // The neighbour has the edge in the other direction.
            if !(has_edge(index, k) && has_edge(other, (corner_of(b) - 3 * other) as usize)) {
                continue;
            }
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
