//! Dense alignment in tracking and mapping.

use std::sync::Arc;

use nalgebra::Isometry3;

use super::align::{Alignment, align};
use super::lines::{LineView, complete};
use super::view::DenseSurface;
use crate::frame::FrameFeatures;
use crate::map::{DenseMotion, KeyframeId};
use crate::tracker::{Frame, Tracker};

/// Neighbours of a new keyframe with which its depth image is aligned.
const NEIGHBORS: usize = 4;

/// Neighbours of each keyframe in the global adjustment.
const FINAL_NEIGHBORS: usize = 6;

/// An alignment counts when at least this share of the pixels inside the other image agrees, and this share of all pixels.
const MIN_AGREEING: f64 = 0.5;
const MIN_OVERLAP: f64 = 0.3;

/// The same for a pose without features.
const SURE_AGREEING: f64 = 0.7;
const SURE_OVERLAP: f64 = 0.5;

impl Tracker {
    /// Refines the pose of a frame with its features and with the alignment of its depth image with that of the reference
    /// keyframe.
    pub(crate) fn refine_densely(&mut self, frame: &mut Frame) {
        frame.dense = None;
        let reference = self.reference;
        let Some(surface) = self.surface_of_frame(frame) else {
            return;
        };
        let Some(other) = self.surface_of_reference() else {
            return;
        };
        let pose = self.map.keyframe(reference).camera_from_world;
        let start = frame.camera_from_world * pose.inverse();
        let Some(found) = credible(align(&other, &surface, other.depth, &start)) else {
            return;
        };
        let motion = self.motion_of(reference, &found);
        frame.dense = Some(motion);
        let start = frame.camera_from_world;
        let before = frame.clone();
        let inliers = self.refine_with(frame, &start, Some(&motion.prior(&pose)));
        if inliers < self.options.min_matches {
            *frame = before;
            frame.dense = None;
        } else {
            frame.inliers = inliers;
        }
    }

    /// Finds the pose of a frame with too few features by the depth images of the last frame and of the reference keyframe, and by lines
    /// where these leave it open.
    pub(crate) fn follow_densely(&mut self, frame: &mut Frame, last: &Frame) -> bool {
        let (Some(surface), Some(before)) =
            (self.surface_of_frame(frame), self.surface_of_frame(last))
        else {
            return false;
        };
        let starts = [self.velocity, Isometry3::identity()];
        let found = starts.iter().find_map(|start| {
            self.sure_motion([&last.view, &frame.view], [&before, &surface], start)
        });
        let Some(found) = found else {
            return false;
        };
        frame.points.fill(None);
        frame.camera_from_world = found * last.camera_from_world;
        // Alignment with the keyframe does not drift.
        let pose = self.map.keyframe(self.reference).camera_from_world;
        if let Some(other) = self.surface_of_reference() {
            let start = frame.camera_from_world * pose.inverse();
            let view = &self.map.keyframe(self.reference).view;
            let found = self.sure_motion([view, &frame.view], [&other, &surface], &start);
            if let Some(found) = found {
                frame.camera_from_world = found * pose;
            }
        }
        frame.inliers = 0;
        frame.agreeing = 0.0;
        true
    }

    /// The motion between two views, given their surfaces, that is believed without features.
    fn sure_motion(
        &self,
        views: [&FrameFeatures; 2],
        [from, to]: [&DenseSurface; 2],
        start: &Isometry3<f64>,
    ) -> Option<Isometry3<f64>> {
        let found = align(from, to, from.depth, start)?;
        if found.agreeing < SURE_AGREEING || found.overlap < SURE_OVERLAP {
            return None;
        }
        if found.determined == 6 {
            return Some(found.target_from_source);
        }
        let [source, target] = views.map(|view| view.image.as_deref());
        let source = LineView::new(source?, from, &self.camera);
        let target = LineView::new(target?, to, &self.camera);
        let information = found.information * self.options.dense_weight;
        complete(
            &self.camera,
            &source,
            &target,
            &found,
            &information,
            from.depth,
        )
    }

    /// Aligns the depth image of a keyframe with those of its neighbours.
    pub(crate) fn align_keyframe(&mut self, id: KeyframeId) {
        let motions = self.motions_of(id, NEIGHBORS, |_| true);
        self.map.keyframe_mut(id).motions = motions;
    }

    /// Aligns all keyframes of a sub-map with their neighbours anew.
    pub(crate) fn align_submap(&mut self, keyframes: &[KeyframeId]) {
        for &id in keyframes {
            let motions = self.motions_of(id, FINAL_NEIGHBORS, |other| other < id);
            self.map.keyframe_mut(id).motions = motions;
        }
    }

    fn motions_of(
        &self,
        id: KeyframeId,
        most: usize,
        is_wanted: impl Fn(KeyframeId) -> bool,
    ) -> Vec<DenseMotion> {
        let keyframe = self.map.keyframe(id);
        let Some(view) = keyframe.view.dense.as_ref().filter(|_| self.is_dense()) else {
            return Vec::new();
        };
        let surface = view.surface(&self.camera);
        let of_loops = keyframe.loops.iter().map(|(other, _)| *other);
        let neighbors = self.map.neighbors(id, usize::MAX);
        let mut others: Vec<KeyframeId> = neighbors
            .into_iter()
            .filter(|other| is_wanted(*other))
            .take(most)
            .collect();
        others.extend(of_loops.filter(|other| is_wanted(*other)));
        others.sort_unstable();
        others.dedup();
        others
            .into_iter()
            .filter_map(|other| {
                let reference = self.map.keyframe(other);
                let there = reference.view.dense.as_ref()?.surface(&self.camera);
                let start = keyframe.camera_from_world * reference.camera_from_world.inverse();
                let found = credible(align(&there, &surface, there.depth, &start))?;
                Some(self.motion_of(other, &found))
            })
            .collect()
    }

    pub(crate) fn is_dense(&self) -> bool {
        self.options.dense_weight > 0.0
    }

    fn motion_of(&self, reference: KeyframeId, found: &Alignment) -> DenseMotion {
        DenseMotion {
            reference,
            from_reference: found.target_from_source,
            information: found.information * self.options.dense_weight,
        }
    }

    fn surface_of_frame(&self, frame: &Frame) -> Option<DenseSurface> {
        let view = frame.view.dense.as_ref().filter(|_| self.is_dense())?;
        Some(view.surface(&self.camera))
    }

    /// The surface of the reference keyframe, which is kept as long as it is the reference.
    fn surface_of_reference(&mut self) -> Option<Arc<DenseSurface>> {
        let id = self.reference;
        if let Some((kept, surface)) = &self.reference_surface
            && *kept == id
        {
            return Some(Arc::clone(surface));
        }
        let view = self.map.keyframe(id).view.dense.as_ref()?;
        let surface = Arc::new(view.surface(&self.camera));
        self.reference_surface = Some((id, Arc::clone(&surface)));
        Some(surface)
    }
}

/// An alignment beside features.
fn credible(found: Option<Alignment>) -> Option<Alignment> {
    found.filter(|one| one.agreeing >= MIN_AGREEING && one.overlap >= MIN_OVERLAP)
}
