//! The exported surface of a map, kept up to date: the one surface that files, page, stream and comparison show.
//!
//! carved triangles → without those that depth contradicts → vertices where depth measured them → flattened within what the
//! measurements allow → edges and boundaries on segments → colours

mod fitted;

use linecarve_carving::{
    Carver, ExportOptions, IncrementalMesh, MeshChange, SurfaceDelta, Triangle, TriangleRole,
    VertexId, VertexOrigin,
};
use linecarve_mesh::{MeshElements, TriangleMesh};
use nalgebra::Point3;

use super::update::MapUpdate;
use fitted::{FittedPositions, Seen};

pub(super) use fitted::{FittedVertex, fitted_positions, used_views};

/// Colour of vertices without an observed colour: middle grey.
pub(super) const DEFAULT_COLOR: [u8; 3] = [128; 3];

/// The colour of a vertex: inside a triangle the mean of the corners beside it, by its weights.
pub(super) fn color_of(
    origin: VertexOrigin<VertexId>,
    color: impl Fn(VertexId) -> Option<[u8; 3]>,
) -> Option<[u8; 3]> {
    let (corners, part) = match origin {
        VertexOrigin::Vertex(vertex) => return color(vertex),
        VertexOrigin::Inside { corners, part } => (corners, part),
        VertexOrigin::Middle => return None,
    };
    let (mut sum, mut unit) = ([0_u32; 3], 0_u32);
    for k in (0..3).filter(|k| part.has_corner(*k)) {
        if let Some(color) = color(corners[k]) {
            let weight = u32::from(part.weights[k]);
            unit += weight;
            for (sum, channel) in sum.iter_mut().zip(color) {
                *sum += weight * u32::from(channel);
            }
        }
    }
    (unit > 0).then(|| sum.map(|sum| (sum / unit) as u8))
}

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
    /// Where depth measured the vertices; `None` where they stay as they are carved.
    fitted: Option<FittedPositions>,
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
    in_view: Vec<VertexId>,
    recolored: Vec<VertexId>,
    /// Whether all vertices have new measurements.
    is_all_refitted: bool,
}

/// What the vertices of a surface are made of.
pub(super) trait VertexSource: Sync {
    /// Where depth measured a vertex.
    fn fit(&self, vertex: VertexId) -> FittedVertex;

    /// Whether the newest keyframe measured a surface at a vertex.
    fn is_measured_by_newest(&self, _vertex: VertexId) -> bool {
        false
    }

    /// How far vertices on edges and boundaries move onto segments.
    fn segment_reach(&self) -> f64 {
        0.0
    }

    /// Visits the segments within that of a position, and others.
    fn visit_segments(&self, _position: &Point3<f64>, _visit: &mut dyn FnMut([Point3<f64>; 2])) {}

    /// The observed colour of a vertex.
    fn color(&self, _vertex: VertexId) -> Option<[u8; 3]> {
        None
    }
}

/// Vertices as they are carved, without colours.
pub(super) struct CarvedVertices<'a>(pub(super) &'a Carver);

impl VertexSource for CarvedVertices<'_> {
    fn fit(&self, vertex: VertexId) -> FittedVertex {
        FittedVertex {
            position: self.0.tetrahedra().position(vertex),
            bound: 0.0,
            views: 0,
        }
    }
}

impl MapSurface {
    /// The surface of a carver; it is made at the first [update](Self::update). With `is_fitted` its vertices lie where depth measured
    /// them.
    pub(super) fn new(carver: &Carver, export: &ExportOptions, is_fitted: bool) -> Self {
        let mut added: Vec<Triangle> = carver.triangles().collect();
        added.sort_unstable();
        let whole = SurfaceDelta {
            added,
            ..SurfaceDelta::default()
        };
        Self {
            mesh: IncrementalMesh::new(export),
            fitted: is_fitted.then(FittedPositions::default),
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
        pending.in_view.extend(&update.in_view);
        pending.is_all_refitted |= update.is_all_refitted;
        pending.recolored.extend(&update.recolored);
    }

    /// Whether the mesh has followed all changes, with this longest edge.
    pub(super) fn is_current(&self, longest_edge: Option<f64>) -> bool {
        let Pending {
            deltas,
            revalidated,
            in_view,
            recolored,
            is_all_refitted,
        } = &self.pending;
        let is_pending = *is_all_refitted
            || !(deltas.is_empty()
                && revalidated.is_empty()
                && in_view.is_empty()
                && recolored.is_empty());
        !is_pending && self.longest_edge == longest_edge
    }

    /// Follows the changes noted, and returns that of the exported surface. `role` says how a triangle is exported, `vertices` where its
    /// corners are and what colours they have.
    ///
    /// # Complexity
    /// Linear in the change; in the size of the surface when the longest edge is another one than before.
    pub(super) fn update(
        &mut self,
        carver: &Carver,
        longest_edge: Option<f64>,
        role: impl Fn(&Triangle) -> TriangleRole,
        vertices: &impl VertexSource,
    ) -> SurfaceChange {
        let mut pending = std::mem::take(&mut self.pending);
        if std::mem::replace(&mut self.longest_edge, longest_edge) != longest_edge {
            pending.revalidated.extend(carver.triangles());
        }
        let (deltas, touched) = (&pending.deltas, &pending.revalidated);
        carver.update_mesh(&mut self.mesh, deltas, touched, role);
        let mut mesh = self.mesh.take_change();
        let placed = mesh.placed.clone();
        if let Some(fitted) = &mut self.fitted {
            let seen = match pending.is_all_refitted {
                true => Seen::All,
                false => Seen::InView(&pending.in_view),
            };
            fitted.follow(&self.mesh, &mut mesh, seen, vertices);
        }
        let color = |vertex| vertices.color(vertex);
        let recolored = self.recolor([&mesh.freed, &placed], pending.recolored, color);
        SurfaceChange {
            mesh,
            recolored,
            is_anew: std::mem::replace(&mut self.is_anew, false),
        }
    }

    /// Updates the colours after a change of the mesh; returns the vertices that stayed and have another colour.
    fn recolor(
        &mut self,
        [freed, placed]: [&[u32]; 2],
        mut vertices: Vec<VertexId>,
        color: impl Fn(VertexId) -> Option<[u8; 3]>,
    ) -> Vec<u32> {
        self.colors.resize(self.mesh.vertex_capacity(), None);
        for &number in freed {
            self.set_color(number, None);
        }
        for &number in placed {
            let now = color_of(self.mesh.vertex_origin(number), &color);
            self.set_color(number, now);
        }
        vertices.sort_unstable();
        vertices.dedup();
        let mut recolored = Vec::new();
        let mut copies = Vec::new();
        let mut beside = Vec::new();
        for vertex in vertices {
            copies.clear();
            copies.extend(self.mesh.copies(vertex));
            let now = (!copies.is_empty()).then(|| color(vertex)).flatten();
            for &copy in &copies {
                if self.set_color(copy, now) {
                    recolored.push(copy);
                    beside.extend(self.fitted.iter().flat_map(|it| it.neighbors(copy)));
                }
            }
        }
        // Vertices inside triangles have the colours of the corners.
        for number in beside {
            let origin = self.mesh.vertex_origin(number);
            if matches!(origin, VertexOrigin::Inside { .. }) {
                let now = color_of(origin, &color);
                if self.set_color(number, now) {
                    recolored.push(number);
                }
            }
        }
        recolored.sort_unstable();
        recolored.dedup();
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
        match &self.fitted {
            Some(fitted) => fitted.position(number),
            None => self.mesh.position(number),
        }
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
            positions: numbers.iter().map(|it| self.position(*it)).collect(),
            triangles: mesh.triangles,
            colors: (self.colored > 0).then(|| numbers.iter().map(color).collect()),
        }
    }
}
