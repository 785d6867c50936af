//! Triangulation of new points.

use linecarve_lines::camera::Camera;
use linecarve_lines::upper_median;
use nalgebra::{Matrix3, Point2, Point3, Unit, Vector3};

use super::epipolar::{FeatureMatch, TwoViewGeometry, match_along_epipolar_lines};
use super::keyframe::MapKeyframe;
use super::map::PointMap;
use super::point::{MapObservation, MapPoint, MapPointId};
use super::triangulate::{parallax_cosine, triangulate_rays};
use crate::pose_correction::CHI2_PIXEL;

/// Smallest baseline of two keyframes as a share of the median depth, as in ORB-SLAM2.
const MIN_BASELINE_SHARE: f64 = 0.01;

impl PointMap {
    /// Triangulates features that have no point yet; returns the number of new points.
    pub(super) fn create_points(&mut self, keyframe: u32) -> usize {
        let neighbors = self.neighbors(keyframe);
        let depth = self.median_depth_in(keyframe);
        let mut pairs = Vec::new();
        let mut created = 0;
        for &neighbor in &neighbors {
            let (this, other) = (
                &self.keyframes[keyframe as usize],
                &self.keyframes[neighbor as usize],
            );
            let geometry = TwoViewGeometry::new(
                &self.camera,
                this.camera_from_world(),
                other.camera_from_world(),
            );
            let mut options = self.options;
            options.pose_sigma_px = this.pose_sigma_px.max(other.pose_sigma_px);
            let too_near =
                depth.is_some_and(|depth| geometry.baseline() < MIN_BASELINE_SHARE * depth);
            if too_near || geometry.baseline() == 0.0 {
                continue;
            }
            match_along_epipolar_lines(
                &geometry,
                &options,
                &this.features,
                |index| this.points[index].is_none(),
                &other.features,
                &other.grid,
                |index| other.points[index].is_none(),
                &mut pairs,
            );
            for pair in &pairs {
                if let Some(mut id) = self.triangulate(keyframe, neighbor, pair) {
                    created += 1;
                    for &further in neighbors.iter().filter(|&&k| k != neighbor) {
                        id = self.extend_track(id, further);
                    }
                }
            }
        }
        created
    }

    /// Covisibility: the number of points that each older keyframe shares with a keyframe.
    pub(super) fn shared_points(&self, keyframe: u32) -> Vec<u32> {
        let mut shared = vec![0_u32; keyframe as usize];
        for id in self.keyframes[keyframe as usize].points.iter().flatten() {
            for observation in self.point(*id).iter().flat_map(|point| &point.observations) {
                if let Some(count) = shared.get_mut(observation.keyframe as usize) {
                    *count += 1;
                }
            }
        }
        shared
    }

    /// Older keyframes to match with a new one: those that share most points, then the latest.
    fn neighbors(&self, keyframe: u32) -> Vec<u32> {
        let shared = self.shared_points(keyframe);
        let view = &self.keyframes[keyframe as usize];
        let ahead = view.pose.world_from_camera() * Vector3::z();
        let mut neighbors: Vec<u32> = (0..keyframe)
            .filter(|&other| {
                // Without shared points the viewing directions must be within 60 degrees.
                let other_view = &self.keyframes[other as usize];
                !other_view.features.is_empty()
                    && (shared[other as usize] > 0
                        || (other_view.pose.world_from_camera() * Vector3::z()).dot(&ahead) > 0.5)
            })
            .collect();
        neighbors.sort_unstable_by_key(|&other| {
            (
                std::cmp::Reverse(shared[other as usize]),
                std::cmp::Reverse(other),
            )
        });
        neighbors.truncate(self.options.neighbors);
        neighbors
    }

    /// Median depth of the points observed in a keyframe.
    pub(super) fn median_depth_in(&self, keyframe: u32) -> Option<f64> {
        let view = &self.keyframes[keyframe as usize];
        let mut depths: Vec<f64> = view
            .points
            .iter()
            .flatten()
            .filter_map(|id| self.point(*id))
            .map(|point| (view.camera_from_world() * point.point_in_world).z)
            .collect();
        upper_median(&mut depths, f64::total_cmp)
    }

    /// Triangulates a match. `None` when the rays do not meet in front of both cameras, when parallax is too small or the
    /// reprojection error too large, or when a feature has got a point meanwhile.
    fn triangulate(
        &mut self,
        keyframe: u32,
        neighbor: u32,
        pair: &FeatureMatch,
    ) -> Option<MapPointId> {
        let observations = [(neighbor, pair.second), (keyframe, pair.first)]
            .map(|(keyframe, feature)| MapObservation { keyframe, feature });
        let views = observations.map(|s| &self.keyframes[s.keyframe as usize]);
        for (view, observation) in views.iter().zip(&observations) {
            if view.points[observation.feature as usize].is_some() {
                return None;
            }
        }
        let rays = [0, 1].map(|i| {
            let pixel = views[i].pixel(observations[i].feature);
            (views[i].center(), direction(&self.camera, views[i], &pixel))
        });
        let start = triangulate_rays(&rays)?;
        let refined = self.fit(&observations, start)?;
        let point_in_world = refined.point_in_world;
        let centers = views.map(MapKeyframe::center);
        if parallax_cosine(&centers, &point_in_world)
            > self.options.parallax_degrees.to_radians().cos()
        {
            return None;
        }
        let fits = observations
            .iter()
            .all(|observation| self.chi2(observation, &point_in_world) < CHI2_PIXEL);
        if !fits {
            return None;
        }
        let descriptor = views[1].features.descriptors[pair.first as usize];
        Some(self.insert(MapPoint {
            point_in_world,
            covariance: refined.covariance,
            observations: observations.to_vec(),
            descriptor,
            viewing: mean_direction(&centers, &point_in_world),
            created_by: keyframe,
            visible: 1,
            found: 1,
            is_established: false,
            published: None,
        }))
    }
}

/// Viewing ray of a pixel of a pinhole camera, in the world.
fn direction(camera: &Camera, view: &MapKeyframe, pixel: &Point2<f64>) -> Unit<Vector3<f64>> {
    let plane = Vector3::new(
        (pixel.x - camera.cx()) / camera.fx(),
        (pixel.y - camera.cy()) / camera.fy(),
        1.0,
    );
    Unit::new_normalize(view.pose.world_from_camera() * plane)
}

/// Unit mean of the directions from camera centres to a point; zero when they cancel out.
pub(super) fn mean_direction(centers: &[Point3<f64>], point: &Point3<f64>) -> Vector3<f64> {
    let sum: Vector3<f64> = centers
        .iter()
        .map(|center| (point - center).normalize())
        .sum();
    sum.try_normalize(0.0).unwrap_or_default()
}

/// The largest standard deviation in any direction: square root of the largest eigenvalue.
pub(super) fn largest_sigma(covariance: &Matrix3<f64>) -> f64 {
    covariance.symmetric_eigenvalues().max().max(0.0).sqrt()
}
