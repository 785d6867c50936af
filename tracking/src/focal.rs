//! The focal length of a camera that nobody calibrated.

use linecarve_lines::camera::Camera;

use crate::camera::Pinhole;
use crate::map::KeyframeId;
use crate::tracker::Tracker;

/// Ratios of successive focal lengths that are tried, coarse to fine.
const RATIOS: [f64; 3] = [1.15, 1.05, 1.015];

/// Focal lengths tried in one direction with one ratio.
const MOST_IN_A_ROW: usize = 6;

/// Steps of an adjustment with another focal length.
const STEPS: usize = 40;

/// Fewest keyframes that determine a focal length.
const MIN_KEYFRAMES: usize = 6;

/// The sum of squared errors must grow by this share when the focal length changes by [`RATIOS`]`[0]`, or the recording does not
/// determine it.
const MIN_GROWTH: f64 = 0.02;

impl Tracker {
    /// Ends the run of one camera with an estimate of its focal length in pixels: that with which an adjustment of the largest
    /// sub-map leaves the smallest errors. `None` when no map was made, or when other focal lengths explain the images as well.
    ///
    /// Matches are those that agreed with the focal length of the tracker, so that an estimate far from it should be used to track and
    /// estimate again.
    pub fn estimate_focal(mut self) -> Option<f64> {
        self.start_at_end();
        let keyframes = (0..self.submaps)
            .map(|submap| self.map.keyframes_of(submap).collect::<Vec<KeyframeId>>())
            .max_by_key(Vec::len)?;
        if keyframes.len() < MIN_KEYFRAMES {
            return None;
        }
        let start = self.camera.fx;
        let mut known: Vec<(f64, f64)> = Vec::new();
        let mut cost = |focal: f64| match known.iter().find(|(other, _)| *other == focal) {
            Some((_, cost)) => *cost,
            None => {
                let cost = self.cost_with_focal(&keyframes, focal);
                known.push((focal, cost));
                cost
            }
        };
        let mut best = start;
        for ratio in RATIOS {
            for factor in [ratio, 1.0 / ratio] {
                for _ in 0..MOST_IN_A_ROW {
                    if cost(best * factor) >= cost(best) {
                        break;
                    }
                    best *= factor;
                }
            }
        }
        let least = (1.0 + MIN_GROWTH) * cost(best);
        let is_determined = [RATIOS[0], 1.0 / RATIOS[0]]
            .iter()
            .all(|factor| cost(best * factor) >= least);
        is_determined.then_some(best)
    }

    /// Sum of squared errors after an adjustment of some keyframes and their points with another focal length.
    fn cost_with_focal(&self, keyframes: &[KeyframeId], focal: f64) -> f64 {
        let (cx, cy) = (self.camera.cx, self.camera.cy);
        let Ok(camera) = Camera::pinhole(focal, focal, cx, cy) else {
            return f64::INFINITY;
        };
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let camera = Pinhole::new(&camera, width, height);
        let mut problem = self.problem(keyframes, &camera);
        let [_, cost] = problem.bundle.minimise(STEPS);
        cost
    }
}
