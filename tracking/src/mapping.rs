//! Extension of the map by a keyframe: new points, fusion, culling.

use std::time::Instant;

use linecarve_lines::upper_median;
use linecarve_points::{
    FeatureMatch, Observation, TwoViewGeometry, match_along_epipolar_lines, parallax_cosine,
    refine_point, triangulate_rays,
};
use nalgebra::{Point3, Unit};

use crate::camera::{CHI2_DEPTH, CHI2_PIXEL, squared};
use crate::map::{KeyframeId, PointId};
use crate::matching::{Expected, NEAR_DESCRIPTOR, Rules, expect_point, match_expected};
use crate::tracker::Tracker;

/// Neighbours with which points are triangulated and fused.
const NEIGHBORS: usize = 10;

/// Neighbours of neighbours with which points are fused.
const SECOND_NEIGHBORS: usize = 3;

/// Smallest baseline for triangulation, as a share of the median depth.
const MIN_BASELINE_SHARE: f64 = 0.02;

/// Cosine of the smallest parallax of a triangulated point.
const MAX_PARALLAX_COSINE: f64 = 0.9998;

/// A point is removed when it was found in less than this share of the frames that should see it.
const MIN_FOUND_SHARE: f64 = 0.25;

/// Keyframes after which a point must have been seen again.
const PROBATION: u32 = 2;

/// A keyframe is redundant when this share of its points is seen by three others.
const REDUNDANT_SHARE: f64 = 0.9;

/// Keyframes after which features without a point hardly get one: their patches, and the image, are dropped.
const IMAGE_AGE: u32 = 20;

/// Weight of a new keyframe in the running estimate of feature noise.
const NOISE_GAIN: f64 = 0.2;

/// Search radius of fusion in pixels of the finest level, relative to that of tracking.
const FUSION_RADIUS: f64 = 1.0;

impl Tracker {
    /// Creates points at the features whose depth is known.
    pub(crate) fn create_from_depth(&mut self, id: KeyframeId) {
        let keyframe = self.map.keyframe(id);
        let world_from_camera = keyframe.camera_from_world.inverse();
        let new: Vec<(u32, Point3<f64>)> = keyframe
            .points
            .iter()
            .zip(&keyframe.view.inverse_depths)
            .enumerate()
            .filter(|(_, (point, _))| point.is_none())
            .filter_map(|(feature, (_, depth))| {
                let feature = feature as u32;
                let ray = self.camera.ray(&keyframe.view.pixel(feature));
                let in_camera = Point3::from(ray / f64::from((*depth)?[0]));
                Some((feature, world_from_camera * in_camera))
            })
            .collect();
        for (feature, position) in new {
            let point = self.map.insert_point(position, id, feature);
            self.recent_points.push(point);
        }
    }

    /// Extends the map by a keyframe that was inserted.
    pub(crate) fn extend_map(&mut self, id: KeyframeId) {
        self.map.update_neighborhood(id);
        let parent = self.map.neighbors(id, 1).first().copied();
        self.map.keyframe_mut(id).parent = parent;
        self.cull_recent_points(id);
        self.triangulate(id);
        self.fuse_neighborhood(id);
        let points: Vec<PointId> = self
            .map
            .keyframe(id)
            .points
            .iter()
            .flatten()
            .copied()
            .collect();
        for point in points {
            self.map.update_point(point);
        }
        self.map.update_neighborhood(id);
        self.align_keyframe(id);
        let start = Instant::now();
        self.adjust_locally(id);
        self.learn_noise(id, NOISE_GAIN);
        self.times.adjustment_ms += start.elapsed().as_secs_f64() * 1e3;
        self.cull_keyframes(id);
        if let Some(old) = id.0.checked_sub(IMAGE_AGE) {
            self.map.keyframe_mut(KeyframeId(old)).drop_images();
        }
        if self.options.loops {
            let start = Instant::now();
            self.close_loop(id);
            self.times.loops_ms += start.elapsed().as_secs_f64() * 1e3;
        }
    }

    /// Removes recent points that were not seen again.
    fn cull_recent_points(&mut self, newest: KeyframeId) {
        let recent = std::mem::take(&mut self.recent_points);
        let least = if self.options.is_monocular { 3 } else { 2 };
        for id in recent {
            let point = self.map.point(id);
            if !point.is_alive {
                continue;
            }
            let age = newest.0 - point.first_keyframe.0;
            let is_rarely_found =
                f64::from(point.found) < MIN_FOUND_SHARE * f64::from(point.visible);
            let is_alone = age >= PROBATION && point.observations.len() < least;
            if is_rarely_found || is_alone {
                self.map.remove_point(id);
            } else if age <= PROBATION {
                self.recent_points.push(id);
            }
        }
    }

    /// Triangulates features that have neither a point nor a depth.
    pub(crate) fn triangulate(&mut self, id: KeyframeId) {
        let options = self.options.feature_options();
        let neighbors = self.map.neighbors(id, NEIGHBORS);
        let Some(depth) = self.median_depth(id) else {
            return;
        };
        let mut pairs: Vec<FeatureMatch> = Vec::new();
        for other in neighbors {
            let (first, second) = (self.map.keyframe(id), self.map.keyframe(other));
            let geometry = TwoViewGeometry::new(
                &self.camera.camera,
                &first.camera_from_world,
                &second.camera_from_world,
            );
            if geometry.baseline() < MIN_BASELINE_SHARE * depth {
                continue;
            }
            match_along_epipolar_lines(
                &geometry,
                &options,
                &first.view.features,
                |at| first.points[at].is_none(),
                &second.view.features,
                &second.view.grid,
                |at| second.points[at].is_none(),
                &mut pairs,
            );
            let found: Vec<(FeatureMatch, Point3<f64>)> = pairs
                .iter()
                .filter_map(|pair| Some((*pair, self.triangulated(id, other, pair)?)))
                .collect();
            for (pair, position) in found {
                let point = self.map.insert_point(position, id, pair.first);
                self.map.add_observation(point, other, pair.second);
                self.map.update_point(point);
                self.recent_points.push(point);
            }
        }
    }

    /// The point of a match, when its rays meet and agree with pixels and depths.
    fn triangulated(
        &self,
        id: KeyframeId,
        other: KeyframeId,
        pair: &FeatureMatch,
    ) -> Option<Point3<f64>> {
        let views = [(id, pair.first), (other, pair.second)];
        let rays = views.map(|(keyframe, feature)| {
            let keyframe = self.map.keyframe(keyframe);
            let ray = self.camera.ray(&keyframe.view.pixel(feature));
            let in_world = keyframe.camera_from_world.inverse() * ray;
            (keyframe.center(), Unit::new_normalize(in_world))
        });
        let start = triangulate_rays(&rays)?;
        let observations = views.map(|(keyframe, feature)| {
            let keyframe = self.map.keyframe(keyframe);
            let measurement = keyframe.view.measurement(feature);
            Observation {
                camera_from_world: keyframe.camera_from_world,
                pixel: measurement.pixel,
                sigma_px: measurement.sigma_px,
            }
        });
        let point = refine_point(&self.camera.camera, &observations, start)?.point_in_world;
        let cosine = parallax_cosine(&rays.map(|(center, _)| center), &point);
        let fits = views
            .iter()
            .all(|(keyframe, feature)| self.agrees(*keyframe, *feature, &point));
        (cosine < MAX_PARALLAX_COSINE && fits).then_some(point)
    }

    /// Whether a feature can be the image of a point.
    fn agrees(&self, keyframe: KeyframeId, feature: u32, point: &Point3<f64>) -> bool {
        let keyframe = self.map.keyframe(keyframe);
        let measurement = keyframe.view.measurement(feature);
        let in_camera = keyframe.camera_from_world * point;
        let residual = measurement.residual(&self.camera, &in_camera);
        residual.is_some_and(|residual| {
            let (pixel, depth) = squared(&residual);
            pixel <= CHI2_PIXEL && depth <= 4.0 * CHI2_DEPTH
        })
    }

    pub(crate) fn median_depth(&self, id: KeyframeId) -> Option<f64> {
        let keyframe = self.map.keyframe(id);
        let mut depths: Vec<f64> = keyframe
            .points
            .iter()
            .flatten()
            .map(|point| (keyframe.camera_from_world * self.map.point(*point).position).z)
            .collect();
        upper_median(&mut depths, f64::total_cmp)
    }

    /// Fuses the points of a keyframe with those of its neighbours.
    fn fuse_neighborhood(&mut self, id: KeyframeId) {
        let mut targets = self.map.neighbors(id, NEIGHBORS);
        for at in 0..targets.len() {
            for second in self.map.neighbors(targets[at], SECOND_NEIGHBORS) {
                if second != id && !targets.contains(&second) {
                    targets.push(second);
                }
            }
        }
        let own = self.points_of(id);
        for &target in &targets {
            self.fuse_into(target, &own, FUSION_RADIUS);
        }
        let mut theirs: Vec<PointId> = targets
            .iter()
            .flat_map(|target| self.map.keyframe(*target).points.iter().flatten().copied())
            .collect();
        theirs.sort_unstable();
        theirs.dedup();
        self.fuse_into(id, &theirs, FUSION_RADIUS);
    }

    pub(crate) fn points_of(&self, id: KeyframeId) -> Vec<PointId> {
        self.map
            .keyframe(id)
            .points
            .iter()
            .flatten()
            .copied()
            .collect()
    }

    /// Looks for points in a keyframe: they gain an observation, or are fused with the point that is there. Returns how many were
    /// found.
    pub(crate) fn fuse_into(
        &mut self,
        target: KeyframeId,
        points: &[PointId],
        radius_factor: f64,
    ) -> usize {
        let keyframe = self.map.keyframe(target);
        let center = keyframe.center();
        let expected: Vec<Expected> = points
            .iter()
            .filter(|id| {
                let point = self.map.point(**id);
                point.is_alive && point.feature_in(target).is_none()
            })
            .filter_map(|id| {
                let pose = &keyframe.camera_from_world;
                expect_point(&self.map, &self.camera, pose, &center, *id, radius_factor)
            })
            .collect();
        let rules = Rules {
            max_distance: NEAR_DESCRIPTOR,
            ratio: 1.0,
        };
        let mut matches = match_expected(&keyframe.view, |_| false, &expected, &rules);
        matches.retain(|(feature, index)| {
            let position = self.map.point(expected[*index].point).position;
            self.agrees(target, *feature, &position)
        });
        for (feature, index) in &matches {
            let point = expected[*index].point;
            match self.map.keyframe(target).points[*feature as usize] {
                Some(other) => self.map.fuse(other, point),
                None if self.map.point(point).is_alive => {
                    self.map.add_observation(point, target, *feature);
                }
                None => {}
            }
        }
        matches.len()
    }

    /// Removes neighbours of a keyframe whose points others see as well.
    fn cull_keyframes(&mut self, newest: KeyframeId) {
        // Without depth, the tracks of points through many keyframes carry shape and scale.
        if self.options.is_monocular {
            return;
        }
        for id in self.map.neighbors(newest, usize::MAX) {
            let keyframe = self.map.keyframe(id);
            if keyframe.parent.is_none() || id == newest || !keyframe.loops.is_empty() {
                continue;
            }
            let (mut points, mut redundant) = (0, 0);
            for (feature, point) in keyframe.points.iter().enumerate() {
                let Some(point) = point else { continue };
                points += 1;
                let octave = keyframe.view.octave(feature as u32);
                let others = self
                    .map
                    .point(*point)
                    .observations
                    .iter()
                    .filter(|(other, at)| {
                        *other != id && self.map.keyframe(*other).view.octave(*at) <= octave + 1
                    })
                    .take(3)
                    .count();
                redundant += usize::from(others == 3);
            }
            if redundant as f64 > REDUNDANT_SHARE * f64::from(points) {
                self.map.remove_keyframe(id);
            }
        }
    }
}
