//! Measurement noise of features, estimated from the reprojection errors that adjustment leaves.
//!
//! A standard deviation that is too large accepts matches that a wrong motion explains: where little of the image moves against the
//! rest, the map of one camera then drifts away from the images without contradiction.

use crate::camera::squared;
use crate::map::KeyframeId;
use crate::tracker::Tracker;
use linecarve_lines::upper_median;

/// Median of the squared length of two independent standard normal errors.
const MEDIAN_CHI2: f64 = 1.386;

/// Standard deviation that is used, relative to the measured one: errors of a new frame are larger than those after adjustment.
const MARGIN: f64 = 1.25;

/// Bounds of the standard deviation, relative to that of the options: a map that fits too well to be true is not believed, and the
/// options are an upper bound. Measured: 0.4 px on rendered rooms and the kitchen of 7-Scenes, 0.6 to 0.9 px on `tum-fr1-rpy`.
const BOUNDS: [f64; 2] = [0.5, 1.0];

/// Fewest points of a keyframe that measure it.
const MIN_POINTS: usize = 100;

impl Tracker {
    /// Standard deviation of new features at the finest level.
    pub(crate) fn feature_sigma_px(&self) -> f64 {
        self.noise * self.options.feature_sigma_px
    }

    /// Updates the running estimate by a keyframe that was adjusted, with a weight of 0 to 1. Only of one camera: with depth, the
    /// noise of features balances pixels against depths.
    pub(crate) fn learn_noise(&mut self, id: KeyframeId, gain: f64) {
        if !self.options.is_monocular {
            return;
        }
        if let Some(sigma_px) = self.measured_sigma_px(id) {
            let share = MARGIN * sigma_px / self.options.feature_sigma_px;
            let share = share.clamp(BOUNDS[0], BOUNDS[1]);
            self.noise += gain * (share - self.noise);
        }
    }

    /// Standard deviation of the features of a keyframe at the finest level, by the median of the errors of its points.
    fn measured_sigma_px(&self, id: KeyframeId) -> Option<f64> {
        let keyframe = self.map.keyframe(id);
        let mut errors: Vec<f64> = keyframe
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| {
                let in_camera = keyframe.camera_from_world * self.map.point((*point)?).position;
                let measurement = keyframe.view.measurement(feature as u32);
                let residual = measurement.residual(&self.camera, &in_camera)?;
                Some(squared(&residual).0)
            })
            .collect();
        if errors.len() < MIN_POINTS {
            return None;
        }
        let median = upper_median(&mut errors, f64::total_cmp)?;
        Some(keyframe.view.sigma_px() * (median / MEDIAN_CHI2).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use linecarve_points::{Descriptor, Features};
    use nalgebra::{Isometry3, Point3};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::frame::FrameDetector;
    use crate::options::TrackingOptions;
    use crate::tracker::Frame;

    /// A tracker with a keyframe whose features are off by errors of this standard deviation.
    fn with_errors(options: TrackingOptions, sigma_px: f64, count: usize) -> (Tracker, KeyframeId) {
        let camera = Camera::pinhole(500.0, 500.0, 319.5, 239.5).unwrap();
        let mut tracker = Tracker::new(options, &camera, 640, 480).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut features = Features::default();
        let mut positions = Vec::new();
        for _ in 0..count {
            let mut number = |most: f64| random.random_range(-most..most);
            let position = Point3::new(number(1.0), number(0.8), 3.0 + number(0.5));
            let pixel = tracker.camera.project_inside(&position).unwrap();
            // A sum of twelve uniform numbers is nearly normal.
            let mut error = || (0..12).map(|_| number(0.5)).sum::<f64>() * sigma_px;
            let [x, y] = [pixel.x + error(), pixel.y + error()];
            features.pixels.push([x as f32, y as f32]);
            features.octaves.push(0);
            features.angles_rad.push(0.0);
            features.descriptors.push(Descriptor([0; 4]));
            features.grey.push(0);
            positions.push(position);
        }
        let unknown = vec![None; count];
        let view = FrameDetector::new(&options).with_depths(features, unknown);
        let mut frame = Frame::new(0, view, Isometry3::identity());
        let id = tracker.insert_keyframe(&mut frame, 0);
        for (feature, position) in (0..).zip(positions) {
            tracker.map.insert_point(position, id, feature);
        }
        (tracker, id)
    }

    #[test]
    fn noise_is_measured_within_its_bounds() {
        let of = |sigma_px: f64| {
            let (mut tracker, id) = with_errors(TrackingOptions::monocular(), sigma_px, 2000);
            tracker.learn_noise(id, 1.0);
            tracker.feature_sigma_px()
        };
        assert!((of(0.6) - 0.75).abs() < 0.04, "{}", of(0.6));
        assert_eq!(of(0.1), 0.5);
        assert_eq!(of(3.0), 1.0);
    }

    #[test]
    fn depth_and_few_points_leave_the_noise_as_it_is() {
        let (mut tracker, id) = with_errors(TrackingOptions::default(), 0.3, 2000);
        tracker.learn_noise(id, 1.0);
        assert_eq!(tracker.feature_sigma_px(), 1.0);
        let (mut tracker, id) = with_errors(TrackingOptions::monocular(), 0.3, 99);
        tracker.learn_noise(id, 1.0);
        assert_eq!(tracker.feature_sigma_px(), 1.0);
    }
}
