//! Whether the map of one camera agrees with the images: parts of it are compared with models made of nothing but matches.

use nalgebra::Isometry3;
use rayon::prelude::*;

use crate::frame::FrameFeatures;
use crate::initialise::Candidate;
use crate::map::KeyframeId;
use crate::records::{Contradiction, MapCheck};
use crate::tracker::Tracker;

/// Keyframes around which the map is compared, at most, and keyframes between them at least.
const MAX_PLACES: usize = 16;
const MIN_APART: usize = 4;

/// A model counts when clearly different ones have at least this cost relative to it, and this share of the observations agree.
const MIN_MARGIN: f64 = 1.5;
const MIN_EXPLAINED: f64 = 0.6;

/// The map contradicts a model when cameras are turned by more than this, in median. Directions do not tell: those of cameras that
/// hardly move are uncertain.
const MAX_TURN_DEGREES: f64 = 2.0;

impl Tracker {
    /// Compares the map of a sub-map with models around some of its keyframes.
    ///
    /// A wrong first map (two views of a plane have two solutions) is consistent in itself and keeps only the observations that fit it.
    /// The models begin with all matches, and with every relative pose that explains two views.
    pub(crate) fn check_map(&self, submap: u32) -> MapCheck {
        let mut keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
        keyframes.sort_by_key(|id| self.map.keyframe(*id).frame);
        let views: Vec<&FrameFeatures> = keyframes
            .iter()
            .map(|id| &self.map.keyframe(*id).view)
            .collect();
        let step = keyframes.len().div_ceil(MAX_PLACES).max(MIN_APART);
        let compare = |anchor: usize| {
            let candidate = Candidate::new(&self.camera, &views, anchor, None);
            let of_anchor = self.map.keyframe(keyframes[anchor]).camera_from_world;
            let in_map: Vec<Option<Isometry3<f64>>> = candidate
                .views()
                .iter()
                .map(|at| {
                    let pose = self.map.keyframe(keyframes[*at]).camera_from_world;
                    Some(pose * of_anchor.inverse())
                })
                .collect();
            let found = candidate.compare(in_map)?;
            let counts = found.margin >= MIN_MARGIN && found.explained >= MIN_EXPLAINED;
            counts.then_some((anchor, found))
        };
        let anchors: Vec<usize> = (step / 2..keyframes.len()).step_by(step).collect();
        let found: Vec<_> = anchors.into_par_iter().filter_map(compare).collect();
        let mut check = MapCheck::default();
        for (anchor, found) in found {
            let difference = found.difference;
            check.compared += 1;
            if difference.turn_degrees > MAX_TURN_DEGREES && found.relative_cost > MIN_MARGIN {
                check.contradictions.push(Contradiction {
                    frame: self.map.keyframe(keyframes[anchor]).frame,
                    turn_degrees: difference.turn_degrees,
                    direction_degrees: difference.direction_degrees,
                });
            } else {
                check
                    .confirmed
                    .push(self.map.keyframe(keyframes[anchor]).frame);
            }
        }
        check
    }
}
