//! Incremental Delaunay tetrahedralisation with exact arithmetic and a unique result.
//!
//! # Layers
//!
//! `storage` knows topology and free lists; `predicates` know positions; `locate`, `insert`, `remove` join the two;
//! `low_dimension` replaces it while the points do not span space; `check` recomputes every invariant.

mod batch;
mod cavity;
mod changes;
mod check;
mod edit;
mod ids;
mod incident;
mod insert;
mod locate;
mod low_dimension;
mod move_vertex;
mod nearest;
mod point;
mod remove;
mod spatial_order;
mod storage;

pub use batch::BatchError;
pub use changes::Changes;
pub use check::TetrahedralizationViolation;
pub use edit::Edit;
pub use ids::{CellId, VertexId};
pub use incident::IncidentCells;
pub use insert::Insertion;
pub use locate::Location;
pub use move_vertex::{Move, MoveError};
pub use point::{MAX_COORDINATE, MIN_COORDINATE, PointError, accept_position};

pub use remove::UnknownVertex;
pub(crate) use spatial_order::{curve_order, hilbert_rank, spatial_order};

use nalgebra::Point3;

use cavity::CavityScratch;
use ids::NO_CELL;
use low_dimension::LowDimension;
use remove::HoleScratch;
use storage::{FACET, Storage};

/// The Delaunay tetrahedra of a changing set of points.
///
/// * **Unique.** The cells are a function of the set of positions alone. Cospherical ties are broken by a symbolic
///   perturbation that depends on coordinates only, so the order of insertions does not matter and removal is the
///   exact inverse of insertion.
/// * **Exact.** Every geometric decision has the sign of real arithmetic for coordinates in the range of
///   [`MAX_COORDINATE`] and [`MIN_COORDINATE`]; others are refused by [`PointError`].
/// * **Degenerate input is an outcome.** Repeated positions give [`Insertion::Duplicate`]. Points that all lie in a
///   plane (or on a line, or coincide) are kept as vertices of a state of [dimension](Tetrahedralization::dimension)
///   two, one or zero, in which **no cell exists**, neither finite nor ghost. Cells appear with the first point
///   that leaves the plane and vanish with the last.
/// * **Changes are reported.** Each operation lists destroyed and created cells in a caller's [`Changes`].
///
/// Outside the hull space is filled with *ghost cells*: a hull facet joined to a vertex at infinity
/// ([`VertexId::GHOST`], always the fourth corner). Every cell thus has four neighbours.
///
/// Not supported: weights, constraints, periodic space, concurrent modification.
///
/// # Example
///
/// ```
/// use linecarve_carving::{Changes, Tetrahedralization};
/// use nalgebra::Point3;
///
/// let mut tetrahedra = Tetrahedralization::new();
/// let mut changes = Changes::new();
/// for corner in 0..8 {
///     let point = Point3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
///     tetrahedra.insert(point, None, &mut changes)?;
/// }
/// assert_eq!(tetrahedra.dimension(), 3);
/// assert!(tetrahedra.check().is_ok());
/// # Ok::<(), linecarve_carving::PointError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tetrahedralization {
    storage: Storage,
    /// Vertices while their dimension is below three; empty otherwise.
    low: LowDimension,
    /// A living cell where the latest change happened; `NO_CELL` below dimension three.
    recent_cell: u32,
    cavity: CavityScratch,
    hole: HoleScratch,
    around: IncidentCells,
}

impl Default for Tetrahedralization {
    fn default() -> Self {
        Self::new()
    }
}

impl Tetrahedralization {
    /// Corners of the facet opposite each corner of a cell, as positions in
    /// [`cell_vertices`](Self::cell_vertices). The facet followed by its opposite corner is positively oriented:
    /// `orient3d(facet[0], facet[1], facet[2], opposite) > 0`.
    pub const FACET: [[usize; 3]; 4] = FACET;

    /// No points.
    pub fn new() -> Self {
        Self {
            storage: Storage::default(),
            low: LowDimension::default(),
            recent_cell: NO_CELL,
            cavity: CavityScratch::default(),
            hole: HoleScratch::default(),
            around: IncidentCells::default(),
        }
    }

    /// Affine dimension of the points: −1 when there is none, 0 for one, 1 on a line, 2 in a plane, otherwise 3.
    ///
    /// Cells exist in dimension 3 only.
    pub fn dimension(&self) -> i8 {
        if self.recent_cell == NO_CELL {
            self.low.dimension()
        } else {
            3
        }
    }

    /// Number of vertices, the ghost not counted.
    pub fn vertex_count(&self) -> usize {
        self.storage.live_vertices()
    }

    /// Number of finite cells.
    pub fn finite_cell_count(&self) -> usize {
        self.storage.live_cells() - self.storage.live_ghost_cells()
    }

    /// Number of ghost cells, which is the number of hull facets.
    pub fn ghost_cell_count(&self) -> usize {
        self.storage.live_ghost_cells()
    }

    /// Length that an array indexed by [`VertexId::index`] must have.
    pub fn vertex_capacity(&self) -> usize {
        self.storage.vertices.len()
    }

    /// Length that an array indexed by [`CellId::index`] must have.
    pub fn cell_capacity(&self) -> usize {
        self.storage.cells.len()
    }

    /// Whether `vertex` is in use.
    pub fn is_vertex(&self, vertex: VertexId) -> bool {
        self.storage.is_vertex_alive(vertex.0)
    }

    /// Whether `cell` is in use: not destroyed yet.
    pub fn is_cell(&self, cell: CellId) -> bool {
        self.storage.is_alive(cell.raw())
    }

    /// Position of a vertex. Negative zeros of the input have become zeros.
    ///
    /// # Panics
    ///
    /// For the ghost and for ids that were never given out.
    #[inline]
    pub fn position(&self, vertex: VertexId) -> Point3<f64> {
        Point3::from(*self.storage.position(vertex.0))
    }

    /// Coordinates of a vertex as the predicates take them; like [`position`](Self::position).
    ///
    /// # Panics
    ///
    /// For the ghost and for ids that were never given out.
    #[inline]
    pub fn coordinates(&self, vertex: VertexId) -> &[f64; 3] {
        self.storage.position(vertex.0)
    }

    /// Corners of a cell, positively oriented; in ghost cells the fourth is [`VertexId::GHOST`] and
    /// `orient3d(v[0], v[1], v[2], q) > 0` for points `q` outside the hull facet.
    ///
    /// Also readable for cells destroyed by the latest operation.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    #[inline]
    pub fn cell_vertices(&self, cell: CellId) -> [VertexId; 4] {
        self.storage.cell(cell.raw()).vertices.map(VertexId)
    }

    /// Cells across the facets opposite the four corners of [`cell_vertices`](Self::cell_vertices).
    ///
    /// Also readable for cells destroyed by the latest operation: the neighbours before it.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    #[inline]
    pub fn neighbors(&self, cell: CellId) -> [CellId; 4] {
        self.storage
            .cell(cell.raw())
            .neighbors
            .map(|n| CellId::from_raw(n >> 2))
    }

    /// The cell across the facet opposite corner `facet`, and the facet by which that cell looks back.
    ///
    /// # Panics
    ///
    /// For ids that were never given out and facets above 3.
    #[inline]
    pub fn neighbor(&self, cell: CellId, facet: usize) -> (CellId, usize) {
        let packed = self.storage.cell(cell.raw()).neighbors[facet];
        (CellId::from_raw(packed >> 2), (packed & 3) as usize)
    }

    /// Whether one corner of the cell is the vertex at infinity.
    #[inline]
    pub fn is_ghost(&self, cell: CellId) -> bool {
        self.storage.cell(cell.raw()).is_ghost()
    }

    /// All cells, ghosts included, by increasing id.
    pub fn cells(&self) -> impl Iterator<Item = CellId> + '_ {
        (0..self.storage.cells.len() as u32)
            .filter(|&c| self.storage.is_alive(c))
            .map(CellId::from_raw)
    }

    /// All vertices, the ghost excluded, by increasing id.
    pub fn vertices(&self) -> impl Iterator<Item = VertexId> + '_ {
        (0..self.storage.vertices.len() as u32)
            .filter(|&v| self.storage.is_vertex_alive(v))
            .map(VertexId)
    }

    /// Whether so many more points certainly find room.
    pub(crate) fn has_room_for(&self, points: usize) -> bool {
        self.storage.has_room_for(points)
    }

    /// One of the cells that have `vertex` as a corner; `None` below dimension three and for dead vertices.
    #[inline]
    pub fn cell_of(&self, vertex: VertexId) -> Option<CellId> {
        let cell = self.storage.vertices.get(vertex.index())?.cell;
        (cell != NO_CELL).then(|| CellId::from_raw(cell))
    }

    /// The same, a finite one.
    #[inline]
    pub(crate) fn finite_cell_of(&self, vertex: VertexId) -> Option<CellId> {
        let cell = self.cell_of(vertex)?;
        Some(match self.is_ghost(cell) {
            true => self.neighbors(cell)[3],
            false => cell,
        })
    }
}

#[cfg(test)]
mod tests;
