//! An anchor view, the poses of views around it, and the models that explain them.

use linecarve_lines::upper_median;
use nalgebra::{Isometry3, UnitQuaternion};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::local_model::{AnchorMatches, LocalModel};
use crate::camera::Pinhole;
use crate::frame::FrameFeatures;
use crate::solve::{
    RayMatch, RelativePose, may_share_translation, moved_sigmas, relative_poses, rotation_alone,
};

/// Distances in views of the others from the anchor.
const DISTANCES: [usize; 11] = [1, 2, 4, 6, 9, 13, 19, 28, 40, 60, 90];

/// Fewest points that a map starts with.
const MIN_POINTS: usize = 50;

/// Parallax from which a point counts fully, and from which it counts at all, in degrees.
const FULL_PARALLAX_DEGREES: f64 = 3.0;
const MIN_PARALLAX_DEGREES: f64 = 0.4;

/// Fewest matches that are at least so many standard deviations from where a rotation alone would move them.
const MIN_POINTS_MOVED: usize = 25;
const MIN_MOVED: f64 = 3.0;

/// Share of the matches below which those that moved are first searched alone for a common translation. Wrong matches of a camera that
/// stands still are so few.
const FEW_MOVED: f64 = 0.15;

/// Distance from a rotation alone from which a match counts fully, in standard deviations.
const FULL_MOVED: f64 = 30.0;

/// Least share of the matches of a pair that agree with its pose.
const MIN_AGREEING: f64 = 0.5;

/// Distance of other models from which a model counts fully.
const FULL_MARGIN: f64 = 0.5;

/// Number of points with full parallax, and share of the observations that agree, from which a model is believed before all views are
/// there that may start a map.
const CLEAR_QUALITY: f64 = 150.0;
const CLEAR_EXPLAINED: f64 = 0.6;

/// Pairs of an anchor from whose poses models grow, and clearly different models that are adjusted to their end.
const MAX_PAIRS: usize = 3;
const MAX_MODELS: usize = 3;

/// Models differ when a camera of one is turned by more than this, or has its direction from the anchor elsewhere.
const DISTINCT_DEGREES: f64 = 1.0;
const DISTINCT_DIRECTION_DEGREES: f64 = 10.0;

/// A view of which all poses that explain its matches with the anchor are known.
struct PosedPair {
    view: usize,
    poses: Vec<RelativePose>,
    /// Sum over matches of how far they are moved relative to a rotation alone.
    parallax: f64,
}

/// An anchor and the pairs with most parallax.
pub(crate) struct Candidate<'a> {
    matches: AnchorMatches<'a>,
    /// Positions of the views; the anchor first.
    views: Vec<usize>,
    pairs: Vec<PosedPair>,
}

/// A model of the views around an anchor.
pub(super) struct Start<'a> {
    pub(super) matches: AnchorMatches<'a>,
    /// Positions of the views of the model; the anchor first.
    pub(super) views: Vec<usize>,
    pub(super) model: LocalModel,
    /// Sum over points of their parallax relative to a full one.
    pub(super) quality: f64,
    /// Cost of the best clearly different model relative to that of this one.
    pub(super) margin: f64,
    /// Share of the observations that agree.
    pub(super) explained: f64,
}

impl Start<'_> {
    /// What a map that begins with this is expected to be worth.
    pub(super) fn worth(&self) -> f64 {
        self.quality * self.explained * (self.margin - 1.0).clamp(0.01, FULL_MARGIN)
    }

    /// Whether no further views are needed to believe it.
    pub(super) fn is_clear(&self) -> bool {
        self.quality >= CLEAR_QUALITY
            && self.explained >= CLEAR_EXPLAINED
            && self.margin >= 1.0 + FULL_MARGIN
    }
}

impl<'a> Candidate<'a> {
    /// Matches of an anchor with the views around it, and poses of the pairs with most parallax, or of one given pair.
    pub(crate) fn new(
        camera: &'a Pinhole,
        views: &[&'a FrameFeatures],
        anchor: usize,
        second: Option<usize>,
    ) -> Self {
        let mut others: Vec<usize> = DISTANCES
            .iter()
            .flat_map(|distance| [anchor.checked_sub(*distance), Some(anchor + distance)])
            .flatten()
            .chain(second)
            .filter(|at| *at < views.len())
            .collect();
        others.sort_unstable();
        others.dedup();
        let of_others: Vec<&FrameFeatures> = others.iter().map(|at| views[*at]).collect();
        let (matches, kept) = AnchorMatches::new(camera, views[anchor], &of_others);
        let mut numbers = vec![anchor];
        numbers.extend(kept.iter().map(|at| others[*at]));
        let mut pairs: Vec<PosedPair> = (1..numbers.len())
            .filter(|view| second.is_none_or(|second| numbers[*view] == second))
            .filter_map(|view| posed_pair(camera, &matches, &numbers, view))
            .collect();
        pairs.sort_by(|a, b| b.parallax.total_cmp(&a.parallax));
        pairs.truncate(MAX_PAIRS);
        Self {
            matches,
            views: numbers,
            pairs,
        }
    }

    pub(super) fn parallax(&self) -> f64 {
        self.pairs.iter().map(|pair| pair.parallax).sum()
    }

    /// Positions of the views; the anchor first.
    pub(crate) fn views(&self) -> &[usize] {
        &self.views
    }

    /// Clearly different models, the one that explains most first.
    fn models(&self) -> Vec<LocalModel> {
        let mut drafts: Vec<LocalModel> = self
            .pairs
            .iter()
            .flat_map(|pair| pair.poses.iter().map(|pose| (pair.view, pose)))
            .map(|(view, pose)| self.matches.draft(view, &pose.second_from_first))
            .collect();
        drafts.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut models: Vec<LocalModel> = Vec::new();
        for draft in drafts {
            let is_new = models
                .iter()
                .all(|other| difference(other, &draft).is_clear());
            if is_new && models.len() < MAX_MODELS {
                models.push(draft);
            }
        }
        for model in &mut models {
            self.matches.refine(model);
        }
        models.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        models
    }

    /// Cost of a model relative to that of the best one. Outliers cost the same in all models and do not count.
    fn relative_cost(&self, cost: f64, best: &LocalModel) -> f64 {
        let outliers = (self.matches.observations() - best.inliers) as f64;
        (cost - outliers) / (best.cost - outliers).max(1.0)
    }

    /// Relative cost of the first model that is clearly different from the best one.
    fn margin(&self, models: &[LocalModel], best: &LocalModel) -> f64 {
        let rival = models
            .iter()
            .find(|other| difference(best, other).is_clear());
        rival.map_or(f64::INFINITY, |rival| self.relative_cost(rival.cost, best))
    }

    /// The model that explains most, and how far clearly different ones are from that.
    pub(super) fn solve(self) -> Option<Start<'a>> {
        let models = self.models();
        let mut model = models.first()?.clone();
        let margin = self.margin(&models, &model);
        let Self { matches, views, .. } = self;
        let explained = model.inliers as f64 / matches.observations() as f64;
        matches.complete(&mut model);
        let parallaxes: Vec<f64> = (0..model.points.len())
            .map(|at| matches.parallax_degrees(&model, at))
            .filter(|parallax| *parallax >= MIN_PARALLAX_DEGREES)
            .collect();
        if parallaxes.len() < MIN_POINTS {
            return None;
        }
        let quality = parallaxes
            .iter()
            .map(|parallax| (parallax / FULL_PARALLAX_DEGREES).min(1.0))
            .sum();
        Some(Start {
            matches,
            views,
            model,
            quality,
            margin,
            explained,
        })
    }

    /// Compares known poses of the views, relative to the anchor, with the model that explains most; `None` when no two views
    /// give a model.
    pub(crate) fn compare(&self, known: Vec<Option<Isometry3<f64>>>) -> Option<Comparison> {
        let mut models = self.models();
        if models.is_empty() {
            return None;
        }
        let known = self.matches.with_poses(known);
        let mut refined = known.clone();
        self.matches.refine(&mut refined);
        let is_near = !difference(&known, &refined).is_clear();
        let cost_of_known = if is_near { refined.cost } else { known.cost };
        models.push(refined);
        models.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = models[0].clone();
        Some(Comparison {
            difference: difference(&best, &known),
            relative_cost: self.relative_cost(cost_of_known, &best),
            margin: self.margin(&models, &best),
            explained: best.inliers as f64 / self.matches.observations().max(1) as f64,
        })
    }
}

/// The poses of a view relative to the anchor; `None` when its matches are few, disagree, or are explained by a rotation alone.
fn posed_pair(
    camera: &Pinhole,
    matches: &AnchorMatches<'_>,
    numbers: &[usize],
    view: usize,
) -> Option<PosedPair> {
    let rays: Vec<RayMatch> = matches.pairs[view]
        .iter()
        .map(|(a, b)| ray_match(camera, matches, [(0, *a as u32), (view, *b as u32)]))
        .collect();
    let seed = ((numbers[0] as u64) << 32) | numbers[view] as u64;
    let rotation = rotation_alone(&rays, &mut ChaCha8Rng::seed_from_u64(seed))?;
    let moved: Vec<f64> = rays
        .iter()
        .map(|one| moved_sigmas(one, &rotation.best))
        .collect();
    // The search for a translation takes most of the time, and a camera that stands still has none.
    let is_moved = |at: &usize| moved[*at] >= MIN_MOVED;
    let moved_rays: Vec<RayMatch> = (0..rays.len())
        .filter(is_moved)
        .map(|at| rays[at])
        .collect();
    if moved_rays.len() < MIN_POINTS_MOVED {
        return None;
    }
    let are_few = (moved_rays.len() as f64) < FEW_MOVED * rays.len() as f64;
    if are_few && !may_share_translation(&moved_rays, &rotation, MIN_POINTS_MOVED) {
        return None;
    }
    let poses = relative_poses(&rays, &rotation);
    let share = poses.first()?.inliers as f64 / rays.len() as f64;
    let is_determined = poses.iter().any(|pose| {
        let points = points_moved(camera, matches, view, pose, &rotation.best);
        points >= MIN_POINTS_MOVED
    });
    if share < MIN_AGREEING || !is_determined {
        return None;
    }
    let sum: f64 = moved
        .iter()
        .map(|moved| (moved / FULL_MOVED).min(1.0))
        .sum();
    Some(PosedPair {
        view,
        poses,
        parallax: share * sum,
    })
}

/// Number of points of a pair that have parallax and are not where a rotation alone would move them.
fn points_moved(
    camera: &Pinhole,
    matches: &AnchorMatches<'_>,
    view: usize,
    pose: &RelativePose,
    rotation_alone: &UnitQuaternion<f64>,
) -> usize {
    let mut poses = vec![None; matches.pairs.len()];
    poses[0] = Some(Isometry3::identity());
    poses[view] = Some(pose.second_from_first);
    let model = matches.with_poses(poses);
    let is_moved = |at: usize| {
        let track = matches.track(at);
        let seen = track[1..].iter().find(|(other, _)| *other == view);
        seen.is_some_and(|seen| {
            let rays = ray_match(camera, matches, [track[0], *seen]);
            moved_sigmas(&rays, rotation_alone) >= MIN_MOVED
        })
    };
    (0..model.points.len())
        .filter(|at| matches.parallax_degrees(&model, *at) >= MIN_PARALLAX_DEGREES && is_moved(*at))
        .count()
}

/// Rays of two observations of a feature.
fn ray_match(camera: &Pinhole, matches: &AnchorMatches<'_>, seen: [(usize, u32); 2]) -> RayMatch {
    let measured = seen.map(|seen| matches.measurement(seen));
    let [first, second] = measured.map(|one| camera.ray(&one.pixel));
    RayMatch {
        first,
        second,
        sigma: measured[0].sigma_px.max(measured[1].sigma_px) / camera.fx,
    }
}

/// How the cameras of two models differ, in median over those of both.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Difference {
    /// Angle between orientations.
    pub(crate) turn_degrees: f64,
    /// Angle between directions from the anchor.
    pub(crate) direction_degrees: f64,
}

impl Difference {
    fn is_clear(&self) -> bool {
        self.turn_degrees > DISTINCT_DEGREES || self.direction_degrees > DISTINCT_DIRECTION_DEGREES
    }
}

/// Known poses against the model that explains the matches best.
#[derive(Debug)]
pub(crate) struct Comparison {
    pub(crate) difference: Difference,
    /// Cost of the known poses relative to that of the model.
    pub(crate) relative_cost: f64,
    /// Cost of the best clearly different model relative to that of this one.
    pub(crate) margin: f64,
    /// Share of the observations that agree with the model.
    pub(crate) explained: f64,
}

fn difference(a: &LocalModel, b: &LocalModel) -> Difference {
    let (mut turns, mut angles) = (Vec::new(), Vec::new());
    for (one, other) in a.poses.iter().zip(&b.poses).skip(1) {
        if let (Some(one), Some(other)) = (one, other) {
            turns.push(one.rotation.angle_to(&other.rotation).to_degrees());
            let [one, other] = [one, other].map(|pose| pose.inverse().translation.vector);
            angles.push(one.angle(&other).to_degrees());
        }
    }
    Difference {
        turn_degrees: upper_median(&mut turns, f64::total_cmp).unwrap_or(0.0),
        direction_degrees: upper_median(&mut angles, f64::total_cmp).unwrap_or(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameDetector;
    use crate::options::TrackingOptions;
    use linecarve_lines::camera::Camera;
    use linecarve_points::{Descriptor, Features};
    use nalgebra::{Point3, Vector3};
    use rand::RngExt;

    fn camera() -> Pinhole {
        let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
        Pinhole::new(&camera, 640, 480)
    }

    /// Poses of cameras that move along an arc, and their images of points on a slanted wall; noise of half a pixel.
    fn arc(count: usize) -> (Vec<Isometry3<f64>>, Vec<FrameFeatures>) {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let points: Vec<(Point3<f64>, Descriptor)> = (0..600)
            .map(|_| {
                let (x, y) = (
                    random.random_range(-2.0..2.0),
                    random.random_range(-1.5..1.5),
                );
                let point = Point3::new(x, y, 2.5 + 0.4 * x);
                (point, Descriptor([(); 4].map(|()| random.random())))
            })
            .collect();
        let poses: Vec<Isometry3<f64>> = (0..count)
            .map(|at| {
                let along = 0.06 * at as f64;
                Isometry3::new(
                    Vector3::new(-along, 0.15 * along * along, 0.1 * along),
                    Vector3::new(0.02 * along, -0.1 * along, 0.0),
                )
            })
            .collect();
        let camera = camera();
        let detector = FrameDetector::new(&TrackingOptions::monocular());
        let views = poses
            .iter()
            .map(|pose| {
                let mut features = Features::default();
                for (point, descriptor) in &points {
                    if let Some(pixel) = camera.project_inside(&(pose * point)) {
                        let mut noise = || random.random_range(-0.8..0.8);
                        features
                            .pixels
                            .push([(pixel.x + noise()) as f32, (pixel.y + noise()) as f32]);
                        features.octaves.push(0);
                        features.angles_rad.push(0.0);
                        features.descriptors.push(*descriptor);
                        features.grey.push(0);
                    }
                }
                let unknown = vec![None; features.len()];
                detector.with_depths(features, unknown)
            })
            .collect();
        (poses, views)
    }

    #[test]
    fn of_the_two_solutions_of_a_plane_further_views_leave_one() {
        let (truth, views) = arc(12);
        let views: Vec<&FrameFeatures> = views.iter().collect();
        let camera = camera();
        let candidate = Candidate::new(&camera, &views, 2, None);
        assert!(candidate.pairs.iter().any(|pair| pair.poses.len() > 1));
        let known: Vec<Option<Isometry3<f64>>> = candidate
            .views()
            .iter()
            .map(|at| Some(truth[*at] * truth[2].inverse()))
            .collect();
        let right = candidate.compare(known).unwrap();
        assert!(!right.difference.is_clear() && right.relative_cost < 1.1);
        assert!(right.margin > 1.5 && right.explained > 0.85, "{right:?}");

        // A map that grew from the other solution.
        let models = candidate.models();
        let wrong = models
            .iter()
            .find(|other| difference(&models[0], other).is_clear())
            .unwrap();
        let wrong = candidate.compare(wrong.poses.clone()).unwrap();
        assert!(
            wrong.difference.is_clear() && wrong.relative_cost > 1.5,
            "{wrong:?}"
        );

        let start = candidate.solve().unwrap();
        for (view, pose) in start.views.iter().zip(&start.model.poses).skip(1) {
            let expected = truth[*view] * truth[2].inverse();
            let angle = pose.unwrap().rotation.angle_to(&expected.rotation);
            assert!(angle < 0.02, "{view}: {angle}");
        }
    }
}
