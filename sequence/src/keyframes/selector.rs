//! Streaming keyframe selection by motion and sharpness.

use std::collections::VecDeque;

use nalgebra::Isometry3;

use super::options::{KeyframeOptions, KeyframeOptionsError};
use super::overlap::PlanarScene;

/// Largest relative motion of later candidates in a window, in multiples of the threshold: a sharper image must not
/// open a gap between keyframes.
const MAX_MOTION: f64 = 1.5;

/// Selects keyframes from a stream of frames. The first frame is a keyframe. Each next keyframe is the sharpest frame of
/// the window that starts at the first frame with enough motion.
///
/// Memory: one window of poses and sharpness values.
#[derive(Debug, Clone)]
pub(super) struct KeyframeSelector {
    options: KeyframeOptions,
    scene: PlanarScene,
    /// The last keyframe and its pose.
    last_keyframe: Option<(usize, Isometry3<f64>)>,
    /// Undecided frames since the last keyframe, at most one window.
    pending: VecDeque<Candidate>,
}

#[derive(Debug, Clone)]
struct Candidate {
    frame: usize,
    world_from_camera: Isometry3<f64>,
    /// Measured at most once; the inner `None` marks an unreadable image.
    sharpness: Option<Option<f64>>,
}

impl KeyframeSelector {
    /// A selector without frames.
    ///
    /// # Errors
    /// If an option is out of range.
    pub(super) fn new(
        options: &KeyframeOptions,
        scene: PlanarScene,
    ) -> Result<Self, KeyframeOptionsError> {
        options.validate()?;
        Ok(Self {
            options: *options,
            scene,
            last_keyframe: None,
            pending: VecDeque::with_capacity(options.sharpness_window),
        })
    }

    /// Adds the next frame and appends the keyframes decided by it, which may be earlier frames.
    ///
    /// `measure` returns the sharpness of a frame, `None` if its image is unreadable. It is called only to compare frames.
    /// An unreadable frame is chosen only if its whole window is unreadable, so that the caller sees the error.
    pub(super) fn push(
        &mut self,
        frame: usize,
        world_from_camera: &Isometry3<f64>,
        measure: &mut dyn FnMut(usize) -> Option<f64>,
        keyframes: &mut Vec<usize>,
    ) {
        self.pending.push_back(Candidate {
            frame,
            world_from_camera: *world_from_camera,
            sharpness: None,
        });
        self.decide(false, measure, keyframes);
    }

    /// Ends the stream: appends the keyframes of open windows.
    pub(super) fn finish(
        mut self,
        measure: &mut dyn FnMut(usize) -> Option<f64>,
        keyframes: &mut Vec<usize>,
    ) {
        self.decide(true, measure, keyframes);
    }

    /// Replaces the poses of the last keyframe and of undecided frames. Those without a pose are forgotten.
    pub(super) fn set_poses(&mut self, pose: impl Fn(usize) -> Option<Isometry3<f64>>) {
        self.last_keyframe = self
            .last_keyframe
            .and_then(|(frame, _)| Some((frame, pose(frame)?)));
        self.pending.retain_mut(|candidate| {
            let found = pose(candidate.frame);
            candidate.world_from_camera = found.unwrap_or(candidate.world_from_camera);
            found.is_some()
        });
    }

    /// The first frame that may still become a keyframe.
    pub(super) fn first_pending(&self) -> Option<usize> {
        self.pending.front().map(|candidate| candidate.frame)
    }

    fn decide(
        &mut self,
        is_end: bool,
        measure: &mut dyn FnMut(usize) -> Option<f64>,
        keyframes: &mut Vec<usize>,
    ) {
        loop {
            while let Some(front) = self.pending.front()
                && self.motion(&front.world_from_camera) < 1.0
            {
                self.pending.pop_front();
            }
            let Some(count) = self.window(is_end) else {
                return;
            };
            let chosen = if count > 1 {
                self.sharpest(count, measure)
            } else {
                0
            };
            // Earlier candidates are dropped; later ones may still become keyframes.
            if let Some(keyframe) = self.pending.drain(..=chosen).next_back() {
                self.last_keyframe = Some((keyframe.frame, keyframe.world_from_camera));
                keyframes.push(keyframe.frame);
            }
        }
    }

    /// Number of frames in the current window; `None` if there is none or it needs more frames.
    fn window(&self, is_end: bool) -> Option<usize> {
        if self.pending.is_empty() {
            return None;
        }
        // Later motion is relative to the first frame, which therefore cannot wait for a sharper one.
        let window = match self.last_keyframe {
            None => 1,
            Some(_) => self.options.sharpness_window,
        };
        let is_near =
            |candidate: &&Candidate| self.motion(&candidate.world_from_camera) <= MAX_MOTION;
        let others = self
            .pending
            .iter()
            .take(window)
            .skip(1)
            .take_while(is_near)
            .count();
        let is_closed = 1 + others == window || 1 + others < self.pending.len() || is_end;
        is_closed.then_some(1 + others)
    }

    /// Index of the sharpest of the first `count` pending frames; the earliest of equal ones.
    fn sharpest(&mut self, count: usize, measure: &mut dyn FnMut(usize) -> Option<f64>) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (position, candidate) in self.pending.iter_mut().take(count).enumerate() {
            let frame = candidate.frame;
            let sharpness = *candidate.sharpness.get_or_insert_with(|| measure(frame));
            if let Some(sharpness) = sharpness
                && sharpness > best.1
            {
                best = (position, sharpness);
            }
        }
        best.0
    }

    /// Motion since the last keyframe relative to the thresholds: 1 at the threshold, infinite without a keyframe.
    fn motion(&self, world_from_camera: &Isometry3<f64>) -> f64 {
        let Some((_, last)) = &self.last_keyframe else {
            return f64::INFINITY;
        };
        let camera_from_last = world_from_camera.inverse() * last;
        // Every frame reaches a threshold of 0.
        let share = |value: f64, threshold: f64| {
            if threshold > 0.0 {
                value / threshold
            } else {
                1.0
            }
        };
        let by_translation = share(
            camera_from_last.translation.vector.norm(),
            self.options.translation(self.scene.median_depth()),
        );
        let by_rotation = share(
            camera_from_last.rotation.angle().to_degrees(),
            self.options.rotation_degrees,
        );
        let by_overlap = self.options.min_overlap.map_or(0.0, |least| {
            (1.0 - self.scene.overlap(&camera_from_last)) / (1.0 - least)
        });
        by_translation.max(by_rotation).max(by_overlap)
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::ImageSize;

    fn scene(median_depth: f64) -> PlanarScene {
        let camera = Camera::pinhole(100.0, 100.0, 99.5, 99.5).unwrap();
        PlanarScene::new(
            &camera,
            ImageSize {
                width: 200,
                height: 200,
            },
            median_depth,
        )
    }

    fn at(x: f64, rotation_degrees: f64) -> Isometry3<f64> {
        let rotation =
            UnitQuaternion::from_scaled_axis(Vector3::y() * rotation_degrees.to_radians());
        Isometry3::from_parts(Translation3::new(x, 0.0, 0.0), rotation)
    }

    fn along_x(step: f64, count: u32) -> Vec<Isometry3<f64>> {
        (0..count).map(|i| at(step * f64::from(i), 0.0)).collect()
    }

    fn options(translation: f64, window: usize) -> KeyframeOptions {
        KeyframeOptions {
            translation: Some(translation),
            sharpness_window: window,
            ..KeyframeOptions::default()
        }
    }

    /// The keyframes of a path before a scene at depth 2, and the frames whose sharpness was measured.
    fn run(
        options: KeyframeOptions,
        poses: &[Isometry3<f64>],
        sharpness: &[Option<f64>],
    ) -> (Vec<usize>, Vec<usize>) {
        let mut selector = KeyframeSelector::new(&options, scene(2.0)).unwrap();
        let (mut keyframes, mut measured) = (Vec::new(), Vec::new());
        let mut measure = |frame: usize| {
            measured.push(frame);
            sharpness.get(frame).copied().unwrap_or(Some(1.0))
        };
        for (frame, pose) in poses.iter().enumerate() {
            selector.push(frame, pose, &mut measure, &mut keyframes);
            assert!(selector.pending.len() < options.sharpness_window.max(1));
        }
        selector.finish(&mut measure, &mut keyframes);
        (keyframes, measured)
    }

    #[test]
    fn a_window_of_one_measures_no_sharpness() {
        let (keyframes, measured) = run(options(0.5, 1), &along_x(0.25, 10), &[]);
        assert_eq!(keyframes, [0, 2, 4, 6, 8]);
        assert!(measured.is_empty());
    }

    #[test]
    fn rotation_makes_keyframes() {
        let poses: Vec<_> = (0..10).map(|i| at(0.0, 4.0 * f64::from(i))).collect();
        assert_eq!(run(options(1.0, 1), &poses, &[]).0, [0, 3, 6, 9]);
    }

    #[test]
    fn lost_overlap_makes_keyframes() {
        let options = KeyframeOptions {
            min_overlap: Some(0.75),
            ..options(100.0, 1)
        };
        // 4 wide at depth 2: each step of 0.2 loses a twentieth, a column of the grid a twelfth.
        assert_eq!(run(options, &along_x(0.2, 12), &[]).0, [0, 5, 10]);
    }

    #[test]
    fn the_sharpest_of_a_window_wins_and_the_earliest_of_equals() {
        let mut sharpness = [Some(1.0); 12];
        sharpness[5] = Some(3.0);
        // Frame 4 is the first that moves by 0.39; frame 5 is sharper; all later ones are equal.
        let (keyframes, measured) = run(options(0.39, 2), &along_x(0.1, 12), &sharpness);
        assert_eq!(keyframes, [0, 5, 9]);
        assert_eq!(measured, [4, 5, 9, 10]);
    }

    #[test]
    fn a_sharper_image_beyond_the_motion_limit_is_not_taken() {
        let sharpness = [Some(1.0), Some(1.0), Some(9.0)];
        assert_eq!(
            run(options(0.9, 3), &along_x(1.0, 3), &sharpness).0,
            [0, 1, 2]
        );
    }

    #[test]
    fn an_unreadable_frame_is_never_preferred() {
        let mut sharpness = [Some(0.1); 12];
        sharpness[4] = None;
        assert_eq!(
            run(options(0.39, 2), &along_x(0.1, 6), &sharpness).0,
            [0, 5]
        );
        assert_eq!(
            run(options(0.39, 2), &along_x(0.1, 6), &[None; 12]).0,
            [0, 4]
        );
    }

    #[test]
    fn scaling_poses_and_depth_together_changes_nothing() {
        let options = KeyframeOptions {
            sharpness_window: 1,
            ..KeyframeOptions::default()
        };
        let chosen = |scale: f64| {
            let mut selector = KeyframeSelector::new(&options, scene(2.0 * scale)).unwrap();
            let mut keyframes = Vec::new();
            for (frame, pose) in along_x(0.031 * scale, 50).iter().enumerate() {
                selector.push(frame, pose, &mut |_| None, &mut keyframes);
            }
            keyframes
        };
        assert_eq!(chosen(1.0), chosen(1024.0));
        assert_eq!(chosen(1.0)[..3], [0, 6, 12]);
    }

    #[test]
    fn options_out_of_range_are_refused() {
        for bad in [
            options(f64::NAN, 1),
            options(1.0, 0),
            KeyframeOptions {
                rotation_degrees: -1.0,
                ..KeyframeOptions::default()
            },
            KeyframeOptions {
                min_overlap: Some(1.0),
                ..KeyframeOptions::default()
            },
        ] {
            assert!(KeyframeSelector::new(&bad, scene(2.0)).is_err(), "{bad:?}");
        }
    }

    proptest! {
        #[test]
        fn keyframes_ascend_begin_with_the_first_and_leave_no_gap(
            steps in prop::collection::vec((0.0..0.3_f64, -4.0..4.0_f64), 1..80),
            sharpness in prop::collection::vec(prop::option::weighted(0.9, 0.1..2.0_f64), 80),
            window in 1_usize..6,
        ) {
            let (mut x, mut rotation) = (0.0, 0.0);
            let poses: Vec<_> = steps.iter().map(|(dx, dt)| { x += dx; rotation += dt; at(x, rotation) }).collect();
            let (keyframes, mut measured) = run(options(0.5, window), &poses, &sharpness);
            prop_assert_eq!(keyframes[0], 0);
            prop_assert!(keyframes.windows(2).all(|pair| pair[0] < pair[1]));
            let count = measured.len();
            measured.dedup();
            prop_assert_eq!(count, measured.len(), "measured twice");
            let motion = |from: usize, to: usize| {
                let moved = (poses[to].translation.vector - poses[from].translation.vector).norm();
                let turned = poses[to].rotation.angle_to(&poses[from].rotation).to_degrees();
                (moved / 0.5).max(turned / 10.0)
            };
            for pair in keyframes.windows(2) {
                // The first frame with enough motion is the keyframe, or at most one window before it.
                let first = (pair[0] + 1..=pair[1]).find(|&i| motion(pair[0], i) >= 1.0 - 1e-9);
                prop_assert!(first.is_some_and(|first| pair[1] - first < window), "{:?}", pair);
            }
        }
    }
}
