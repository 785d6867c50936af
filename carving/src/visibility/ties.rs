//! Places that are expected to be matter, each known to the cell that holds it.
//!
//! Places are told apart by numbers of the owner's choosing. A cell lists those in its interior and on its boundary, so
//! that they can be located anew when it goes; only those in the open interior count for it.

use crate::predicates::orient3d;
use crate::tetrahedralization::{CellId, Location, Tetrahedralization, accept};

const NONE: u32 = u32::MAX;

/// Where one place is.
#[derive(Clone, Copy, Debug)]
struct Tie {
    /// The cell that lists it.
    cell: u32,
    /// Whether it is in the open interior of that cell.
    is_inside: bool,
    /// The places before and after it in the list of the cell.
    links: [u32; 2],
}

impl Tie {
    const EMPTY: Tie = Tie {
        cell: NONE,
        is_inside: false,
        links: [NONE; 2],
    };
}

/// Places and the cells that hold them.
#[derive(Clone, Debug, Default)]
pub(super) struct Ties {
    ties: Vec<Tie>,
    /// Per cell the first place that it lists.
    first: Vec<u32>,
    /// Places that have lost their cell.
    adrift: Vec<u32>,
}

impl Ties {
    /// Makes room for cells and places with numbers below.
    pub(super) fn grow(&mut self, cells: usize, places: usize) {
        self.first.resize(cells.max(self.first.len()), NONE);
        self.ties.resize(places.max(self.ties.len()), Tie::EMPTY);
    }

    /// Finds the cell of a place, which has none so far; returns it when the place is in its open interior.
    pub(super) fn hang(
        &mut self,
        tetrahedra: &Tetrahedralization,
        id: u32,
        place: &[f64; 3],
        hint: Option<CellId>,
    ) -> Option<CellId> {
        // A place out of range is beyond everything.
        let location = tetrahedra.locate(&(*place).into(), hint).ok()?;
        let (cell, is_inside) = match location {
            Location::InCell(cell) => (cell, true),
            Location::OnFacet { cell, .. }
            | Location::OnEdge { cell, .. }
            | Location::Outside(cell) => (cell, false),
            Location::OnVertex(vertex) => (tetrahedra.cell_of(vertex)?, false),
            Location::NoCells => return None,
        };
        let next = std::mem::replace(&mut self.first[cell.index()], id);
        if next != NONE {
            self.ties[next as usize].links[0] = id;
        }
        self.ties[id as usize] = Tie {
            cell: cell.index() as u32,
            is_inside,
            links: [NONE, next],
        };
        is_inside.then_some(cell)
    }

    /// Takes a place away; returns the cell for which it counted.
    pub(super) fn lift(&mut self, id: u32) -> Option<CellId> {
        let Tie {
            cell,
            is_inside,
            links: [before, after],
        } = *self.ties.get(id as usize)?;
        if cell == NONE {
            return None;
        }
        self.ties[id as usize].cell = NONE;
        let cell = CellId::from_index(cell as usize);
        match before {
            NONE => self.first[cell.index()] = after,
            before => self.ties[before as usize].links[1] = after,
        }
        if after != NONE {
            self.ties[after as usize].links[0] = before;
        }
        is_inside.then_some(cell)
    }

    /// Takes the places of a cell that is destroyed or reshaped away from it.
    pub(super) fn set_adrift(&mut self, cell: CellId) {
        // Cells that there has been no room for hold nothing.
        let Some(first) = self.first.get_mut(cell.index()) else {
            return;
        };
        let mut id = std::mem::replace(first, NONE);
        while id != NONE {
            self.adrift.push(id);
            let tie = &mut self.ties[id as usize];
            id = tie.links[1];
            tie.cell = NONE;
        }
    }

    /// Moves the places that have lost their cell to `ids`, which is cleared first.
    pub(super) fn take_adrift(&mut self, ids: &mut Vec<u32>) {
        ids.clear();
        ids.append(&mut self.adrift);
    }

    /// Forgets where all places are.
    pub(super) fn clear(&mut self) {
        self.first.fill(NONE);
        for tie in &mut self.ties {
            tie.cell = NONE;
        }
        self.adrift.clear();
    }
}

/// Whether a place is in the open interior of a finite cell, by the rule alone.
pub(super) fn is_inside(tetrahedra: &Tetrahedralization, cell: CellId, place: [f64; 3]) -> bool {
    let Ok(place) = accept(&place.into()) else {
        return false;
    };
    let vertices = tetrahedra.cell_vertices(cell);
    Tetrahedralization::FACET.iter().all(|facet| {
        let [a, b, c] = facet.map(|k| tetrahedra.coordinates(vertices[k]));
        orient3d(a, b, c, &place) > 0.0
    })
}
