//! The vertices of an incremental mesh.

use nalgebra::Point3;

use crate::tetrahedralization::VertexId;

/// Marks the end of a list.
const NONE: u32 = u32::MAX;

/// A vertex of the mesh.
#[derive(Clone, Copy, Debug)]
struct MeshVertex {
    position: Point3<f64>,
    /// The vertex that it copies; `None` for the midpoint of a split edge.
    origin: Option<VertexId>,
    /// Number of face corners at it.
    uses: u32,
    /// The next copy of the same vertex.
    next: u32,
}

/// The vertices of an incremental mesh by number, and the copies of each vertex of the tetrahedralisation.
#[derive(Clone, Debug, Default)]
pub(super) struct MeshVertices {
    vertices: Vec<MeshVertex>,
    free: Vec<u32>,
    /// First copy of each vertex of the tetrahedralisation.
    first: Vec<u32>,
}

impl MeshVertices {
    /// Number of numbers given out, those without a vertex included.
    pub(super) fn capacity(&self) -> usize {
        self.vertices.len()
    }

    /// Number of vertices.
    pub(super) fn len(&self) -> usize {
        self.vertices.len() - self.free.len()
    }

    /// Whether a number belongs to a vertex.
    pub(super) fn is_vertex(&self, number: u32) -> bool {
        (self.vertices.get(number as usize)).is_some_and(|vertex| vertex.uses > 0)
    }

    pub(super) fn position(&self, number: u32) -> &Point3<f64> {
        &self.vertices[number as usize].position
    }

    pub(super) fn origin(&self, number: u32) -> Option<VertexId> {
        self.vertices[number as usize].origin
    }

    /// The copies of a vertex of the tetrahedralisation, the newest first.
    pub(super) fn copies(&self, vertex: VertexId) -> impl Iterator<Item = u32> + '_ {
        let at = |number: u32| (number != NONE).then_some(number);
        let first = self.first.get(vertex.index()).copied().and_then(at);
        std::iter::successors(
            first,
            move |&number| at(self.vertices[number as usize].next),
        )
    }

    /// Adds a vertex without uses; it takes the number that was freed last.
    pub(super) fn add(&mut self, position: Point3<f64>, origin: Option<VertexId>) -> u32 {
        let number = self.free.pop().unwrap_or(self.vertices.len() as u32);
        let mut next = NONE;
        if let Some(origin) = origin {
            if self.first.len() <= origin.index() {
                self.first.resize(origin.index() + 1, NONE);
            }
            next = std::mem::replace(&mut self.first[origin.index()], number);
        }
        let vertex = MeshVertex {
            position,
            origin,
            uses: 0,
            next,
        };
        match self.vertices.get_mut(number as usize) {
            Some(free) => *free = vertex,
            None => self.vertices.push(vertex),
        }
        number
    }

    /// Moves a vertex; returns whether it was elsewhere.
    pub(super) fn place(&mut self, number: u32, position: Point3<f64>) -> bool {
        let vertex = &mut self.vertices[number as usize];
        std::mem::replace(&mut vertex.position, position) != position
    }

    pub(super) fn count_use(&mut self, number: u32) {
        self.vertices[number as usize].uses += 1;
    }

    /// Takes back a use; returns whether there are others.
    pub(super) fn end_use(&mut self, number: u32) -> bool {
        let vertex = &mut self.vertices[number as usize];
        vertex.uses -= 1;
        vertex.uses > 0
    }

    /// Frees the number of a vertex without uses.
    pub(super) fn free(&mut self, number: u32) {
        let MeshVertex { origin, next, .. } = self.vertices[number as usize];
        if let Some(origin) = origin {
            let before = self
                .copies(origin)
                .find(|&copy| self.vertices[copy as usize].next == number);
            match before {
                Some(before) => self.vertices[before as usize].next = next,
                None => self.first[origin.index()] = next,
            }
        }
        self.vertices[number as usize].origin = None;
        self.free.push(number);
    }
}
