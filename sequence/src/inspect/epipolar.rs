//! Test of epipolar consistency: distances of matched corners to their epipolar lines, under the poses as read and
//! alternatives. It needs no depth, and does not depend on the scale of the poses.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::image_samples::ImageSamples;
use super::pose_hypotheses::{PoseHypothesis, pose_hypotheses, simplest_of_best};
use super::{corners, quantile};
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
    /// A warning if an alternative fits much better, or no convention fits.
    pub(super) fn warning(&self) -> Option<String> {
        let width = self.width as f64;
        if self.as_read.median_px < GOOD * width {
            return None;
        }
        let poor = format!(
            "matched corners lie {:.1} px from their epipolar lines (median of {} in {} pairs)",
            self.as_read.median_px, self.matches, self.pairs
        );
        let best = simplest_of_best(&self.others, |other| (other.median_px, other.differences))?;
        if best.median_px < CLEARLY_BETTER * self.as_read.median_px {
            let remedy = best.remedy.as_ref().map_or_else(String::new, |remedy| {
                format!(" (in linecarve.toml: {remedy})")
            });
            let rest = if best.median_px > GOOD * width {
                "; this is still too far: the poses themselves are inaccurate"
            } else {
                ""
            };
            return Some(format!(
                "{poor}, but {:.1} px with {}: check the pose convention{remedy}{rest}",
                best.median_px, best.reading
            ));
        }
        (self.as_read.median_px > BAD * width).then(|| {
            format!(
                "{poor}, and no other pose convention is much better: check intrinsics, time stamps and poses"
            )
        })
    }
}

/// Compares matched corners of image pairs; `None` if there are too few matches.
pub(super) fn measure(sequence: &Sequence, image_samples: &ImageSamples) -> Option<EpipolarFacts> {
    let width = sequence.color_size().width as usize;
    let hypotheses = pose_hypotheses(sequence);
    let camera = sequence.color_camera();
    let pairs = image_samples.pairs();
    let measured: Vec<Option<(usize, Vec<Vec<f64>>)>> = pairs
        .par_iter()
        .map(|pair| {
            let ([i, j], [a, b]) = (pair.frames, pair.corners);
            let found = corners::matches(a, b);
            if found.len() < MIN_PAIR_MATCHES {
                return None;
            }
            let mut motions: Vec<f64> = found
                .iter()
                .map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]))
                .collect();
            if quantile(&mut motions, 0.5).is_none_or(|median| median < MIN_MOTION * width as f64) {
                return None;
            }
            let distances: Vec<Vec<f64>> = hypotheses
                .iter()
                .map(|hypothesis| {
                    let b_from_a = relative(hypothesis, sequence, i, j);
                    found
                        .iter()
                        .filter_map(|(p, q)| distance(camera, &b_from_a, *p, *q))
                        .collect()
                })
                .collect();
            Some((found.len(), distances))
        })
        .collect();
    let used: Vec<_> = measured.into_iter().flatten().collect();
    let matches: usize = used.iter().map(|pair| pair.0).sum();
    if matches < MIN_MATCHES {
        return None;
    }
    let mut all: Vec<EpipolarHypothesis> = hypotheses
        .into_iter()
        .enumerate()
        .filter_map(|(h, hypothesis)| {
            let mut distances: Vec<f64> = used
                .iter()
                .flat_map(|pair| pair.1[h].iter().copied())
                .collect();
            let near = distances.iter().filter(|d| **d < 2.0).count();
            // A convention that leaves most matches without a line proves nothing.
            if 2 * distances.len() < matches {
                return None;
            }
            Some(EpipolarHypothesis {
                reading: hypothesis.description,
                share_within_2_px: near as f64 / distances.len() as f64,
                median_px: quantile(&mut distances, 0.5)?,
                remedy: hypothesis.remedy,
                differences: hypothesis.differences,
            })
        })
        .collect();
    if all.first().is_none_or(|first| first.remedy.is_some()) {
        return None;
    }
    let as_read = all.remove(0);
    all.sort_by(|a, b| a.median_px.total_cmp(&b.median_px));
    Some(EpipolarFacts {
        pairs: used.len(),
        matches,
        as_read,
        others: all,
        width,
    })
}

fn relative(
    hypothesis: &PoseHypothesis,
    sequence: &Sequence,
    i: usize,
    j: usize,
) -> Isometry3<f64> {
    hypothesis.world_from_color(sequence, j).inverse() * hypothesis.world_from_color(sequence, i)
}

/// The larger of the distances, in pixels, of `q` to the epipolar line of `p` and of `p` to that of `q`; `None` if a line
/// does not exist, as without translation.
fn distance(camera: &Camera, b_from_a: &Isometry3<f64>, p: [f64; 2], q: [f64; 2]) -> Option<f64> {
    let ray = |pixel: [f64; 2]| {
        Vector3::new(
            (pixel[0] - camera.cx()) / camera.fx(),
            (pixel[1] - camera.cy()) / camera.fy(),
            1.0,
        )
    };
    let (a, b) = (ray(p), ray(q));
    let t = b_from_a.translation.vector;
    let length = t.norm();
    if length == 0.0 {
        return None;
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
        }
        let turned = Isometry3::from_parts(Translation3::identity(), b_from_a.rotation);
        assert_eq!(distance(&camera, &turned, [1.0, 2.0], [3.0, 4.0]), None);
    }
}
