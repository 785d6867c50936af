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
use super::part::{TrianglePart, VertexOrigin};
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
    /// A part of it is exported, when its component is large enough; all of it where it fills a [gap](ExportOptions::fill_gaps).
    Part(TrianglePart),
}

impl TriangleRole {
    /// Whether some of the triangle is exported.
    pub(super) fn is_exported(&self) -> bool {
        matches!(self, Self::Exported | Self::Part(_))
    }

    /// What is exported of the triangle, if not all or nothing.
    pub(super) fn part(&self) -> Option<TrianglePart> {
        match self {
            Self::Part(part) => Some(*part),
            Self::Ignored | Self::Counted | Self::Exported => None,
        }
    }

    /// Whether the edge that starts at a corner is exported.
    pub(super) fn has_edge(&self, edge: usize) -> bool {
        self.is_exported() && self.part().is_none_or(|part| part.edges[edge])
    }

    /// Whether a corner is exported.
    fn has_corner(&self, corner: usize) -> bool {
        self.is_exported() && self.part().is_none_or(|part| part.has_corner(corner))
    }

    /// The role where these neighbours are exported as a whole.
    pub(super) fn beside_whole(self, is_beside_whole: [bool; 3]) -> Self {
        let Self::Part(part) = self else {
            return self;
        };
        let part = part.beside(|k| is_beside_whole[k]);
        part.map_or(Self::Counted, Self::Part)
    }

    /// The same role of the triangle whose corners begin with what was corner `first`.
    #[must_use]
    pub fn rotated(self, first: usize) -> Self {
        match self {
            Self::Part(part) => Self::Part(part.rotated(first)),
            other => other,
        }
    }
}

/// What is known about a triangle of the carved surface.
#[derive(Clone, Copy, Debug)]
struct Record {
    role: TriangleRole,
    /// Whether its component is large enough.
    is_large: bool,
    /// Whether it is left out, and the triangles across its edges are not.
    is_gap: bool,
    /// Whether the triangle across each edge is exported as a whole; known of those that are not.
    is_beside_whole: [bool; 3],
    /// The mesh vertex at each corner; [`NONE`] where it is not exported.
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
            is_beside_whole: [false; 3],
            corners: [NONE; 3],
            face: NONE,
        }
    }
}

impl Record {
    /// What is exported of it: what its role, its neighbours and its component make of it.
    fn exported(&self) -> TriangleRole {
        match self.role {
            _ if !self.is_large => TriangleRole::Counted,
            _ if self.is_gap => TriangleRole::Exported,
            role => role.beside_whole(self.is_beside_whole),
        }
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
    /// Whether what is exported of a triangle depends on its neighbours.
    joins: bool,
    /// All triangles of the carved surface.
    records: FxHashMap<Triangle, Record>,
    vertices: MeshVertices,
    faces: Faces,
    /// Triangles with a split edge, and those of which a part is exported.
    splits: FxHashMap<Triangle, Split>,
    /// The triangle around each vertex that lies inside one.
    inside: FxHashMap<u32, Triangle>,
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
            joins: options.needs_neighbors(),
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

    /// The vertex of the tetrahedralisation at a vertex; `None` for the midpoint of a split edge and inside a triangle.
    ///
    /// # Panics
    ///
    /// For numbers that were never given out.
    pub fn origin(&self, number: u32) -> Option<VertexId> {
        self.vertices.origin(number)
    }

    /// What a vertex is.
    ///
    /// # Panics
    ///
    /// For numbers that were never given out.
    pub fn vertex_origin(&self, number: u32) -> VertexOrigin<VertexId> {
        let inside = || {
            let corners = self.inside.get(&number)?;
            let part = self.records.get(corners)?.exported().part()?;
            Some(VertexOrigin::Inside {
                corners: *corners,
                part,
            })
        };
        match self.origin(number) {
            Some(vertex) => VertexOrigin::Vertex(vertex),
            None => inside().unwrap_or(VertexOrigin::Middle),
        }
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
