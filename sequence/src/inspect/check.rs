//! The questions that a run asks first: whether a few images contradict how the files are read.
//!
//! They are those of [`inspect`](super::inspect) on a few pairs of frames. Alternatives are only tried if the pairs do not agree as read,
//! so that a sequence without faults costs the decoding of eight depth images, of eight images whose corners are matched, and of four frames
//! whose outlines are compared with edges.

use nalgebra::Isometry3;

use super::consistency::DepthVerdict;
use super::epipolar::CornerVerdict;
use super::image_samples::{CornerPair, FrameCorners};
use super::{consistency, epipolar, evenly_spaced, registration};
use crate::{FrameError, Sequence};

/// Number of compared pairs.
const PAIRS: usize = 4;

/// Frames on either side of a frame that may be its partner.
const REACH: usize = 60;

/// Most pixels of outlines that are compared with edges.
const OUTLINE_PIXELS: usize = 1500;

/// Largest rotation between the frames of a pair: with more, corners do not match and depth does not overlap.
const MAX_ROTATION_DEG: f64 = 15.0;

/// Largest distance between the frames of a pair, as a share of the extent of the path.
const MAX_DISTANCE: f64 = 0.15;

/// What a few images say about how the files of a sequence are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ImageCheck {
    /// What in the files contradicts the images, with the remedy.
    pub contradiction: Option<String>,
    /// What is doubtful, but may be no more than inaccurate.
    pub warning: Option<String>,
}

impl ImageCheck {
    fn contradicts(text: Option<String>) -> Self {
        Self {
            contradiction: text,
            warning: None,
        }
    }
}

/// Asks a few images whether a depth scale, a pose convention or intrinsics fit much better than those read, whether depth is moved against
/// the images, and whether the poses belong to them. Without poses only outlines are compared.
///
/// # Errors
/// If an image makes the whole sequence unusable (image size, depth format).
pub fn check_images(sequence: &Sequence) -> Result<ImageCheck, FrameError> {
    if !sequence.has_poses() {
        return Ok(ImageCheck::contradicts(misregistration(sequence)));
    }
    let mut check = check_poses(sequence)?;
    match &mut check.contradiction {
        Some(text) => *text = with_poses_read(sequence, text),
        None => check.contradiction = misregistration(sequence),
    }
    Ok(check)
}

fn check_poses(sequence: &Sequence) -> Result<ImageCheck, FrameError> {
    let of_depth = pairs(sequence, |frame| sequence.frames()[frame].depth.is_some());
    let verdict = consistency::verdict(sequence, &of_depth)?;
    match verdict {
        DepthVerdict::Contradicts(text) => return Ok(ImageCheck::contradicts(Some(text))),
        DepthVerdict::PosesOrDepth { poses, depth } => {
            let fit = of_corners(sequence, |pairs| epipolar::fits(sequence, pairs))?;
            let text = match fit {
                Some(true) => format!("the poses fit the images, but {depth}"),
                Some(false) => poses,
                None => format!("{poses}\nor, if the poses fit the images: {depth}"),
            };
            return Ok(ImageCheck::contradicts(Some(text)));
        }
        _ => {}
    }
    let corners = corner_verdict(sequence)?;
    if let Some(CornerVerdict::Contradicts(text)) = corners {
        return Ok(ImageCheck::contradicts(Some(text)));
    }
    if let DepthVerdict::Unexplained(text) = verdict {
        return Ok(ImageCheck::contradicts(Some(text)));
    }
    // Layers of models with free scales disagree as well, but corners fit.
    let disagrees = match verdict {
        DepthVerdict::Disagrees(share) => Some(format!(
            "depth images disagree by {:.0} % of depth with one another",
            100.0 * share
        )),
        _ => None,
    };
    let is_bad = corners.as_ref().is_some_and(CornerVerdict::is_bad);
    let doubtful = match (corners, disagrees) {
        (Some(CornerVerdict::Poor { text, .. }), Some(depth)) => {
            Some(format!("{text}, and {depth}"))
        }
        (Some(CornerVerdict::Poor { text, .. }), None) if is_bad => Some(text),
        (None, depth) => depth,
        _ => None,
    };
    Ok(ImageCheck {
        contradiction: None,
        warning: doubtful.map(|text| {
            format!("{text}: check that poses (clock, order, number) and intrinsics belong to these images")
        }),
    })
}

/// Says that registered depth is moved against the images, as outlines of a few images show.
fn misregistration(sequence: &Sequence) -> Option<String> {
    if !is_registered(sequence) {
        return None;
    }
    let facts = registration::measure(sequence, PAIRS, OUTLINE_PIXELS)?;
    let width = f64::from(sequence.color_size().width);
    facts.is_far(width).then(|| facts.warning())?
}

/// What corners say. Images beside each other are asked if those that are near by their poses do not match, as under wrong poses.
fn corner_verdict(sequence: &Sequence) -> Result<Option<CornerVerdict>, FrameError> {
    let ask = |pairs: &[CornerPair<'_>]| epipolar::verdict(sequence, pairs);
    if let Some(found) = of_corners(sequence, ask)? {
        return Ok(Some(found));
    }
    let steps = evenly_spaced(sequence.frames().len().saturating_sub(1), PAIRS);
    let beside: Vec<[usize; 2]> = steps.into_iter().map(|at| [at, at + 1]).collect();
    of_pairs(sequence, &beside, ask)
}

/// What a few pairs of images say by their corners.
fn of_corners<T>(
    sequence: &Sequence,
    ask: impl FnOnce(&[CornerPair<'_>]) -> Option<T>,
) -> Result<Option<T>, FrameError> {
    of_pairs(sequence, &pairs(sequence, |_| true), ask)
}

fn of_pairs<T>(
    sequence: &Sequence,
    pairs: &[[usize; 2]],
    ask: impl FnOnce(&[CornerPair<'_>]) -> Option<T>,
) -> Result<Option<T>, FrameError> {
    let corners = FrameCorners::find(sequence, pairs)?;
    Ok(ask(&corners.pairs(pairs)))
}

/// A text after the file that the poses are of: a folder may have several.
fn with_poses_read(sequence: &Sequence, text: &str) -> String {
    let folder = sequence.folder().display().to_string();
    let of_file =
        |convention: &&String| convention.starts_with("poses: ") && convention.contains(&folder);
    let poses = sequence.conventions().iter().find(of_file);
    match poses.and_then(|poses| poses.split(';').next()) {
        Some(poses) => format!("({poses}) {text}"),
        None => text.to_owned(),
    }
}

fn is_registered(sequence: &Sequence) -> bool {
    let calibration = sequence.depth_calibration();
    calibration.is_some_and(|calibration| calibration.registered)
}

/// Median distance of matched corners to their epipolar lines in pixels, if the frames had these recorded poses; `None` if a few pairs have
/// too few matches.
///
/// # Errors
/// If an image makes the whole sequence unusable.
pub(crate) fn epipolar_median(
    sequence: &Sequence,
    recorded: &[Option<Isometry3<f64>>],
) -> Result<Option<f64>, FrameError> {
    let pose = |frame: usize| {
        let recorded = recorded.get(frame)?.as_ref()?;
        let convention = &sequence.pose_convention;
        Some(convention.world_from_color(recorded, &sequence.extrinsics))
    };
    of_corners(sequence, |pairs| {
        epipolar::median_of_poses(sequence, pairs, pose)
    })
}

/// Pairs of frames that see the same, as far apart as that allows. Rotations between frames do not depend on the pose convention.
pub(super) fn pairs(sequence: &Sequence, is_usable: impl Fn(usize) -> bool) -> Vec<[usize; 2]> {
    let frames = sequence.frames();
    let usable: Vec<usize> = (0..frames.len()).filter(|&at| is_usable(at)).collect();
    let position = |at: usize| frames[usable[at]].world_from_camera.translation.vector;
    let Some(first) = usable.first().map(|_| position(0)) else {
        return Vec::new();
    };
    let (mut low, mut high) = (first, first);
    for at in 0..usable.len() {
        low = low.inf(&position(at));
        high = high.sup(&position(at));
    }
    let reach = MAX_DISTANCE * (high - low).norm();
    let mut pairs: Vec<[usize; 2]> = evenly_spaced(usable.len(), PAIRS)
        .into_iter()
        .filter_map(|at| {
            let rotation = |other: usize| {
                let [a, b] = [at, other].map(|at| frames[usable[at]].world_from_camera.rotation);
                a.angle_to(&b).to_degrees()
            };
            let distance = |other: usize| (position(other) - position(at)).norm();
            let around = at.saturating_sub(REACH)..(at + REACH + 1).min(usable.len());
            let others = || around.clone().filter(|other| *other != at);
            let best = others()
                .filter(|&other| rotation(other) <= MAX_ROTATION_DEG && distance(other) <= reach)
                .max_by(|&a, &b| distance(a).total_cmp(&distance(b)))
                .filter(|&other| distance(other) > 0.0)
                // Frames that are far apart: the one that is turned the least of the nearest.
                .or_else(|| {
                    others()
                        .filter(|other| other.abs_diff(at) <= 2)
                        .min_by(|&a, &b| {
                            let by_rotation = rotation(a).total_cmp(&rotation(b));
                            by_rotation.then(a.abs_diff(at).cmp(&b.abs_diff(at)))
                        })
                })?;
            Some([usable[at.min(best)], usable[at.max(best)]])
        })
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
