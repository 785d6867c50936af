//! The exported surface of a map, kept up to date.

use linecarve_carving::{
    Carver, ExportOptions, IncrementalMesh, MeshChange, SurfaceDelta, Triangle, TriangleRole,
    VertexId,
};
use linecarve_mesh::{MeshElements, TriangleMesh};
use nalgebra::Point3;

use super::update::MapUpdate;

/// Colour of vertices without an observed colour: middle grey.
pub(super) const DEFAULT_COLOR: [u8; 3] = [128; 3];

/// The change of a [`MapSurface`] between two moments.
#[derive(Debug, Clone, Default)]
pub struct SurfaceChange {
    /// Vertices and faces.
    pub mesh: MeshChange,
    /// Vertices that stayed and have another colour, ascending.
    pub recolored: Vec<u32>,
    /// Whether the numbers of vertices were given out anew: the change is that of an empty surface.
    pub is_anew: bool,
}

/// The exported surface with colours. Each keyframe costs what it changes.
///
/// Vertices have numbers, which stay while the vertex does. Coordinates are in the frame of computation.
#[derive(Debug, Clone)]
pub struct MapSurface {
    mesh: IncrementalMesh,
    /// Observed colours by vertex.
    colors: Vec<Option<[u8; 3]>>,
    /// Number of vertices with an observed colour.
    colored: usize,
    /// Longest edge at the last update.
    longest_edge: Option<f64>,
    is_anew: bool,
    pending: Pending,
}

/// Changes that the mesh has not followed yet.
#[derive(Debug, Clone, Default)]
struct Pending {
    deltas: Vec<SurfaceDelta>,
    revalidated: Vec<Triangle>,
    recolored: Vec<VertexId>,
}

impl MapSurface {
    /// The surface of a carver; it is made at the first [update](Self::update).
    pub(super) fn new(carver: &Carver, export: &ExportOptions) -> Self {
        let mut added: Vec<Triangle> = carver.triangles().collect();
        added.sort_unstable();
        let whole = SurfaceDelta {
            added,
            ..SurfaceDelta::default()
        };
        Self {
            mesh: IncrementalMesh::new(export),
            colors: Vec::new(),
            colored: 0,
            longest_edge: export.longest_edge,
            is_anew: true,
            pending: Pending {
                deltas: vec![whole],
                ..Pending::default()
            },
        }
    }

    /// Notes what an update of the map changed.
    pub(super) fn note(&mut self, update: &MapUpdate) {
        let pending = &mut self.pending;
        let deltas = update.deltas.iter();
        pending.deltas.extend(
            deltas
                .filter(|delta| **delta != SurfaceDelta::default())
                .cloned(),
        );
        pending.revalidated.extend(&update.revalidated);
        pending.recolored.extend(&update.recolored);
    }

    /// Whether the mesh has followed all changes, with this longest edge.
    pub(super) fn is_current(&self, longest_edge: Option<f64>) -> bool {
        let Pending {
            deltas,
            revalidated,
            recolored,
        } = &self.pending;
        let is_pending = !(deltas.is_empty() && revalidated.is_empty() && recolored.is_empty());
        !is_pending && self.longest_edge == longest_edge
    }

    /// Follows the changes noted, and returns that of the exported surface. `role` says how a triangle is exported, `color` gives
    /// the observed colours.
    ///
    /// # Complexity
    /// Linear in the change; in the size of the surface when the longest edge is another one than before.
    pub(super) fn update(
        &mut self,
        carver: &Carver,
        longest_edge: Option<f64>,
        role: impl Fn(&Triangle) -> TriangleRole,
        color: impl Fn(VertexId) -> Option<[u8; 3]>,
    ) -> SurfaceChange {
        let mut pending = std::mem::take(&mut self.pending);
        if std::mem::replace(&mut self.longest_edge, longest_edge) != longest_edge {
            pending.revalidated.extend(carver.triangles());
        }
        let (deltas, touched) = (&pending.deltas, &pending.revalidated);
        carver.update_mesh(&mut self.mesh, deltas, touched, role);
        let mesh = self.mesh.take_change();
        let recolored = self.recolor(&mesh, pending.recolored, color);
        SurfaceChange {
            mesh,
            recolored,
            is_anew: std::mem::replace(&mut self.is_anew, false),
        }
    }

    /// Updates the colours after a change of the mesh; returns the vertices that stayed and have another colour.
    fn recolor(
        &mut self,
        change: &MeshChange,
        mut vertices: Vec<VertexId>,
        color: impl Fn(VertexId) -> Option<[u8; 3]>,
    ) -> Vec<u32> {
        self.colors.resize(self.mesh.vertex_capacity(), None);
        for &number in &change.freed {
            self.set_color(number, None);
        }
        for &number in &change.placed {
            let now = self.mesh.origin(number).and_then(&color);
            self.set_color(number, now);
        }
        vertices.sort_unstable();
        vertices.dedup();
        let mut recolored = Vec::new();
        let mut copies = Vec::new();
        for vertex in vertices {
            copies.clear();
            copies.extend(self.mesh.copies(vertex));
            let now = (!copies.is_empty()).then(|| color(vertex)).flatten();
            for &copy in &copies {
                if self.set_color(copy, now) {
                    recolored.push(copy);
                }
            }
        }
        recolored.sort_unstable();
        recolored
    }

    /// Sets the colour of a vertex; returns whether it had another one.
    fn set_color(&mut self, number: u32, color: Option<[u8; 3]>) -> bool {
        let before = std::mem::replace(&mut self.colors[number as usize], color);
        self.colored += usize::from(color.is_some());
        self.colored -= usize::from(before.is_some());
        before != color
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.mesh.vertex_count()
    }

    /// The numbers of vertices lie below this one.
    pub fn vertex_capacity(&self) -> usize {
        self.mesh.vertex_capacity()
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.mesh.face_count()
    }

    /// Position of a vertex.
    ///
    /// # Panics
    /// For numbers that were never given out.
    pub fn position(&self, number: u32) -> Point3<f64> {
        self.mesh.position(number)
    }

    /// Observed colour of a vertex.
    ///
    /// # Panics
    /// For numbers that were never given out.
    pub fn color(&self, number: u32) -> Option<[u8; 3]> {
        self.colors[number as usize]
    }

    /// The surface in an order that depends on its history: as fast as memory allows. `index` is reused memory.
    pub fn elements<'a>(
        &'a self,
        index: &'a mut Vec<u32>,
    ) -> MeshElements<
        impl Iterator<Item = Point3<f64>> + 'a,
        impl Iterator<Item = [u8; 3]> + 'a,
        impl Iterator<Item = [u32; 3]> + 'a,
    > {
        let numbers = || (0..self.vertex_capacity() as u32).filter(|&n| self.mesh.is_vertex(n));
        index.clear();
        index.resize(self.vertex_capacity(), 0);
        for (place, number) in (0..).zip(numbers()) {
            index[number as usize] = place;
        }
        let index: &'a [u32] = index;
        let color = |number| self.color(number).unwrap_or(DEFAULT_COLOR);
        MeshElements {
            positions: numbers().map(|number| self.position(number)),
            colors: (self.colored > 0).then(|| numbers().map(color)),
            elements: (self.mesh.faces()).map(|face| face.map(|number| index[number as usize])),
        }
    }

    /// A copy of the surface in an order that depends on the surface alone.
    pub fn to_mesh(&self) -> TriangleMesh {
        let (mesh, numbers) = self.mesh.to_mesh();
        let color = |number: &u32| self.color(*number).unwrap_or(DEFAULT_COLOR);
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: (self.colored > 0).then(|| numbers.iter().map(color).collect()),
        }
    }
}
