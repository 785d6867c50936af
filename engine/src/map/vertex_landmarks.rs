//! The landmark at each vertex of the tetrahedralisation.

use linecarve_carving::{Carver, PointId, Triangle, VertexId, ViewId};
use nalgebra::Point3;

/// Marks a vertex without landmark.
const NONE: u32 = u32::MAX;

/// A carved surface: its vertices, and those of points.
pub(super) trait CarvedSurface: Sync {
    /// Numbers of vertices are less than this.
    fn vertex_capacity(&self) -> usize;

    /// The vertex of a point, where the surface may have one.
    fn vertex_of(&self, point: PointId) -> Option<VertexId>;

    fn position(&self, vertex: VertexId) -> Point3<f64>;

    /// All triangles, in no particular order.
    fn triangles(&self) -> Vec<Triangle>;

    /// Whether no edge of a triangle is longer than `longest`.
    fn has_edges_within(&self, triangle: &Triangle, longest: f64) -> bool {
        let p = triangle.map(|vertex| self.position(vertex));
        (0..3).all(|k| (p[k] - p[(k + 1) % 3]).norm() <= longest)
    }
}

impl CarvedSurface for Carver {
    fn vertex_capacity(&self) -> usize {
        self.tetrahedra().vertex_capacity()
    }

    fn vertex_of(&self, point: PointId) -> Option<VertexId> {
        Carver::vertex_of(self, point)
    }

    fn position(&self, vertex: VertexId) -> Point3<f64> {
        self.tetrahedra().position(vertex)
    }

    fn triangles(&self) -> Vec<Triangle> {
        Carver::triangles(self).collect()
    }
}

/// The landmark at each vertex. Of several at one position, the one updated last.
#[derive(Debug, Clone, Default)]
pub(super) struct VertexLandmarks {
    landmarks: Vec<u32>,
    /// The vertex of each landmark when it was last updated, [`NONE`] without one.
    vertices: Vec<u32>,
    /// Number of the latest postponed update of each landmark, 0 without one, and of all.
    postponed: Vec<u64>,
    latest: u64,
}

impl VertexLandmarks {
    /// Notes landmarks whose vertices are updated later, as there are none yet.
    pub(super) fn postpone(&mut self, landmarks: impl Iterator<Item = u32>) {
        for landmark in landmarks {
            let needed = landmark as usize + 1;
            self.postponed.resize(needed.max(self.postponed.len()), 0);
            self.latest += 1;
            self.postponed[landmark as usize] = self.latest;
        }
    }

    /// Makes up for the postponed updates, in their order; arguments as in [`update`](Self::update).
    pub(super) fn update_postponed(
        &mut self,
        surface: &dyn CarvedSurface,
        points: &[PointId],
        changed: &mut Vec<VertexId>,
    ) {
        let postponed = std::mem::take(&mut self.postponed);
        let noted = |landmark: &u32| postponed[*landmark as usize] > 0;
        let mut landmarks: Vec<u32> = (0..postponed.len() as u32).filter(noted).collect();
        landmarks.sort_unstable_by_key(|landmark| postponed[*landmark as usize]);
        self.update(surface, points, landmarks.into_iter(), changed);
    }

    /// Updates the vertices of landmarks; `points` gives the carver's id of each. Appends their vertices before and after.
    pub(super) fn update(
        &mut self,
        surface: &dyn CarvedSurface,
        points: &[PointId],
        landmarks: impl Iterator<Item = u32>,
        changed: &mut Vec<VertexId>,
    ) {
        self.landmarks.resize(surface.vertex_capacity(), NONE);
        self.vertices.resize(points.len(), NONE);
        for landmark in landmarks {
            let vertex = surface.vertex_of(points[landmark as usize]);
            let now = vertex.map_or(NONE, |vertex| vertex.index() as u32);
            let before = std::mem::replace(&mut self.vertices[landmark as usize], now);
            if before != now && before != NONE {
                changed.push(VertexId::from_index(before as usize));
            }
            if let Some(vertex) = vertex {
                self.landmarks[vertex.index()] = landmark;
                changed.push(vertex);
            }
        }
    }

    /// The landmark at a vertex.
    pub(super) fn landmark(&self, vertex: VertexId) -> Option<u32> {
        self.landmarks
            .get(vertex.index())
            .copied()
            .filter(|landmark| *landmark != NONE)
    }
}

/// The views that observe each vertex, for [`DepthValidation`](super::depth_validation::DepthValidation).
#[derive(Clone, Copy)]
pub(super) struct VertexViews<'a> {
    surface: &'a dyn CarvedSurface,
    carver: &'a Carver,
    points: &'a [PointId],
    vertices: &'a VertexLandmarks,
}

impl<'a> VertexViews<'a> {
    /// `points` gives the carver's id of each landmark.
    pub(super) fn new(
        carver: &'a Carver,
        points: &'a [PointId],
        vertices: &'a VertexLandmarks,
    ) -> Self {
        Self::of(carver, carver, points, vertices)
    }

    /// The same of a surface of the carver's points that others carved.
    pub(super) fn of(
        surface: &'a dyn CarvedSurface,
        carver: &'a Carver,
        points: &'a [PointId],
        vertices: &'a VertexLandmarks,
    ) -> Self {
        Self {
            surface,
            carver,
            points,
            vertices,
        }
    }

    /// The carved surface.
    pub(super) fn surface(&self) -> &'a dyn CarvedSurface {
        self.surface
    }

    /// The carver with the cells of the surface.
    pub(super) fn carver(&self) -> &'a Carver {
        self.carver
    }

    /// The vertex of a landmark; `None` when it was removed.
    pub(super) fn vertex(&self, landmark: u32) -> Option<VertexId> {
        self.carver.vertex_of(self.points[landmark as usize])
    }

    /// The views that observe a vertex.
    pub(super) fn views(&self, vertex: VertexId) -> impl Iterator<Item = ViewId> + '_ {
        self.vertices
            .landmark(vertex)
            .into_iter()
            .flat_map(|landmark| self.carver.views_of(self.points[landmark as usize]))
    }
}
