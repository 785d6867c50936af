//! What the segments contribute to a cell, computed from the rule alone.

use crate::tetrahedralization::{CellId, Tetrahedralization};

use super::super::anchors::is_inside;
use super::super::segment_cell::crosses_cell;
use super::super::{Contribution, ListError, ObservationId, ObservationTable, Views};
use super::SegmentVisibility;
use super::evidence::ANCHORS;
use super::triangle_cell::triangle_meets_cell;

impl SegmentVisibility {
    pub(super) fn expected_in(
        &self,
        tetrahedra: &Tetrahedralization,
        views: &Views,
        cell: CellId,
    ) -> Result<Contribution, ListError> {
        let has_lists = self.crossings.has_lists();
        let listed = has_lists.then(|| self.crossings.of(cell));
        let mut listed: Vec<ObservationId> = listed.into_iter().flatten().collect();
        listed.sort_unstable();
        let repeated = listed.windows(2).find(|pair| pair[0] == pair[1]);
        let stale = listed.iter().find(|id| !self.table.is_in_use(**id));
        if let Some(&observation) = stale.or(repeated.map(|pair| &pair[0])) {
            return Err(ListError {
                observation,
                is_listed: true,
            });
        }
        let mut expected = Contribution::default();
        if tetrahedra.is_ghost(cell) {
            return Ok(expected);
        }
        let corners = tetrahedra
            .cell_vertices(cell)
            .map(|v| tetrahedra.coordinates(v));
        for id in self.table.all() {
            let evidence = self.table.get(id).evidence(tetrahedra, views);
            let [a, b] = evidence.ends;
            if triangle_meets_cell([evidence.center, a, b], corners) {
                if has_lists && listed.binary_search(&id).is_err() {
                    return Err(ListError {
                        observation: id,
                        is_listed: false,
                    });
                }
                let ends_in = crosses_cell(a, b, corners);
                expected.weight += u64::from(!ends_in) * u64::from(evidence.weight);
                if let Some(softness) = &self.softness {
                    let frame = evidence.frame(softness);
                    let contribution = evidence.passage(&frame, corners, ends_in);
                    expected.evidence.add(&contribution);
                }
            }
            if let Some(softness) = &self.softness
                && evidence.has_area()
            {
                let frame = evidence.frame(softness);
                let inside = (0..ANCHORS)
                    .map(|k| evidence.anchor(&frame, softness, k))
                    .filter(|anchor| is_inside(tetrahedra, cell, *anchor));
                expected.evidence.occupied +=
                    inside.count() as u64 * evidence.anchor_weight(softness);
            }
        }
        Ok(expected)
    }
}
