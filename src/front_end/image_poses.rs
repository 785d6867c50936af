//! Poses, and the lens, as the images have them, for depth that comes from images alone.
//!
//! Depth is triangulated between keyframes that lie close together: what a pose is wrong by, in pixels, goes into it many times
//! over, and is the same for all edges of a keyframe, so that no average takes it away.

use nalgebra::Isometry3;

use super::{
    Arrival, FeatureFrontEnd, FrontEnd, FrontEndError, Keyframe, group_size, run_in_groups,
};
use crate::options::Options;
use linecarve_points::PoseChange;
use linecarve_points::{PointMap, PointOptionsError};
use linecarve_sequence::Sequence;
use serde::Serialize;

/// Poses that are moved by less than this share of what they may be wrong by stay as given. Points err as well: exact poses would
/// follow their errors. What poses are really wrong by shows in full; what points alone err by moves them little.
const LEAST_SHARE: f64 = 0.5;

/// How far the given poses are from what the images show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PoseSummary {
    /// Keyframes that see enough points to be moved.
    pub keyframes: usize,
    /// The points.
    pub points: usize,
    /// Root of the mean squared distance of their projections from their features, with the poses moved.
    pub reprojection_rms_px: f64,
    /// By how much directions were moved: root mean square of an axis, in pixels of the image.
    pub turn_px: f64,
    /// By how much places were, as seen at the median depth.
    pub shift_px: f64,
    /// Radial distortion, `k1` of Brown's model, of images that came as those of a pinhole; it is taken out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens_k1: Option<f64>,
    /// Whether the moved poses are used in place of those given.
    pub is_corrected: bool,
}

impl PoseSummary {
    /// Root mean square of turn and shift, in pixels.
    pub fn moved_px(&self) -> f64 {
        (0.5 * (self.turn_px.powi(2) + self.shift_px.powi(2))).sqrt()
    }
}

/// The poses of keyframes, and what images have to say about them.
#[derive(Debug, Clone)]
pub struct ImagePoses {
    /// Of each keyframe, `point_in_world = pose * point_in_camera`: corrected, or as given where too few points are seen or the
    /// given poses are good enough.
    pub world_from_camera: Vec<Isometry3<f64>>,
    /// How far poses and images are apart, and the lens that images which came as those of a pinhole turned out to have.
    pub summary: PoseSummary,
}

/// Why poses could not be corrected.
#[derive(Debug, thiserror::Error)]
pub enum ImagePosesError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] PointOptionsError),
    /// What is at fault is not one image alone.
    #[error(transparent)]
    Image(#[from] FrontEndError),
}

/// Brings the poses of `frames` into agreement with the points that their images share: each held by its given pose as
/// `[pose_correction]` says, keyframe by keyframe and in the end all together. When that moves them by little and shows no lens,
/// all stay as given. An image that cannot be read is passed over here; who needs it will say so. `progress` is told of every
/// keyframe.
///
/// # Errors
/// When options are out of range, or when an image's fault is one of all.
///
/// # Complexity
/// Features of every image; for the rest see [`PointMap`](linecarve_points::PointMap) and its `adjust_all`.
pub fn correct_poses(
    sequence: &Sequence,
    frames: &[usize],
    options: &Options,
    mut progress: impl FnMut() + Send,
) -> Result<ImagePoses, ImagePosesError> {
    let mut map = empty_point_map(sequence, options)?;
    // Position among the keyframes of each one in the map.
    let mut pushed: Vec<usize> = Vec::with_capacity(frames.len());
    let mut front_end = FrontEnd::Features(FeatureFrontEnd::new(options.map_points));
    let take = |position, arrival| {
        match arrival {
            Arrival::Final(Ok(Keyframe::Features(keyframe))) => {
                pushed.push(position);
                map.push(&keyframe.world_from_camera, keyframe.features);
            }
            Arrival::Final(Err(error)) if !error.is_limited_to_frame() => {
                return Err(ImagePosesError::Image(error));
            }
            _ => {}
        }
        progress();
        Ok(())
    };
    run_in_groups(&mut front_end, sequence, frames, group_size(), None, take)?;
    map.adjust_all();

    let mut world_from_camera: Vec<Isometry3<f64>> = frames
        .iter()
        .map(|frame| sequence.frames()[*frame].world_from_camera)
        .collect();
    let corrected: Vec<(usize, u32)> = pushed
        .iter()
        .zip(0_u32..)
        .filter(|(_, number)| map.is_corrected(*number))
        .map(|(position, number)| (*position, number))
        .collect();
    let pose = |number: u32| &map.keyframes()[number as usize].pose;
    let changes = corrected.iter().map(|(_, number)| pose(*number).change());
    let mut summary = summary_of(
        changes,
        sequence.color_camera().mean_focal_px(),
        map.median_depth(),
    );
    summary.lens_k1 = map.lens().k1();
    // Poses that were found under a lens go with it.
    summary.is_corrected = summary.lens_k1.is_some()
        || summary.moved_px() > LEAST_SHARE * options.pose_correction.sigma_px;
    let quality = map.quality();
    summary.points = quality.points;
    summary.reprojection_rms_px = quality.reprojection_rms_px;
    if summary.is_corrected {
        for (position, number) in corrected {
            world_from_camera[position] = *pose(number).world_from_camera();
        }
    }
    Ok(ImagePoses {
        world_from_camera,
        summary,
    })
}

/// Root mean squares over the axes.
fn summary_of(
    changes: impl Iterator<Item = PoseChange>,
    focal_px: f64,
    median_depth: Option<f64>,
) -> PoseSummary {
    let mut summary = PoseSummary::default();
    let (mut turns, mut shifts) = (0.0, 0.0);
    for change in changes {
        summary.keyframes += 1;
        turns += change.rotation_rad.powi(2);
        shifts += change.translation.powi(2);
    }
    if let Some(depth) = median_depth
        && summary.keyframes > 0
    {
        let axes = (3 * summary.keyframes) as f64;
        summary.turn_px = focal_px * (turns / axes).sqrt();
        summary.shift_px = focal_px * (shifts / axes).sqrt() / depth;
    }
    summary
}

/// An empty map of points for keyframes of a sequence. Lens distortion is estimated only when the sequence does not know it.
///
/// # Errors
/// When an option is out of range.
pub(crate) fn empty_point_map(
    sequence: &Sequence,
    options: &Options,
) -> Result<PointMap, PointOptionsError> {
    let mut correction = options.pose_correction;
    correction.lens &= !sequence.has_known_distortion();
    let size = sequence.color_size();
    PointMap::new(
        options.map_points,
        correction,
        sequence.color_camera(),
        size.width as usize,
        size.height as usize,
    )
}
