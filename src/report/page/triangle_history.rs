//! The history of the triangles of a surface over states.

use linecarve_carving::Face;
use rustc_hash::FxHashMap;

use super::element_history::Lifetime;

/// The triangles of a surface that changes from state to state, stored as one record per lifetime. Memory grows with the
/// changes.
#[derive(Debug, Clone, Default)]
pub(super) struct TriangleHistory {
    /// Triangles by the vertices of the page, sorted by first state, then by triangle.
    records: Vec<([u32; 3], Lifetime)>,
    /// The record of each current face of the surface.
    current: FxHashMap<Face, u32>,
    states: u16,
}

impl TriangleHistory {
    /// Adds a state: the faces that are gone, and those that are new, with their vertices on the page.
    ///
    /// # Complexity
    /// O(n log n) for n changed faces.
    pub(super) fn push(
        &mut self,
        gone: impl IntoIterator<Item = Face>,
        came: impl IntoIterator<Item = (Face, [u32; 3])>,
    ) {
        for face in gone {
            if let Some(record) = self.current.remove(&face) {
                self.records[record as usize].1.end(self.states);
            }
        }
        let lifetime = Lifetime::beginning(self.states);
        let mut came: Vec<([u32; 3], Face)> =
            came.into_iter().map(|(face, ids)| (ids, face)).collect();
        came.sort_unstable();
        for (ids, face) in came {
            self.current.insert(face, self.records.len() as u32);
            self.records.push((ids, lifetime));
        }
        self.states += 1;
    }

    /// The current faces.
    pub(super) fn faces(&self) -> Vec<Face> {
        self.current.keys().copied().collect()
    }

    /// Drops every second state, beginning with the first.
    ///
    /// # Panics
    /// When the number of states is odd: the last one is needed for the next.
    pub(super) fn thin(&mut self) {
        assert!(self.states.is_multiple_of(2), "the last state stays");
        let mut kept: Vec<([u32; 3], Lifetime, u32)> = Vec::new();
        for (index, (ids, lifetime)) in (0..).zip(std::mem::take(&mut self.records)) {
            if let Some(lifetime) = lifetime.thinned() {
                kept.push((ids, lifetime, index));
            }
        }
        kept.sort_unstable_by_key(|(ids, lifetime, _)| (lifetime.first_state, *ids));
        let moved: FxHashMap<u32, u32> = (0..)
            .zip(&kept)
            .filter(|(_, (_, lifetime, _))| lifetime.end_state.is_none())
            .map(|(now, (_, _, before))| (*before, now))
            .collect();
        for record in self.current.values_mut() {
            if let Some(now) = moved.get(record) {
                *record = *now;
            }
        }
        let records = kept.into_iter().map(|(ids, lifetime, _)| (ids, lifetime));
        self.records = records.collect();
        self.states /= 2;
    }

    /// Gives each vertex of the page another number, in the same order.
    pub(super) fn renumber(&mut self, numbers: &[u32]) {
        for (ids, _) in &mut self.records {
            *ids = ids.map(|id| numbers[id as usize]);
        }
    }

    /// All lifetimes, sorted by first state, then by triangle.
    pub(super) fn records(&self) -> &[([u32; 3], Lifetime)] {
        &self.records
    }

    /// Memory of the lifetimes, in bytes.
    pub(super) fn memory(&self) -> usize {
        size_of_val(&self.records[..])
    }

    /// Number of triangles added with each state.
    pub(super) fn added_counts(&self) -> Vec<u32> {
        let mut added_counts = vec![0; usize::from(self.states)];
        for (_, lifetime) in &self.records {
            added_counts[usize::from(lifetime.first_state)] += 1;
        }
        added_counts
    }
}
