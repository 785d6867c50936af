//! The exported surface, kept up to date by changes.
//!
//! [`extract`](super::extract) makes the exported surface anew. An [`IncrementalMesh`] follows the carver instead and looks only
//! at what an update may have changed, in this order: triangles that came, went or are exported differently; the components
//! around them; fans around the vertices in reach, each of which becomes a mesh vertex; edges with the same ends, all but one
//! of which are split; faces.

mod change;
mod components;
mod export;
mod faces;
mod fans;
mod locate;
mod splits;
mod surroundings;
mod update;
mod vertices;

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::delta::Triangle;
use super::extract::ExportOptions;
use crate::tetrahedralization::VertexId;
use faces::Faces;
use splits::Split;
use vertices::MeshVertices;

pub use change::{ChangeLog, Face, MeshChange};
pub(crate) use locate::Carved;

/// Marks a corner without mesh vertex and a triangle without face.
const NONE: u32 = u32::MAX;

/// How a triangle of the carved surface is exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TriangleRole {
    /// It is left out, and components are those without it.
    #[default]
    Ignored,
    /// It is left out, but counts for the size of its component, and is exported where it fills a
    /// [gap](ExportOptions::fill_gaps).
    Counted,
    /// It is exported when its component is large enough.
    Exported,
}

/// What is known about a triangle of the carved surface.
#[derive(Clone, Copy, Debug)]
struct Record {
    role: TriangleRole,
    /// Whether its component is large enough.
    is_large: bool,
    /// Whether it is left out, and the triangles across its edges are not.
    is_gap: bool,
    /// The mesh vertex at each corner; [`NONE`] when it is not exported.
    corners: [u32; 3],
    /// Its face; [`NONE`] when it is not exported or split.
    face: u32,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            role: TriangleRole::Ignored,
            is_large: false,
            is_gap: false,
            corners: [NONE; 3],
            face: NONE,
        }
    }
}

impl Record {
    fn is_exported(&self) -> bool {
        (self.role == TriangleRole::Exported || self.is_gap) && self.is_large
    }
}

/// The exported surface of a [`Carver`](crate::Carver), kept up to date by its deltas:
/// [`Carver::update_mesh`](crate::Carver::update_mesh).
///
/// Vertices and faces have numbers. A number stays with its vertex; that of a vertex that is gone is given to another one later.
/// The numbers depend on the history of the carver, the surface does not: [`to_mesh`](Self::to_mesh) equals
/// [`Carver::mesh_where`](crate::Carver::mesh_where).
///
/// # Complexity
///
/// An update costs what it changes. Memory is linear in the number of triangles.
#[derive(Clone, Debug, Default)]
pub struct IncrementalMesh {
    minimum_component: usize,
    manifold: bool,
    fills_gaps: bool,
    /// All triangles of the carved surface.
    records: FxHashMap<Triangle, Record>,
    vertices: MeshVertices,
    faces: Faces,
    /// Triangles with a split edge.
    splits: FxHashMap<Triangle, Split>,
    /// Triangles with an edge of which another has the same ends; some of them had one once.
    repeated: FxHashSet<Triangle>,
    log: ChangeLog,
}

impl IncrementalMesh {
    /// An empty mesh. `options.longest_edge` is not looked at: the role of a triangle says whether it is exported.
    pub fn new(options: &ExportOptions) -> Self {
        Self {
            minimum_component: options.minimum_component,
            manifold: options.manifold,
            fills_gaps: options.fill_gaps,
            ..Self::default()
        }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// The numbers of vertices lie below this one.
    pub fn vertex_capacity(&self) -> usize {
        self.vertices.capacity()
    }

    /// Whether a number belongs to a vertex.
    pub fn is_vertex(&self, number: u32) -> bool {
        self.vertices.is_vertex(number)
    }

    /// Position of a vertex.
    ///
    /// # Panics
    ///
    /// For numbers that were never given out.
    pub fn position(&self, number: u32) -> Point3<f64> {
        *self.vertices.position(number)
    }

    /// The vertex of the tetrahedralisation at a vertex; `None` for the midpoint of a split edge.
    ///
    /// # Panics
    ///
    /// For numbers that were never given out.
    pub fn origin(&self, number: u32) -> Option<VertexId> {
        self.vertices.origin(number)
    }

    /// The vertices at a vertex of the tetrahedralisation: one for each fan of the surface.
    pub fn copies(&self, vertex: VertexId) -> impl Iterator<Item = u32> + '_ {
        self.vertices.copies(vertex)
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// All faces, in an order that depends on history.
    pub fn faces(&self) -> impl Iterator<Item = Face> + '_ {
        self.faces.iter()
    }

    /// The change since the last call.
    pub fn take_change(&mut self) -> MeshChange {
        self.log.take()
    }
}
