//! The faces of an incremental mesh.

use super::super::delta::rotate_smallest_first;
use super::change::{ChangeLog, Face};
use super::vertices::MeshVertices;

/// Marks a number without a face.
const FREE: Face = [u32::MAX; 3];

/// The faces of an incremental mesh by number.
#[derive(Clone, Debug, Default)]
pub(super) struct Faces {
    corners: Vec<Face>,
    free: Vec<u32>,
}

impl Faces {
    /// Number of faces.
    pub(super) fn len(&self) -> usize {
        self.corners.len() - self.free.len()
    }

    /// All faces, by number.
    pub(super) fn iter(&self) -> impl Iterator<Item = Face> + '_ {
        self.corners.iter().copied().filter(|face| *face != FREE)
    }

    pub(super) fn corners(&self, number: u32) -> Face {
        self.corners[number as usize]
    }

    /// Adds a face and counts the uses of its vertices; it takes the number that was freed last.
    pub(super) fn add(
        &mut self,
        corners: Face,
        vertices: &mut MeshVertices,
        log: &mut ChangeLog,
    ) -> u32 {
        let corners = rotate_smallest_first(corners);
        log.add(corners);
        for corner in corners {
            vertices.count_use(corner);
        }
        match self.free.pop() {
            Some(number) => {
                self.corners[number as usize] = corners;
                number
            }
            None => {
                self.corners.push(corners);
                (self.corners.len() - 1) as u32
            }
        }
    }

    /// Removes a face; appends the vertices that it was the last to use.
    pub(super) fn remove(
        &mut self,
        number: u32,
        vertices: &mut MeshVertices,
        unused: &mut Vec<u32>,
        log: &mut ChangeLog,
    ) {
        let corners = std::mem::replace(&mut self.corners[number as usize], FREE);
        self.free.push(number);
        log.remove(corners);
        unused.extend(
            corners
                .into_iter()
                .filter(|&corner| !vertices.end_use(corner)),
        );
    }
}
