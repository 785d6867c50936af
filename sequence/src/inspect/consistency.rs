//! Test of depth consistency: depth of one frame against depth of another, under the poses as read and alternatives.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;
use serde::Serialize;

use super::super::depth_values::ray_length;
use super::depth_alternatives::{DepthConvention, alternatives, as_read, search};
use super::pose_hypotheses::simplest_of_best;
use super::{evenly_spaced, quantile, remedy_text, skip_unreadable};
use crate::{DepthCalibration, DepthImage, FrameError, Sequence};

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

/// A median below this share as read is accepted: no sensor measures better, and the smallest fault is larger but where frames hardly move.
const EXACT: f64 = 0.003;

/// With a median as read between both, an alternative is reported below this share of it: noise is the same in both.
const FAR_BETTER: f64 = 0.25;

/// Smallest number of compared pixels of a few pairs that prove something.
const MIN_PIXELS: usize = 300;

/// An alternative that contradicts the files fits at least this well.
const FITS: f64 = 0.05;

/// Depth that disagrees by more than this share is wrong, though no alternative says how: noise and drift are below a tenth, layers of
/// models with a scale of their own about that.
const UNEXPLAINED: f64 = 0.25;

/// Pairs that a search for unknown numbers compares: it keeps them in memory.
const SEARCHED_PAIRS: usize = 4;

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
    /// The pose of a frame is that of the frame so many further.
    #[serde(skip)]
    offset: isize,
}

impl DepthConsistency {
    /// A warning if an alternative fits much better.
    pub(super) fn warning(&self) -> Option<String> {
        let best = better(&self.as_read, &self.others)?;
        Some(format!(
            "depth images {} frames apart {}",
            self.gap,
            agree_better(&self.as_read, best)
        ))
    }
}

/// Says that an alternative fits better, and the remedy.
fn agree_better(as_read: &DepthHypothesis, best: &DepthHypothesis) -> String {
    format!(
        "agree better with {} (median difference {:.2} % of depth) than as read ({:.2} %): check the pose convention and \
         depth scale{}",
        best.reading,
        100.0 * best.median_relative,
        100.0 * as_read.median_relative,
        remedy_text(best.remedy.as_deref())
    )
}

/// The simplest of the best alternatives, if it fits much better than as read.
fn better<'a>(
    as_read: &DepthHypothesis,
    others: &'a [DepthHypothesis],
) -> Option<&'a DepthHypothesis> {
    if as_read.median_relative < GOOD {
        return None;
    }
    // With little overlap a good fit proves nothing.
    let comparable: Vec<&DepthHypothesis> = others
        .iter()
        .filter(|other| other.pixels * 4 >= as_read.pixels)
        .collect();
    simplest_of_best(&comparable, |other| {
        (other.median_relative, other.differences)
    })
    .copied()
    .filter(|best| best.median_relative < CLEARLY_BETTER * as_read.median_relative)
}

/// Compares pairs of depth images `gap` frames apart; `None` if no pair is comparable.
pub(super) fn measure(
    sequence: &Sequence,
    gap: usize,
    pairs: usize,
) -> Result<Option<DepthConsistency>, FrameError> {
    let frames = sequence.frames();
    let candidates: Vec<usize> = (0..frames.len().saturating_sub(gap))
        .filter(|&i| gap > 0 && frames[i].depth.is_some() && frames[i + gap].depth.is_some())
        .collect();
    let pairs: Vec<[usize; 2]> = evenly_spaced(candidates.len(), pairs)
        .into_iter()
        .map(|at| [candidates[at], candidates[at] + gap])
        .collect();
    let Some(calibration) = sequence.depth_calibration() else {
        return Ok(None);
    };
    let mut conventions = vec![as_read(sequence, calibration)];
    conventions.extend(alternatives(sequence, calibration));
    let Some((pairs_compared, as_read, mut others)) =
        measure_pairs(sequence, calibration, &pairs, &conventions)?
    else {
        return Ok(None);
    };
    if as_read.median_relative >= GOOD {
        others.extend(searched(sequence, calibration, &pairs, &others)?);
        others.sort_by(|a, b| a.median_relative.total_cmp(&b.median_relative));
    }
    Ok(Some(DepthConsistency {
        gap,
        pairs: pairs_compared,
        as_read,
        others,
    }))
}

/// What a few pairs of depth images say about the convention as read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum DepthVerdict {
    /// They agree.
    Agrees,
    /// An alternative agrees much better; it is given in words.
    Contradicts(String),
    /// Poses of the frames beside agree much better: either those are wrong, or each depth image is of another frame.
    OfOtherFrame {
        /// What to say if poses do not fit the images.
        poses: String,
        /// What to say if they do.
        depth: String,
    },
    /// They do not tell.
    Unknown,
}

/// Compares a few pairs. Alternatives are only tried if the depth does not agree as read.
pub(super) fn verdict(
    sequence: &Sequence,
    pairs: &[[usize; 2]],
) -> Result<DepthVerdict, FrameError> {
    let Some(calibration) = sequence.depth_calibration() else {
        return Ok(DepthVerdict::Unknown);
    };
    let first = as_read(sequence, calibration);
    let found = measure_pairs(sequence, calibration, pairs, std::slice::from_ref(&first))?;
    // Nothing to compare as read is no agreement: a wrong scale may leave no overlap.
    let found = found.filter(|(_, found, _)| found.pixels >= MIN_PIXELS);
    let misfit = found.map_or(f64::INFINITY, |(_, found, _)| found.median_relative);
    if misfit < EXACT {
        return Ok(DepthVerdict::Agrees);
    }
    let mut conventions = vec![first];
    conventions.extend(alternatives(sequence, calibration));
    let measured = measure_pairs(sequence, calibration, pairs, &conventions)?;
    let Some((_, as_read, mut others)) = measured else {
        return Ok(DepthVerdict::Unknown);
    };
    if misfit < GOOD {
        // Short distances hide much, but not from depth without noise.
        others.retain(|other| other.pixels * 2 >= as_read.pixels);
        let best = simplest_of_best(&others, |other| (other.median_relative, other.differences));
        let best = best.filter(|best| best.median_relative < FAR_BETTER * as_read.median_relative);
        return Ok(best.map_or(DepthVerdict::Agrees, |best| {
            DepthVerdict::Contradicts(format!("depth images {}", agree_better(&as_read, best)))
        }));
    }
    others.extend(searched(sequence, calibration, pairs, &others)?);
    others.retain(|other| other.pixels >= MIN_PIXELS);
    let best = better(&as_read, &others).filter(|best| best.median_relative < FITS);
    let found = best.map(|best| format!("depth images {}", agree_better(&as_read, best)));
    if let (Some(best), Some(poses)) = (best.filter(|best| best.offset != 0), &found) {
        let beside = if best.offset < 0 { "previous" } else { "next" };
        let depth = format!(
            "each depth image belongs to the {beside} image: depth agrees so (median difference {:.2} % of depth), not as read ({:.2} %), \
             and the poses fit the images: give depth images the numbers of their images",
            100.0 * best.median_relative,
            100.0 * as_read.median_relative
        );
        return Ok(DepthVerdict::OfOtherFrame {
            poses: poses.clone(),
            depth,
        });
    }
    Ok(found
        .or_else(|| unexplained(&as_read))
        .map_or(DepthVerdict::Unknown, DepthVerdict::Contradicts))
}

/// Says that depth images disagree by far more than noise and drift, if no alternative explains it.
fn unexplained(as_read: &DepthHypothesis) -> Option<String> {
    let is_wrong = as_read.pixels >= MIN_PIXELS
        && as_read.median_relative.is_finite()
        && as_read.median_relative > UNEXPLAINED;
    is_wrong.then(|| {
        format!(
            "depth images disagree by {:.0} % of depth with one another (median of {} pixels seen from two frames), and no other pose \
             convention, depth scale, focal length or kind of value explains it: check that depth and poses belong to these images",
            100.0 * as_read.median_relative,
            as_read.pixels
        )
    })
}

/// Scales and focal lengths that a search finds.
fn searched(
    sequence: &Sequence,
    calibration: &DepthCalibration,
    pairs: &[[usize; 2]],
    others: &[DepthHypothesis],
) -> Result<Vec<DepthHypothesis>, FrameError> {
    let few: Vec<[usize; 2]> = evenly_spaced(pairs.len(), SEARCHED_PAIRS)
        .into_iter()
        .map(|at| pairs[at])
        .collect();
    let loaded: Vec<DepthPair> = few
        .into_par_iter()
        .map(|frames| DepthPair::load(sequence, frames))
        .collect::<Result<Vec<_>, FrameError>>()?
        .into_iter()
        .flatten()
        .collect();
    let is_explained = others.iter().any(|other| other.median_relative < GOOD);
    let mut conventions = vec![as_read(sequence, calibration)];
    conventions.extend(search(sequence, calibration, &loaded, is_explained));
    let measured = measure_pairs(sequence, calibration, pairs, &conventions)?;
    Ok(measured.map_or_else(Vec::new, |(_, _, others)| others))
}

type Measured = (usize, DepthHypothesis, Vec<DepthHypothesis>);

/// Measures all conventions, of which the first is that as read; the others are sorted, the best first.
fn measure_pairs(
    sequence: &Sequence,
    calibration: &DepthCalibration,
    pairs: &[[usize; 2]],
    conventions: &[DepthConvention],
) -> Result<Option<Measured>, FrameError> {
    let measured = pairs
        .par_iter()
        .map(|&frames| {
            let pair = DepthPair::load(sequence, frames)?;
            Ok(pair.map(|pair| {
                let residuals = conventions
                    .iter()
                    .map(|convention| pair.residuals(sequence, calibration, convention, 1));
                residuals.collect::<Vec<_>>()
            }))
        })
        .collect::<Result<Vec<_>, FrameError>>()?;
    let compared = measured.iter().flatten().count();
    if compared == 0 {
        return Ok(None);
    }
    let mut hypotheses = conventions.iter().enumerate().map(|(index, convention)| {
        let all = || {
            measured
                .iter()
                .flatten()
                .flat_map(|residuals| &residuals[index])
        };
        let mut absolute: Vec<f64> = all().map(|residual| residual.0).collect();
        let mut relative: Vec<f64> = all().map(|residual| residual.1).collect();
        let within = relative.iter().filter(|&&value| value < AGREEMENT).count();
        DepthHypothesis {
            reading: convention.description.clone(),
            remedy: convention.remedy.clone(),
            differences: convention.differences,
            offset: convention.poses.offset,
            pixels: relative.len(),
            // Without any overlap nothing agrees.
            median_difference: quantile(&mut absolute, 0.5).unwrap_or(f64::INFINITY),
            median_relative: quantile(&mut relative, 0.5).unwrap_or(f64::INFINITY),
            share_within_1_percent: within as f64 / relative.len().max(1) as f64,
        }
    });
    let Some(as_read) = hypotheses.next() else {
        return Ok(None);
    };
    let mut others: Vec<DepthHypothesis> = hypotheses.filter(|other| other.pixels > 0).collect();
    others.sort_by(|a, b| a.median_relative.total_cmp(&b.median_relative));
    Ok(Some((compared, as_read, others)))
}

/// Two depth images.
pub(super) struct DepthPair {
    frames: [usize; 2],
    depths: [DepthImage; 2],
}

impl DepthPair {
    /// `None` if one of them is missing or cannot be decoded.
    fn load(sequence: &Sequence, frames: [usize; 2]) -> Result<Option<Self>, FrameError> {
        let [i, j] = frames;
        let (Some(a), Some(b)) = (
            skip_unreadable(sequence.load_depth(i))?.flatten(),
            skip_unreadable(sequence.load_depth(j))?.flatten(),
        ) else {
            return Ok(None);
        };
        Ok(Some(Self {
            frames,
            depths: [a, b],
        }))
    }

    /// Absolute and relative differences under a convention; of the pixels that are compared, every `every`-th in either direction.
    pub(super) fn residuals(
        &self,
        sequence: &Sequence,
        calibration: &DepthCalibration,
        convention: &DepthConvention,
        every: usize,
    ) -> Vec<(f64, f64)> {
        let color_from_depth = &calibration.color_from_depth;
        let Some(b_from_a) = convention.poses.b_from_a(sequence, self.frames) else {
            return Vec::new();
        };
        let b_from_a = color_from_depth.inverse() * b_from_a * color_from_depth;
        let camera = convention.camera.as_ref().unwrap_or(&calibration.camera);
        let [a, b] = &self.depths;
        let depth = |depth: f32, x: usize, y: usize| {
            let depth = f64::from(depth);
            if convention.values == calibration.values {
                return convention.factor * depth;
            }
            let ray = ray_length(camera, x, y);
            convention.factor
                * convention
                    .values
                    .depth(calibration.values.value(depth, ray), ray)
        };
        compare(a, b, &b_from_a, depth, camera, every)
    }
}

/// Absolute and relative differences between depth of `a` transformed into `b` and depth of `b`; `depth` takes depth as read at a pixel.
fn compare(
    a: &DepthImage,
    b: &DepthImage,
    b_from_a: &Isometry3<f64>,
    depth: impl Fn(f32, usize, usize) -> f64,
    camera: &Camera,
    every: usize,
) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let stride = (a.width() / SAMPLES_ACROSS).max(1) * every;
    for y in (stride / 2..a.height()).step_by(stride) {
        for x in (stride / 2..a.width()).step_by(stride) {
            let Some(&z) = a.get(x, y).filter(|&&z| z > 0.0) else {
                continue;
            };
            let pixel = Point2::new(x as f64, y as f64);
            let Ok(point) = camera.point_at_depth(&pixel, depth(z, x, y)) else {
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
            let measured = depth(there, u as usize, v as usize);
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
            let residuals = compare(
                &depth_a,
                &depth_b,
                &b_from_a,
                |depth, _, _| factor * f64::from(depth),
                &camera,
                1,
            );
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
