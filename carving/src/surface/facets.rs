//! Labels and surface facets of all cells, kept up to date.

use crate::tetrahedralization::{CellId, Changes, IncidentCells, Tetrahedralization, VertexId};

use super::Hull;
use super::delta::{SurfaceDelta, Triangle, rotate_smallest_first};

/// Set for free cells.
const FREE: u8 = 1 << 4;

/// One byte for each cell: the label, and for free cells which of the four facets are on the surface.
///
/// The facet of a surface triangle is recorded on its free side only, so the triangles of a destroyed cell are known
/// without its neighbours, which may be gone as well.
#[derive(Clone, Debug)]
pub(crate) struct Facets {
    hull: Hull,
    cells: Vec<u8>,
    count: usize,
    relabelled: Vec<CellId>,
}

impl Facets {
    /// No cells.
    pub(crate) fn new(hull: Hull) -> Self {
        Self {
            hull,
            cells: Vec::new(),
            count: 0,
            relabelled: Vec::new(),
        }
    }

    pub(crate) fn hull(&self) -> Hull {
        self.hull
    }

    /// Number of triangles.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Whether a cell is free.
    #[inline]
    pub(crate) fn is_free(&self, cell: CellId) -> bool {
        self.cells[cell.index()] & FREE != 0
    }

    /// Whether the cell is the free side of a surface triangle at `facet`.
    #[inline]
    pub(crate) fn is_surface(&self, cell: CellId, facet: usize) -> bool {
        self.cells[cell.index()] & 1 << facet != 0
    }

    /// All surface triangles as free cell and facet, by increasing cell.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (CellId, usize)> + '_ {
        self.cells
            .iter()
            .enumerate()
            .filter(|(_, state)| **state & 0b1111 != 0)
            .flat_map(|(index, &state)| {
                (0..4)
                    .filter(move |facet| state & 1 << facet != 0)
                    .map(move |facet| (CellId::from_index(index), facet))
            })
    }

    /// Appends the surface triangles with a corner at `vertex`, each once.
    pub(crate) fn around(
        &self,
        tetrahedra: &Tetrahedralization,
        vertex: VertexId,
        scratch: &mut IncidentCells,
        found: &mut Vec<Triangle>,
    ) {
        for &cell in tetrahedra.incident_cells(vertex, scratch) {
            let corners = tetrahedra.cell_vertices(cell);
            let facets = (0..4).filter(|&facet| corners[facet] != vertex);
            found.extend(
                facets
                    .filter(|&facet| self.is_surface(cell, facet))
                    .map(|facet| triangle(tetrahedra, cell, facet)),
            );
        }
    }

    /// Follows a change of cells and labels. `flipped` lists cells that survived and may have another label now.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells listed, and sorting of the changed triangles.
    pub(crate) fn update(
        &mut self,
        tetrahedra: &Tetrahedralization,
        changes: &Changes,
        flipped: &[CellId],
        is_free: impl Fn(CellId) -> bool,
        delta: &mut SurfaceDelta,
    ) {
        if self.cells.len() < tetrahedra.cell_capacity() {
            self.cells.resize(tetrahedra.cell_capacity(), 0);
        }
        for &cell in changes.destroyed.iter().chain(&changes.reshaped) {
            let state = std::mem::take(&mut self.cells[cell.index()]);
            for facet in (0..4).filter(|facet| state & 1 << facet != 0) {
                delta.removed.push(triangle(tetrahedra, cell, facet));
                self.count -= 1;
            }
        }
        let mut relabelled = std::mem::take(&mut self.relabelled);
        relabelled.clear();
        relabelled.extend(changes.created.iter().chain(&changes.reshaped));
        for &cell in &relabelled {
            self.cells[cell.index()] = if is_free(cell) { FREE } else { 0 };
        }
        for &cell in flipped {
            if tetrahedra.is_cell(cell) && is_free(cell) != self.is_free(cell) {
                self.cells[cell.index()] ^= FREE;
                relabelled.push(cell);
            }
        }
        for &cell in &relabelled {
            for facet in 0..4 {
                let (other, back) = tetrahedra.neighbor(cell, facet);
                self.settle(tetrahedra, cell, facet, other, delta);
                self.settle(tetrahedra, other, back, cell, delta);
            }
        }
        self.relabelled = relabelled;
        if self.hull == Hull::Drop {
            list_border(tetrahedra, changes, &mut delta.border);
        }
        delta.normalize();
    }

    /// Labels all cells, and finds all triangles.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells.
    pub(crate) fn fill(
        &mut self,
        tetrahedra: &Tetrahedralization,
        is_free: impl Fn(CellId) -> bool,
    ) {
        self.cells = vec![0; tetrahedra.cell_capacity()];
        self.count = 0;
        for cell in tetrahedra.cells() {
            self.cells[cell.index()] = if is_free(cell) { FREE } else { 0 };
        }
        for cell in tetrahedra.cells() {
            for facet in 0..4 {
                let other = tetrahedra.neighbor(cell, facet).0;
                if self.is_wanted(tetrahedra, cell, other) {
                    self.cells[cell.index()] |= 1 << facet;
                    self.count += 1;
                }
            }
        }
    }

    /// Whether the facet between two cells is on the surface with the first on the free side.
    fn is_wanted(&self, tetrahedra: &Tetrahedralization, cell: CellId, other: CellId) -> bool {
        self.is_free(cell)
            && !self.is_free(other)
            && (self.hull != Hull::Drop || !tetrahedra.is_ghost(other))
    }

    /// Records whether the facet between `cell` and `other` is on the surface with `cell` on the free side.
    fn settle(
        &mut self,
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        facet: usize,
        other: CellId,
        delta: &mut SurfaceDelta,
    ) {
        let wanted = self.is_wanted(tetrahedra, cell, other);
        let state = &mut self.cells[cell.index()];
        if (*state & 1 << facet != 0) == wanted {
            return;
        }
        *state ^= 1 << facet;
        let triangle = triangle(tetrahedra, cell, facet);
        if wanted {
            delta.added.push(triangle);
            self.count += 1;
        } else {
            delta.removed.push(triangle);
            self.count -= 1;
        }
    }
}

/// Lists the corners of hull facets that came or went, in increasing order.
fn list_border(tetrahedra: &Tetrahedralization, changes: &Changes, border: &mut Vec<VertexId>) {
    for &cell in changes.destroyed.iter().chain(&changes.created) {
        let corners = tetrahedra.cell_vertices(cell);
        if corners.iter().any(|corner| corner.is_ghost()) {
            border.extend(corners.iter().filter(|corner| !corner.is_ghost()));
        }
    }
    border.sort_unstable();
    border.dedup();
}

/// The facet of a free cell as seen from inside that cell.
pub(crate) fn triangle(tetrahedra: &Tetrahedralization, cell: CellId, facet: usize) -> Triangle {
    let vertices = tetrahedra.cell_vertices(cell);
    rotate_smallest_first(Tetrahedralization::FACET[facet].map(|k| vertices[k]))
}
