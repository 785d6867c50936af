//! The surface triangles of a tile, and the neighbours across edges that it knows.
//!
//! A triangle belongs to the tile of its first vertex, an edge to that of its own: all cells around are then cells of the tile.

use linecarve_carving::internals::{across_where, has_edges_within, is_surface_where};
use linecarve_carving::{CellId, Tetrahedralization, VertexId};

use crate::error::TilesError;
use crate::file::Writer;
use crate::giants::CellSums;
use crate::label::Labels;
use crate::split::by_position;
use crate::stage::{Counts, Item, counts};
use crate::tile::{NO_VERTEX, TileCells, tile_of};
use crate::work::Work;

/// A vertex of the surface with its position, as it goes to a file.
pub(crate) type SurfaceVertex = (u64, [f64; 3]);

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let cells = TileCells::framed(work, item)?;
    let is_free = labels(work, item, &cells)?;
    let plan = work.plan();
    let (hull, longest) = (plan.carver.hull, plan.export.longest_edge);
    let tetrahedra = &cells.tetrahedra;
    let is_free = |cell: CellId| is_free[cell.index()];
    let mut triangles: Vec<[u64; 5]> = Vec::new();
    let mut edges: Vec<[u64; 4]> = Vec::new();
    let mut vertices: Vec<SurfaceVertex> = Vec::new();
    for cell in tetrahedra.cells().filter(|&cell| cells.is_star(cell)) {
        for facet in 0..4 {
            let corners = corners(tetrahedra, cell, facet);
            let is_own = corners.iter().any(|&corner| cells.is_own(corner));
            if !is_own || !is_surface_where(tetrahedra, is_free, hull, (cell, facet)) {
                continue;
            }
            if longest.is_some_and(|longest| !has_edges_within(tetrahedra, &corners, longest)) {
                continue;
            }
            let corners = first_id_first(&cells, corners);
            let apex = |k: usize| {
                let edge = [corners[k], corners[(k + 1) % 3]];
                let at = across_where(tetrahedra, is_free, hull, (cell, facet), edge);
                at.map_or(NO_VERTEX, |(cell, facet)| {
                    let apex = self::corners(tetrahedra, cell, facet);
                    let apex = apex.into_iter().find(|corner| !edge.contains(corner));
                    apex.map_or(NO_VERTEX, |apex| cells.id(apex))
                })
            };
            let ids @ [a, b, c] = corners.map(|corner| cells.id(corner));
            if tile_of(a) == item.number {
                triangles.push([a, b, c, apex(0), apex(2)]);
            }
            if tile_of(b.min(c)) == item.number {
                edges.push([a, b, c, apex(1)]);
            }
            for (corner, id) in corners.into_iter().zip(ids) {
                if cells.is_own(corner) {
                    vertices.push((id, *tetrahedra.coordinates(corner)));
                }
            }
        }
    }
    triangles.sort_unstable();
    edges.sort_unstable();
    vertices.sort_unstable_by(|(_, a), (_, b)| by_position(a, b));
    vertices.dedup_by_key(|(id, _)| *id);
    let mut writer = work.create_result(item)?;
    writer.section(&triangles)?;
    writer.section(&edges)?;
    writer.section(&vertices.iter().map(|(id, _)| *id).collect::<Vec<u64>>())?;
    writer.section(&vertices.iter().map(|(_, p)| *p).collect::<Vec<[f64; 3]>>())?;
    Ok((writer, counts([("triangles", triangles.len())])))
}

/// The corners of a facet as seen from inside its cell.
fn corners(tetrahedra: &Tetrahedralization, cell: CellId, facet: usize) -> [VertexId; 3] {
    let vertices = tetrahedra.cell_vertices(cell);
    Tetrahedralization::FACET[facet].map(|k| vertices[k])
}

fn first_id_first(cells: &TileCells, corners: [VertexId; 3]) -> [VertexId; 3] {
    let first = (0..3).min_by_key(|&k| cells.id(corners[k])).unwrap_or(0);
    std::array::from_fn(|k| corners[(first + k) % 3])
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
