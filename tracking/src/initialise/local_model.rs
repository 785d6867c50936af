//! Structure and motion of a few views around one of them, from nothing but matches.

use linecarve_points::{Observation, parallax_cosine, refine_point, triangulate_rays};
use nalgebra::{Isometry3, Point3, Unit};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::adjust::{Bundle, BundleObservation, BundlePoint};
use crate::camera::{CHI2_PIXEL, Measurement, Pinhole, squared};
use crate::frame::FrameFeatures;
use crate::matching::{UNGUIDED, match_descriptors};
use crate::solve::{Correspondence, pose_by_consensus};

/// Fewest matches of a view with the anchor.
const MIN_MATCHES: usize = 80;

/// Fewest points with which a view agrees that gets a pose.
const MIN_INLIERS: usize = 40;

/// Least parallax of a point, in degrees.
const MIN_PARALLAX_DEGREES: f64 = 0.3;

/// Pairs of views from which the position of a point is sought.
const TRIES: usize = 3;

/// Features seen by most views, from which models are made; the others get their position at the end.
const MAX_TRACKS: usize = 500;

/// Bounds of observations that count, relative to the 95 % bound, and steps of each adjustment: of a draft, and to its end.
const DRAFT: [(f64, usize); 2] = [(16.0, 6), (4.0, 6)];
const FINAL: [(f64, usize); 2] = [(4.0, 10), (1.0, 15)];

/// A step that lowers the cost by less than this share ends an adjustment.
const LAST_GAIN: f64 = 1e-5;

/// An observation of an anchor feature: view (0 is the anchor) and feature.
type Seen = (usize, u32);

/// Features of an anchor view, and where views around it see them.
pub(crate) struct AnchorMatches<'a> {
    camera: &'a Pinhole,
    views: Vec<&'a FrameFeatures>,
    /// Observations of each matched feature, that in the anchor first; features with most observations first.
    tracks: Vec<Vec<Seen>>,
    /// Matches of each view: features in the anchor and in it.
    pub(crate) pairs: Vec<Vec<(usize, usize)>>,
}

/// Poses of the views and positions of the features, in the camera of the anchor and up to scale.
#[derive(Debug, Clone)]
pub(crate) struct LocalModel {
    /// `view_from_anchor`; `None` where too few points agree.
    pub(crate) poses: Vec<Option<Isometry3<f64>>>,
    /// Position of each track.
    pub(crate) points: Vec<Option<Point3<f64>>>,
    /// Sum of squared errors relative to their 95 % bound, at most one for each observation and one where it has no prediction.
    pub(crate) cost: f64,
    /// Observations within their bound, without those of the anchor.
    pub(crate) inliers: usize,
}

impl<'a> AnchorMatches<'a> {
    /// Matches the anchor with other views; those with few matches are left out. Returns the matches and the positions of the
    /// views in `others`.
    pub(crate) fn new(
        camera: &'a Pinhole,
        anchor: &'a FrameFeatures,
        others: &[&'a FrameFeatures],
    ) -> (Self, Vec<usize>) {
        let mut views = vec![anchor];
        let mut pairs = vec![Vec::new()];
        let mut kept = Vec::new();
        let mut of_feature: Vec<Vec<Seen>> = vec![Vec::new(); anchor.len()];
        for (at, other) in others.iter().enumerate() {
            let found = match_descriptors(
                &anchor.features.descriptors,
                &other.features.descriptors,
                &UNGUIDED,
            );
            if found.len() < MIN_MATCHES {
                continue;
            }
            for (feature, there) in &found {
                of_feature[*feature].push((views.len(), *there as u32));
            }
            views.push(other);
            pairs.push(found);
            kept.push(at);
        }
        let mut tracks: Vec<Vec<Seen>> = of_feature
            .into_iter()
            .enumerate()
            .filter(|(_, seen)| !seen.is_empty())
            .map(|(feature, seen)| {
                let mut track = vec![(0, feature as u32)];
                track.extend(seen);
                track
            })
            .collect();
        tracks.sort_by_key(|track| std::cmp::Reverse(track.len()));
        let matches = Self {
            camera,
            views,
            tracks,
            pairs,
        };
        (matches, kept)
    }

    pub(crate) fn track(&self, at: usize) -> &[Seen] {
        &self.tracks[at]
    }

    pub(crate) fn measurement(&self, (view, feature): Seen) -> Measurement {
        self.views[view].measurement(feature)
    }

    /// Observations that models explain or not.
    pub(crate) fn observations(&self) -> usize {
        let tracks = self.tracks.iter().take(MAX_TRACKS);
        tracks.map(|track| track.len() - 1).sum()
    }

    /// The model that grows from a pose of one view: points of both, poses of the others, and all roughly adjusted together.
    pub(crate) fn draft(&self, second: usize, second_from_anchor: &Isometry3<f64>) -> LocalModel {
        let mut poses = vec![None; self.views.len()];
        poses[0] = Some(Isometry3::identity());
        poses[second] = Some(*second_from_anchor);
        let mut model = self.with_poses(poses);
        self.improve(&mut model, &DRAFT);
        model
    }

    /// Adjusts a model to its end.
    pub(crate) fn refine(&self, model: &mut LocalModel) {
        self.improve(model, &FINAL);
    }

    /// Adds the features that were left aside.
    pub(crate) fn complete(&self, model: &mut LocalModel) {
        model.points.resize(self.tracks.len(), None);
        self.triangulate(model);
    }

    fn improve(&self, model: &mut LocalModel, rounds: &[(f64, usize)]) {
        for (bound, steps) in rounds {
            for view in 1..self.views.len() {
                if model.poses[view].is_none() {
                    model.poses[view] = self.locate(model, view);
                }
            }
            self.triangulate(model);
            self.adjust(model, bound * CHI2_PIXEL, *steps);
        }
        self.judge(model);
    }

    /// The model with given poses, for comparison: points are triangulated, and nothing is adjusted.
    pub(crate) fn with_poses(&self, poses: Vec<Option<Isometry3<f64>>>) -> LocalModel {
        let mut model = LocalModel {
            poses,
            points: vec![None; self.tracks.len().min(MAX_TRACKS)],
            cost: 0.0,
            inliers: 0,
        };
        self.triangulate(&mut model);
        self.judge(&mut model);
        model
    }

    /// Squared error of an observation in variances; infinite behind the camera.
    fn chi2(&self, seen: Seen, pose: &Isometry3<f64>, point: &Point3<f64>) -> f64 {
        let residual = self
            .measurement(seen)
            .residual(self.camera, &(pose * point));
        residual.map_or(f64::INFINITY, |residual| squared(&residual).0)
    }

    fn judge(&self, model: &mut LocalModel) {
        model.cost = 0.0;
        model.inliers = 0;
        for (track, point) in self.tracks.iter().zip(&model.points) {
            for seen in &track[1..] {
                let share = match (point, &model.poses[seen.0]) {
                    (Some(point), Some(pose)) => self.chi2(*seen, pose, point) / CHI2_PIXEL,
                    _ => 1.0,
                };
                model.inliers += usize::from(share < 1.0);
                model.cost += share.min(1.0);
            }
        }
    }

    /// Whether the anchor and a view see a track where its point is.
    pub(crate) fn agrees(&self, model: &LocalModel, at: usize, seen: Seen) -> bool {
        match (&model.points[at], &model.poses[seen.0]) {
            (Some(point), Some(pose)) => self.chi2(seen, pose, point) <= CHI2_PIXEL,
            _ => false,
        }
    }

    /// Largest parallax of a track in degrees, over views that agree.
    pub(crate) fn parallax_degrees(&self, model: &LocalModel, at: usize) -> f64 {
        let Some(point) = &model.points[at] else {
            return 0.0;
        };
        let mut largest: f64 = 0.0;
        for seen in &self.tracks[at][1..] {
            if let (true, Some(pose)) = (self.agrees(model, at, *seen), &model.poses[seen.0]) {
                let centers = [Point3::origin(), pose.inverse() * Point3::origin()];
                largest = largest.max(degrees(parallax_cosine(&centers, point)));
            }
        }
        largest
    }

    fn triangulate(&self, model: &mut LocalModel) {
        for at in 0..model.points.len() {
            let track = &self.tracks[at];
            if model.points[at].is_some() {
                continue;
            }
            let mut seen: Vec<(f64, Seen)> = track[1..]
                .iter()
                .filter_map(|seen| {
                    let pose = model.poses[seen.0].as_ref()?;
                    Some((pose.translation.vector.norm_squared(), *seen))
                })
                .collect();
            seen.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let mut most = 0;
            for (_, other) in seen.iter().take(TRIES) {
                let Some(point) = self.point_of(model, track[0], *other) else {
                    continue;
                };
                let count = seen
                    .iter()
                    .filter(|(_, one)| {
                        let pose = model.poses[one.0].as_ref();
                        pose.is_some_and(|pose| self.chi2(*one, pose, &point) <= CHI2_PIXEL)
                    })
                    .count();
                if count > most {
                    most = count;
                    model.points[at] = Some(point);
                }
            }
        }
    }

    /// The point where the rays of the anchor and of another view meet; `None` when they do not, or are nearly parallel.
    fn point_of(&self, model: &LocalModel, anchor: Seen, other: Seen) -> Option<Point3<f64>> {
        let observations = [
            (Isometry3::identity(), anchor),
            (model.poses[other.0]?, other),
        ]
        .map(|(pose, seen)| {
            let measurement = self.measurement(seen);
            Observation {
                camera_from_world: pose,
                pixel: measurement.pixel,
                sigma_px: measurement.sigma_px,
            }
        });
        let rays = [0, 1].map(|at| {
            let back = observations[at].camera_from_world.inverse();
            let direction = back * self.camera.ray(&observations[at].pixel);
            (back * Point3::origin(), Unit::new_normalize(direction))
        });
        let start = triangulate_rays(&rays)?;
        let point = refine_point(&self.camera.camera, &observations, start)?.point_in_world;
        let fits = observations.iter().all(|one| {
            one.chi2(&self.camera.camera, &point)
                .is_some_and(|chi2| chi2 <= CHI2_PIXEL)
        });
        let parallax = degrees(parallax_cosine(&rays.map(|(center, _)| center), &point));
        (fits && parallax >= MIN_PARALLAX_DEGREES).then_some(point)
    }

    /// The pose of a view from the points of the model.
    fn locate(&self, model: &LocalModel, view: usize) -> Option<Isometry3<f64>> {
        let matches: Vec<Correspondence> = self
            .tracks
            .iter()
            .zip(&model.points)
            .filter_map(|(track, point)| {
                let seen = track[1..].iter().find(|(other, _)| *other == view)?;
                Some(((*point)?, self.measurement(*seen)))
            })
            .collect();
        let mut random = ChaCha8Rng::seed_from_u64(view as u64);
        let least = MIN_INLIERS.max(matches.len() / 3);
        let mut is_inlier = Vec::new();
        pose_by_consensus(self.camera, &matches, least, &mut random, &mut is_inlier)
            .map(|found| found.camera_from_world)
    }

    /// Adjusts poses and points with the observations that are within a bound.
    fn adjust(&self, model: &mut LocalModel, bound: f64, steps: usize) {
        let mut slot_of = vec![None; self.views.len()];
        let mut poses = Vec::new();
        for (view, pose) in model.poses.iter().enumerate() {
            if let Some(pose) = pose {
                slot_of[view] = Some(poses.len() as u32);
                poses.push(*pose);
            }
        }
        let mut points = Vec::new();
        let mut of_track = Vec::new();
        for at in 0..model.points.len() {
            let track = &self.tracks[at];
            let Some(position) = &model.points[at] else {
                continue;
            };
            let observations: Vec<BundleObservation> = track
                .iter()
                .filter_map(|seen| {
                    let pose = model.poses[seen.0].as_ref()?;
                    Some(BundleObservation {
                        camera: slot_of[seen.0]?,
                        measurement: self.measurement(*seen),
                        is_used: self.chi2(*seen, pose, position) <= bound,
                    })
                })
                .collect();
            if observations.iter().filter(|one| one.is_used).count() >= 2 {
                of_track.push(at);
                points.push(BundlePoint {
                    position: *position,
                    observations,
                });
            } else {
                model.points[at] = None;
            }
        }
        let mut bundle = Bundle {
            camera: self.camera,
            is_free: (0..poses.len()).map(|slot| slot > 0).collect(),
            poses,
            points,
            factors: Vec::new(),
            last_gain: LAST_GAIN,
        };
        bundle.minimise(steps);
        for (view, slot) in slot_of.iter().enumerate() {
            if let Some(slot) = slot {
                model.poses[view] = Some(bundle.poses[*slot as usize]);
            }
        }
        for (at, point) in of_track.into_iter().zip(bundle.points) {
            model.points[at] = Some(point.position);
        }
    }
}

/// Angle of a cosine.
fn degrees(cosine: f64) -> f64 {
    cosine.clamp(-1.0, 1.0).acos().to_degrees()
}
