//! Errors that recordings are written with, for tests of what reads them.

use linecarve_lines::depth::DepthCorrection;
use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::load::DepthImage;

/// Side of the blocks of pixels that are wrong together.
const BLOCK: usize = 8;
/// By how much they are wrong, as a share of the depth, to either side.
const WRONG_BY: f32 = 0.4;

/// How pixels with wrong depth are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum WrongDepth {
    /// Like all others.
    #[default]
    Unmarked,
    /// With the lowest class of confidence, where the layout has confidence; all others with the highest.
    Marked,
    /// As unknown.
    Unknown,
}

/// Errors of the frames of a recording. All are drawn anew for each frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Disturbance {
    /// Largest relative error of the scale of depth, to either side.
    pub scale: f64,
    /// Largest shift of the depth, to either side, in units of the poses.
    pub shift: f64,
    /// RMS length of the error of positions, in units of the poses.
    pub translation: f64,
    /// RMS angle of the error of rotations, in radians.
    pub rotation: f64,
    /// Share of the pixels whose depth is wrong by 40 %, in blocks of 8 x 8.
    pub wrong: f64,
    /// How these are written.
    pub wrong_depth: WrongDepth,
    /// Seed of all errors.
    pub seed: u64,
}

/// The errors of one frame.
pub(super) struct FrameErrors {
    pub(super) motion: Isometry3<f64>,
    depth: DepthCorrection,
    random: ChaCha8Rng,
    wrong: f64,
    wrong_depth: WrongDepth,
}

impl Disturbance {
    /// The errors of a frame; they do not depend on other frames.
    pub(super) fn of_frame(&self, index: usize) -> FrameErrors {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(index as u64);
        let mut either_side = |size: f64| size * (2.0 * random.random::<f64>() - 1.0);
        let depth = DepthCorrection {
            scale: 1.0 + either_side(self.scale),
            inverse_shift: 0.0,
            shift: either_side(self.shift),
        };
        // A uniform distribution from -1 to 1 has the variance 1 / 3, as has each part of a vector of RMS length 1.
        let mut vector =
            |size: f64| Vector3::new(either_side(size), either_side(size), either_side(size));
        let motion = Isometry3::new(vector(self.translation), vector(self.rotation));
        FrameErrors {
            motion,
            depth,
            random,
            wrong: self.wrong,
            wrong_depth: self.wrong_depth,
        }
    }
}

impl FrameErrors {
    /// Disturbs a depth image. Returns the class of confidence of each pixel, if wrong ones are marked.
    pub(super) fn apply(mut self, depth: &mut DepthImage) -> Option<Vec<u8>> {
        if self.depth != DepthCorrection::IDENTITY {
            self.depth.apply(depth.samples_mut());
        }
        let (width, height) = (depth.width(), depth.height());
        let columns = width.div_ceil(BLOCK);
        let factors: Vec<Option<f32>> = (0..columns * height.div_ceil(BLOCK))
            .map(|_| {
                let is_wrong = self.random.random::<f64>() < self.wrong;
                let is_nearer = self.random.random::<bool>();
                let by = if is_nearer { -WRONG_BY } else { WRONG_BY };
                is_wrong.then_some(1.0 + by)
            })
            .collect();
        let mut classes = vec![2; width * height];
        let pixels = depth.samples_mut().iter_mut().zip(&mut classes);
        for (at, (depth, class)) in pixels.enumerate() {
            let block = at / width / BLOCK * columns + at % width / BLOCK;
            let Some(factor) = factors[block] else {
                continue;
            };
            *class = 0;
            *depth = match self.wrong_depth {
                WrongDepth::Unknown => 0.0,
                WrongDepth::Unmarked | WrongDepth::Marked => *depth * factor,
            };
        }
        (self.wrong_depth == WrongDepth::Marked).then_some(classes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_their_size_and_their_marks() {
        let disturbance = Disturbance {
            scale: 0.1,
            shift: 0.05,
            translation: 0.02,
            rotation: 0.01,
            wrong: 0.3,
            wrong_depth: WrongDepth::Marked,
            seed: 7,
        };
        let (mut squares, mut wrong) = ([0.0; 2], 0);
        for frame in 0..100 {
            let errors = disturbance.of_frame(frame);
            squares[0] += errors.motion.translation.vector.norm_squared();
            squares[1] += errors.motion.rotation.angle().powi(2);
            let mut depth = DepthImage::new(64, 48, vec![2.0; 64 * 48]).unwrap();
            let classes = errors.apply(&mut depth).unwrap();
            wrong += classes.iter().filter(|class| **class == 0).count();
            for (depth, class) in depth.samples().iter().zip(classes) {
                let share = if class == 0 { [0.5, 1.6] } else { [0.87, 1.13] };
                assert!(*depth >= 2.0 * share[0] && *depth <= 2.0 * share[1]);
            }
        }
        let rms = squares.map(|sum| f64::sqrt(sum / 100.0));
        assert!(
            (rms[0] - 0.02).abs() < 0.003 && (rms[1] - 0.01).abs() < 0.0015,
            "{rms:?}"
        );
        assert!((f64::from(wrong as u32) / (100.0 * 64.0 * 48.0) - 0.3).abs() < 0.02);
    }

    #[test]
    fn nothing_is_disturbed_by_default() {
        let mut depth = DepthImage::new(3, 1, vec![0.0, 1.7, 2.3]).unwrap();
        let errors = Disturbance::default().of_frame(5);
        assert_eq!(errors.motion, Isometry3::identity());
        assert_eq!(errors.apply(&mut depth), None);
        assert_eq!(depth.samples(), [0.0, 1.7, 2.3]);
    }
}
