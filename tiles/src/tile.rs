//! The tetrahedra of a tile: those of its own points and of points of other tiles.

use linecarve_carving::internals::TracedRay;
use linecarve_carving::{BatchError, CellId, Changes, Insertion, Tetrahedralization, VertexId};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::bounds::Bounds;
use crate::error::TilesError;
use crate::file::{Kind, Reader};
use crate::record::RayRecord;
use crate::stage::{Item, Stage};
use crate::work::Work;

/// In place of the id of a vertex: there is none.
pub(crate) const NO_VERTEX: u64 = u64::MAX;

/// A vertex of the whole scene: its tile and its number there.
pub(crate) fn global(tile: usize, local: usize) -> u64 {
    (tile as u64) << 32 | local as u64
}

/// The tile that owns a vertex.
pub(crate) fn tile_of(id: u64) -> usize {
    (id >> 32) as usize
}

/// The number of a vertex in its tile.
pub(crate) fn local_of(id: u64) -> usize {
    (id & u64::from(u32::MAX)) as usize
}

/// A vertex of the whole scene with its position.
pub(crate) type Vertex = (u64, [f64; 3]);

/// A finite cell by its vertices in increasing order. It belongs to the tile of the first.
pub(crate) type CellKey = [u64; 4];

/// A ray of a file.
pub(crate) fn traced(ray: &RayRecord, centers: &[[f64; 3]]) -> TracedRay {
    TracedRay {
        center: centers.get(ray.view as usize).copied().unwrap_or_default(),
        target: ray.target,
        sigma: (!ray.sigma.is_nan()).then_some(ray.sigma),
        weight: ray.weight,
        support: ray.support,
    }
}

/// The vertices of a tile.
pub(crate) fn own_vertices(work: &Work, tile: usize) -> Result<Vec<Vertex>, TilesError> {
    let points = work.open_tile("points", tile, Kind::Points)?;
    let mut vertices = Vec::new();
    for block in 1..points.section_count() {
        for position in points.records(block)? {
            vertices.push((global(tile, vertices.len()), position));
        }
    }
    Ok(vertices)
}

/// Vertices of two sections of a file: ids, positions.
pub(crate) fn listed(reader: &Reader, section: usize) -> Result<Vec<Vertex>, TilesError> {
    let ids: Vec<u64> = reader.records(section)?;
    let positions: Vec<[f64; 3]> = reader.records(section + 1)?;
    if ids.len() != positions.len() {
        return Err(TilesError::damaged(reader.path(), "lists differ in length"));
    }
    Ok(ids.into_iter().zip(positions).collect())
}

/// Tetrahedra with the ids of their vertices in the whole scene.
pub(crate) struct TileCells {
    tile: usize,
    pub(crate) tetrahedra: Tetrahedralization,
    /// By index of the vertex.
    ids: Vec<u64>,
    vertices: FxHashMap<u64, VertexId>,
}

impl TileCells {
    /// The tetrahedra of distinct vertices.
    pub(crate) fn new(tile: usize, vertices: &[Vertex]) -> Result<Self, BatchError> {
        let mut cells = Self {
            tile,
            tetrahedra: Tetrahedralization::new(),
            ids: Vec::new(),
            vertices: FxHashMap::default(),
        };
        let positions: Vec<Point3<f64>> = vertices.iter().map(|(_, p)| (*p).into()).collect();
        let (tetrahedra, outcomes) = Tetrahedralization::from_points(&positions)?;
        cells.tetrahedra = tetrahedra;
        cells.enter(vertices, &outcomes);
        Ok(cells)
    }

    /// The tetrahedra that the stage `frame` found for a tile: near its own points they are those of the whole scene.
    pub(crate) fn framed(work: &Work, item: Item) -> Result<Self, TilesError> {
        Self::framed_with(work, item, Vec::new())
    }

    /// The same with more vertices, which changes no cell of the whole scene.
    pub(crate) fn framed_with(
        work: &Work,
        item: Item,
        more: Vec<Vertex>,
    ) -> Result<Self, TilesError> {
        let tile = item.number;
        let needed = Item {
            stage: Stage::Frame,
            number: tile,
        };
        let frame = work.open_result(needed, item)?;
        let mut vertices = own_vertices(work, tile)?;
        vertices.extend(listed(&frame, 0)?);
        vertices.extend(more);
        vertices.sort_unstable_by_key(|(id, _)| *id);
        vertices.dedup_by_key(|(id, _)| *id);
        Self::new(tile, &vertices)
            .map_err(|error| TilesError::damaged(frame.path(), error.to_string()))
    }

    fn enter(&mut self, vertices: &[Vertex], outcomes: &[Insertion]) {
        self.ids
            .resize(self.tetrahedra.vertex_capacity(), NO_VERTEX);
        for (&(id, _), outcome) in vertices.iter().zip(outcomes) {
            self.ids[outcome.vertex().index()] = id;
            self.vertices.insert(id, outcome.vertex());
        }
    }

    /// Inserts more vertices; `changes` lists what that did to the cells.
    pub(crate) fn insert(
        &mut self,
        vertices: &[Vertex],
        changes: &mut Changes,
    ) -> Result<(), BatchError> {
        let positions: Vec<Point3<f64>> = vertices.iter().map(|(_, p)| (*p).into()).collect();
        let mut outcomes = Vec::new();
        (self.tetrahedra).insert_batch(&positions, &mut outcomes, changes)?;
        self.enter(vertices, &outcomes);
        Ok(())
    }

    /// The vertex with an id of the whole scene, if it is here.
    pub(crate) fn vertex(&self, id: u64) -> Option<VertexId> {
        self.vertices.get(&id).copied()
    }

    /// The id in the whole scene; [`NO_VERTEX`] of the ghost.
    pub(crate) fn id(&self, vertex: VertexId) -> u64 {
        match vertex.is_ghost() {
            true => NO_VERTEX,
            false => self.ids[vertex.index()],
        }
    }

    /// Whether a vertex belongs to the tile.
    pub(crate) fn is_own(&self, vertex: VertexId) -> bool {
        !vertex.is_ghost() && tile_of(self.ids[vertex.index()]) == self.tile
    }

    /// Whether a cell has a vertex of the tile.
    pub(crate) fn is_star(&self, cell: CellId) -> bool {
        let vertices = self.tetrahedra.cell_vertices(cell);
        vertices.iter().any(|&vertex| self.is_own(vertex))
    }

    /// Whether a cell has a vertex of the tile, or one across a facet has.
    pub(crate) fn is_near(&self, cell: CellId) -> bool {
        let mut neighbors = self.tetrahedra.neighbors(cell).into_iter();
        self.is_star(cell) || neighbors.any(|other| self.is_star(other))
    }

    /// The vertices of a finite cell; `None` of a ghost cell.
    pub(crate) fn key(&self, cell: CellId) -> Option<CellKey> {
        let vertices = self.tetrahedra.cell_vertices(cell);
        (!vertices[3].is_ghost()).then(|| {
            let mut key = vertices.map(|vertex| self.ids[vertex.index()]);
            key.sort_unstable();
            key
        })
    }

    /// For each vertex of the key of a finite cell its place among the corners of the cell.
    pub(crate) fn places(&self, cell: CellId) -> [usize; 4] {
        let vertices = self.tetrahedra.cell_vertices(cell);
        let mut places = [0, 1, 2, 3];
        places.sort_unstable_by_key(|&k| self.ids[vertices[k].index()]);
        places
    }

    /// The longest side of the bounding box of a finite cell; 0 of a ghost cell.
    pub(crate) fn extent(&self, cell: CellId) -> f64 {
        self.bounds(cell).map_or(0.0, |bounds| bounds.extent())
    }

    /// The bounding box of a finite cell.
    pub(crate) fn bounds(&self, cell: CellId) -> Option<Bounds> {
        let vertices = self.tetrahedra.cell_vertices(cell);
        let corners = || vertices.iter().map(|&v| self.tetrahedra.coordinates(v));
        (!vertices[3].is_ghost()).then(|| Bounds::of(corners()))
    }
}
