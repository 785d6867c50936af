//! A view: its pose and the rays through its segments.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};

use super::options::MatchedOptions;
use crate::baselines::line_detection::LineSegment2d;
use crate::baselines::method::PosedKeyframe;
use linecarve_lines::camera::Camera;

/// A segment of an image with the rays through its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewSegment {
    pub(super) ends_px: [Point2<f64>; 2],
    pub(super) length_px: f64,
    /// Unit rays through the ends, in the world.
    pub(super) rays: [Vector3<f64>; 2],
    /// Unit normal of the plane of the two rays.
    pub(super) normal: Vector3<f64>,
}

/// One image with its pose.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub(super) center: Point3<f64>,
    /// Optical axis in the world.
    pub(super) axis: Vector3<f64>,
    pub(super) camera_from_world: Isometry3<f64>,
    pub(super) camera: Camera,
    /// sigma_p as a length at distance 1.
    pub(super) sigma: f64,
    /// Shortest segment of the image in pixels.
    pub(super) minimum_length_px: f64,
    pub(super) segments: Vec<ViewSegment>,
}

impl View {
    pub(super) fn new(
        keyframe: &PosedKeyframe<'_>,
        segments: &[LineSegment2d],
        options: &MatchedOptions,
    ) -> Self {
        let camera = keyframe.camera.clone();
        let world_from_camera = keyframe.world_from_camera;
        let diagonal = (keyframe.image.width() as f64).hypot(keyframe.image.height() as f64);
        let minimum_length_px = options.minimum_length_share * diagonal;
        let mut lifted: Vec<ViewSegment> = segments
            .iter()
            .filter(|segment| segment.length_px() >= minimum_length_px)
            .filter_map(|segment| {
                let ray = |end: usize| {
                    let ray = camera.unproject(&segment.ends_px[end]).ok()?;
                    Some(world_from_camera * ray)
                };
                let rays = [ray(0)?, ray(1)?];
                Some(ViewSegment {
                    ends_px: segment.ends_px,
                    length_px: segment.length_px(),
                    normal: rays[0].cross(&rays[1]).try_normalize(0.0)?,
                    rays,
                })
            })
            .collect();
        // A stable sort: of equally long ones the first.
        lifted.sort_by(|a, b| b.length_px.total_cmp(&a.length_px));
        lifted.truncate(options.maximum_segments);
        Self {
            center: Point3::from(world_from_camera.translation.vector),
            axis: world_from_camera * Vector3::z(),
            camera_from_world: world_from_camera.inverse(),
            sigma: options.position_sigma_px / camera.mean_focal_px(),
            camera,
            minimum_length_px,
            segments: lifted,
        }
    }

    /// The ends of a segment at distances along their rays.
    pub(super) fn ends_at(&self, segment: u32, distances: [f64; 2]) -> [Point3<f64>; 2] {
        let rays = &self.segments[segment as usize].rays;
        [
            self.center + rays[0] * distances[0],
            self.center + rays[1] * distances[1],
        ]
    }

    /// sigma_p as a length at a point.
    pub(super) fn sigma_at(&self, point: &Point3<f64>) -> f64 {
        self.sigma * (point - self.center).norm()
    }

    /// The inverse of the camera matrix: pixels to the plane at depth 1.
    fn inverse_camera_matrix(&self) -> Matrix3<f64> {
        let camera = &self.camera;
        let (fx, fy) = (1.0 / camera.fx(), 1.0 / camera.fy());
        Matrix3::new(
            fx,
            0.0,
            -camera.cx() * fx,
            0.0,
            fy,
            -camera.cy() * fy,
            0.0,
            0.0,
            1.0,
        )
    }

    /// The fundamental matrix: the epipolar line in `other` of a pixel of this view.
    pub(super) fn fundamental(&self, other: &Self) -> Matrix3<f64> {
        let other_from_self = other.camera_from_world * self.camera_from_world.inverse();
        let essential = other_from_self.translation.vector.cross_matrix()
            * other_from_self.rotation.to_rotation_matrix().matrix();
        other.inverse_camera_matrix().transpose() * essential * self.inverse_camera_matrix()
    }
}
