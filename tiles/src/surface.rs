//! The surface triangles of a tile, with fans around its vertices and the parts of components that it sees.
//!
//! A triangle belongs to the tile of its corner with the lexicographically smallest position, an edge to that of its smaller end. All
//! cells around an end are cells of the tile, so it knows all triangles there, in the order that they have in the whole, and the
//! neighbours across their edges. That settles fans and their order, and all components that are large enough or wholly its own.

use linecarve_carving::internals::{
    NO_NEIGHBOR, RankedSurface, across_where, connect, has_edges_within, is_surface_where,
    rotate_smallest_first,
};
use linecarve_carving::{CellId, Tetrahedralization, VertexId};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::file::Writer;
use crate::giants::CellSums;
use crate::label::Labels;
use crate::split::by_position;
use crate::stage::{Counts, Item, counts};
use crate::surface_file::{IdTriangle, Place, Side, SurfacePart, SurfaceVertex};
use crate::tile::{TileCells, local_of, tile_of};
use crate::work::Work;

/// A facet of the surface with its free cell.
type Facet = (CellId, usize);

/// All triangles at vertices of the tile.
struct Around {
    tile: usize,
    /// Ids of the vertices by rank.
    ids: Vec<u64>,
    surface: RankedSurface,
}

impl Around {
    fn of(cells: &TileCells, work: &Work, item: Item, is_free: &[bool]) -> Self {
        let plan = work.plan();
        let (hull, longest) = (plan.carver.hull, plan.export.longest_edge);
        let tetrahedra = &cells.tetrahedra;
        let is_free = |cell: CellId| is_free[cell.index()];
        let mut facets: Vec<([VertexId; 3], Facet)> = Vec::new();
        for cell in tetrahedra.cells().filter(|&cell| cells.is_star(cell)) {
            for facet in 0..4 {
                let corners = corners(tetrahedra, cell, facet);
                let is_near = corners.iter().any(|&corner| cells.is_own(corner))
                    && is_surface_where(tetrahedra, is_free, hull, (cell, facet))
                    && longest.is_none_or(|most| has_edges_within(tetrahedra, &corners, most));
                if is_near {
                    facets.push((corners, (cell, facet)));
                }
            }
        }
        let mut ranks = vec![u32::MAX; tetrahedra.vertex_capacity()];
        let mut vertices: Vec<VertexId> = Vec::new();
        for corner in facets.iter().flat_map(|(corners, _)| corners) {
            if std::mem::replace(&mut ranks[corner.index()], 0) == u32::MAX {
                vertices.push(*corner);
            }
        }
        vertices.sort_unstable_by(|&a, &b| {
            by_position(tetrahedra.coordinates(a), tetrahedra.coordinates(b))
        });
        for (rank, vertex) in (0u32..).zip(&vertices) {
            ranks[vertex.index()] = rank;
        }
        let rank = |vertex: VertexId| ranks[vertex.index()];
        let mut keyed: Vec<([u32; 3], Facet)> = facets
            .into_iter()
            .map(|(corners, facet)| (rotate_smallest_first(corners.map(rank)), facet))
            .collect();
        keyed.sort_unstable_by_key(|(key, _)| *key);
        let triangles: Vec<[u32; 3]> = keyed.iter().map(|(key, _)| *key).collect();
        let mut neighbors = Vec::new();
        if plan.export.needs_neighbors() || plan.keeps_neighbors {
            let packed = |(cell, facet): Facet| cell.index() as u64 * 4 + facet as u64;
            let mut numbers: Vec<(u64, u32)> =
                keyed.iter().map(|(_, at)| packed(*at)).zip(0..).collect();
            numbers.sort_unstable();
            let across = |key: [u32; 3], at: Facet, k: usize| {
                let edge = [key[k], key[(k + 1) % 3]].map(|rank| vertices[rank as usize]);
                if !edge.iter().any(|&end| cells.is_own(end)) {
                    return NO_NEIGHBOR;
                }
                let other = across_where(tetrahedra, is_free, hull, at, edge).map(packed);
                // The neighbour may have been left out for a long edge.
                let found = other
                    .and_then(|other| numbers.binary_search_by_key(&other, |(at, _)| *at).ok());
                found.map_or(NO_NEIGHBOR, |found| numbers[found].1)
            };
            let of_triangle =
                |&(key, at): &([u32; 3], Facet)| [0, 1, 2].map(|k| across(key, at, k));
            neighbors = keyed.iter().map(of_triangle).collect();
        }
        let positions = vertices
            .iter()
            .map(|&vertex| *tetrahedra.coordinates(vertex));
        Self {
            tile: item.number,
            ids: vertices.iter().map(|&vertex| cells.id(vertex)).collect(),
            surface: RankedSurface {
                positions: positions.collect(),
                triangles,
                neighbors,
            },
        }
    }

    fn is_own(&self, rank: u32) -> bool {
        tile_of(self.ids[rank as usize]) == self.tile
    }

    fn key(&self, triangle: [u32; 3]) -> IdTriangle {
        triangle.map(|rank| self.ids[rank as usize])
    }
}

/// The number of the component of each triangle: 0 if it is large enough, [`TOO_SMALL`], or from 1 on what another tile may enlarge.
fn components(around: &Around, of: &[u32], least: usize) -> Vec<u32> {
    let triangles = &around.surface.triangles;
    let mut sizes = vec![0u32; triangles.len()];
    let mut is_open = vec![false; triangles.len()];
    for (triangle, &component) in triangles.iter().zip(of) {
        sizes[component as usize] += 1;
        is_open[component as usize] |= !triangle.iter().all(|&rank| around.is_own(rank));
    }
    let mut numbers = vec![0u32; triangles.len()];
    let mut next = 0;
    for (index, number) in numbers.iter_mut().enumerate() {
        if of[index] as usize == index && (sizes[index] as usize) < least {
            *number = match is_open[index] {
                true => {
                    next += 1;
                    next
                }
                false => TOO_SMALL,
            };
        }
    }
    of.iter()
        .map(|&component| numbers[component as usize])
        .collect()
}

/// The component of triangles that are left out.
const TOO_SMALL: u32 = u32::MAX;

/// What the tile knows, in the form of its file.
fn part(around: &Around, least: usize, is_manifold: bool) -> SurfacePart {
    let surface = &around.surface;
    let triangles = &surface.triangles;
    let (mut fans, mut edges, mut numbers) = (Vec::new(), Vec::new(), vec![0; triangles.len()]);
    if !surface.neighbors.is_empty() {
        let connected = connect(surface, |_, _| true);
        numbers = components(around, &connected.components, least);
        (fans, edges) = match is_manifold {
            true => (connected.fans, connected.edges),
            false => (Vec::new(), Vec::new()),
        };
    }
    let fan = |index: usize, k: usize| fans.get(index).map_or(0, |fans| fans[k]);
    let used = || {
        let all = triangles.iter().zip(&numbers).enumerate();
        all.filter(|(_, (_, number))| **number != TOO_SMALL)
            .map(|(index, (triangle, number))| (index, *triangle, *number))
    };
    // One for each fan, or without fans for each component at a vertex.
    let mut copies: Vec<(u32, u32, u32)> = Vec::new();
    for (index, triangle, number) in used() {
        for (k, corner) in triangle.into_iter().enumerate() {
            let is_first = !is_manifold || fan(index, k) as usize == 3 * index + k;
            if is_first && around.is_own(corner) {
                copies.push((corner, fan(index, k), number));
            }
        }
    }
    copies.sort_unstable();
    copies.dedup();
    let mut part = SurfacePart::default();
    // Fans that are not the first of their vertex.
    let mut later: FxHashMap<u32, u32> = FxHashMap::default();
    let mut latest = (u32::MAX, 0, 0);
    for &(rank, fan, component) in &copies {
        latest = match latest.0 == rank {
            true => (rank, fan, latest.2 + u32::from(fan != latest.1)),
            false => (rank, fan, 0),
        };
        if latest.2 > 0 {
            later.insert(fan, latest.2);
        }
        part.vertices.push(SurfaceVertex {
            local: local_of(around.ids[rank as usize]) as u32,
            copy: latest.2,
            component,
            position: surface.positions[rank as usize],
        });
    }
    for (index, triangle, number) in used() {
        let ids = around.key(triangle);
        for (k, corner) in triangle.into_iter().enumerate() {
            let copy = later.get(&fan(index, k)).filter(|_| around.is_own(corner));
            part.fans.extend(copy.map(|&number| Place {
                triangle: ids,
                corner: k as u32,
                number,
            }));
        }
        if number > 0 {
            part.small.push((ids, number));
        }
        if around.is_own(triangle[0]) {
            part.triangles.push((ids, number));
        }
    }
    part.fans.sort_unstable();
    part.small.sort_unstable();
    part.repeated = match is_manifold {
        true => repeated(around, &fans, &edges),
        false => Vec::new(),
    };
    part
}

/// Edges with the same ends in the same fans, as far as the tile knows these: their sides, with the number of each edge among these.
/// It knows the fans of its own vertices, of which the smaller end is one.
fn repeated(around: &Around, fans: &[[u32; 3]], edges: &[[u32; 3]]) -> Vec<(Place, [f64; 3])> {
    let RankedSurface {
        positions,
        triangles,
        neighbors,
    } = &around.surface;
    // Fan of the smaller end; fan or rank of the larger one; the edge.
    let mut ends: Vec<(u32, (bool, u32), u32)> = Vec::new();
    for (index, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (low, high) = match triangle[k] < triangle[next] {
                true => (k, next),
                false => (next, k),
            };
            let is_first = edges[index][k] as usize == 3 * index + k;
            if is_first && around.is_own(triangle[low]) {
                let larger = match around.is_own(triangle[high]) {
                    true => (true, fans[index][high]),
                    false => (false, triangle[high]),
                };
                ends.push((fans[index][low], larger, edges[index][k]));
            }
        }
    }
    ends.sort_unstable();
    let mut repeated = Vec::new();
    for same in ends.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if same.len() == 1 {
            continue;
        }
        for (number, (.., edge)) in (0u32..).zip(same) {
            let (index, k) = (*edge as usize / 3, *edge as usize % 3);
            let ends = [triangles[index][k], triangles[index][(k + 1) % 3]];
            let [a, b] = ends.map(|rank| Point3::from(positions[rank as usize]));
            let midpoint = nalgebra::center(&a, &b).into();
            let place = |index: usize, k: usize| Place {
                triangle: around.key(triangles[index]),
                corner: k as u32,
                number,
            };
            repeated.push((place(index, k), midpoint));
            let other = neighbors[index][k];
            if other != NO_NEIGHBOR {
                let back = triangles[other as usize].iter().position(|&v| v == ends[1]);
                repeated.push((place(other as usize, back.unwrap_or(0)), midpoint));
            }
        }
    }
    repeated
}

/// Sides of edges of the tile where the neighbour is not just the other of two triangles.
fn sides(around: &Around) -> Vec<Side> {
    let RankedSurface {
        positions,
        triangles,
        neighbors,
    } = &around.surface;
    let all = (0..triangles.len()).flat_map(|index| [0, 1, 2].map(|k| (index, k)));
    let ends = |(index, k): (usize, usize)| {
        let (a, b) = (triangles[index][k], triangles[index][(k + 1) % 3]);
        [a.min(b), a.max(b)]
    };
    let mut own: Vec<([u32; 2], (usize, usize))> = all
        .map(|side| (ends(side), side))
        .filter(|([low, _], _)| around.is_own(*low))
        .collect();
    own.sort_unstable();
    let mut sides = Vec::new();
    for same in own.chunk_by(|a, b| a.0 == b.0) {
        for &([low, high], (index, k)) in same {
            let other = match same {
                [(_, (a, _)), (_, (b, _))] => (a + b - index) as u32,
                _ => NO_NEIGHBOR,
            };
            let neighbor = neighbors[index][k];
            if neighbor == other {
                continue;
            }
            let apex = triangles.get(neighbor as usize).and_then(|triangle| {
                let apex = triangle.iter().find(|rank| **rank != low && **rank != high);
                apex.map(|&rank| positions[rank as usize])
            });
            let corner = |n: usize| positions[triangles[index][(k + n) % 3] as usize];
            let apex = apex.unwrap_or([f64::NAN; 3]);
            sides.push([corner(0), corner(1), corner(2), apex]);
        }
    }
    sides
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let cells = TileCells::framed(work, item)?;
    let is_free = labels(work, item, &cells)?;
    let around = Around::of(&cells, work, item, &is_free);
    drop((cells, is_free));
    let export = &work.plan().export;
    let mut part = part(&around, export.minimum_component, export.manifold);
    if work.plan().keeps_neighbors {
        part.sides = sides(&around);
    }
    let mut writer = work.create_result(item)?;
    part.write(&mut writer)?;
    let counted = [
        ("triangles", part.triangles.len()),
        ("vertices", part.vertices.len()),
        ("corners_in_later_fans", part.fans.len()),
        ("sides_of_repeated_edges", part.repeated.len()),
        ("triangles_of_small_components", part.small.len()),
    ];
    Ok((writer, counts(counted)))
}

/// The corners of a facet as seen from inside its cell.
fn corners(tetrahedra: &Tetrahedralization, cell: CellId, facet: usize) -> [VertexId; 3] {
    let vertices = tetrahedra.cell_vertices(cell);
    Tetrahedralization::FACET[facet].map(|k| vertices[k])
}

/// Whether each cell around the tile's own points is free; false for all others.
fn labels(work: &Work, item: Item, cells: &TileCells) -> Result<Vec<bool>, TilesError> {
    let tetrahedra = &cells.tetrahedra;
    let stars = || {
        let stars = tetrahedra.cells().filter(|&cell| cells.is_star(cell));
        stars.filter_map(|cell| Some((cell, cells.key(cell)?)))
    };
    let missing = || TilesError::damaged(&work.path(item), "a cell without a label");
    let mut is_free = vec![false; tetrahedra.cell_capacity()];
    match work.plan().carver.labels {
        linecarve_carving::Labels::Votes(votes) => {
            let sums = CellSums::read(work, item, stars().map(|(_, key)| key).collect())?;
            for (cell, key) in stars() {
                let sum = sums.of(&key).ok_or_else(missing)?;
                is_free[cell.index()] = votes.is_free(sum[0]);
            }
        }
        linecarve_carving::Labels::Cut(_) => {
            let labels = Labels::read(work, item, stars().map(|(_, key)| key).collect())?;
            for (cell, key) in stars() {
                is_free[cell.index()] = labels.is_free(&key).ok_or_else(missing)?;
            }
        }
    }
    Ok(is_free)
}
