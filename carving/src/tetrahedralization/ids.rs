//! Identifiers of vertices and cells.

use std::num::NonZeroU32;

/// Raw index that stands for the ghost vertex in storage.
pub(super) const GHOST: u32 = u32::MAX;
/// Raw index that stands for "no cell".
pub(super) const NO_CELL: u32 = u32::MAX;

/// A vertex of a [`Tetrahedralization`](super::Tetrahedralization), or the [ghost](VertexId::GHOST).
///
/// Valid until the vertex is removed; a later insertion may then be given the same id. Ids are small: they
/// index parallel arrays of length [`vertex_capacity`](super::Tetrahedralization::vertex_capacity).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct VertexId(pub(super) u32);

impl VertexId {
    /// The vertex at infinity: the fourth vertex of every cell outside the hull. It has no position.
    pub const GHOST: VertexId = VertexId(GHOST);

    /// Position of this vertex in arrays parallel to the vertices.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }

    /// The vertex at `index` of arrays parallel to the vertices.
    ///
    /// # Panics
    ///
    /// When `index` exceeds `u32::MAX`, which no tetrahedralisation can hold.
    #[inline]
    pub fn from_index(index: usize) -> Self {
        VertexId(u32::try_from(index).expect("vertex indices fit in 32 bits"))
    }

    /// Whether this is the vertex at infinity.
    #[inline]
    pub fn is_ghost(self) -> bool {
        self.0 == GHOST
    }
}

/// A cell (finite tetrahedron or ghost) of a [`Tetrahedralization`](super::Tetrahedralization).
///
/// Valid until a change reports the cell as destroyed; a later operation may then give the same id to a new
/// cell. `Option<CellId>` takes no more room than the id.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CellId(NonZeroU32);

impl CellId {
    /// Position of this cell in arrays parallel to the cells.
    #[inline]
    pub fn index(self) -> usize {
        self.raw() as usize
    }

    /// The cell at `index` of arrays parallel to the cells.
    ///
    /// # Panics
    ///
    /// When `index` is `u32::MAX` or more, which no tetrahedralisation can hold.
    #[inline]
    pub fn from_index(index: usize) -> Self {
        Self::from_raw(u32::try_from(index).expect("cell indices fit in 32 bits"))
    }

    #[inline]
    pub(super) fn raw(self) -> u32 {
        self.0.get() - 1
    }

    #[inline]
    pub(super) fn from_raw(raw: u32) -> Self {
        CellId(NonZeroU32::MIN.saturating_add(raw))
    }
}

impl std::fmt::Debug for CellId {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "CellId({})", self.raw())
    }
}
