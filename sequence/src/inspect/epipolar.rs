//! Do corners that look alike lie where the poses say? And would they under another reading of the poses?
//!
//! This needs no depth: a corner seen in one image must lie on its epipolar line in another. The distance to that line is
//! the measure. It is blind to the scale of the poses.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::image_samples::ImageSamples;
use super::pose_hypotheses::{PoseHypothesis, pose_hypotheses, simplest_of_best};
use super::{corners, quantile};
use crate::Sequence;

/// Pairs whose corners move by less than this share of the image width say nothing: there every reading fits.
const MIN_MOTION: f64 = 0.01;

/// A pair with fewer matches is passed over.
const MIN_PAIR_MATCHES: usize = 20;

/// Below this many matches in all, nothing is said.
const MIN_MATCHES: usize = 60;

/// Another reading is suspected when its median distance is below this share of that as read.
const CLEARLY_BETTER: f64 = 0.5;

/// As read, a median below this share of the image width is not suspected, whatever fits even better.
const GOOD: f64 = 0.003;

/// A median beyond this share of the width cannot be triangulated from, even when no other reading is better.
const BAD: f64 = 0.006;

/// How well corners that look alike lie on each other's epipolar lines.
#[derive(Debug, Clone, Serialize)]
pub struct EpipolarFacts {
    /// How many pairs of images had enough matches and motion.
    pub pairs: usize,
    /// How many matches.
    pub matches: usize,
    /// Under the poses as read.
    pub as_read: EpipolarHypothesis,
    /// Under other readings, the best first.
    pub others: Vec<EpipolarHypothesis>,
    /// Width of the images in pixels.
    width: usize,
}

/// Distances to epipolar lines under one reading of the poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpipolarHypothesis {
    /// The reading, in words.
    pub reading: String,
    /// Median distance in pixels.
    pub median_px: f64,
    /// Share of the matches within 2 px.
    pub share_within_2_px: f64,
    /// What in a sidecar makes the sequence be read so; `None` as read.
    pub remedy: Option<String>,
    /// In how many things the reading differs from the files as read.
    pub differences: usize,
}

impl EpipolarFacts {
    /// A warning when another reading fits much better, or none fits.
    pub(super) fn warning(&self) -> Option<String> {
        let width = self.width as f64;
        if self.as_read.median_px < GOOD * width {
            return None;
        }
        let poor = format!(
            "matching corners lie {:.1} px (median of {} in {} pairs) from where the poses put them",
            self.as_read.median_px, self.matches, self.pairs
        );
        let best = simplest_of_best(&self.others, |other| (other.median_px, other.differences))?;
        if best.median_px < CLEARLY_BETTER * self.as_read.median_px {
            let remedy = best.remedy.as_ref().map_or_else(String::new, |remedy| {
                format!(" (in linecarve.toml: {remedy})")
            });
            let rest = if best.median_px > GOOD * width {
                "; that is still too far: the poses themselves are off"
            } else {
                ""
            };
            return Some(format!(
                "{poor}, but {:.1} px with {}: check the convention of the files{remedy}{rest}",
                best.median_px, best.reading
            ));
        }
        (self.as_read.median_px > BAD * width).then(|| {
            format!(
                "{poor}, and no other reading is much better: check intrinsics, the clock of the poses, and the poses \
                 themselves"
            )
        })
    }
}

/// Compares pairs of images; `None` when there is too little to compare.
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
            // A reading that leaves most matches without a line has proven nothing.
            if 2 * distances.len() < matches {
                return None;
            }
            Some(EpipolarHypothesis {
                reading: hypothesis.words,
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

/// Distance in pixels of `q` from the epipolar line of `p`, and of `p` from that of `q`, whichever is larger; `None` when
/// a line does not exist, as between cameras at one place.
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
    // The line of p in image b holds the epipole t and the image of the direction of p.
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
    fn points_lie_on_their_lines_and_moved_ones_do_not() {
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
