//! The first map of one camera: from the views among many that determine it best.

mod candidate;
mod local_model;

use rayon::prelude::*;

use crate::frame::FrameFeatures;
use crate::map::KeyframeId;
use crate::tracker::{Frame, Tracker};
pub(crate) use candidate::Candidate;
use candidate::Start;

/// Views that are tried as anchors, evenly over the views.
pub(crate) const ANCHORS: usize = 12;

/// Views that are tried where frames are answered as they come, over the newer half: the older ones were tried before.
const EARLY_ANCHORS: usize = 4;

/// Anchors whose models are made: those with most parallax.
const MAX_STARTS: usize = 6;

/// Steps of the first adjustment.
const STEPS: [usize; 2] = [20, 20];

impl Tracker {
    /// Starts a map from some of the views, whose frame numbers begin at `first`. Returns frames of the map by position, that of
    /// the anchor first; `None` when no views determine a map, or `is_early` and they do not do so clearly.
    pub(crate) fn start_from_views(
        &mut self,
        views: &[FrameFeatures],
        first: u32,
        is_early: bool,
    ) -> Option<Vec<(usize, Frame, KeyframeId)>> {
        let camera = self.camera.clone();
        let of_views: Vec<&FrameFeatures> = views.iter().collect();
        let start = match self.options.start_pair {
            Some(pair) => {
                let position = |number: u32| {
                    let at = number.checked_sub(first)? as usize;
                    (at < views.len()).then_some(at)
                };
                let [a, b] = [position(pair[0])?, position(pair[1])?];
                Candidate::new(&camera, &of_views, a, Some(b)).solve()?
            }
            None => {
                let (oldest, anchors) = match is_early {
                    true => (views.len() / 2, EARLY_ANCHORS),
                    false => (0, ANCHORS),
                };
                let step = (views.len() - oldest).div_ceil(anchors).max(1);
                let anchors: Vec<usize> = (oldest..views.len()).step_by(step).collect();
                let mut candidates: Vec<Candidate> = anchors
                    .into_par_iter()
                    .map(|anchor| Candidate::new(&camera, &of_views, anchor, None))
                    .collect();
                candidates.sort_by(|a, b| b.parallax().total_cmp(&a.parallax()));
                candidates.truncate(MAX_STARTS);
                let starts: Vec<Start> = candidates
                    .into_par_iter()
                    .filter_map(Candidate::solve)
                    .collect();
                starts
                    .into_iter()
                    .filter(|start| !is_early || start.is_clear())
                    .max_by(|a, b| a.worth().total_cmp(&b.worth()))?
            }
        };
        Some(self.insert_start(views, first, &start))
    }

    /// Inserts the keyframes and their points, adjusts them, and makes the median depth one.
    fn insert_start(
        &mut self,
        views: &[FrameFeatures],
        first: u32,
        start: &Start<'_>,
    ) -> Vec<(usize, Frame, KeyframeId)> {
        let submap = self.submaps;
        self.submaps += 1;
        let mut inserted: Vec<(usize, Frame, KeyframeId)> = Vec::new();
        let mut id_of = vec![None; start.views.len()];
        for (view, pose) in start.model.poses.iter().enumerate() {
            let Some(pose) = pose else { continue };
            let at = start.views[view];
            let mut frame = Frame::new(first + at as u32, views[at].clone(), *pose);
            let id = self.insert_keyframe(&mut frame, submap);
            id_of[view] = Some(id);
            inserted.push((at, frame, id));
        }
        for track in 0..start.model.points.len() {
            let Some(position) = start.model.points[track] else {
                continue;
            };
            let seen: Vec<(KeyframeId, u32)> = start
                .matches
                .track(track)
                .iter()
                .filter(|seen| start.matches.agrees(&start.model, track, **seen))
                .filter_map(|(view, feature)| Some((id_of[*view]?, *feature)))
                .collect();
            let [(keyframe, feature), others @ ..] = &*seen else {
                continue;
            };
            if others.is_empty() {
                continue;
            }
            let point = self.map.insert_point(position, *keyframe, *feature);
            for (keyframe, feature) in others {
                self.map.add_observation(point, *keyframe, *feature);
            }
            self.map.update_point(point);
        }
        let ids: Vec<KeyframeId> = inserted.iter().map(|(_, _, id)| *id).collect();
        for id in &ids[1..] {
            self.map.keyframe_mut(*id).parent = Some(ids[0]);
        }
        self.adjust(&ids, STEPS);
        self.learn_noise(ids[0], 1.0);
        let sigma_px = self.feature_sigma_px();
        for id in &ids {
            self.map.keyframe_mut(*id).view.set_sigma_px(sigma_px);
        }
        let depth = self.median_depth(ids[0]).unwrap_or(1.0);
        self.map.rescale(1.0 / depth);
        for id in &ids {
            self.map.update_neighbors(*id);
        }
        for (_, frame, id) in &mut inserted {
            self.reference = *id;
            frame.camera_from_world = self.map.keyframe(*id).camera_from_world;
            frame.points.clone_from(&self.map.keyframe(*id).points);
            frame.inliers = frame.matched();
            self.record(frame);
        }
        inserted
    }
}
