//! Points that a keyframe sees again.

use nalgebra::{Matrix2, Point2};

use super::epipolar::{LEVEL_TOLERANCE, TwoViewGeometry, angle_between, clear_best};
use super::map::PointMap;
use super::point::{MapObservation, MapPoint, MapPointId};
use super::triangulate::CHI2_PIXEL;

/// The best candidate for a known point must be below this share of the second best, as in ORB-SLAM2.
const KNOWN_RATIO: f64 = 0.9;

/// A point is looked for when it is seen within 60 degrees of the mean direction from which it was.
const VIEWING_COSINE: f64 = 0.5;

/// Half the side of the window in which a badly known point is looked for, at most.
const WIDEST_SEARCH_PX: f64 = 40.0;

/// Where and how a keyframe should see a point.
struct Prediction {
    pixel: Point2<f64>,
    /// Covariance of the pixel from that of the point.
    spread: Matrix2<f64>,
    octave: f64,
    angle_rad: f32,
}

/// What a search for known points found.
pub(super) struct Found {
    /// Points that should be seen.
    expected: Vec<MapPointId>,
    /// The point that each feature is, and the bits in which they differ.
    pub(super) winners: Vec<Option<(u32, MapPointId)>>,
    /// Points that another one beat to a feature.
    losers: Vec<(MapPointId, u32)>,
}

impl PointMap {
    /// Looks for the points that a new keyframe sees.
    pub(super) fn search(&self, keyframe: u32) -> Found {
        let count = self.keyframes[keyframe as usize].features.len();
        let mut winners: Vec<Option<(u32, MapPointId)>> = vec![None; count];
        let mut losers: Vec<(MapPointId, u32)> = Vec::new();
        let mut expected = Vec::new();
        for &id in &self.living {
            let Some(point) = self.point(id) else {
                continue;
            };
            let Some(prediction) = self.predict(point, keyframe) else {
                continue;
            };
            expected.push(id);
            let Some((distance, feature)) = self.find(point, &prediction, keyframe) else {
                continue;
            };
            let slot = &mut winners[feature as usize];
            match slot {
                Some((best, winner)) if *best <= distance => losers.push((id, feature)),
                Some((_, winner)) => {
                    losers.push((*winner, feature));
                    *slot = Some((distance, id));
                }
                None => *slot = Some((distance, id)),
            }
        }
        Found {
            expected,
            winners,
            losers,
        }
    }

    /// Finds the points that a new keyframe sees; returns how many.
    pub(super) fn observe(&mut self, keyframe: u32) -> usize {
        let Found {
            expected,
            winners,
            mut losers,
        } = self.search(keyframe);
        for id in expected {
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                point.visible += 1;
            }
        }
        let mut observed = 0;
        for (feature, winner) in winners.iter().enumerate() {
            let Some((_, id)) = *winner else { continue };
            let feature = feature as u32;
            self.add_sighting(id, MapObservation { keyframe, feature });
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                point.found += 1;
            }
            observed += 1;
        }
        // Two points that one feature could be are perhaps one point.
        losers.sort_unstable();
        for (loser, feature) in losers {
            if let Some((_, winner)) = winners[feature as usize] {
                self.merge(loser, winner);
            }
        }
        observed
    }

    /// Where a keyframe should see a point; `None` when it should not.
    fn predict(&self, point: &MapPoint, keyframe: u32) -> Option<Prediction> {
        let view = &self.keyframes[keyframe as usize];
        let in_camera = view.camera_from_world() * point.point_in_world;
        // The cheap tests first: this runs for every point of the map.
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
            spread: jacobian * point.covariance * jacobian.transpose(),
            octave,
            angle_rad: geometry.transfer_angle(
                first.features.pixels[feature],
                first.features.angles_rad[feature],
            ),
        })
    }

    /// The feature of a keyframe that a point clearly is, and the bits in which they differ.
    fn find(&self, point: &MapPoint, prediction: &Prediction, keyframe: u32) -> Option<(u32, u32)> {
        let view = &self.keyframes[keyframe as usize];
        let features = &view.features;
        let coarsest = (prediction.octave + LEVEL_TOLERANCE).clamp(0.0, 15.0) as u8;
        let widest = self.options.sigma_px(coarsest, view.pose_sigma_px);
        let reach = |axis: usize| {
            let variance = prediction.spread[(axis, axis)] + widest * widest;
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
            let spread = prediction.spread + Matrix2::identity() * (sigma * sigma);
            let error = view.pixel(feature) - prediction.pixel;
            let is_near = spread
                .try_inverse()
                .is_some_and(|information| error.dot(&(information * error)) < CHI2_PIXEL);
            if is_near && error.amax() <= WIDEST_SEARCH_PX {
                let distance = point.descriptor.distance(&features.descriptors[index]);
                candidates.push((distance, feature));
            }
        });
        clear_best(&candidates, features, &self.options, KNOWN_RATIO)
            .filter(|(distance, _)| *distance <= self.options.known_descriptor_distance)
    }

    /// Looks for a point in an older keyframe that does not see it yet. A feature that is another point joins the two,
    /// when one position fits all their pixels. Returns the id of the point, which joining may change.
    pub(super) fn extend(&mut self, id: MapPointId, keyframe: u32) -> MapPointId {
        let found = self.point(id).and_then(|point| {
            if point.observation_in(keyframe).is_some() {
                return None;
            }
            let prediction = self.predict(point, keyframe)?;
            self.find(point, &prediction, keyframe)
        });
        let Some((_, feature)) = found else {
            return id;
        };
        match self.keyframes[keyframe as usize].points[feature as usize] {
            None => {
                self.add_sighting(id, MapObservation { keyframe, feature });
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

    /// Makes one point of two when one position fits the pixels of both: `lost` becomes `kept`. Returns whether it did.
    pub(super) fn merge(&mut self, lost: MapPointId, kept: MapPointId) -> bool {
        let (Some(from), Some(into)) = (self.point(lost), self.point(kept)) else {
            return false;
        };
        let added: Vec<MapObservation> = from
            .observations
            .iter()
            .copied()
            .filter(|sighting| into.observation_in(sighting.keyframe).is_none())
            .collect();
        let together: Vec<MapObservation> =
            into.observations.iter().chain(&added).copied().collect();
        let Some(refined) = self.fit(&together, into.point_in_world) else {
            return false;
        };
        let all_fit = together
            .iter()
            .all(|sighting| self.chi2(sighting, &refined.point_in_world) < CHI2_PIXEL);
        if !all_fit {
            return false;
        }
        self.remove(lost);
        for sighting in added {
            self.add_sighting(kept, sighting);
        }
        true
    }
}
