//! The part of space that a keyframe may have measured.

use nalgebra::{Isometry3, Point3, Vector3};

/// A box and the four sides of a pyramid with its apex at a camera: outside of it a keyframe measured nothing.
#[derive(Debug, Clone)]
pub(super) struct ViewRegion {
    low: Point3<f64>,
    high: Point3<f64>,
    /// Inner normals of the sides, and their scalar products with the apex.
    sides: Vec<(Vector3<f64>, f64)>,
}

/// Share of the coordinates that rounding may move a side by.
const SLACK: f64 = 1e-9;

impl ViewRegion {
    /// All of space.
    pub(super) fn everything() -> Self {
        let [low, high] = [f64::NEG_INFINITY, f64::INFINITY].map(|all| Point3::new(all, all, all));
        Self {
            low,
            high,
            sides: Vec::new(),
        }
    }

    /// The region between the camera and `frame`, points in the frame of the camera that surround at one depth, which is positive, all
    /// that was measured.
    pub(super) fn new(world_from_camera: &Isometry3<f64>, frame: &[Point3<f64>]) -> Self {
        let apex = Point3::from(world_from_camera.translation.vector);
        let (mut low, mut high) = (apex, apex);
        let (mut least, mut largest) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in frame {
            let point_in_world = world_from_camera * point;
            low = low.inf(&point_in_world);
            high = high.sup(&point_in_world);
            for axis in 0..2 {
                least[axis] = least[axis].min(point[axis] / point.z);
                largest[axis] = largest[axis].max(point[axis] / point.z);
            }
        }
        // Right, left, below and above the tangents of the outermost rays.
        let normals = [
            Vector3::new(1.0, 0.0, -least[0]),
            Vector3::new(-1.0, 0.0, largest[0]),
            Vector3::new(0.0, 1.0, -least[1]),
            Vector3::new(0.0, -1.0, largest[1]),
        ];
        let sides = normals.map(|normal| {
            let normal = world_from_camera.rotation * normal;
            (normal, normal.dot(&apex.coords))
        });
        Self {
            low,
            high,
            sides: sides.to_vec(),
        }
    }

    /// Whether the region holds a point.
    pub(super) fn holds(&self, point: &[f64; 3]) -> bool {
        let is_within =
            |axis: usize| self.low[axis] <= point[axis] && point[axis] <= self.high[axis];
        (0..3).all(is_within) && self.meets_sides([*point; 2])
    }

    /// Whether a part of a box, given by its lowest and highest corner, may lie in the region.
    pub(super) fn meets(&self, corners: [[f64; 3]; 2]) -> bool {
        let [low, high] = corners;
        let overlaps = |axis: usize| self.low[axis] <= high[axis] && low[axis] <= self.high[axis];
        (0..3).all(overlaps) && self.meets_sides(corners)
    }

    /// Whether a corner of a box lies inside of each side.
    fn meets_sides(&self, [low, high]: [[f64; 3]; 2]) -> bool {
        self.sides.iter().all(|(normal, offset)| {
            // The corner farthest along the normal.
            let farthest = |axis: usize| match normal[axis] > 0.0 {
                true => normal[axis] * high[axis],
                false => normal[axis] * low[axis],
            };
            let along = [0, 1, 2].map(farthest);
            let size = along.iter().map(|part| part.abs()).sum::<f64>() + offset.abs();
            along.iter().sum::<f64>() >= offset - SLACK * size
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A view of 90 by 60 degrees or so, 4 deep.
    fn region(pose: &Isometry3<f64>) -> ViewRegion {
        let frame = [[-4.0, -2.0], [4.0, -2.0], [4.0, 2.5], [-3.0, 2.5]];
        ViewRegion::new(pose, &frame.map(|[x, y]| Point3::new(x, y, 4.0)))
    }

    #[test]
    fn a_region_is_a_pyramid() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let rotation = UnitQuaternion::from_euler_angles(0.3, -0.8, 2.0);
        let pose = Isometry3::from_parts(Vector3::new(10.0, -20.0, 5.0).into(), rotation);
        let region = region(&pose);
        let mut inside = 0;
        for _ in 0..2000 {
            let mut draw = |bound: f64| random.random_range(-bound..bound);
            let point = Point3::new(draw(6.0), draw(6.0), draw(6.0));
            let is_seen = point.z > 0.0
                && point.z < 4.0
                && (-1.0..1.0).contains(&(point.x / point.z))
                && (-0.5..0.625).contains(&(point.y / point.z));
            let point_in_world: [f64; 3] = (pose * point).coords.into();
            assert!(!is_seen || region.holds(&point_in_world));
            // Beyond the far end the box decides, which is larger.
            assert!(is_seen || point.z > 4.0 || !region.holds(&point_in_world));
            inside += usize::from(is_seen);
            let half = draw(1.0).abs();
            let corners = [-half, half].map(|by| point_in_world.map(|c| c + by));
            assert!(!region.holds(&point_in_world) || region.meets(corners));
        }
        assert!(inside > 50);
        assert!(!region.meets([[0.0; 3], [1.0; 3]]));
        assert!(ViewRegion::everything().holds(&[1e9, 0.0, -1e9]));
    }
}
