//! Verifies the surface.

use rustc_hash::FxHashMap;
use thiserror::Error;

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::Hull;
use super::facets::{Facets, triangle};

/// The first property of the surface found broken, with its witness. Any occurrence is a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SurfaceViolation {
    /// The recorded label of a cell contradicts its weight.
    #[error("{cell:?} is recorded as free: {recorded}, but its weight is {weight}")]
    Label {
        /// The cell.
        cell: CellId,
        /// The label on record.
        recorded: bool,
        /// Its total crossing weight.
        weight: u64,
    },
    /// A facet is recorded as surface without separating free from occupied, or the reverse.
    #[error("facet {facet} of {cell:?} is recorded wrongly")]
    Facet {
        /// The cell.
        cell: CellId,
        /// The corner opposite the facet.
        facet: usize,
    },
    /// Together with the hull facets of free cells, the triangles pass an edge more often in one direction than in the
    /// other: the surface is not closed, or a triangle is turned over.
    #[error("edge {from:?} -> {to:?} is passed {surplus} times more than its reverse")]
    Open {
        /// Start of the edge.
        from: VertexId,
        /// End of the edge.
        to: VertexId,
        /// Passages from start to end minus those from end to start.
        surplus: i64,
    },
    /// The number of triangles on record is wrong.
    #[error("{recorded} triangles on record, {found} found")]
    Count {
        /// The number on record.
        recorded: usize,
        /// The number found.
        found: usize,
    },
}

/// Recomputes labels and facets of all cells and verifies that the surface is closed and oriented.
pub(crate) fn check(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    weight: impl Fn(CellId) -> u64,
    is_free: impl Fn(CellId) -> bool,
) -> Result<(), SurfaceViolation> {
    let mut found = 0;
    let mut edges: FxHashMap<(VertexId, VertexId), i64> = FxHashMap::default();
    for cell in tetrahedra.cells() {
        if facets.is_free(cell) != is_free(cell) {
            return Err(SurfaceViolation::Label {
                cell,
                recorded: facets.is_free(cell),
                weight: weight(cell),
            });
        }
        for facet in 0..4 {
            let (other, _) = tetrahedra.neighbor(cell, facet);
            let is_boundary = is_free(cell) && !is_free(other);
            let is_hull = is_boundary && tetrahedra.is_ghost(other);
            let is_surface = is_boundary && (facets.hull() != Hull::Drop || !is_hull);
            if facets.is_surface(cell, facet) != is_surface {
                return Err(SurfaceViolation::Facet { cell, facet });
            }
            found += usize::from(is_surface);
            if is_boundary {
                let corners = triangle(tetrahedra, cell, facet);
                for k in 0..3 {
                    let (from, to) = (corners[k], corners[(k + 1) % 3]);
                    let (key, sign) = if from < to {
                        ((from, to), 1)
                    } else {
                        ((to, from), -1)
                    };
                    *edges.entry(key).or_default() += sign;
                }
            }
        }
    }
    if found != facets.len() {
        return Err(SurfaceViolation::Count {
            recorded: facets.len(),
            found,
        });
    }
    let mut open: Vec<_> = edges
        .into_iter()
        .filter(|(_, surplus)| *surplus != 0)
        .collect();
    open.sort_unstable();
    match open.first() {
        Some(&((from, to), surplus)) => Err(SurfaceViolation::Open { from, to, surplus }),
        None => Ok(()),
    }
}
