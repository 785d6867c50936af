//! Recomputes every invariant.

use thiserror::Error;

use super::Tetrahedralization;
use super::ids::{CellId, GHOST, NO_CELL, VertexId};
use super::storage::FACET;
use crate::predicates::orient3d;

/// The first invariant found broken, with its witness. Any occurrence is a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TetrahedralizationViolation {
    /// A corner is not a living vertex, occurs twice, or the ghost is not last.
    #[error("{cell:?} has invalid corners {vertices:?}")]
    Corners {
        /// The cell.
        cell: CellId,
        /// Its corners.
        vertices: [VertexId; 4],
    },
    /// The neighbour across a facet does not refer to it, is dead, or has other corners there.
    #[error("facet {facet} of {cell:?} and its neighbour do not match")]
    Adjacency {
        /// The cell.
        cell: CellId,
        /// The corner opposite the facet.
        facet: usize,
    },
    /// A finite cell is flat or turned over.
    #[error("{cell:?} is not positively oriented")]
    Orientation {
        /// The cell.
        cell: CellId,
    },
    /// A vertex lies inside the perturbed circumsphere of a cell; for a ghost cell: the hull is not convex or its
    /// facets are not Delaunay.
    #[error("{vertex:?} is in conflict with {cell:?}")]
    Conflict {
        /// The cell.
        cell: CellId,
        /// The vertex.
        vertex: VertexId,
    },
    /// The cell recorded for a vertex is dead or does not contain it.
    #[error("the cell recorded for {vertex:?} does not contain it")]
    VertexCell {
        /// The vertex.
        vertex: VertexId,
    },
    /// Vertices, edges, facets and cells do not form a sphere: V − E + F − C is not 0, or counters are wrong.
    #[error("Euler characteristic {characteristic} instead of 0")]
    Euler {
        /// Vertices (with the ghost) minus edges plus facets minus cells.
        characteristic: i64,
    },
    /// A mark or label of an operation was left behind.
    #[error("a mark was left on {cell:?}")]
    Mark {
        /// The cell.
        cell: CellId,
    },
    /// The vertices of a state below dimension three are inconsistent, or cells exist nevertheless.
    #[error("the state of dimension {dimension} is inconsistent")]
    LowDimension {
        /// The dimension.
        dimension: i8,
    },
}

impl Tetrahedralization {
    /// Verifies every invariant exactly; meant for tests.
    ///
    /// Corners and adjacency, orientation, the empty perturbed circumsphere across every facet (which implies that
    /// every circumsphere is empty of all vertices), convexity of the hull, the cell of each vertex, Euler's
    /// formula, and marks.
    ///
    /// # Errors
    ///
    /// The first [`TetrahedralizationViolation`].
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells, apart from sorting edges.
    pub fn check(&self) -> Result<(), TetrahedralizationViolation> {
        if self.recent_cell == NO_CELL {
            return self.check_low();
        }
        if self.low.dimension() != -1 || !self.storage.is_alive(self.recent_cell) {
            return Err(TetrahedralizationViolation::LowDimension {
                dimension: self.low.dimension(),
            });
        }
        for cell in self.cells() {
            self.check_cell(cell)?;
        }
        for vertex in self.vertices() {
            let contains = self
                .cell_of(vertex)
                .is_some_and(|c| self.is_cell(c) && self.cell_vertices(c).contains(&vertex));
            if !contains || self.storage.vertices[vertex.index()].label != super::storage::NO_LABEL
            {
                return Err(TetrahedralizationViolation::VertexCell { vertex });
            }
        }
        self.check_euler()
    }

    /// Verifies that no vertex at all is in conflict with any cell; quadratic, for small sets.
    ///
    /// # Errors
    ///
    /// The first [`TetrahedralizationViolation`] of [`check`](Self::check), or the first vertex in conflict with a cell.
    pub fn check_exhaustively(&self) -> Result<(), TetrahedralizationViolation> {
        self.check()?;
        for cell in self.cells() {
            for vertex in self.vertices() {
                self.check_conflict(cell, vertex)?;
            }
        }
        Ok(())
    }

    fn check_low(&self) -> Result<(), TetrahedralizationViolation> {
        let consistent = self.storage.live_cells() == 0
            && self.storage.live_ghost_cells() == 0
            && self.low.is_consistent(&self.storage)
            && self.low.vertices().count() == self.vertex_count()
            && self.vertices().all(|v| self.cell_of(v).is_none());
        if consistent {
            Ok(())
        } else {
            Err(TetrahedralizationViolation::LowDimension {
                dimension: self.low.dimension(),
            })
        }
    }

    fn check_cell(&self, cell: CellId) -> Result<(), TetrahedralizationViolation> {
        let vertices = self.cell_vertices(cell);
        let raw = vertices.map(|v| v.0);
        let valid = (0..4).all(|i| {
            let usable = self.storage.is_vertex_alive(raw[i]) || (raw[i] == GHOST && i == 3);
            usable && !raw[..i].contains(&raw[i])
        });
        if !valid {
            return Err(TetrahedralizationViolation::Corners { cell, vertices });
        }
        if self.storage.states[cell.index()] != super::storage::state::ALIVE {
            return Err(TetrahedralizationViolation::Mark { cell });
        }
        if raw[3] != GHOST {
            let [a, b, c, d] = raw.map(|v| self.storage.position(v));
            if orient3d(a, b, c, d) <= 0.0 {
                return Err(TetrahedralizationViolation::Orientation { cell });
            }
        }
        for (facet, corners) in FACET.iter().enumerate() {
            let broken = TetrahedralizationViolation::Adjacency { cell, facet };
            if self.storage.cell(cell.raw()).neighbors[facet] == NO_CELL {
                return Err(broken);
            }
            let (other, back) = self.neighbor(cell, facet);
            if !self.is_cell(other) || self.neighbor(other, back) != (cell, facet) {
                return Err(broken);
            }
            // Seen from the other side the facet turns the other way.
            let here = corners.map(|k| vertices[k]);
            let there = FACET[back].map(|k| self.cell_vertices(other)[k]);
            let turned = (0..3).any(|k| here == [there[k], there[(k + 2) % 3], there[(k + 1) % 3]]);
            if !turned {
                return Err(broken);
            }
            self.check_conflict(cell, self.cell_vertices(other)[back])?;
        }
        Ok(())
    }

    fn check_conflict(
        &self,
        cell: CellId,
        vertex: VertexId,
    ) -> Result<(), TetrahedralizationViolation> {
        let record = self.storage.cell(cell.raw());
        if vertex.is_ghost() || record.vertices.contains(&vertex.0) {
            return Ok(());
        }
        // Of a ghost cell: when the vertex is the far corner of the finite neighbour, the facet's side decides.
        let inner_has_it = record.is_ghost()
            && self
                .storage
                .cell(record.neighbors[3] >> 2)
                .vertices
                .contains(&vertex.0);
        let p = self.storage.position(vertex.0);
        let conflict = if inner_has_it {
            let [a, b, c, _] = record.vertices;
            let at = |v: u32| self.storage.position(v);
            orient3d(at(a), at(b), at(c), p) >= 0.0
        } else {
            self.is_in_conflict(record, p)
        };
        if conflict {
            return Err(TetrahedralizationViolation::Conflict { cell, vertex });
        }
        Ok(())
    }

    fn check_euler(&self) -> Result<(), TetrahedralizationViolation> {
        let mut edges = Vec::new();
        let mut cells = 0;
        let mut ghosts = 0;
        for cell in self.cells() {
            cells += 1;
            ghosts += usize::from(self.is_ghost(cell));
            let v = self.cell_vertices(cell);
            for i in 0..4 {
                for j in 0..i {
                    edges.push((v[i].min(v[j]), v[i].max(v[j])));
                }
            }
        }
        edges.sort_unstable();
        edges.dedup();
        // Each cell has four facets, each shared by two.
        let characteristic =
            (self.vertex_count() as i64 + 1) - edges.len() as i64 + 2 * cells - cells;
        let counted = ghosts == self.ghost_cell_count()
            && cells as usize == self.finite_cell_count() + self.ghost_cell_count();
        if characteristic != 0 || !counted {
            return Err(TetrahedralizationViolation::Euler { characteristic });
        }
        Ok(())
    }
}
