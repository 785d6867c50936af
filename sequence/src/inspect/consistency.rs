//! Test of depth consistency: depth of one frame against depth of another, under the poses as read and alternatives.

use rayon::prelude::*;
use serde::Serialize;

use super::depth_alternatives::{DepthConvention, alternatives, as_read, search};
use super::depth_pair::{DepthPair, Residuals};
use super::pose_hypotheses::simplest_of_best;
use super::{evenly_spaced, quantile, remedy_text};
use crate::{DepthCalibration, FrameError, Sequence};

/// Largest relative difference of depths that agree.
const AGREEMENT: f64 = 0.01;

/// An alternative is reported if its median residual is below this share of that as read. A wrong convention is worse by
/// an order of magnitude; noise and drift change the residual by tenths.
const CLEARLY_BETTER: f64 = 0.5;

/// A median below this share as read is good: over short distances and before flat walls every convention fits. An alternative must then
/// be far better.
const GOOD: f64 = 0.01;
const FAR_BETTER: f64 = 0.25;

/// A median below this share as read is accepted without comparison: no sensor measures better.
const EXACT: f64 = 0.003;

/// Smallest number of compared pixels of a few pairs that prove something.
const MIN_PIXELS: usize = 300;

/// An alternative that contradicts the files fits at least this well.
pub(super) const FITS: f64 = 0.05;

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
    /// Whether the axes are those of a turned or mirrored camera.
    #[serde(skip)]
    is_turned: bool,
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
    let share = match as_read.median_relative {
        median if median < EXACT => return None,
        median if median < GOOD => FAR_BETTER,
        _ => CLEARLY_BETTER,
    };
    // With little overlap a good fit proves nothing.
    let comparable: Vec<&DepthHypothesis> = others
        .iter()
        .filter(|other| other.pixels * 4 >= as_read.pixels)
        .collect();
    simplest_of_best(&comparable, |other| {
        (other.median_relative, other.differences)
    })
    .copied()
    .filter(|best| best.median_relative < share * as_read.median_relative)
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
    let as_read_convention = as_read(sequence, calibration);
    let mut conventions = vec![as_read_convention.clone()];
    conventions.extend(alternatives(sequence, calibration));
    let Some((pairs_compared, as_read, mut others)) =
        measure_pairs(sequence, calibration, &pairs, &conventions)?
    else {
        return Ok(None);
    };
    if as_read.median_relative >= GOOD {
        let few = evenly_spaced(pairs.len(), SEARCHED_PAIRS).into_iter();
        let few: Vec<[usize; 2]> = few.map(|at| pairs[at]).collect();
        let found = search(
            sequence,
            calibration,
            &load(sequence, &few)?,
            is_explained(&others),
        );
        let mut conventions = vec![as_read_convention];
        conventions.extend(found);
        let measured = measure_pairs(sequence, calibration, &pairs, &conventions)?;
        others.extend(measured.map_or_else(Vec::new, |(_, _, found)| found));
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
#[derive(Debug, Clone, PartialEq)]
pub(super) enum DepthVerdict {
    /// They agree.
    Agrees,
    /// An alternative agrees much better; it is given in words.
    Contradicts(String),
    /// Poses of the frames beside, or with other axes, agree much better: either those are wrong, or depth images are.
    PosesOrDepth {
        /// What to say if poses do not fit the images.
        poses: String,
        /// What to say if they do.
        depth: String,
    },
    /// They disagree by far more than noise and drift, and no alternative says how.
    Unexplained(String),
    /// They disagree by this share of the depth, as those of a model with free scales do, and those with poses of other times.
    Disagrees(f64),
    /// They do not tell.
    Unknown,
}

/// Compares a few pairs, which are decoded once. Alternatives are only tried if the depth does not agree as read.
pub(super) fn verdict(
    sequence: &Sequence,
    pairs: &[[usize; 2]],
) -> Result<DepthVerdict, FrameError> {
    let Some(calibration) = sequence.depth_calibration() else {
        return Ok(DepthVerdict::Unknown);
    };
    let loaded = load(sequence, pairs)?;
    let measure = |conventions: &[DepthConvention]| {
        let residuals = |pair: &DepthPair| pair.of_all(sequence, calibration, conventions);
        let measured: Vec<Residuals> = loaded.par_iter().map(residuals).collect();
        hypotheses(&measured, conventions)
    };
    let first = as_read(sequence, calibration);
    let Some((as_read, _)) = measure(std::slice::from_ref(&first)) else {
        return Ok(DepthVerdict::Unknown);
    };
    // Nothing to compare as read is no agreement: a wrong scale may leave no overlap.
    let is_compared = as_read.pixels >= MIN_PIXELS;
    let is_good = is_compared && as_read.median_relative < GOOD;
    if is_compared && as_read.median_relative < EXACT {
        return Ok(DepthVerdict::Agrees);
    }
    let differs = format!("depth differs by {:.0} %", 100.0 * as_read.median_relative);
    if let Some(text) = one_pose(sequence, &differs).filter(|_| is_compared && !is_good) {
        return Ok(DepthVerdict::Contradicts(text));
    }
    let mut others = others_of(measure, &first, alternatives(sequence, calibration));
    if !is_good {
        let found = search(sequence, calibration, &loaded, is_explained(&others));
        others.extend(others_of(measure, &first, found));
    }
    others.retain(|other| other.pixels >= MIN_PIXELS);
    let Some(best) = better(&as_read, &others).filter(|best| best.median_relative < FITS) else {
        return Ok(match unexplained(&as_read) {
            Some(text) => DepthVerdict::Unexplained(text),
            None if is_good => DepthVerdict::Agrees,
            None if is_compared && as_read.median_relative > FITS => {
                DepthVerdict::Disagrees(as_read.median_relative)
            }
            None => DepthVerdict::Unknown,
        });
    };
    let poses = format!("depth images {}", agree_better(&as_read, best));
    let depth = match best.offset {
        0 if best.is_turned => format!(
            "depth images are turned or mirrored against the images, as with {}: {}: write them as the images lie",
            best.reading,
            agree_so(&as_read, best)
        ),
        0 => return Ok(DepthVerdict::Contradicts(poses)),
        offset => format!(
            "each depth image belongs to the {} image: {}: give depth images the numbers of their images",
            if offset < 0 { "previous" } else { "next" },
            agree_so(&as_read, best)
        ),
    };
    Ok(DepthVerdict::PosesOrDepth { poses, depth })
}

/// Says that depth agrees under an alternative.
fn agree_so(as_read: &DepthHypothesis, best: &DepthHypothesis) -> String {
    format!(
        "depth agrees so (median difference {:.2} % of depth), not as read ({:.2} %)",
        100.0 * best.median_relative,
        100.0 * as_read.median_relative
    )
}

/// Says that all frames have the same pose, while `what` from one to the next; `None` if they do not.
pub(super) fn one_pose(sequence: &Sequence, what: &str) -> Option<String> {
    let frames = sequence.frames();
    let is_one = frames
        .windows(2)
        .all(|pair| pair[0].world_from_camera == pair[1].world_from_camera);
    is_one.then(|| {
        format!(
            "all {} poses are the same, but {what} from one image to the next: give the poses of a camera that moves, or none",
            frames.len()
        )
    })
}

/// The hypotheses of conventions beside that as read.
fn others_of(
    measure: impl Fn(&[DepthConvention]) -> Option<(DepthHypothesis, Vec<DepthHypothesis>)>,
    as_read: &DepthConvention,
    others: Vec<DepthConvention>,
) -> Vec<DepthHypothesis> {
    let conventions = [vec![as_read.clone()], others].concat();
    measure(&conventions).map_or_else(Vec::new, |(_, others)| others)
}

/// Whether an alternative fits by itself.
fn is_explained(others: &[DepthHypothesis]) -> bool {
    others.iter().any(|other| other.median_relative < GOOD)
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

type Measured = (usize, DepthHypothesis, Vec<DepthHypothesis>);

/// Measures all conventions on the pairs that can be compared, and counts these; the first convention is that as read. Pairs are loaded one
/// by one.
fn measure_pairs(
    sequence: &Sequence,
    calibration: &DepthCalibration,
    pairs: &[[usize; 2]],
    conventions: &[DepthConvention],
) -> Result<Option<Measured>, FrameError> {
    let measured: Vec<Residuals> = pairs
        .par_iter()
        .map(|&frames| {
            let pair = DepthPair::load(sequence, frames)?;
            Ok(pair.map(|pair| pair.of_all(sequence, calibration, conventions)))
        })
        .collect::<Result<Vec<_>, FrameError>>()?
        .into_iter()
        .flatten()
        .collect();
    let found = hypotheses(&measured, conventions);
    Ok(found.map(|(as_read, others)| (measured.len(), as_read, others)))
}

/// The hypothesis as read, and the others that compare anything, the best first; `None` without pairs.
fn hypotheses(
    measured: &[Residuals],
    conventions: &[DepthConvention],
) -> Option<(DepthHypothesis, Vec<DepthHypothesis>)> {
    if measured.is_empty() {
        return None;
    }
    let mut hypotheses = conventions.iter().enumerate().map(|(index, convention)| {
        let all = || measured.iter().flat_map(|residuals| &residuals[index]);
        let mut absolute: Vec<f64> = all().map(|residual| residual.0).collect();
        let mut relative: Vec<f64> = all().map(|residual| residual.1).collect();
        let within = relative.iter().filter(|&&value| value < AGREEMENT).count();
        DepthHypothesis {
            reading: convention.description.clone(),
            remedy: convention.remedy.clone(),
            differences: convention.differences,
            offset: convention.poses.offset,
            is_turned: convention.poses.is_turned,
            pixels: relative.len(),
            // Without any overlap nothing agrees.
            median_difference: quantile(&mut absolute, 0.5).unwrap_or(f64::INFINITY),
            median_relative: quantile(&mut relative, 0.5).unwrap_or(f64::INFINITY),
            share_within_1_percent: within as f64 / relative.len().max(1) as f64,
        }
    });
    let as_read = hypotheses.next()?;
    let mut others: Vec<DepthHypothesis> = hypotheses.filter(|other| other.pixels > 0).collect();
    others.sort_by(|a, b| a.median_relative.total_cmp(&b.median_relative));
    Some((as_read, others))
}

/// The pairs that can be compared, in memory.
fn load(sequence: &Sequence, pairs: &[[usize; 2]]) -> Result<Vec<DepthPair>, FrameError> {
    let loaded = pairs
        .par_iter()
        .map(|&frames| DepthPair::load(sequence, frames))
        .collect::<Result<Vec<_>, FrameError>>()?;
    Ok(loaded.into_iter().flatten().collect())
}
