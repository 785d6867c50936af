//! The first map of one camera: from the two views among many that determine it best.

use linecarve_points::{Observation, parallax_cosine, refine_point, triangulate_rays};
use nalgebra::{Isometry3, Point3, Unit};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::camera::CHI2_PIXEL;
use crate::frame::FrameFeatures;
use crate::matching::{UNGUIDED, match_descriptors};
use crate::solve::{Correspondence, RayMatch, moved_sigmas, pose_by_consensus, relative_pose};
use crate::tracker::{Frame, Tracker};

/// First views that are tried, evenly over the views.
const ANCHORS: usize = 12;

/// Distances in views between the two of a pair.
const DISTANCES: [usize; 11] = [1, 2, 4, 6, 9, 13, 19, 28, 40, 60, 90];

/// Fewest matches of a pair, and fewest points that it starts with.
const MIN_MATCHES: usize = 80;
const MIN_POINTS: usize = 50;

/// Parallax from which a point counts fully, in degrees.
const FULL_PARALLAX_DEGREES: f64 = 3.0;

/// Least parallax of a point of the first map, in degrees.
const MIN_PARALLAX_DEGREES: f64 = 0.4;

/// Fewest points of the first map that are at least so many standard deviations from where a rotation alone would move them.
const MIN_POINTS_MOVED: usize = 25;
const MIN_MOVED: f64 = 3.0;

/// A pose that another pose of the same pair rivals with this share of its matches is ambiguous.
const RIVAL_SHARE: f64 = 0.9;

/// Best pairs whose points are looked for in further views.
const MAX_CANDIDATES: usize = 8;

/// Steps of the first adjustment.
const STEPS: [usize; 2] = [20, 20];

/// Two views and the points that they determine.
struct Start {
    views: [usize; 2],
    second_from_first: Isometry3<f64>,
    /// Features in both views, and their point in the first camera.
    points: Vec<([usize; 2], Point3<f64>)>,
    quality: f64,
}

impl Tracker {
    /// Starts a map from two of the views, whose frame numbers begin at `first`. Returns the positions of both, and the frame of
    /// the second; `None` when no pair of views determines a map.
    pub(crate) fn start_from_pair(
        &mut self,
        views: &[FrameFeatures],
        first: u32,
    ) -> Option<([usize; 2], Frame)> {
        if let Some(pair) = self.options.start_pair {
            let of_views = |number: u32| {
                let at = number.checked_sub(first)? as usize;
                (at < views.len()).then_some(at)
            };
            let start = self.start_of(views, [of_views(pair[0])?, of_views(pair[1])?])?;
            let frame = self.insert_start(views, first, &start);
            return Some((start.views, frame));
        }
        let mut starts: Vec<Start> = Vec::new();
        let step = views.len().div_ceil(ANCHORS).max(1);
        for anchor in (0..views.len()).step_by(step) {
            for distance in DISTANCES {
                if anchor + distance >= views.len() {
                    break;
                }
                let pair = [anchor, anchor + distance];
                starts.extend(self.start_of(views, pair));
            }
        }
        starts.sort_by(|a, b| b.quality.total_cmp(&a.quality).then(a.views.cmp(&b.views)));
        starts.truncate(MAX_CANDIDATES);
        for start in &mut starts {
            start.quality *= self.confirmation(views, start);
        }
        starts.sort_by(|a, b| b.quality.total_cmp(&a.quality).then(a.views.cmp(&b.views)));
        let start = starts.into_iter().find(|one| one.quality > 0.0)?;
        let frame = self.insert_start(views, first, &start);
        Some((start.views, frame))
    }

    /// Points and quality of a pair of views.
    fn start_of(&self, views: &[FrameFeatures], pair: [usize; 2]) -> Option<Start> {
        let of = pair.map(|at| &views[at]);
        let pairs = match_descriptors(
            &of[0].features.descriptors,
            &of[1].features.descriptors,
            &UNGUIDED,
        );
        if pairs.len() < MIN_MATCHES {
            return None;
        }
        let matches: Vec<RayMatch> = pairs
            .iter()
            .map(|(a, b)| {
                let measured = [of[0].measurement(*a as u32), of[1].measurement(*b as u32)];
                let [first, second] = measured.map(|one| self.camera.ray(&one.pixel));
                RayMatch {
                    first,
                    second,
                    sigma: measured[0].sigma_px.max(measured[1].sigma_px) / self.camera.fx,
                }
            })
            .collect();
        let seed = ((pair[0] as u64) << 32) | pair[1] as u64;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let pose = relative_pose(&matches, &mut random)?;
        if 2 * pose.inliers < matches.len() {
            return None;
        }
        let second_from_first = pose.second_from_first;
        let mut points = Vec::new();
        let mut quality = 0.0;
        let mut moved = 0;
        for (&(a, b), rays) in pairs.iter().zip(&matches) {
            let Some((point, parallax)) = self.point_of(of, [a, b], &second_from_first) else {
                continue;
            };
            if parallax >= MIN_PARALLAX_DEGREES {
                moved += usize::from(moved_sigmas(rays, &pose.rotation_alone) >= MIN_MOVED);
                points.push(([a, b], point));
                quality += (parallax / FULL_PARALLAX_DEGREES).min(1.0);
            }
        }
        if points.len() < MIN_POINTS || moved < MIN_POINTS_MOVED {
            return None;
        }
        if pose.rival as f64 > RIVAL_SHARE * pose.inliers as f64 {
            quality *= 0.5;
        }
        quality *= pose.inliers as f64 / matches.len() as f64;
        Some(Start {
            views: pair,
            second_from_first,
            points,
            quality,
        })
    }

    /// The point of a match in the first camera, and its parallax in degrees; `None` when the rays do not meet.
    fn point_of(
        &self,
        views: [&FrameFeatures; 2],
        features: [usize; 2],
        second_from_first: &Isometry3<f64>,
    ) -> Option<(Point3<f64>, f64)> {
        let poses = [Isometry3::identity(), *second_from_first];
        let measured = [0, 1].map(|at| views[at].measurement(features[at] as u32));
        let rays = [0, 1].map(|at| {
            let back = poses[at].inverse();
            let direction = back * self.camera.ray(&measured[at].pixel);
            (back * Point3::origin(), Unit::new_normalize(direction))
        });
        let start = triangulate_rays(&rays)?;
        let observations = [0, 1].map(|at| Observation {
            camera_from_world: poses[at],
            pixel: measured[at].pixel,
            sigma_px: measured[at].sigma_px,
        });
        let point = refine_point(&self.camera.camera, &observations, start)?.point_in_world;
        let fits = observations.iter().all(|one| {
            one.chi2(&self.camera.camera, &point)
                .is_some_and(|chi2| chi2 <= CHI2_PIXEL)
        });
        let cosine = parallax_cosine(&rays.map(|(center, _)| center), &point);
        fits.then(|| (point, cosine.clamp(-1.0, 1.0).acos().to_degrees()))
    }

    /// Share of the points of a pair that agree with the poses of a view between and of a view beyond both.
    fn confirmation(&self, views: &[FrameFeatures], start: &Start) -> f64 {
        let [a, b] = start.views;
        let others = [
            a.midpoint(b),
            (b + (b - a).div_ceil(2)).min(views.len() - 1),
        ];
        let descriptors: Vec<_> = start
            .points
            .iter()
            .map(|(features, _)| *views[a].descriptor(features[0] as u32))
            .collect();
        let mut sum = 0.0;
        let mut count = 0.0;
        for other in others {
            if other == a || other == b {
                continue;
            }
            count += 1.0;
            let found =
                match_descriptors(&views[other].features.descriptors, &descriptors, &UNGUIDED);
            let matches: Vec<Correspondence> = found
                .iter()
                .map(|(feature, at)| {
                    (
                        start.points[*at].1,
                        views[other].measurement(*feature as u32),
                    )
                })
                .collect();
            let mut is_inlier = Vec::new();
            let mut random = ChaCha8Rng::seed_from_u64(other as u64);
            let pose = pose_by_consensus(&self.camera, &matches, 15, &mut random, &mut is_inlier);
            if let Some(pose) = pose {
                sum += pose.inliers as f64 / matches.len() as f64;
            }
        }
        // Neighbouring views have none between them.
        if count == 0.0 { 0.5 } else { sum / count }
    }

    /// Inserts both keyframes and their points, adjusts them, and makes the median depth one.
    fn insert_start(&mut self, views: &[FrameFeatures], first: u32, start: &Start) -> Frame {
        let submap = self.submaps;
        self.submaps += 1;
        let poses = [Isometry3::identity(), start.second_from_first];
        let mut frames = [0, 1].map(|at| {
            let number = first + start.views[at] as u32;
            Frame::new(number, views[start.views[at]].clone(), poses[at])
        });
        let ids = [0, 1].map(|at| self.insert_keyframe(&mut frames[at], submap));
        for (features, position) in &start.points {
            let point = self.map.insert_point(*position, ids[0], features[0] as u32);
            self.map.add_observation(point, ids[1], features[1] as u32);
            self.map.update_point(point);
        }
        self.map.keyframe_mut(ids[1]).parent = Some(ids[0]);
        self.adjust(&ids, STEPS);
        let depth = self.median_depth(ids[0]).unwrap_or(1.0);
        self.map.rescale(1.0 / depth);
        for id in ids {
            self.map.update_neighbors(id);
        }
        for (frame, id) in frames.iter_mut().zip(ids) {
            self.reference = id;
            frame.camera_from_world = self.map.keyframe(id).camera_from_world;
            frame.points.clone_from(&self.map.keyframe(id).points);
            frame.inliers = frame.matched();
            self.record(frame);
        }
        let [_, second] = frames;
        second
    }
}
