//! Test of epipolar consistency: distances of matched corners to their epipolar lines, under the poses as read and
//! alternatives. It needs no depth, and does not depend on the scale of the poses.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::consistency::one_pose;
use super::image_samples::{CornerPair, ImageSamples};
use super::intrinsics_hypotheses::{FOCAL_STEP, description, focal_hypotheses, refined, section};
use super::pose_hypotheses::{PoseHypothesis, axes_hypotheses, pose_hypotheses, simplest_of_best};
use super::{corners, quantile, remedy_text};
use crate::Sequence;

/// Smallest median corner motion of a pair, as a share of the image width: with less motion every convention fits.
const MIN_MOTION: f64 = 0.01;

/// Smallest number of matches of a pair.
const MIN_PAIR_MATCHES: usize = 20;

/// Smallest number of matches in all pairs.
const MIN_MATCHES: usize = 60;

/// An alternative is reported if its median distance is below this share of that as read.
const CLEARLY_BETTER: f64 = 0.5;

/// A median as read below this share of the image width is accepted without comparison.
const GOOD: f64 = 0.003;

/// A median above this share of the width is reported even if no alternative is better: poses are too poor to
/// triangulate.
const BAD: f64 = 0.006;

/// A median above this share of the width is no inaccuracy: other poses, images or intrinsics. Tuned on rendered rooms.
const UNUSABLE: f64 = 0.04;

/// Changes of the focal length up to this share are corrected from the images, where depth comes from them.
const CORRECTED_FOCAL: f64 = 0.08;

/// Distances of matched corners to their epipolar lines.
#[derive(Debug, Clone, Serialize)]
pub struct EpipolarFacts {
    /// Number of image pairs with enough matches and motion.
    pub pairs: usize,
    /// Number of matches.
    pub matches: usize,
    /// Distances under the convention as read.
    pub as_read: EpipolarHypothesis,
    /// Distances under alternatives, best first.
    pub others: Vec<EpipolarHypothesis>,
    /// Image width in pixels.
    width: usize,
}

/// Distances to epipolar lines under one pose convention.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpipolarHypothesis {
    /// Description of the convention.
    pub reading: String,
    /// Median distance in pixels.
    pub median_px: f64,
    /// Share of the matches within 2 px.
    pub share_within_2_px: f64,
    /// The sidecar entry that selects this convention; `None` as read.
    pub remedy: Option<String>,
    /// Number of differences from the convention as read.
    pub differences: usize,
}

impl EpipolarFacts {
    /// The simplest of the best alternatives, if it fits much better than as read.
    fn better(&self) -> Option<&EpipolarHypothesis> {
        if self.as_read.median_px < GOOD * self.width as f64 {
            return None;
        }
        simplest_of_best(&self.others, |other| (other.median_px, other.differences))
            .filter(|best| best.median_px < CLEARLY_BETTER * self.as_read.median_px)
    }

    /// How far corners are off as read.
    fn poor(&self) -> String {
        format!(
            "matched corners lie {:.1} px from their epipolar lines (median of {} in {} pairs)",
            self.as_read.median_px, self.matches, self.pairs
        )
    }

    /// Says that an alternative fits better, with its remedy.
    fn said_of(&self, best: &EpipolarHypothesis) -> String {
        let remedy = remedy_text(best.remedy.as_deref());
        let rest = if best.median_px > GOOD * self.width as f64 {
            "; this is still too far: the poses themselves are inaccurate"
        } else {
            ""
        };
        format!(
            "{}, but {:.1} px with {}: check the pose convention and the intrinsics{rest}{remedy}",
            self.poor(),
            best.median_px,
            best.reading
        )
    }

    /// A warning if an alternative fits much better, or no convention fits.
    pub(super) fn warning(&self) -> Option<String> {
        let better = self.better().map(|best| self.said_of(best));
        better.or_else(|| {
            (self.as_read.median_px > BAD * self.width as f64).then(|| {
                format!(
                    "{}, and no other pose convention is much better: check intrinsics, time stamps and poses",
                    self.poor()
                )
            })
        })
    }
}

/// What the matched corners of a few pairs of images say about the poses as read.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CornerVerdict {
    /// They fit.
    Fits,
    /// The simplest of the best alternatives, in words.
    Contradicts(String),
    /// They do not fit, and nothing else is much better.
    Poor {
        /// How far corners are off, in words.
        text: String,
        /// The same as a share of the width of the image.
        share: f64,
    },
}

impl CornerVerdict {
    /// Whether corners are so far off that poses are too poor to triangulate.
    pub(super) fn is_bad(&self) -> bool {
        matches!(self, Self::Poor { share, .. } if *share > BAD)
    }
}

/// Compares a few pairs of images. Alternatives are only tried if the poses as read do not fit.
///
/// `None` if there are too few matches to tell.
pub(super) fn verdict(sequence: &Sequence, pairs: &[CornerPair<'_>]) -> Option<CornerVerdict> {
    let matched = Matched::of(sequence, pairs)?;
    if matched.fits_as_read() {
        return Some(CornerVerdict::Fits);
    }
    let facts = matched.facts()?;
    let contradiction = contradiction_of(sequence, &facts).map(CornerVerdict::Contradicts);
    Some(contradiction.unwrap_or_else(|| CornerVerdict::Poor {
        text: facts.poor(),
        share: facts.as_read.median_px / facts.width as f64,
    }))
}

fn contradiction_of(sequence: &Sequence, facts: &EpipolarFacts) -> Option<String> {
    // What does not fit either proves no other convention: the poses are inaccurate.
    let share = |median_px: f64| median_px / facts.width as f64;
    if let Some(best) = facts.better().filter(|best| share(best.median_px) < BAD) {
        return Some(facts.said_of(best));
    }
    let off = facts.as_read.median_px;
    let moves = format!("corners move by {off:.1} px");
    let one_pose = one_pose(sequence, &moves).filter(|_| share(off) > BAD);
    one_pose.or_else(|| {
        (share(off) > UNUSABLE).then(|| {
            format!(
                "{}, and no other pose convention or focal length explains it: check that poses and intrinsics belong to these images",
                facts.poor()
            )
        })
    })
}

/// Whether matched corners fit the poses as read; `None` if there are too few matches.
pub(super) fn fits(sequence: &Sequence, pairs: &[CornerPair<'_>]) -> Option<bool> {
    Some(Matched::of(sequence, pairs)?.fits_as_read())
}

/// Compares matched corners of image pairs; `None` if there are too few matches.
pub(super) fn measure(sequence: &Sequence, image_samples: &ImageSamples) -> Option<EpipolarFacts> {
    Matched::of(sequence, &image_samples.pairs())?.facts()
}

/// Median distance of matched corners to their epipolar lines, of poses given by frame; `None` if there are too few matches.
pub(super) fn median_of_poses(
    sequence: &Sequence,
    pairs: &[CornerPair<'_>],
    pose: impl Fn(usize) -> Option<Isometry3<f64>>,
) -> Option<f64> {
    let matched = Matched::of(sequence, pairs)?;
    let b_from_a = |[a, b]: [usize; 2]| Some(pose(b)?.inverse() * pose(a)?);
    matched
        .median(sequence.color_camera(), b_from_a)
        .map(|found| found.0)
}

/// Pairs of images with enough matches and motion.
struct Matched<'a> {
    sequence: &'a Sequence,
    /// The frames of each pair, and the matching pixels.
    pairs: Vec<([usize; 2], Vec<Match>)>,
    matches: usize,
}

/// A pixel of either image.
type Match = ([f64; 2], [f64; 2]);

impl<'a> Matched<'a> {
    fn of(sequence: &'a Sequence, pairs: &[CornerPair<'_>]) -> Option<Self> {
        let width = f64::from(sequence.color_size().width);
        let pairs: Vec<([usize; 2], Vec<Match>)> = pairs
            .par_iter()
            .filter_map(|pair| {
                let found = corners::matches(pair.corners[0], pair.corners[1]);
                if found.len() < MIN_PAIR_MATCHES {
                    return None;
                }
                let mut motions: Vec<f64> = found
                    .iter()
                    .map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]))
                    .collect();
                let median = quantile(&mut motions, 0.5)?;
                (median >= MIN_MOTION * width).then_some((pair.frames, found))
            })
            .collect();
        let matches: usize = pairs.iter().map(|pair| pair.1.len()).sum();
        (matches >= MIN_MATCHES).then_some(Self {
            sequence,
            pairs,
            matches,
        })
    }

    /// Median distance, and the share within 2 px. `None` if most matches have no line, which proves nothing.
    fn median(
        &self,
        camera: &Camera,
        b_from_a: impl Fn([usize; 2]) -> Option<Isometry3<f64>>,
    ) -> Option<(f64, f64)> {
        let mut distances: Vec<f64> = Vec::with_capacity(self.matches);
        for (frames, matches) in &self.pairs {
            let Some(motion) = b_from_a(*frames) else {
                continue;
            };
            let found = matches
                .iter()
                .filter_map(|(p, q)| distance(camera, &motion, *p, *q));
            distances.extend(found);
        }
        if 2 * distances.len() < self.matches {
            return None;
        }
        let near = distances.iter().filter(|d| **d < 2.0).count();
        let share = near as f64 / distances.len() as f64;
        Some((quantile(&mut distances, 0.5)?, share))
    }

    fn hypothesis(&self, poses: &PoseHypothesis, camera: &Camera) -> Option<EpipolarHypothesis> {
        let motion = |frames| poses.b_from_a(self.sequence, frames);
        let (median_px, share_within_2_px) = self.median(camera, motion)?;
        Some(EpipolarHypothesis {
            reading: poses.description.clone(),
            median_px,
            share_within_2_px,
            remedy: poses.remedy.clone(),
            differences: poses.differences,
        })
    }

    /// Whether most matches lie in front of both cameras.
    fn is_in_front(&self, poses: &PoseHypothesis, camera: &Camera) -> bool {
        let in_front = |(frames, matches): &([usize; 2], Vec<Match>)| {
            let motion = poses.b_from_a(self.sequence, *frames)?;
            let is_seen =
                |(p, q): &&Match| depths(camera, &motion, *p, *q).iter().all(|z| *z > 0.0);
            Some(matches.iter().filter(is_seen).count())
        };
        let count: usize = self.pairs.iter().filter_map(in_front).sum();
        2 * count > self.matches
    }

    fn as_read(&self) -> Option<EpipolarHypothesis> {
        let poses = PoseHypothesis::as_read(self.sequence);
        self.hypothesis(&poses, self.sequence.color_camera())
    }

    fn fits_as_read(&self) -> bool {
        let good = GOOD * f64::from(self.sequence.color_size().width);
        self.as_read()
            .is_some_and(|as_read| as_read.median_px < good)
    }

    /// The distances as read and under all alternatives.
    fn facts(&self) -> Option<EpipolarFacts> {
        let camera = self.sequence.color_camera();
        let as_read = self.as_read()?;
        let mut others: Vec<EpipolarHypothesis> = pose_hypotheses(self.sequence)
            .par_iter()
            .filter(|poses| poses.differences > 0)
            .filter_map(|poses| self.hypothesis(poses, camera))
            .collect();
        if !self.fits_as_read() {
            others.extend(self.best_focal(camera));
            let bad = BAD * f64::from(self.sequence.color_size().width);
            if others.iter().all(|other| other.median_px > bad) {
                let axes = axes_hypotheses(self.sequence);
                // Distances to lines do not change when all axes are reversed.
                let of_axes = axes
                    .par_iter()
                    .filter(|poses| self.is_in_front(poses, camera))
                    .filter_map(|poses| self.hypothesis(poses, camera));
                others.extend(of_axes.collect::<Vec<_>>());
            }
        }
        others.sort_by(|a, b| a.median_px.total_cmp(&b.median_px));
        Some(EpipolarFacts {
            pairs: self.pairs.len(),
            matches: self.matches,
            as_read,
            others,
            width: self.sequence.color_size().width as usize,
        })
    }

    /// The focal length that fits best.
    fn best_focal(&self, camera: &Camera) -> Option<EpipolarHypothesis> {
        let poses = PoseHypothesis::as_read(self.sequence);
        let size = self.sequence.color_size();
        let best = |cameras: Vec<Camera>| {
            cameras
                .into_par_iter()
                .filter_map(|camera| Some((self.hypothesis(&poses, &camera)?, camera)))
                .collect::<Vec<_>>()
                .into_iter()
                .min_by(|a, b| a.0.median_px.total_cmp(&b.0.median_px))
        };
        let (_, coarse) = best(focal_hypotheses(camera, [size.width, size.height]))?;
        let (fit, found) = best(refined(&coarse, FOCAL_STEP))?;
        let change = found.mean_focal_px() / camera.mean_focal_px();
        if (change - 1.0).abs() < CORRECTED_FOCAL {
            return None;
        }
        let stored = self.sequence.stored_color_camera();
        Some(EpipolarHypothesis {
            reading: description(camera, &found),
            remedy: Some(section("color", &found, camera, stored)),
            differences: 1,
            ..fit
        })
    }
}

/// The larger of the distances, in pixels, of `q` to the epipolar line of `p` and of `p` to that of `q`. Without translation the line is a
/// point, that of the direction of `p`. `None` if that lies behind the camera.
fn distance(camera: &Camera, b_from_a: &Isometry3<f64>, p: [f64; 2], q: [f64; 2]) -> Option<f64> {
    let (a, b) = (ray(camera, p), ray(camera, q));
    let t = b_from_a.translation.vector;
    let length = t.norm();
    if length == 0.0 {
        let seen = b_from_a.rotation * a;
        let off = [
            camera.fx() * (seen.x / seen.z - b.x),
            camera.fy() * (seen.y / seen.z - b.y),
        ];
        return (seen.z > 0.0).then(|| off[0].hypot(off[1]));
    }
    // The line of p in image b joins the epipole t and the image of the direction of p.
    let line_in_b = t.cross(&(b_from_a.rotation * a)) / length;
    // q lies on it where b . (t x R a) = 0, and so p on the line of q, (t x R)^T b.
    let line_in_a = b_from_a.rotation.inverse() * b.cross(&t) / length;
    let residual = b.dot(&line_in_b).abs();
    let slope = |line: &Vector3<f64>| (line.x / camera.fx()).hypot(line.y / camera.fy());
    let distance = residual / slope(&line_in_b).min(slope(&line_in_a));
    distance.is_finite().then_some(distance)
}

/// The depths of the point that two pixels see, in both images.
fn depths(camera: &Camera, b_from_a: &Isometry3<f64>, p: [f64; 2], q: [f64; 2]) -> [f64; 2] {
    let (a, b) = (b_from_a.rotation * ray(camera, p), ray(camera, q));
    let t = b_from_a.translation.vector;
    // From za a + t = zb b: the cross product with b, and with a.
    let across = a.cross(&b);
    let square = across.norm_squared();
    [
        b.cross(&t).dot(&across) / square,
        a.cross(&t).dot(&across) / square,
    ]
}

/// The ray of a pixel, at depth 1.
fn ray(camera: &Camera, pixel: [f64; 2]) -> Vector3<f64> {
    Vector3::new(
        (pixel[0] - camera.cx()) / camera.fx(),
        (pixel[1] - camera.cy()) / camera.fy(),
        1.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point2, Point3, Translation3, UnitQuaternion};

    #[test]
    fn projections_lie_on_their_epipolar_lines() {
        let camera = Camera::pinhole(500.0, 510.0, 320.0, 240.0).unwrap();
        let b_from_a = Isometry3::from_parts(
            Translation3::new(-0.4, 0.05, 0.1),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.05, -0.1, 0.2)),
        );
        for point in [Point3::new(0.3, -0.2, 3.0), Point3::new(-1.0, 0.5, 2.0)] {
            let pixel = |p: &Point3<f64>| {
                let Point2 { coords } = camera.project(p).unwrap();
                [coords.x, coords.y]
            };
            let (p, q) = (pixel(&point), pixel(&(b_from_a * point)));
            assert!(distance(&camera, &b_from_a, p, q).unwrap() < 1e-9);
            let off = distance(&camera, &b_from_a, p, [q[0], q[1] + 5.0]).unwrap();
            assert!((2.0..12.0).contains(&off), "{off}");
            let [in_a, in_b] = depths(&camera, &b_from_a, p, q);
            assert!((in_a - point.z).abs() < 1e-9 && (in_b - (b_from_a * point).z).abs() < 1e-9);
        }
        let turned = Isometry3::from_parts(Translation3::identity(), b_from_a.rotation);
        let pixel = |p: &Point3<f64>| camera.project(p).unwrap();
        let point = Point3::new(0.3, -0.2, 3.0);
        let (p, q) = (pixel(&point), pixel(&(turned * point)));
        let of = |q: [f64; 2]| distance(&camera, &turned, [p.x, p.y], q).unwrap();
        assert!(of([q.x, q.y]) < 1e-9);
        assert!((of([q.x + 3.0, q.y - 4.0]) - 5.0).abs() < 1e-9);
        // Seen from behind.
        let back = Isometry3::rotation(Vector3::new(0.0, 3.0, 0.0));
        assert_eq!(distance(&camera, &back, [p.x, p.y], [q.x, q.y]), None);
    }
}
