//! A view whose depth image is unpacked.

use linecarve_lines::depth::DepthImage;
use nalgebra::{Isometry3, Point3, Vector3};

use super::PosedDepth;

/// The pixels of a [`PosedDepth`].
pub(super) struct View {
    image: DepthImage,
    world_from_depth: Isometry3<f64>,
    depth_from_world: Isometry3<f64>,
    sides: [Vector3<f64>; 4],
}

impl View {
    pub(super) fn new(posed: &PosedDepth<'_>) -> Self {
        let image = posed.depth.unpack();
        Self {
            sides: image.sides(),
            image,
            world_from_depth: posed.world_from_depth,
            depth_from_world: posed.world_from_depth.inverse(),
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

    /// How far a point lies before the surface measured along its ray; `None` where nothing was measured.
    #[inline]
    pub(super) fn distance(&self, point_in_world: &Point3<f64>) -> Option<f64> {
        self.image
            .distance(&(self.depth_from_world * point_in_world))
    }

    /// Whether a sphere may be seen: not behind the camera, and not beside all of its image.
    pub(super) fn may_see(&self, center: &Point3<f64>, radius: f64) -> bool {
        let center = self.depth_from_world * center;
        if center.z < -radius {
            return false;
        }
        self.sides
            .iter()
            .all(|inward| inward.dot(&center.coords) >= -radius)
    }
}
