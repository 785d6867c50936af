//! Where the depth of the keyframes says that a vertex lies.

use linecarve_carving::VertexId;
use nalgebra::Point3;

use super::depth_validation::DepthValidation;
use super::lines::VertexColors;
use super::segment_map::SegmentMap;
use super::surface::{FittedVertex, VertexSource, used_views};
use super::surface_points::MeasuredPlane;
use super::vertex_adjustment::{GATE_SIGMAS, adjusted, scatter_of, spread_of};

/// The vertices of a map of lines.
pub(super) struct FittedVertices<'a> {
    pub(super) colors: VertexColors<'a>,
    pub(super) validation: &'a DepthValidation,
    /// Whether depth comes from depth images: vertices move to it. Depth from images is off by more than its deviations where poses are, so
    /// that vertices stay, and are flattened within those deviations.
    pub(super) is_measured: bool,
    pub(super) segments: &'a SegmentMap,
    /// How far vertices on edges and boundaries move onto segments.
    pub(super) segment_reach: f64,
}

impl VertexSource for FittedVertices<'_> {
    /// # Complexity
    /// Linear in the views.
    fn fit(&self, vertex: VertexId) -> FittedVertex {
        let position = self.colors.position(vertex);
        let surfaces = self.validation.surfaces();
        let planes = surfaces.filter_map(|surface| surface.plane_near(&position, GATE_SIGMAS));
        let mut planes: Vec<MeasuredPlane> = planes.collect();
        let views = planes.len();
        planes.truncate(used_views(views));
        if !self.is_measured {
            return FittedVertex {
                position,
                bound: spread_of(&planes),
                views,
            };
        }
        let moved = adjusted(&position, &planes);
        for plane in &mut planes {
            plane.distance -= plane.normal.dot(&(moved - position));
        }
        FittedVertex {
            position: moved,
            bound: scatter_of(&mut planes),
            views,
        }
    }

    fn is_measured_by_newest(&self, vertex: VertexId) -> bool {
        let position = self.colors.position(vertex);
        let newest = self.validation.newest();
        newest.is_some_and(|surface| surface.plane_near(&position, GATE_SIGMAS).is_some())
    }

    fn segment_reach(&self) -> f64 {
        self.segment_reach
    }

    fn visit_segments(&self, position: &Point3<f64>, visit: &mut dyn FnMut([Point3<f64>; 2])) {
        if self.is_measured {
            self.segments
                .clusters_near(position, self.segment_reach)
                .for_each(visit);
        }
    }

    fn color(&self, vertex: VertexId) -> Option<[u8; 3]> {
        self.colors.get(vertex)
    }
}
