//! Which point of the map lies at a vertex of the tetrahedralisation.

use linecarve_carving::carver::{Carver, PointId, ViewId};
use linecarve_carving::tetrahedralization::VertexId;

/// No landmark at a vertex.
const NONE: u32 = u32::MAX;

/// The landmark, and so the point, at each vertex. Of several at one place the one noted last.
#[derive(Debug, Clone, Default)]
pub(super) struct VertexLandmarks {
    landmarks: Vec<u32>,
}

impl VertexLandmarks {
    /// Notes where landmarks lie now; `points` gives the carver's id of each landmark. Those that were removed are
    /// passed over: their vertices are no longer corners of anything.
    pub(super) fn update(
        &mut self,
        carver: &Carver,
        points: &[PointId],
        landmarks: impl Iterator<Item = u32>,
    ) {
        self.landmarks
            .resize(carver.tetrahedra().vertex_capacity(), NONE);
        for landmark in landmarks {
            if let Some(vertex) = carver.vertex_of(points[landmark as usize]) {
                self.landmarks[vertex.index()] = landmark;
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

/// Who sees what: the map as [`DepthValidation`](super::depth_validation::DepthValidation) asks it.
#[derive(Clone, Copy)]
pub(super) struct VertexViews<'a> {
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
        Self {
            carver,
            points,
            vertices,
        }
    }

    /// The carved surface.
    pub(super) fn carver(&self) -> &'a Carver {
        self.carver
    }

    /// The vertex of a landmark; `None` when it was given up.
    pub(super) fn vertex(&self, landmark: u32) -> Option<VertexId> {
        self.carver.vertex_of(self.points[landmark as usize])
    }

    /// The views that see the point at a vertex.
    pub(super) fn views(&self, vertex: VertexId) -> impl Iterator<Item = ViewId> + '_ {
        self.vertices
            .landmark(vertex)
            .into_iter()
            .flat_map(|landmark| self.carver.views_of(self.points[landmark as usize]))
    }
}
