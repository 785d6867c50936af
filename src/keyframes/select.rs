//! Keyframes by motion, the sharpest of a few.

use nalgebra::Isometry3;

use super::options::{KeyframeOptions, KeyframeOptionsError};
use super::sharpness::sharpness;
use crate::sequence::Sequence;

/// Chooses keyframes from a stream of frames. Memory: one window of sharpness values.
#[derive(Debug, Clone)]
pub struct Selector {
    translation: f64,
    rotation_rad: f64,
    window: usize,
    last_keyframe: Option<Isometry3<f64>>,
    candidates: Vec<Candidate>,
}

#[derive(Debug, Clone)]
struct Candidate {
    frame: usize,
    world_from_camera: Isometry3<f64>,
    sharpness: Option<f64>,
}

impl Selector {
    /// A selector for a scene of the given median depth (units of the poses).
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(options: &KeyframeOptions, median_depth: f64) -> Result<Self, KeyframeOptionsError> {
        options.validate()?;
        Ok(Self {
            translation: options.translation(median_depth),
            rotation_rad: options.rotation_degrees.to_radians(),
            window: options.sharpness_window,
            last_keyframe: None,
            candidates: Vec::with_capacity(options.sharpness_window),
        })
    }

    /// Looks at the next frame; gives the keyframe that is thereby decided, if any, which may be an earlier frame.
    ///
    /// `measure` gives the frame's sharpness, `None` when its image cannot be read. It is asked only when frames are to
    /// be compared. An unreadable frame is chosen only when the whole window is unreadable, so that the fault shows.
    pub fn push(
        &mut self,
        frame: usize,
        world_from_camera: &Isometry3<f64>,
        measure: impl FnOnce() -> Option<f64>,
    ) -> Option<usize> {
        let is_due = match &self.last_keyframe {
            // The first frame is a keyframe, at once: every frame after it is compared with it.
            None => true,
            Some(last) => !self.candidates.is_empty() || self.has_moved(last, world_from_camera),
        };
        if !is_due {
            return None;
        }
        let is_compared = self.window > 1;
        self.candidates.push(Candidate {
            frame,
            world_from_camera: *world_from_camera,
            sharpness: if is_compared { measure() } else { None },
        });
        (self.candidates.len() == self.window).then(|| self.decide())?
    }

    /// The stream is over: the keyframe of a window that has begun, if any.
    pub fn finish(mut self) -> Option<usize> {
        self.decide()
    }

    fn has_moved(&self, last: &Isometry3<f64>, world_from_camera: &Isometry3<f64>) -> bool {
        let motion = last.inverse() * world_from_camera;
        motion.translation.vector.norm() >= self.translation
            || motion.rotation.angle() >= self.rotation_rad
    }

    /// The sharpest candidate, of equal ones the earliest, becomes the last keyframe.
    fn decide(&mut self) -> Option<usize> {
        let sharpness = |candidate: &Candidate| candidate.sharpness.unwrap_or(f64::NEG_INFINITY);
        let best = self.candidates.drain(..).reduce(|best, next| {
            if sharpness(&next) > sharpness(&best) {
                next
            } else {
                best
            }
        })?;
        self.last_keyframe = Some(best.world_from_camera);
        Some(best.frame)
    }
}

/// The keyframes of a whole sequence, in its order. Images are read only for windows of more than one frame, and of
/// those only the frames that are compared. `progress` is told how many frames have been looked at.
///
/// # Errors
/// When an option is out of range.
pub fn select(
    sequence: &Sequence,
    options: &KeyframeOptions,
    median_depth: f64,
    mut progress: impl FnMut(usize),
) -> Result<Vec<usize>, KeyframeOptionsError> {
    let mut selector = Selector::new(options, median_depth)?;
    let mut keyframes = Vec::new();
    for (index, frame) in sequence.frames().iter().enumerate() {
        let measure = || {
            sequence
                .load_gray(index)
                .ok()
                .map(|image| sharpness(&image))
        };
        keyframes.extend(selector.push(index, &frame.world_from_camera, measure));
        progress(index + 1);
    }
    keyframes.extend(selector.finish());
    Ok(keyframes)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    use super::*;

    fn options(window: usize) -> KeyframeOptions {
        KeyframeOptions {
            translation: Some(1.0),
            rotation_degrees: 10.0,
            sharpness_window: window,
            ..KeyframeOptions::default()
        }
    }

    /// A path along x in steps of 0.4, with the given sharpness of each frame.
    fn along_x(window: usize, sharpness: &[f64]) -> Vec<usize> {
        let mut selector = Selector::new(&options(window), 2.0).unwrap();
        let mut keyframes = Vec::new();
        for (frame, value) in sharpness.iter().enumerate() {
            let pose = Isometry3::from(Translation3::new(0.4 * frame as f64, 0.0, 0.0));
            keyframes.extend(selector.push(frame, &pose, || Some(*value)));
        }
        keyframes.extend(selector.finish());
        keyframes
    }

    #[test]
    fn without_a_window_the_first_frame_that_has_moved_is_taken() {
        assert_eq!(along_x(1, &[0.0; 8]), [0, 3, 6]);
    }

    #[test]
    fn the_sharpest_of_the_window_is_taken_and_motion_counts_from_it() {
        // First window 0..2 gives 1; from x = 0.4 the next due frame is 4; window 4..6 gives 6; then 9 alone.
        let sharpness = [1.0, 5.0, 2.0, 9.0, 1.0, 2.0, 3.0, 9.0, 9.0, 1.0];
        assert_eq!(along_x(3, &sharpness), [1, 6, 9]);
    }

    #[test]
    fn an_unreadable_frame_is_never_preferred() {
        let mut selector = Selector::new(&options(2), 2.0).unwrap();
        let pose = Isometry3::identity();
        assert_eq!(selector.push(0, &pose, || None), None);
        assert_eq!(selector.push(1, &pose, || Some(0.0)), Some(1));
    }

    #[test]
    fn turning_is_motion_too() {
        let mut selector = Selector::new(&options(1), 2.0).unwrap();
        let turned = |degrees: f64| {
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::y() * degrees.to_radians());
            Isometry3::from_parts(Translation3::identity(), rotation)
        };
        assert_eq!(selector.push(0, &turned(0.0), || None), Some(0));
        assert_eq!(selector.push(1, &turned(9.0), || None), None);
        assert_eq!(selector.push(2, &turned(10.5), || None), Some(2));
    }

    #[test]
    fn scaling_poses_and_depth_together_changes_nothing() {
        let share = KeyframeOptions {
            translation: None,
            sharpness_window: 1,
            ..KeyframeOptions::default()
        };
        let chosen = |scale: f64| {
            let mut selector = Selector::new(&share, 2.0 * scale).unwrap();
            (0..50)
                .filter(|frame| {
                    let x = 0.031 * f64::from(*frame) * scale;
                    let pose = Isometry3::from(Translation3::new(x, 0.0, 0.0));
                    selector.push(*frame as usize, &pose, || None).is_some()
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(chosen(1.0), chosen(1000.0));
        assert!(chosen(1.0).len() > 3);
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let bad = KeyframeOptions {
            rotation_degrees: f64::NAN,
            ..KeyframeOptions::default()
        };
        assert!(Selector::new(&bad, 2.0).is_err());
        assert!(Selector::new(&options(0), 2.0).is_err());
    }
}
