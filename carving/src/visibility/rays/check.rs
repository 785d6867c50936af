//! What the rays contribute to a cell, computed from the rule alone.

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::super::anchors::is_inside;
use super::super::segment_cell::{crosses_cell, crosses_ghost};
use super::super::{Contribution, ListError, ObservationId, Sum, Views};
use super::RayVisibility;
use super::walk::Walker;

impl RayVisibility {
    /// Whether a ray crosses a cell.
    pub(crate) fn crosses(
        &self,
        tetrahedra: &Tetrahedralization,
        views: &Views,
        ray: ObservationId,
        cell: CellId,
    ) -> bool {
        let center = views.center(self.table.view(ray));
        let target = VertexId::from_index(self.table.vertex(ray) as usize);
        let target = tetrahedra.coordinates(target);
        let vertices = tetrahedra.cell_vertices(cell);
        if tetrahedra.is_ghost(cell) {
            let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
            crosses_ghost(center, target, facet)
        } else {
            let corners = vertices.map(|v| tetrahedra.coordinates(v));
            crosses_cell(center, target, corners)
        }
    }

    /// What all rays contribute to a cell, computed from the rule alone, without any walk or list.
    ///
    /// # Errors
    ///
    /// A ray that the cell lists wrongly.
    pub(crate) fn expected(
        &self,
        tetrahedra: &Tetrahedralization,
        views: &Views,
        cell: CellId,
    ) -> Result<Contribution, ListError> {
        let has_lists = self.crossings.has_lists();
        let mut is_listed = vec![false; self.table.capacity()];
        if has_lists {
            for ray in self.crossings.of(cell) {
                is_listed[ray.0 as usize] = true;
            }
        }
        let walker = Walker {
            tetrahedra,
            views,
            rays: &self.table,
            softness: self.softness,
        };
        let is_ghost = tetrahedra.is_ghost(cell);
        let mut expected = Contribution::default();
        for ray in self.table.all() {
            let crosses = self.crosses(tetrahedra, views, ray, cell);
            let is_listed = is_listed[ray.0 as usize];
            // Rays that run in the boundary of the cell may be listed as well.
            if has_lists && crosses != is_listed && (crosses || !self.table.is_degenerate(ray)) {
                return Err(ListError {
                    observation: ray,
                    is_listed,
                });
            }
            expected.weight += u64::from(crosses) * u64::from(self.table.weight(ray));
            let Some(evidence) = walker.evidence(ray) else {
                continue;
            };
            if is_ghost {
                continue;
            }
            if crosses {
                let vertices = tetrahedra.cell_vertices(cell);
                let exit = evidence.exit(vertices.map(|v| tetrahedra.coordinates(v)));
                if let Some(sum) = Sum::of_exit(exit) {
                    *expected.evidence.of(sum) += evidence.passage(tetrahedra, cell, exit);
                }
            }
            if is_inside(tetrahedra, cell, evidence.anchor()) {
                expected.evidence.occupied += evidence.anchor_weight();
            }
        }
        Ok(expected)
    }
}
