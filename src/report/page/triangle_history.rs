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
    states: u32,
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
                self.records[record as usize].1.end_state = Some(self.states);
            }
        }
        let lifetime = Lifetime {
            first_state: self.states,
            end_state: None,
        };
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
        // The odd states stay; s / 2 of them lie before state s.
        let mut kept: Vec<([u32; 3], Lifetime, usize)> = Vec::new();
        for (index, (ids, mut lifetime)) in self.records.drain(..).enumerate() {
            lifetime.first_state /= 2;
            lifetime.end_state = lifetime.end_state.map(|end_state| end_state / 2);
            if lifetime.end_state != Some(lifetime.first_state) {
                kept.push((ids, lifetime, index));
            }
        }
        kept.sort_unstable_by_key(|(ids, lifetime, _)| (lifetime.first_state, *ids));
        let moved: FxHashMap<u32, u32> = (0..)
            .zip(&kept)
            .filter(|(_, (_, lifetime, _))| lifetime.end_state.is_none())
            .map(|(now, (_, _, before))| (*before as u32, now))
            .collect();
        for record in self.current.values_mut() {
            if let Some(now) = moved.get(record) {
                *record = *now;
            }
        }
        let records = kept.into_iter().map(|(ids, lifetime, _)| (ids, lifetime));
        self.records.extend(records);
        self.states /= 2;
    }

    /// All lifetimes, sorted by first state, then by triangle.
    pub(super) fn records(&self) -> &[([u32; 3], Lifetime)] {
        &self.records
    }

    /// Number of triangles added with each state.
    pub(super) fn added_counts(&self) -> Vec<u32> {
        let mut added_counts = vec![0; self.states as usize];
        for (_, lifetime) in &self.records {
            added_counts[lifetime.first_state as usize] += 1;
        }
        added_counts
    }
}
