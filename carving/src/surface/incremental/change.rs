//! The change of an incremental mesh.

use rustc_hash::FxHashSet;

/// Corners of a face by the numbers of its vertices, counter-clockwise seen from free space, the smallest first.
pub type Face = [u32; 3];

/// The change of an [`IncrementalMesh`](super::IncrementalMesh) between two moments. All lists are sorted, and no element is
/// twice in a list.
///
/// To follow the mesh: delete `removed`, update the positions of `placed`, insert `added`. A number in `freed` may be given to
/// another vertex later.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshChange {
    /// Vertices that are new or at another position, and those inside triangles whose part is another one.
    pub placed: Vec<u32>,
    /// Vertices that are gone.
    pub freed: Vec<u32>,
    /// Faces that are new.
    pub added: Vec<Face>,
    /// Faces that are gone.
    pub removed: Vec<Face>,
    /// Faces that stayed and have a corner at another position.
    pub reshaped: Vec<Face>,
}

impl MeshChange {
    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        let lists = [&self.added, &self.removed, &self.reshaped];
        self.placed.is_empty() && self.freed.is_empty() && lists.iter().all(|it| it.is_empty())
    }
}

/// Sums up changes.
#[derive(Clone, Debug, Default)]
pub struct ChangeLog {
    placed: FxHashSet<u32>,
    freed: FxHashSet<u32>,
    added: FxHashSet<Face>,
    removed: FxHashSet<Face>,
    reshaped: FxHashSet<Face>,
}

impl ChangeLog {
    /// Adds a change that follows those so far.
    pub fn append(&mut self, change: &MeshChange) {
        for face in &change.removed {
            self.remove(*face);
        }
        for number in &change.freed {
            self.free(*number);
        }
        for number in &change.placed {
            self.place(*number);
        }
        for face in &change.added {
            self.add(*face);
        }
        for face in &change.reshaped {
            self.reshape(*face);
        }
    }

    /// The sum; the log is empty afterwards.
    pub fn take(&mut self) -> MeshChange {
        MeshChange {
            placed: sorted(&mut self.placed),
            freed: sorted(&mut self.freed),
            added: sorted(&mut self.added),
            removed: sorted(&mut self.removed),
            reshaped: sorted(&mut self.reshaped),
        }
    }

    /// A vertex came or moved.
    pub(super) fn place(&mut self, number: u32) {
        self.freed.remove(&number);
        self.placed.insert(number);
    }

    /// A vertex went.
    pub(super) fn free(&mut self, number: u32) {
        self.placed.remove(&number);
        self.freed.insert(number);
    }

    /// A face came. If it was there before, its vertices may have been replaced meanwhile.
    pub(super) fn add(&mut self, face: Face) {
        if self.removed.remove(&face) {
            self.reshaped.insert(face);
        } else {
            self.added.insert(face);
        }
    }

    /// A face went.
    pub(super) fn remove(&mut self, face: Face) {
        if !self.added.remove(&face) {
            self.reshaped.remove(&face);
            self.removed.insert(face);
        }
    }

    /// A corner of a face moved.
    pub(super) fn reshape(&mut self, face: Face) {
        if !self.added.contains(&face) {
            self.reshaped.insert(face);
        }
    }
}

/// Empties a set into a sorted list.
fn sorted<T: Ord + Copy>(set: &mut FxHashSet<T>) -> Vec<T> {
    let mut list: Vec<T> = set.drain().collect();
    list.sort_unstable();
    list
}
