//! Refinement and culling of points.

use nalgebra::Point3;

use super::create::{largest_sigma, mean_direction};
use super::descriptor::Descriptor;
use super::map::PointMap;
use super::point::{MapObservation, MapPointId};
use super::triangulate::{Observation, RefinedPoint, parallax_cosine, refine_point};
use crate::pose_correction::CHI2_PIXEL;

/// Smallest share of the keyframes predicted to see a young point that match it, as in ORB-SLAM2.
const MIN_FOUND_SHARE: f64 = 0.25;

impl PointMap {
    /// An observation with pose, pixel and deviation.
    fn observation(&self, observation: &MapObservation) -> Observation {
        let keyframe = &self.keyframes[observation.keyframe as usize];
        let octave = keyframe.features.octaves[observation.feature as usize];
        Observation {
            camera_from_world: *keyframe.camera_from_world(),
            pixel: keyframe.pixel(observation.feature),
            sigma_px: self.options.sigma_px(octave, keyframe.pose_sigma_px),
        }
    }

    /// Squared reprojection error in variances; infinite behind the camera.
    pub(super) fn chi2(&self, observation: &MapObservation, point: &Point3<f64>) -> f64 {
        let chi2 = self.observation(observation).chi2(&self.camera, point);
        chi2.unwrap_or(f64::INFINITY)
    }

    /// The point with the smallest reprojection errors.
    pub(super) fn fit(
        &self,
        observations: &[MapObservation],
        start: Point3<f64>,
    ) -> Option<RefinedPoint> {
        let observations: Vec<Observation> =
            observations.iter().map(|s| self.observation(s)).collect();
        refine_point(&self.camera, &observations, start)
    }

    /// Refines every point whose observations changed, drops outliers and updates whether the point is established.
    pub(super) fn refine_dirty(&mut self) {
        let mut dirty = std::mem::take(&mut self.dirty);
        dirty.sort_unstable();
        dirty.dedup();
        for &id in &dirty {
            if self.refine(id).is_none() {
                self.remove(id);
            }
            self.touched.push(id);
        }
        dirty.clear();
        self.dirty = dirty;
    }

    /// `None` when fewer than two observations are left.
    fn refine(&mut self, id: MapPointId) -> Option<()> {
        let point = self.point(id)?;
        let mut observations = point.observations.clone();
        let mut refined = self.fit(&observations, point.point_in_world)?;
        // Drop the worst outlier first: it may cause the other errors.
        loop {
            let errors = observations
                .iter()
                .map(|observation| self.chi2(observation, &refined.point_in_world));
            let (worst, error) = errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
            if error < CHI2_PIXEL {
                break;
            }
            let gone = observations.remove(worst);
            self.assign(gone, None);
            if observations.len() < 2 {
                break;
            }
            refined = self.fit(&observations, refined.point_in_world)?;
        }
        let centers: Vec<Point3<f64>> = observations
            .iter()
            .map(|s| self.center(s.keyframe))
            .collect();
        let descriptors: Vec<Descriptor> = observations
            .iter()
            .map(|s| self.keyframes[s.keyframe as usize].features.descriptors[s.feature as usize])
            .collect();
        let at = refined.point_in_world;
        let nearest = centers
            .iter()
            .map(|center| (at - center).norm())
            .fold(f64::INFINITY, f64::min);
        let options = &self.options;
        let is_established = observations.len() >= options.min_views
            && parallax_cosine(&centers, &at) < options.parallax_degrees.to_radians().cos()
            && largest_sigma(&refined.covariance) < options.max_relative_sigma * nearest;
        let is_left = observations.len() >= 2;

        let point = self.points[id.0 as usize].as_deref_mut()?;
        point.observations = observations;
        point.point_in_world = at;
        point.covariance = refined.covariance;
        point.viewing = mean_direction(&centers, &at);
        point.descriptor = Descriptor::representative(&descriptors)?;
        point.is_established = is_established;
        is_left.then_some(())
    }

    /// Culls young points with too few observations and ends the probation of the others.
    pub(super) fn cull(&mut self, keyframe: u32) {
        let mut on_probation = std::mem::take(&mut self.on_probation);
        on_probation.retain(|&id| {
            let Some(point) = self.point(id) else {
                return false;
            };
            let age = (keyframe - point.created_by) as usize;
            let is_rarely_found =
                f64::from(point.found) < MIN_FOUND_SHARE * f64::from(point.visible);
            let is_lonely =
                age >= self.options.probation && point.observations.len() < self.options.min_views;
            if is_rarely_found || is_lonely {
                self.remove(id);
                return false;
            }
            age < self.options.probation
        });
        self.on_probation = on_probation;
    }
}
