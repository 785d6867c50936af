//! Test of depth consistency: depth of one frame against depth of another, under the poses as read and alternatives.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;
use serde::Serialize;

use super::pose_hypotheses::{AS_READ, PoseHypothesis, pose_hypotheses, simplest_of_best};
use super::{evenly_spaced, quantile, skip_unreadable};
use crate::{DepthImage, FrameError, Sequence};

/// Compared pixels across an image; the spacing is the same in both directions.
const SAMPLES_ACROSS: usize = 80;

/// Largest relative difference of depths that agree.
const AGREEMENT: f64 = 0.01;

/// An alternative is reported if its median residual is below this share of that as read. A wrong convention is worse by
/// an order of magnitude; noise and drift change the residual by tenths.
const CLEARLY_BETTER: f64 = 0.5;

/// A median below this share as read is accepted without comparison: over short distances and before flat walls every
/// convention fits.
const GOOD: f64 = 0.01;

/// Common depth scales: millimetres, TUM RGB-D, RealSense L515, and a power of two.
const SCALES: [f64; 4] = [1000.0, 5000.0, 4000.0, 256.0];

/// Depth consistency between frames a fixed gap apart.
#[derive(Debug, Clone, Serialize)]
pub struct DepthConsistency {
    /// Gap in frames.
    pub gap: usize,
    /// Number of compared image pairs.
    pub pairs: usize,
    /// Consistency under the convention as read.
    pub as_read: DepthHypothesis,
    /// Consistency under alternatives, best first.
    pub others: Vec<DepthHypothesis>,
}

/// Depth consistency under one convention.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DepthHypothesis {
    /// Description of the convention.
    pub reading: String,
    /// Number of compared pixels.
    pub pixels: usize,
    /// Median difference between transformed and measured depth, in pose units.
    pub median_difference: f64,
    /// Median relative difference, the measure of fit.
    pub median_relative: f64,
    /// Share of the compared pixels that differ by less than 1 %.
    pub share_within_1_percent: f64,
    /// The sidecar entry that selects this convention; `None` as read.
    pub remedy: Option<String>,
    /// Number of differences from the convention as read.
    pub differences: usize,
}

impl DepthConsistency {
    /// A warning if an alternative fits much better.
    pub(super) fn warning(&self) -> Option<String> {
        let best = simplest_of_best(&self.others, |other| {
            (other.median_relative, other.differences)
        })?;
        if self.as_read.median_relative < GOOD {
            return None;
        }
        // With little overlap a good fit proves nothing.
        let is_comparable = best.pixels * 4 >= self.as_read.pixels;
        (is_comparable && best.median_relative < CLEARLY_BETTER * self.as_read.median_relative).then(|| {
            format!(
                "depth images {} frames apart agree better with {} (median difference {:.2} % of depth) than as read \
                 ({:.2} %): check the pose convention and depth scale{}",
                self.gap,
                best.reading,
                100.0 * best.median_relative,
                100.0 * self.as_read.median_relative,
                best.remedy
                    .as_ref()
                    .map_or_else(String::new, |remedy| format!(" (in linecarve.toml: {remedy})"))
            )
        })
    }
}

/// A convention of poses and depth scale to test.
struct DepthConvention {
    description: String,
    /// The sidecar entry that selects it.
    remedy: Option<String>,
    differences: usize,
    poses: PoseHypothesis,
    /// Factor on depth as read.
    factor: f64,
}

/// The convention as read, then alternative pose conventions, then alternative depth scales.
fn conventions(sequence: &Sequence, scale: f64) -> Vec<DepthConvention> {
    let mut all: Vec<DepthConvention> = pose_hypotheses(sequence)
        .into_iter()
        .map(|poses| DepthConvention {
            description: poses.description.clone(),
            remedy: poses.remedy.clone(),
            differences: poses.differences,
            poses,
            factor: 1.0,
        })
        .collect();
    for other in SCALES
        .into_iter()
        .filter(|other| (other / scale - 1.0).abs() > 1e-3)
    {
        let as_read = pose_hypotheses(sequence).into_iter().next();
        all.extend(as_read.map(|poses| DepthConvention {
            description: format!("a depth scale of {other} instead of {scale}"),
            remedy: Some(format!("[depth] scale = {other:?}")),
            differences: 1,
            poses,
            factor: scale / other,
        }));
    }
    all
}

/// Compares pairs of depth images `gap` frames apart; `None` if no pair is comparable.
pub(super) fn measure(
    sequence: &Sequence,
    gap: usize,
    pairs: usize,
) -> Result<Option<DepthConsistency>, FrameError> {
    let Some(calibration) = sequence.depth_calibration() else {
        return Ok(None);
    };
    let frames = sequence.frames();
    let candidates: Vec<usize> = (0..frames.len().saturating_sub(gap))
        .filter(|&i| gap > 0 && frames[i].depth.is_some() && frames[i + gap].depth.is_some())
        .collect();
    let conventions = conventions(sequence, calibration.scale);
    let measured = evenly_spaced(candidates.len(), pairs)
        .par_iter()
        .map(|&at| {
            let (i, j) = (candidates[at], candidates[at] + gap);
            let (Some(a), Some(b)) = (
                skip_unreadable(sequence.load_depth(i))?.flatten(),
                skip_unreadable(sequence.load_depth(j))?.flatten(),
            ) else {
                return Ok(None);
            };
            let residuals: Vec<_> = conventions
                .iter()
                .map(|convention| {
                    let pose = |index: usize| {
                        convention.poses.world_from_color(sequence, index)
                            * calibration.color_from_depth
                    };
                    let b_from_a = pose(j).inverse() * pose(i);
                    compare(&a, &b, &b_from_a, convention.factor, &calibration.camera)
                })
                .collect();
            Ok(Some(residuals))
        })
        .collect::<Result<Vec<_>, FrameError>>()?;
    let pairs = measured.iter().flatten().count();
    let mut hypotheses: Vec<DepthHypothesis> = conventions
        .into_iter()
        .enumerate()
        .filter_map(|(index, convention)| {
            let all = || {
                measured
                    .iter()
                    .flatten()
                    .flat_map(|residuals| &residuals[index])
            };
            let mut absolute: Vec<f64> = all().map(|residual| residual.0).collect();
            let mut relative: Vec<f64> = all().map(|residual| residual.1).collect();
            let within = relative.iter().filter(|&&value| value < AGREEMENT).count();
            Some(DepthHypothesis {
                reading: convention.description,
                remedy: convention.remedy,
                differences: convention.differences,
                pixels: relative.len(),
                median_difference: quantile(&mut absolute, 0.5)?,
                median_relative: quantile(&mut relative, 0.5)?,
                share_within_1_percent: within as f64 / relative.len() as f64,
            })
        })
        .collect();
    let is_as_read = |hypothesis: &DepthHypothesis| hypothesis.reading == AS_READ;
    let Some(at) = hypotheses.iter().position(is_as_read) else {
        return Ok(None);
    };
    let as_read = hypotheses.remove(at);
    hypotheses.sort_by(|a, b| a.median_relative.total_cmp(&b.median_relative));
    Ok(Some(DepthConsistency {
        gap,
        pairs,
        as_read,
        others: hypotheses,
    }))
}

/// Absolute and relative differences between depth of `a` transformed into `b` and depth of `b`.
fn compare(
    a: &DepthImage,
    b: &DepthImage,
    b_from_a: &Isometry3<f64>,
    factor: f64,
    camera: &Camera,
) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let stride = (a.width() / SAMPLES_ACROSS).max(1);
    for y in (stride / 2..a.height()).step_by(stride) {
        for x in (stride / 2..a.width()).step_by(stride) {
            let Some(&z) = a.get(x, y).filter(|&&z| z > 0.0) else {
                continue;
            };
            let pixel = Point2::new(x as f64, y as f64);
            let Ok(point) = camera.point_at_depth(&pixel, f64::from(z) * factor) else {
                continue;
            };
            let point_in_b = b_from_a * point;
            let Some(seen) = camera.project(&point_in_b) else {
                continue;
            };
            let (u, v) = (seen.x.round(), seen.y.round());
            if u < 0.0 || v < 0.0 {
                continue;
            }
            let Some(&there) = b.get(u as usize, v as usize).filter(|&&z| z > 0.0) else {
                continue;
            };
            let measured = f64::from(there) * factor;
            let difference = (point_in_b.z - measured).abs();
            out.push((difference, difference / measured));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_convention::{CameraAxes, Extrinsics, PoseConvention, PoseDirection};
    use linecarve_lines::image::Plane;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Depth of the inside of a sphere of radius 3 around the world's origin.
    fn depth_at(world_from_camera: &Isometry3<f64>, camera: &Camera) -> DepthImage {
        let samples = (0..80 * 60)
            .map(|i| {
                let pixel = Point2::new(f64::from(i % 80), f64::from(i / 80));
                let ray = camera.point_at_depth(&pixel, 1.0).unwrap().coords;
                let (from, along) = (
                    world_from_camera.translation.vector,
                    world_from_camera.rotation * ray,
                );
                let (a, b, c) = (
                    along.norm_squared(),
                    from.dot(&along),
                    from.norm_squared() - 9.0,
                );
                ((-b + (b * b - a * c).sqrt()) / a) as f32
            })
            .collect();
        Plane::new(80, 60, samples).unwrap()
    }

    #[test]
    fn true_poses_agree_and_wrong_conventions_do_not() {
        let camera = Camera::pinhole(60.0, 60.0, 39.5, 29.5).unwrap();
        let a = Isometry3::from_parts(
            Translation3::new(0.5, 0.2, -0.3),
            UnitQuaternion::from_euler_angles(0.3, 0.5, 0.1),
        );
        let b = Isometry3::from_parts(
            Translation3::new(0.1, -0.2, 0.4),
            UnitQuaternion::from_euler_angles(0.2, 0.4, 0.2),
        );
        let (depth_a, depth_b) = (depth_at(&a, &camera), depth_at(&b, &camera));
        let median = |direction: PoseDirection, axes: CameraAxes, factor: f64| {
            let reading = PoseConvention {
                direction,
                axes,
                ..PoseConvention::default()
            };
            let extrinsics = Extrinsics {
                color_from_depth: None,
                body_from_color: None,
            };
            let pose = |recorded| reading.world_from_color(recorded, &extrinsics);
            let b_from_a = pose(&b).inverse() * pose(&a);
            let residuals = compare(&depth_a, &depth_b, &b_from_a, factor, &camera);
            // A wrong convention may leave no overlap at all.
            if residuals.len() < 10 {
                return f64::INFINITY;
            }
            let mut relative: Vec<f64> = residuals.iter().map(|r| r.1).collect();
            quantile(&mut relative, 0.5).unwrap()
        };
        let (as_read, axes) = (PoseDirection::AsRead, CameraAxes::AsRead);
        let right = median(as_read, axes, 1.0);
        assert!(right < 0.01, "{right}");
        for (direction, axes, factor) in [
            (PoseDirection::Inverse, axes, 1.0),
            (PoseDirection::RotationInverse, axes, 1.0),
            (as_read, CameraAxes::YAndZFlipped, 1.0),
            (PoseDirection::Inverse, CameraAxes::YAndZFlipped, 1.0),
            (as_read, axes, 5.0),
            (as_read, axes, 0.2),
        ] {
            assert!(median(direction, axes, factor) > 2.0 * right);
        }
    }
}
