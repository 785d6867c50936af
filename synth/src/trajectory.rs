//! The camera path of a scene: a smooth curve with hand-held motion.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use linecarve_mesh::render::upright_rotation;

/// Standard deviation of the hand's position.
const UNSTEADY_M: f64 = 0.012;
/// Standard deviation of the hand's direction.
const UNSTEADY_RAD: f64 = 0.012;
/// Oscillations of the hand along the path.
const SWINGS: [f64; 4] = [3.0, 5.0, 8.0, 13.0];

/// A curve with the parameter 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    /// Camera position.
    pub(super) eye: fn(f64) -> [f64; 3],
    /// Target point.
    pub(super) target: fn(f64) -> [f64; 3],
    /// Whether the path is closed, so that its end is not visited twice.
    pub(super) closed: bool,
}

/// The motion of a camera along a path, with the sway of a hand.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    path: Path,
    /// Amplitude and phase of each swing of each of six degrees of freedom.
    swings: Vec<[f64; 2]>,
    /// Frames from the start of the path to its end.
    length: f64,
}

impl Path {
    /// The motion in which this many frames, equally spaced in the parameter, reach along the path.
    pub(super) fn motion(&self, frames: u32, seed: u64) -> Motion {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Each of six degrees of freedom has a whole number of periods: a closed path stays closed.
        let swings = (0..6 * SWINGS.len())
            .map(|_| [random.random::<f64>(), random.random::<f64>()])
            .collect();
        let last = if self.closed {
            frames
        } else {
            frames.saturating_sub(1)
        };
        Motion {
            path: *self,
            swings,
            length: f64::from(last.max(1)),
        }
    }
}

impl Motion {
    /// The pose `world_from_camera` at the time of a frame, or between frames.
    pub(super) fn at(&self, frame: f64) -> Isometry3<f64> {
        let t = frame / self.length;
        let sway = |freedom: usize| -> f64 {
            SWINGS
                .iter()
                .zip(&self.swings[freedom * SWINGS.len()..])
                .map(|(swing, [amplitude, phase])| {
                    amplitude * (std::f64::consts::TAU * (swing * t + phase)).sin() / swing.sqrt()
                })
                .sum()
        };
        let eye = Point3::from((self.path.eye)(t));
        let target = Point3::from((self.path.target)(t));
        let steady = upright_rotation(&(target - eye), &Vector3::z());
        let shift = Vector3::from_fn(|axis, _| UNSTEADY_M * sway(axis));
        let turn = Vector3::from_fn(|axis, _| UNSTEADY_RAD * sway(3 + axis));
        Isometry3::from_parts(
            Translation3::from(eye.coords + shift),
            steady * UnitQuaternion::from_scaled_axis(turn),
        )
    }
}
