//! What an operation did, as lists of cells.

use super::ids::CellId;

/// The cells that one operation destroyed and created; owned by the caller and refilled without allocation
/// once its lists have grown.
///
/// * `destroyed` and `created` have no id in common: the slots of destroyed cells are handed out again only by
///   the *next* operation that changes the tetrahedralisation. Until then the corners of destroyed cells can be
///   read like those of living ones. Their neighbours, too, describe the state before, if the operation was a
///   single insertion or removal; after operations of several steps (a move, a batch, an
///   [`Edit`](super::Edit)) they are those at the moment of the destruction.
/// * Cells that exist only in the middle of an operation of several steps (a move, a batch) are in no list.
/// * The order of each list is a function of the history of operations alone.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Cells that are gone.
    pub destroyed: Vec<CellId>,
    /// Cells that are new.
    pub created: Vec<CellId>,
    /// Cells that kept id, corners and neighbours, while a corner moved in place. Only moves fill it.
    pub reshaped: Vec<CellId>,
}

impl Changes {
    /// Empty lists.
    pub fn new() -> Self {
        Self::default()
    }

    /// Empties the lists, keeping their memory.
    pub fn clear(&mut self) {
        self.destroyed.clear();
        self.created.clear();
        self.reshaped.clear();
    }

    /// Whether no cell changed.
    pub fn is_empty(&self) -> bool {
        self.destroyed.is_empty() && self.created.is_empty() && self.reshaped.is_empty()
    }
}
