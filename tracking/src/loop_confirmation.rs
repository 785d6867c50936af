//! Whether several keyframes find the place of a loop.

use nalgebra::Isometry3;

use crate::adjust::PoseEdge;
use crate::loops::{EDGE_SIGMA, FoundLoop, MAX_CHI2};
use crate::map::KeyframeId;
use crate::tracker::{Frame, Tracker};

/// Neighbours that must find the place, too: with the keyframe of the loop these are three.
pub(crate) const CONFIRMING: usize = 2;

/// Neighbours that are asked.
const MAX_ASKED: usize = 10;

/// Keyframes of the place among whose points a neighbour is sought: that of the loop, and those that share most points with it.
const MAX_SOUGHT: usize = 3;

impl Tracker {
    /// Whether at least `needed` neighbours of a keyframe find the place of its loop by themselves, and agree where it is.
    pub(crate) fn is_confirmed(
        &mut self,
        id: KeyframeId,
        found: &FoundLoop,
        needed: usize,
    ) -> bool {
        let reference = self.reference;
        let mut confirmed = 0;
        for other in self.map.neighbors(id, MAX_ASKED) {
            if confirmed >= needed {
                break;
            }
            confirmed += usize::from(self.confirms(other, id, found));
        }
        self.reference = reference;
        confirmed >= needed
    }

    /// Whether a keyframe finds the place of a loop of `id` where the motion between the two says that it is.
    fn confirms(&mut self, other: KeyframeId, id: KeyframeId, found: &FoundLoop) -> bool {
        let (keyframe, of_loop) = (self.map.keyframe(other), self.map.keyframe(id));
        let other_from_id = keyframe.camera_from_world * of_loop.camera_from_world.inverse();
        let view = keyframe.view.clone();
        let mut frame = Frame::new(keyframe.frame, view, Isometry3::identity());
        let around = self.map.neighbors(found.to(), MAX_SOUGHT - 1);
        let place = std::iter::once(found.to()).chain(around);
        let is_found = (200..).zip(place).any(|(stage, one)| {
            self.match_keyframe(&mut frame, one, stage)
                && self.track_local_map(&mut frame, 5.0)
                && self.track_local_map(&mut frame, 3.0)
                && frame.is_credible()
                && frame.inliers >= self.options.min_relocated
        });
        let depth = self.median_depth(id).unwrap_or(1.0);
        is_found
            && agrees(
                &other_from_id,
                &[*found.camera_from_world(), frame.camera_from_world],
                depth,
            )
    }
}

/// Whether two poses in the place of a loop differ by the motion between their keyframes. Each of the three is as uncertain as an edge of
/// the pose graph.
fn agrees(b_from_a: &Isometry3<f64>, a_and_b: &[Isometry3<f64>; 2], depth: f64) -> bool {
    let root = 3.0_f64.sqrt();
    let edge = PoseEdge {
        from: 0,
        to: 1,
        to_from: *b_from_a,
        sigma: [root * EDGE_SIGMA[0] * depth, root * EDGE_SIGMA[1]],
        is_robust: false,
    };
    edge.residual(a_and_b).norm_squared() <= MAX_CHI2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_agree_within_the_noise_of_three_motions() {
        let motion = Isometry3::translation(0.3, 0.0, 0.0);
        let a = Isometry3::rotation(nalgebra::Vector3::new(0.1, 0.7, 0.0));
        let moved = |by: f64| [a, Isometry3::translation(0.3 + by, 0.0, 0.0) * a];
        // 4.74 deviations of 1.73 times 0.01.
        assert!(agrees(&motion, &moved(0.0), 2.0));
        assert!(agrees(&motion, &moved(0.08), 2.0));
        assert!(!agrees(&motion, &moved(0.084), 2.0));
        assert!(!agrees(&motion, &moved(0.08), 1.0));
    }
}
