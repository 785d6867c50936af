//! Where keyframes are whose given poses disagree with their images.
//!
//! Images measure how neighbouring keyframes lie to each other, much better than poses that come from elsewhere. Over long distances
//! they drift: a focal length or lens that is slightly off bends the whole trajectory. The given poses bind the world: another sensor,
//! or whoever uses the surface, knows it by them.

use nalgebra::{Isometry3, Vector3, Vector6};

/// Keyframes on either side over which the given poses are averaged.
const REACH: usize = 4;
/// Farthest camera among them, in median depths.
const FARTHEST: f64 = 0.5;
/// Largest angle between viewing directions among them.
const LARGEST_TURN: f64 = 0.8;

/// Poses of keyframes in the world of the `given` poses, with the noise of single poses averaged out: each is the mean of where
/// the given poses of the keyframes around it put it, through the relative poses of `fitted`. Keyframes around are the four before and
/// after it that are near in the world, too.
///
/// # Complexity
/// Linear in the keyframes.
pub(super) fn placed(
    given: &[Isometry3<f64>],
    fitted: &[Isometry3<f64>],
    median_depth: f64,
) -> Vec<Isometry3<f64>> {
    let from_fitted = |position: usize| {
        let own = &fitted[position];
        let around = position.saturating_sub(REACH)..(position + REACH + 1).min(given.len());
        let (mut sum, mut count) = (Vector6::zeros(), 0.0);
        for other in around {
            let between = fitted[other].inv_mul(own);
            let is_near = between.translation.vector.norm() <= FARTHEST * median_depth
                && between.rotation.angle() <= LARGEST_TURN;
            if other != position && !is_near {
                continue;
            }
            // From the fitted to the placed camera.
            let moved = own.inv_mul(&(given[other] * between));
            let turn = moved.rotation.scaled_axis();
            let parts = moved.translation.vector.iter().chain(turn.iter());
            sum += Vector6::from_iterator(parts.copied());
            count += 1.0;
        }
        let mean = sum / count;
        let part = |first: usize| Vector3::new(mean[first], mean[first + 1], mean[first + 2]);
        own * Isometry3::new(part(0), part(3))
    };
    (0..given.len()).map(from_fitted).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(count: usize) -> Vec<Isometry3<f64>> {
        (0..count)
            .map(|i| {
                let t = i as f64;
                Isometry3::new(
                    Vector3::new(0.1 * t, 0.02 * t, 0.0),
                    Vector3::new(0.0, 0.03 * t, 0.01),
                )
            })
            .collect()
    }

    fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let between = a.inv_mul(b);
        between
            .translation
            .vector
            .norm()
            .max(between.rotation.angle())
    }

    #[test]
    fn poses_that_fit_stay_and_a_common_motion_of_the_fitted_ones_is_taken_back() {
        let given = path(20);
        for (placed, given) in placed(&given, &given, 2.0).iter().zip(&given) {
            assert!(distance(placed, given) < 1e-12);
        }
        let away = Isometry3::new(Vector3::new(0.5, -0.2, 1.0), Vector3::new(0.3, 0.1, -0.2));
        let fitted: Vec<Isometry3<f64>> = given.iter().map(|pose| away * pose).collect();
        for (placed, given) in placed(&given, &fitted, 2.0).iter().zip(&given) {
            assert!(distance(placed, given) < 1e-9);
        }
    }

    #[test]
    fn noise_of_given_poses_is_averaged_and_bends_of_fitted_ones_are_taken_back() {
        let truth = path(60);
        // Noise without a mean over a few keyframes, and a bend of three degrees over the path.
        let noise = |i: usize| 0.01 * [1.0, -2.0, 1.5, -0.5][i % 4];
        let given: Vec<Isometry3<f64>> = (0..60)
            .map(|i| truth[i] * Isometry3::new(Vector3::new(noise(i), 0.0, 0.0), Vector3::zeros()))
            .collect();
        let fitted: Vec<Isometry3<f64>> = (0..60)
            .map(|i| Isometry3::rotation(Vector3::new(0.0, 0.05 * i as f64 / 60.0, 0.0)) * truth[i])
            .collect();
        let placed = placed(&given, &fitted, 4.0);
        let worst = |poses: &[Isometry3<f64>]| {
            let pairs = poses.iter().zip(&truth).skip(REACH).take(60 - 2 * REACH);
            pairs
                .map(|(pose, truth)| distance(pose, truth))
                .fold(0.0, f64::max)
        };
        assert!(worst(&given) > 0.015 && worst(&fitted) > 0.04);
        assert!(worst(&placed) < 0.006, "{}", worst(&placed));
    }

    #[test]
    fn far_keyframes_do_not_count() {
        let fitted = [0.0, 0.1, 50.0].map(|x| Isometry3::translation(x, 0.0, 0.0));
        let mut given = fitted;
        given[2] = Isometry3::new(Vector3::new(50.0, 0.0, 0.0), Vector3::new(0.0, 0.1, 0.0));
        let placed = placed(&given, &fitted, 2.0);
        for (placed, given) in placed.iter().zip(&given) {
            assert!(distance(placed, given) < 1e-12);
        }
        assert!(super::placed(&[], &[], 2.0).is_empty());
    }
}
