//! The streaming decision: keyframes by motion, the sharpest of a few.

use std::collections::VecDeque;

use nalgebra::Isometry3;

use super::options::{KeyframeOptions, KeyframeOptionsError};
use super::overlap::PlanarScene;

/// Candidates behind the first of a window are only those that have moved no further than this many times what makes a
/// keyframe: a sharper image must not open a gap.
const MAX_MOTION: f64 = 1.5;

/// Chooses keyframes from a stream of frames. The first frame is one, at once; the next is sought among the few frames
/// from the first that has moved enough since, and so on.
///
/// Memory: one window of poses and sharpness values.
#[derive(Debug, Clone)]
pub(super) struct KeyframeSelector {
    options: KeyframeOptions,
    scene: PlanarScene,
    last_keyframe: Option<Isometry3<f64>>,
    /// Frames since the last keyframe about which nothing is decided, at most a window.
    pending: VecDeque<Candidate>,
}

#[derive(Debug, Clone)]
struct Candidate {
    frame: usize,
    world_from_camera: Isometry3<f64>,
    /// Measured at most once; the inner `None` is an image that cannot be read.
    sharpness: Option<Option<f64>>,
}

impl KeyframeSelector {
    /// A selector that has seen no frame.
    ///
    /// # Errors
    /// When an option is out of range.
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

    /// ImageSamples at the next frame; appends the keyframes that are thereby decided, which may be earlier frames.
    ///
    /// `measure` gives the sharpness of a frame, `None` when its image cannot be read. It is asked only when frames are
    /// to be compared. An unreadable frame is chosen only when its whole window is unreadable, so that the fault shows.
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

    /// The stream is over: appends the keyframes of windows that have begun.
    pub(super) fn finish(
        mut self,
        measure: &mut dyn FnMut(usize) -> Option<f64>,
        keyframes: &mut Vec<usize>,
    ) {
        self.decide(true, measure, keyframes);
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
            // Those before it are passed over; those behind it may still become keyframes of their own.
            if let Some(keyframe) = self.pending.drain(..=chosen).next_back() {
                self.last_keyframe = Some(keyframe.world_from_camera);
                keyframes.push(keyframe.frame);
            }
        }
    }

    /// How many frames from the front compete; `None` when there is none or more must be awaited.
    fn window(&self, is_end: bool) -> Option<usize> {
        if self.pending.is_empty() {
            return None;
        }
        // Everything after the first frame is compared with it: it cannot wait for a sharper one.
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

    /// The position of the sharpest of the first `count` frames, of equal ones the earliest.
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

    /// How far a pose is from the last keyframe, 1 where it becomes the next; infinite when there is none yet.
    fn motion(&self, world_from_camera: &Isometry3<f64>) -> f64 {
        let Some(last) = &self.last_keyframe else {
            return f64::INFINITY;
        };
        let camera_from_last = world_from_camera.inverse() * last;
        // A threshold of 0 is passed by every frame.
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

    fn at(x: f64, turn_degrees: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::y() * turn_degrees.to_radians());
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

    /// The keyframes of a path before a scene at depth 2, and the frames whose sharpness was asked for.
    fn run(
        options: KeyframeOptions,
        poses: &[Isometry3<f64>],
        sharpness: &[Option<f64>],
    ) -> (Vec<usize>, Vec<usize>) {
        let mut selector = KeyframeSelector::new(&options, scene(2.0)).unwrap();
        let (mut keyframes, mut asked) = (Vec::new(), Vec::new());
        let mut measure = |frame: usize| {
            asked.push(frame);
            sharpness.get(frame).copied().unwrap_or(Some(1.0))
        };
        for (frame, pose) in poses.iter().enumerate() {
            selector.push(frame, pose, &mut measure, &mut keyframes);
            assert!(selector.pending.len() < options.sharpness_window.max(1));
        }
        selector.finish(&mut measure, &mut keyframes);
        (keyframes, asked)
    }

    #[test]
    fn without_a_window_the_first_frame_that_has_moved_is_taken_and_none_is_decoded() {
        let (keyframes, asked) = run(options(0.5, 1), &along_x(0.25, 10), &[]);
        assert_eq!(keyframes, [0, 2, 4, 6, 8]);
        assert!(asked.is_empty());
    }

    #[test]
    fn turning_is_motion_too() {
        let poses: Vec<_> = (0..10).map(|i| at(0.0, 4.0 * f64::from(i))).collect();
        assert_eq!(run(options(1.0, 1), &poses, &[]).0, [0, 3, 6, 9]);
    }

    #[test]
    fn losing_sight_is_motion_too() {
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
        // 4 is the first that has moved by 0.39, 5 is sharper; from there on all are equal.
        let (keyframes, asked) = run(options(0.39, 2), &along_x(0.1, 12), &sharpness);
        assert_eq!(keyframes, [0, 5, 9]);
        assert_eq!(asked, [4, 5, 9, 10]);
    }

    #[test]
    fn a_sharper_image_far_away_opens_no_gap() {
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
            let (mut x, mut turn) = (0.0, 0.0);
            let poses: Vec<_> = steps.iter().map(|(dx, dt)| { x += dx; turn += dt; at(x, turn) }).collect();
            let (keyframes, mut asked) = run(options(0.5, window), &poses, &sharpness);
            prop_assert_eq!(keyframes[0], 0);
            prop_assert!(keyframes.windows(2).all(|pair| pair[0] < pair[1]));
            let count = asked.len();
            asked.dedup();
            prop_assert_eq!(count, asked.len(), "measured twice");
            let motion = |from: usize, to: usize| {
                let moved = (poses[to].translation.vector - poses[from].translation.vector).norm();
                let turned = poses[to].rotation.angle_to(&poses[from].rotation).to_degrees();
                (moved / 0.5).max(turned / 10.0)
            };
            for pair in keyframes.windows(2) {
                // The first frame that had moved enough is the keyframe or at most a window before it.
                let first = (pair[0] + 1..=pair[1]).find(|&i| motion(pair[0], i) >= 1.0 - 1e-9);
                prop_assert!(first.is_some_and(|first| pair[1] - first < window), "{:?}", pair);
            }
        }
    }
}
