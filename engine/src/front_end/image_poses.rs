//! Correction of poses and lens from images, for depth from images alone.
//!
//! Depth is triangulated over short baselines, which amplify pose errors. All edges of a keyframe share them, so averaging
//! does not help.

use nalgebra::Isometry3;

use super::placed_poses::placed;
use super::{
    Arrival, FeatureFrontEnd, FrontEnd, FrontEndError, Keyframe, group_size, run_in_groups,
};
use crate::options::Options;
use linecarve_lines::camera::CameraCorrection;
use linecarve_points::{CameraMotion, HeldBackErrors, PointMap, PointOptionsError, camera_motion};
use linecarve_sequence::Sequence;
use serde::Serialize;

/// Difference between the given poses and those that the images show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PoseSummary {
    /// Keyframes with enough points for a correction.
    pub keyframes: usize,
    /// Number of points.
    pub points: usize,
    /// RMS reprojection error after the correction.
    pub reprojection_rms_px: f64,
    /// RMS rotation per axis, in pixels of the image.
    pub turn_px: f64,
    /// RMS translation per axis, in pixels at the median depth.
    pub shift_px: f64,
    /// How the camera differs from the given one; the corrected poses and the given ones belong to the corrected camera.
    #[serde(flatten)]
    pub camera: Option<CameraCorrection>,
    /// Time from the first to the last row as a share of the time between two frames, where a rolling shutter is why images and poses
    /// disagree: the given poses are kept.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rolling_shutter: Option<f64>,
    /// Errors of matches that no adjustment saw, by which poses and camera were chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_back: Option<HeldBackErrors>,
    /// Whether the corrected poses replace the given ones.
    pub is_corrected: bool,
}

/// Poses of keyframes after the comparison with images.
#[derive(Debug, Clone)]
pub struct ImagePoses {
    /// `point_in_world = pose * point_in_camera` for each keyframe, with which images are matched: corrected, or as given where too
    /// few points are observed or the given poses are accurate enough.
    pub fitted: Vec<Isometry3<f64>>,
    /// Where each keyframe is in the world of the given poses: the mean of where those of the keyframes around it put it, through the
    /// relative poses of `fitted`. The same as `fitted` where nothing was corrected.
    pub placed: Vec<Isometry3<f64>>,
    /// Difference of poses and images, and the estimated lens.
    pub summary: PoseSummary,
}

/// Poses cannot be corrected.
#[derive(Debug, thiserror::Error)]
pub enum ImagePosesError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] PointOptionsError),
    /// An error that is not limited to one image.
    #[error(transparent)]
    Image(#[from] FrontEndError),
}

/// Adjusts the poses of `frames` to the points that their images share. Each is held by its given pose as `[pose_correction]`
/// configures: incrementally, and finally all together. Poses, or the camera, are corrected only where that explains matches that no
/// adjustment saw. Unreadable images are skipped. `progress` is called for every keyframe.
///
/// # Errors
/// When options are out of range, or an error is not limited to one image.
///
/// # Complexity
/// Feature detection in every image; for the rest see [`PointMap`](linecarve_points::PointMap) and its `adjust_all`.
pub fn correct_poses(
    sequence: &Sequence,
    frames: &[usize],
    options: &Options,
    mut progress: impl FnMut() + Send,
) -> Result<ImagePoses, ImagePosesError> {
    let mut map = empty_point_map(sequence, options)?;
    // Positions in `frames` of the keyframes in the map.
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
    run_in_groups(
        &mut front_end,
        sequence,
        frames,
        0,
        group_size(),
        None,
        take,
    )?;
    for (number, position) in pushed.iter().enumerate() {
        if let Some(motion) = motion_at(sequence, frames[*position]) {
            map.set_motion(number as u32, motion);
        }
    }
    map.adjust_all();

    let given: Vec<Isometry3<f64>> = frames
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
    let median_depth = map.median_depth();
    let [turn_px, shift_px] = median_depth.map_or([0.0; 2], |depth| map.corrections_px(depth));
    let mut summary = PoseSummary {
        keyframes: corrected.len(),
        turn_px,
        shift_px,
        ..PoseSummary::default()
    };
    summary.camera = map.lens().correction();
    summary.held_back = map.held_back_errors();
    summary.rolling_shutter = map.readout();
    summary.is_corrected = map.has_adjusted_poses();
    let quality = map.quality();
    summary.points = quality.points;
    summary.reprojection_rms_px = quality.reprojection_rms_px;
    let mut fitted = given.clone();
    let mut places = given.clone();
    if summary.is_corrected {
        for (position, number) in corrected {
            fitted[position] = *pose(number).world_from_camera();
        }
        if let Some(median_depth) = median_depth {
            places = placed(&given, &fitted, median_depth);
        }
    }
    Ok(ImagePoses {
        fitted,
        placed: places,
        summary,
    })
}

/// Motion of the camera at a frame, from the poses of the frames next to it.
fn motion_at(sequence: &Sequence, frame: usize) -> Option<CameraMotion> {
    let frames = sequence.frames();
    let (before, after) = (frame.saturating_sub(1), (frame + 1).min(frames.len() - 1));
    let pose = |frame: usize| &frames[frame].world_from_camera;
    (before < after).then(|| camera_motion(pose(before), pose(after), after - before))
}

/// An empty map of feature points. Lens distortion is estimated only when the sequence does not give it.
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
