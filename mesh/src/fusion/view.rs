//! A view whose depth image is unpacked.

use linecarve_lines::depth::DepthImage;
use nalgebra::{Isometry3, IsometryMatrix3, Point3, Vector3};
use wide::f32x4;

use super::PosedDepth;

/// The pixels of a [`PosedDepth`].
pub(super) struct View {
    image: DepthImage,
    world_from_depth: IsometryMatrix3<f64>,
    depth_from_world: IsometryMatrix3<f64>,
    sides: [Vector3<f64>; 4],
}

impl View {
    pub(super) fn new(posed: &PosedDepth<'_>) -> Self {
        let image = posed.depth.unpack();
        Self {
            sides: image.sides(),
            image,
            world_from_depth: with_matrix(&posed.world_from_depth),
            depth_from_world: with_matrix(&posed.world_from_depth.inverse()),
        }
    }

    /// All measured points, in world coordinates.
    pub(super) fn points(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        let (columns, rows) = (self.image.columns(), self.image.rows());
        let pixels = (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)));
        pixels.filter_map(|(column, row)| {
            let point = self.image.point(column, row)?;
            Some(self.world_from_depth * point)
        })
    }

    /// How far points lie before the surface measured along their rays; NaN where nothing was measured. The points are four offsets from a place in
    /// world coordinates, which is at `place` in the frame of the camera.
    #[inline]
    pub(super) fn distances(&self, place: &Point3<f64>, offsets: &[f32x4; 3]) -> f32x4 {
        let rotation = &self.depth_from_world.rotation;
        let along = |axis: usize| {
            let [x, y, z] = [0, 1, 2].map(|other| rotation[(axis, other)] as f32);
            offsets[0] * x + offsets[1] * y + offsets[2] * z + place[axis] as f32
        };
        self.image.distances([along(0), along(1), along(2)])
    }

    /// The depth image.
    pub(super) fn image(&self) -> &DepthImage {
        &self.image
    }

    /// A direction in world coordinates, from one in the frame of the camera.
    pub(super) fn in_world(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_depth.rotation * direction
    }

    /// A point in the frame of the camera.
    pub(super) fn in_camera(&self, point_in_world: &Point3<f64>) -> Point3<f64> {
        self.depth_from_world * point_in_world
    }

    /// Whether a sphere around a point in the frame of the camera may be seen: not behind the camera, and not beside all of its image.
    pub(super) fn may_see(&self, center: &Point3<f64>, radius: f64) -> bool {
        if center.z < -radius {
            return false;
        }
        self.sides
            .iter()
            .all(|inward| inward.dot(&center.coords) >= -radius)
    }
}

/// A sphere around points: its centre and radius. That of no point has no extent.
pub(super) fn sphere_around(points: impl IntoIterator<Item = Point3<f64>>) -> (Point3<f64>, f64) {
    let mut points = points.into_iter();
    let first = points.next().unwrap_or_default();
    let (low, high) = points.fold((first, first), |(low, high), point| {
        (low.inf(&point), high.sup(&point))
    });
    let center = nalgebra::center(&low, &high);
    (center, (high - center).norm())
}

/// The same motion; its matrix moves a point in half as many operations as a quaternion.
fn with_matrix(motion: &Isometry3<f64>) -> IsometryMatrix3<f64> {
    IsometryMatrix3::from_parts(motion.translation, motion.rotation.to_rotation_matrix())
}
