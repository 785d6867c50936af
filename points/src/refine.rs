//! Points brought to where their sightings have them, and points given up.

use nalgebra::Point3;

use super::create::{largest_sigma, mean_direction};
use super::descriptor::Descriptor;
use super::map::PointMap;
use super::point::{MapObservation, MapPointId};
use super::triangulate::{CHI2_PIXEL, Observation, RefinedPoint, parallax_cosine, refine_point};

/// A young point must be found in this share of the keyframes that should see it, as in ORB-SLAM2.
const MIN_FOUND_SHARE: f64 = 0.25;

impl PointMap {
    /// A sighting as the refinement takes it.
    fn sight(&self, sighting: &MapObservation) -> Observation {
        let keyframe = &self.keyframes[sighting.keyframe as usize];
        let octave = keyframe.features.octaves[sighting.feature as usize];
        Observation {
            camera_from_world: *keyframe.camera_from_world(),
            pixel: keyframe.pixel(sighting.feature),
            sigma_px: self.options.sigma_px(octave, keyframe.pose_sigma_px),
        }
    }

    /// Squared error of a sighting in variances; infinite behind the camera.
    pub(super) fn chi2(&self, sighting: &MapObservation, point: &Point3<f64>) -> f64 {
        let chi2 = self.sight(sighting).chi2(&self.camera, point);
        chi2.unwrap_or(f64::INFINITY)
    }

    /// The point that fits some sightings best.
    pub(super) fn fit(
        &self,
        sightings: &[MapObservation],
        start: Point3<f64>,
    ) -> Option<RefinedPoint> {
        let sights: Vec<Observation> = sightings.iter().map(|s| self.sight(s)).collect();
        refine_point(&self.camera, &sights, start)
    }

    /// Refines every point whose sightings changed, drops sightings that do not fit, and judges the point anew.
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

    /// `None` when nothing is left of the point.
    fn refine(&mut self, id: MapPointId) -> Option<()> {
        let point = self.point(id)?;
        let mut sightings = point.observations.clone();
        let mut refined = self.fit(&sightings, point.point_in_world)?;
        // The worst goes first: it may be what spoils the others.
        loop {
            let errors = sightings
                .iter()
                .map(|sighting| self.chi2(sighting, &refined.point_in_world));
            let (worst, error) = errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
            if error < CHI2_PIXEL {
                break;
            }
            let gone = sightings.remove(worst);
            self.assign(gone, None);
            if sightings.len() < 2 {
                break;
            }
            refined = self.fit(&sightings, refined.point_in_world)?;
        }
        let centers: Vec<Point3<f64>> = sightings.iter().map(|s| self.center(s.keyframe)).collect();
        let descriptors: Vec<Descriptor> = sightings
            .iter()
            .map(|s| self.keyframes[s.keyframe as usize].features.descriptors[s.feature as usize])
            .collect();
        let at = refined.point_in_world;
        let nearest = centers
            .iter()
            .map(|center| (at - center).norm())
            .fold(f64::INFINITY, f64::min);
        let options = &self.options;
        let is_established = sightings.len() >= options.min_views
            && parallax_cosine(&centers, &at) < options.parallax_degrees.to_radians().cos()
            && largest_sigma(&refined.covariance) < options.max_relative_sigma * nearest;
        let is_left = sightings.len() >= 2;

        let point = self.points[id.0 as usize].as_deref_mut()?;
        point.observations = sightings;
        point.point_in_world = at;
        point.covariance = refined.covariance;
        point.viewing = mean_direction(&centers, &at);
        point.descriptor = Descriptor::representative(&descriptors)?;
        point.is_established = is_established;
        is_left.then_some(())
    }

    /// Gives up young points that too few keyframes see, and ends the probation of those that enough do.
    pub(super) fn cull(&mut self, keyframe: u32) {
        let mut on_probation = std::mem::take(&mut self.on_probation);
        on_probation.retain(|&id| {
            let Some(point) = self.point(id) else {
                return false;
            };
            let age = (keyframe - point.born) as usize;
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
