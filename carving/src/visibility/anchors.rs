//! Positions that are expected to be occupied, each attached to the cell that holds it.
//!
//! An anchor has a number of its owner's choosing. A cell lists the anchors in its interior and on its boundary, so
//! that they can be located again when it is destroyed; only those in the open interior count for it.

use crate::growth::resize;
use crate::predicates::orient3d;
use crate::tetrahedralization::{CellId, Location, Tetrahedralization, VertexId, accept_position};

const NONE: u32 = u32::MAX;

/// Where one anchor is attached.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    /// The cell that lists it.
    cell: u32,
    /// Whether it is in the open interior of that cell.
    is_inside: bool,
    /// The anchors before and after it in the list of the cell.
    links: [u32; 2],
}

impl Anchor {
    const DETACHED: Anchor = Anchor {
        cell: NONE,
        is_inside: false,
        links: [NONE; 2],
    };
}

/// Anchors and the cells that hold them.
#[derive(Clone, Debug)]
pub(super) struct OccupiedAnchors {
    /// Whether cells list their anchors; otherwise they are located only.
    has_lists: bool,
    /// The latest vertex with an anchor behind it, and its cell, while there are no lists: other anchors behind it are near.
    latest: Option<(VertexId, CellId)>,
    anchors: Vec<Anchor>,
    /// For each cell the first anchor that it lists.
    first: Vec<u32>,
    /// Anchors whose cell was destroyed or reshaped.
    orphaned: Vec<u32>,
}

impl OccupiedAnchors {
    /// No anchors, and lists of them where asked for.
    pub(super) fn new(has_lists: bool) -> Self {
        Self {
            has_lists,
            latest: None,
            anchors: Vec::new(),
            first: Vec::new(),
            orphaned: Vec::new(),
        }
    }

    /// Makes room for cells and anchors with numbers below.
    pub(super) fn grow(&mut self, cells: usize, anchors: usize) {
        resize(&mut self.first, cells, NONE);
        resize(&mut self.anchors, anchors, Anchor::DETACHED);
    }

    /// Attaches an anchor behind a vertex to the cell at its position; returns the cell when the anchor is in its open interior.
    pub(super) fn attach(
        &mut self,
        tetrahedra: &Tetrahedralization,
        id: u32,
        position: &[f64; 3],
        vertex: VertexId,
    ) -> Option<CellId> {
        let hint = match self.latest {
            Some((latest, cell)) if latest == vertex => Some(cell),
            _ => tetrahedra.cell_of(vertex),
        };
        // A position out of range is outside every cell.
        let location = tetrahedra.locate(&(*position).into(), hint).ok()?;
        let (cell, is_inside) = match location {
            Location::InCell(cell) => (cell, true),
            Location::OnFacet { cell, .. }
            | Location::OnEdge { cell, .. }
            | Location::Outside(cell) => (cell, false),
            Location::OnVertex(vertex) => (tetrahedra.cell_of(vertex)?, false),
            Location::NoCells => return None,
        };
        if !self.has_lists {
            self.latest = Some((vertex, cell));
            return is_inside.then_some(cell);
        }
        let next = std::mem::replace(&mut self.first[cell.index()], id);
        if next != NONE {
            self.anchors[next as usize].links[0] = id;
        }
        self.anchors[id as usize] = Anchor {
            cell: cell.index() as u32,
            is_inside,
            links: [NONE, next],
        };
        is_inside.then_some(cell)
    }

    /// The cell for which an anchor counts.
    pub(super) fn cell(&self, id: u32) -> Option<CellId> {
        let anchor = self.anchors.get(id as usize)?;
        (anchor.cell != NONE && anchor.is_inside).then(|| CellId::from_index(anchor.cell as usize))
    }

    /// Detaches an anchor; returns the cell for which it counted.
    pub(super) fn detach(&mut self, id: u32) -> Option<CellId> {
        let Anchor {
            cell,
            is_inside,
            links: [before, after],
        } = *self.anchors.get(id as usize)?;
        if cell == NONE {
            return None;
        }
        self.anchors[id as usize].cell = NONE;
        let cell = CellId::from_index(cell as usize);
        match before {
            NONE => self.first[cell.index()] = after,
            before => self.anchors[before as usize].links[1] = after,
        }
        if after != NONE {
            self.anchors[after as usize].links[0] = before;
        }
        is_inside.then_some(cell)
    }

    /// Orphans the anchors of a cell that is destroyed or reshaped.
    pub(super) fn orphan(&mut self, cell: CellId) {
        // A cell without an entry has no anchors.
        let Some(first) = self.first.get_mut(cell.index()) else {
            return;
        };
        let mut id = std::mem::replace(first, NONE);
        while id != NONE {
            self.orphaned.push(id);
            let anchor = &mut self.anchors[id as usize];
            id = anchor.links[1];
            anchor.cell = NONE;
        }
    }

    /// Moves the orphaned anchors to `ids`, which is cleared first.
    pub(super) fn take_orphaned(&mut self, ids: &mut Vec<u32>) {
        ids.clear();
        ids.append(&mut self.orphaned);
    }

    /// Detaches all anchors.
    pub(super) fn clear(&mut self) {
        self.latest = None;
        self.first.fill(NONE);
        for anchor in &mut self.anchors {
            anchor.cell = NONE;
        }
        self.orphaned.clear();
    }
}

/// Whether a position is in the open interior of a finite cell, computed from the rule alone.
pub(super) fn is_inside(tetrahedra: &Tetrahedralization, cell: CellId, position: [f64; 3]) -> bool {
    let Ok(position) = accept_position(&position.into()) else {
        return false;
    };
    let vertices = tetrahedra.cell_vertices(cell);
    Tetrahedralization::FACET.iter().all(|facet| {
        let [a, b, c] = facet.map(|k| tetrahedra.coordinates(vertices[k]));
        orient3d(a, b, c, &position) > 0.0
    })
}
