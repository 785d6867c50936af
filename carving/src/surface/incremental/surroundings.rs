//! The triangles around vertices, each looked up once in an update.

use rustc_hash::FxHashMap;

use super::locate::{Carved, Located};
use crate::tetrahedralization::{IncidentCells, VertexId};

/// What is known of the surface around vertices; while it does not change.
#[derive(Default)]
pub(super) struct Surroundings {
    scratch: IncidentCells,
    /// For each vertex the first of its triangles in `triangles`, and the end of them.
    known: FxHashMap<VertexId, [u32; 2]>,
    triangles: Vec<Located>,
}

impl Surroundings {
    /// The surface triangles around a vertex, in increasing order; none when the vertex is gone. `found` is cleared first.
    pub(super) fn list(&mut self, carved: Carved<'_>, vertex: VertexId, found: &mut Vec<Located>) {
        if let Some([first, end]) = self.known.get(&vertex) {
            found.clear();
            found.extend(&self.triangles[*first as usize..*end as usize]);
            return;
        }
        carved.around(vertex, &mut self.scratch, found);
        let first = self.triangles.len() as u32;
        self.triangles.extend(&*found);
        self.known
            .insert(vertex, [first, self.triangles.len() as u32]);
    }
}
