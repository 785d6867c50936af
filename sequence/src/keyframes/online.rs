//! Keyframe selection while frames arrive and their poses are still corrected.

use nalgebra::Isometry3;

use super::options::{KeyframeOptions, KeyframeOptionsError};
use super::overlap::PlanarScene;
use super::selector::KeyframeSelector;
use super::sharpness::sharpness;
use crate::Sequence;

/// Selects keyframes by the rules of [`select_keyframes`](super::select_keyframes) from a sequence that grows.
///
/// A keyframe is decided as soon as the frames of its sharpness window are there.
#[derive(Debug, Clone)]
pub struct OnlineKeyframes(KeyframeSelector);

impl OnlineKeyframes {
    /// A selection without frames. `median_depth` is the median scene depth in pose units.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(
        sequence: &Sequence,
        options: &KeyframeOptions,
        median_depth: f64,
    ) -> Result<Self, KeyframeOptionsError> {
        let scene = PlanarScene::new(sequence.color_camera(), sequence.color_size(), median_depth);
        KeyframeSelector::new(options, scene).map(Self)
    }

    /// Adds a frame, in ascending order; returns the keyframes that are decided now, which may be earlier frames.
    ///
    /// `pose` gives the pose of a frame as it is known now, in the coordinates of the new frame, or `None` when there is none:
    /// then the frame is forgotten. When the last keyframe is forgotten, the next frame is a keyframe.
    pub fn push(
        &mut self,
        sequence: &Sequence,
        frame: usize,
        pose: impl Fn(usize) -> Option<Isometry3<f64>>,
    ) -> Vec<usize> {
        let mut keyframes = Vec::new();
        self.0.set_poses(&pose);
        if let Some(world_from_camera) = pose(frame) {
            let mut measure = |frame| sharpness_of(sequence, frame);
            self.0
                .push(frame, &world_from_camera, &mut measure, &mut keyframes);
        }
        keyframes
    }

    /// The first frame that may still become a keyframe; `None` when all are decided.
    pub fn first_undecided(&self) -> Option<usize> {
        self.0.first_pending()
    }

    /// Decides the last frames.
    pub fn finish(self, sequence: &Sequence) -> Vec<usize> {
        let mut keyframes = Vec::new();
        let mut measure = |frame| sharpness_of(sequence, frame);
        self.0.finish(&mut measure, &mut keyframes);
        keyframes
    }
}

/// Sharpness of the image of a frame; `None` when it cannot be read.
pub(super) fn sharpness_of(sequence: &Sequence, frame: usize) -> Option<f64> {
    let image = sequence.load_gray(frame).ok()?;
    Some(sharpness(&image))
}
