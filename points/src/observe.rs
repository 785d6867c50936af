//! Matching of known points with a keyframe, by projection.

use nalgebra::{Matrix2, Point2};

use super::epipolar::{LEVEL_TOLERANCE, TwoViewGeometry, angle_between, ratio_test};
use super::map::PointMap;
use super::point::{MapObservation, MapPoint, MapPointId};
use crate::pose_correction::CHI2_PIXEL;

/// Ratio test of known points, as in ORB-SLAM2.
const KNOWN_RATIO: f64 = 0.9;

/// Largest deviation from the mean viewing direction: 60 degrees.
const VIEWING_COSINE: f64 = 0.5;

/// Largest half side of the search window of an uncertain point.
const WIDEST_SEARCH_PX: f64 = 40.0;

/// Predicted observation of a point in a keyframe.
struct Prediction {
    pixel: Point2<f64>,
    /// Covariance of the pixel by that of the point.
    covariance: Matrix2<f64>,
    octave: f64,
    angle_rad: f32,
}

/// Matches of known points with the features of a keyframe.
pub(super) struct ProjectionMatches {
    /// Points predicted to be visible.
    expected: Vec<MapPointId>,
    /// Per feature: descriptor distance and point of its best match.
    pub(super) matches: Vec<Option<(u32, MapPointId)>>,
    /// Points whose feature has a better match: candidates for merging.
    duplicates: Vec<(MapPointId, u32)>,
}

impl PointMap {
    /// Matches the points of the map with a new keyframe.
    pub(super) fn search_by_projection(&self, keyframe: u32) -> ProjectionMatches {
        let count = self.keyframes[keyframe as usize].features.len();
        let mut matches: Vec<Option<(u32, MapPointId)>> = vec![None; count];
        let mut duplicates: Vec<(MapPointId, u32)> = Vec::new();
        let mut expected = Vec::new();
        for &id in &self.living {
            let Some(point) = self.point(id) else {
                continue;
            };
            let Some(prediction) = self.predict(point, keyframe) else {
                continue;
            };
            expected.push(id);
            let Some((distance, feature)) = self.find_match(point, &prediction, keyframe) else {
                continue;
            };
            let slot = &mut matches[feature as usize];
            match slot {
                Some((best, matched)) if *best <= distance => duplicates.push((id, feature)),
                Some((_, matched)) => {
                    duplicates.push((*matched, feature));
                    *slot = Some((distance, id));
                }
                None => *slot = Some((distance, id)),
            }
        }
        ProjectionMatches {
            expected,
            matches,
            duplicates,
        }
    }

    /// Adds the observations of known points in a new keyframe; returns their number.
    pub(super) fn match_known_points(&mut self, keyframe: u32) -> usize {
        let ProjectionMatches {
            expected,
            matches,
            mut duplicates,
        } = self.search_by_projection(keyframe);
        for id in expected {
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                point.visible += 1;
            }
        }
        let mut observed = 0;
        for (feature, matched) in matches.iter().enumerate() {
            let Some((_, id)) = *matched else { continue };
            let feature = feature as u32;
            self.add_observation(id, MapObservation { keyframe, feature });
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                point.found += 1;
            }
            observed += 1;
        }
        // Two points that match the same feature may be the same point.
        duplicates.sort_unstable();
        for (duplicate, feature) in duplicates {
            if let Some((_, matched)) = matches[feature as usize] {
                self.merge(duplicate, matched);
            }
        }
        observed
    }

    /// Predicted observation of a point; `None` when it is not visible.
    fn predict(&self, point: &MapPoint, keyframe: u32) -> Option<Prediction> {
        let view = &self.keyframes[keyframe as usize];
        let in_camera = view.camera_from_world() * point.point_in_world;
        // Cheap tests first: this runs for every point of the map.
        let pixel = self.camera.project(&in_camera)?;
        let [width, height] = self.size;
        let is_inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height;
        if !is_inside {
            return None;
        }
        let ray = point.point_in_world - view.center();
        let distance = ray.norm();
        if ray.dot(&point.viewing) < VIEWING_COSINE * distance {
            return None;
        }
        let reference = point.observations.first()?;
        let first = &self.keyframes[reference.keyframe as usize];
        let feature = reference.feature as usize;
        let then = (point.point_in_world - first.center()).norm();
        let octave = f64::from(first.features.octaves[feature])
            + (then / distance).ln() / self.options.scale_factor.ln();
        if !(octave > -LEVEL_TOLERANCE
            && octave < self.options.levels as f64 - 1.0 + LEVEL_TOLERANCE)
        {
            return None;
        }
        let geometry = TwoViewGeometry::new(
            &self.camera,
            first.camera_from_world(),
            view.camera_from_world(),
        );
        let (_, by_point) = self.camera.project_with_jacobian(&in_camera)?;
        let rotation = view.camera_from_world().rotation.to_rotation_matrix();
        let jacobian = by_point * rotation.matrix();
        Some(Prediction {
            pixel,
            covariance: jacobian * point.covariance * jacobian.transpose(),
            octave,
            angle_rad: geometry.transfer_angle(
                first.features.pixels[feature],
                first.features.angles_rad[feature],
            ),
        })
    }

    /// Descriptor distance and feature of the best match that passes the ratio test.
    fn find_match(
        &self,
        point: &MapPoint,
        prediction: &Prediction,
        keyframe: u32,
    ) -> Option<(u32, u32)> {
        let view = &self.keyframes[keyframe as usize];
        let features = &view.features;
        let coarsest = (prediction.octave + LEVEL_TOLERANCE).clamp(0.0, 15.0) as u8;
        let widest = self.options.sigma_px(coarsest, view.pose_sigma_px);
        let reach = |axis: usize| {
            let variance = prediction.covariance[(axis, axis)] + widest * widest;
            (CHI2_PIXEL * variance).sqrt().min(WIDEST_SEARCH_PX)
        };
        let (x, y) = (prediction.pixel.x, prediction.pixel.y);
        let low = [(x - reach(0)) as f32, (y - reach(1)) as f32];
        let high = [(x + reach(0)) as f32, (y + reach(1)) as f32];
        let rotation = self.options.rotation_degrees.to_radians() as f32;
        let mut candidates = Vec::new();
        view.grid.near_box(low, high, |feature| {
            let index = feature as usize;
            let octave = features.octaves[index];
            if (f64::from(octave) - prediction.octave).abs() > LEVEL_TOLERANCE
                || angle_between(features.angles_rad[index], prediction.angle_rad) > rotation
            {
                return;
            }
            let sigma = self.options.sigma_px(octave, view.pose_sigma_px);
            let covariance = prediction.covariance + Matrix2::identity() * (sigma * sigma);
            let error = view.pixel(feature) - prediction.pixel;
            let is_near = covariance
                .try_inverse()
                .is_some_and(|information| error.dot(&(information * error)) < CHI2_PIXEL);
            if is_near && error.amax() <= WIDEST_SEARCH_PX {
                let distance = point.descriptor.distance(&features.descriptors[index]);
                candidates.push((distance, feature));
            }
        });
        ratio_test(&candidates, features, &self.options, KNOWN_RATIO)
            .filter(|(distance, _)| *distance <= self.options.known_descriptor_distance)
    }

    /// Matches a point with an older keyframe that does not observe it yet. When the feature has another point, merges the two if
    /// one position fits all observations. Returns the id of the point, which a merger may change.
    pub(super) fn extend_track(&mut self, id: MapPointId, keyframe: u32) -> MapPointId {
        let found = self.point(id).and_then(|point| {
            if point.observation_in(keyframe).is_some() {
                return None;
            }
            let prediction = self.predict(point, keyframe)?;
            self.find_match(point, &prediction, keyframe)
        });
        let Some((_, feature)) = found else {
            return id;
        };
        match self.keyframes[keyframe as usize].points[feature as usize] {
            None => {
                self.add_observation(id, MapObservation { keyframe, feature });
                id
            }
            Some(other) => {
                if self.merge(id, other) {
                    other
                } else {
                    id
                }
            }
        }
    }

    /// Merges `lost` into `kept` when one position fits the observations of both. Returns whether it did.
    pub(super) fn merge(&mut self, lost: MapPointId, kept: MapPointId) -> bool {
        let (Some(from), Some(into)) = (self.point(lost), self.point(kept)) else {
            return false;
        };
        let added: Vec<MapObservation> = from
            .observations
            .iter()
            .copied()
            .filter(|observation| into.observation_in(observation.keyframe).is_none())
            .collect();
        let together: Vec<MapObservation> =
            into.observations.iter().chain(&added).copied().collect();
        let Some(refined) = self.fit(&together, into.point_in_world) else {
            return false;
        };
        let all_fit = together
            .iter()
            .all(|observation| self.chi2(observation, &refined.point_in_world) < CHI2_PIXEL);
        if !all_fit {
            return false;
        }
        self.remove(lost);
        for observation in added {
            self.add_observation(kept, observation);
        }
        true
    }
}
