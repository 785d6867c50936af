//! Where features see their points, to a fraction of a pixel: patches are aligned with that of the first keyframe that saw the point and has one.

use nalgebra::Isometry3;

use crate::camera::Measurement;
use crate::frame::{Alignment, FrameFeatures, level_scale};
use crate::map::{KeyframeId, PointId};
use crate::patches::{Template, plane_warp};
use crate::tracker::{Frame, Tracker};

impl Tracker {
    /// Where a frame sees its points, with aligned matches.
    pub(crate) fn seen(&self, frame: &Frame) -> Vec<(PointId, Measurement)> {
        let pose = &frame.camera_from_world;
        let seen = (0..).zip(&frame.points).filter_map(|(feature, point)| {
            let point = (*point)?;
            let alignment = match frame.view.patches.is_empty() {
                true => Alignment::Pending,
                false => {
                    let template = self.template_of(point);
                    self.alignment(&frame.view, feature, pose, point, template)
                }
            };
            Some((point, frame.view.measurement_at(feature, alignment)))
        });
        seen.collect()
    }

    /// Aligns what a keyframe sees and was not aligned yet.
    pub(crate) fn align_observations(&mut self, id: KeyframeId) {
        for feature in 0..self.map.keyframe(id).view.patches.len() as u32 {
            let keyframe = self.map.keyframe(id);
            let Some(point) = keyframe.points[feature as usize] else {
                continue;
            };
            if keyframe.view.alignment(feature) != Alignment::Pending {
                continue;
            }
            let alignment = match self.template_of(point) {
                // The feature that a point is aligned with is where it is.
                Some((first, _)) if first == id => Alignment::Found([0.0; 2]),
                template => {
                    let pose = &keyframe.camera_from_world;
                    self.alignment(&keyframe.view, feature, pose, point, template)
                }
            };
            let view = &mut self.map.keyframe_mut(id).view;
            view.set_alignment(feature, alignment);
        }
    }

    fn alignment(
        &self,
        view: &FrameFeatures,
        feature: u32,
        camera_from_world: &Isometry3<f64>,
        point: PointId,
        template: Option<(KeyframeId, u32)>,
    ) -> Alignment {
        let shift = template
            .and_then(|template| self.shift(view, feature, camera_from_world, point, template));
        shift.map_or(Alignment::Failed, Alignment::Found)
    }

    /// Where a point is from the feature of a view that sees it, in pixels of the level.
    fn shift(
        &self,
        view: &FrameFeatures,
        feature: u32,
        camera_from_world: &Isometry3<f64>,
        point: PointId,
        (keyframe, first): (KeyframeId, u32),
    ) -> Option<[f32; 2]> {
        let point = self.map.point(point);
        let keyframe = self.map.keyframe(keyframe);
        let patch = keyframe.view.patch(first)?;
        let pose = &keyframe.camera_from_world;
        let warp = plane_warp(
            &self.camera,
            &(camera_from_world * pose.inverse()),
            &(pose * point.position),
        )?;
        let scale = level_scale(view.octave(feature)) / level_scale(keyframe.view.octave(first));
        let step = warp.try_inverse()? * scale;
        let known = match keyframe.view.alignment(first) {
            Alignment::Found(shift) => shift,
            _ => [0.0; 2],
        };
        Template::new(patch, known, &step)?.find(view.patch(feature)?)
    }

    /// The first keyframe that sees a point and has the patch around it, and the feature there.
    fn template_of(&self, point: PointId) -> Option<(KeyframeId, u32)> {
        let mut seen = self.map.point(point).observations.iter();
        seen.find(|(keyframe, feature)| self.map.keyframe(*keyframe).view.patch(*feature).is_some())
            .copied()
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use nalgebra::Point3;

    use super::*;
    use crate::frame::FrameDetector;
    use crate::options::TrackingOptions;
    use crate::stereo::tests::image;

    /// A tracker with two keyframes before a wall that moves by `disparity` pixels, whose points are where the first sees them.
    fn two_keyframes(options: TrackingOptions, disparity: f64) -> (Tracker, [KeyframeId; 2]) {
        let camera = Camera::pinhole(300.0, 300.0, 159.5, 119.5).unwrap();
        let mut tracker = Tracker::new(options, &camera, 320, 240).unwrap();
        let detector = FrameDetector::new(&options);
        let views = [image(0.0, 1.0, 0.0), image(disparity, 0.9, 8.0)]
            .map(|image| detector.detect(&image, None));
        let ids = [0, 1].map(|number| {
            let shift = -disparity / 300.0 * 2.0 * f64::from(number);
            let pose = Isometry3::translation(shift, 0.0, 0.0);
            let view = views[number as usize].clone();
            tracker.insert_keyframe(&mut Frame::new(number, view, pose), 0)
        });
        for first in 0..views[0].len() as u32 {
            let pixel = views[0].pixel(first);
            let position = Point3::from(tracker.camera.ray(&pixel) * 2.0);
            let point = tracker.map.insert_point(position, ids[0], first);
            let distance = |at: u32| {
                let offset = views[1].pixel(at) - pixel;
                (offset.x + disparity).hypot(offset.y)
            };
            let second = (0..views[1].len() as u32)
                .filter(|at| views[1].octave(*at) == views[0].octave(first))
                .min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
            if let Some(second) = second.filter(|at| distance(*at) < 1.2) {
                tracker.map.add_observation(point, ids[1], second);
            }
        }
        (tracker, ids)
    }

    /// The errors of the second of [`two_keyframes`] once observations are aligned.
    fn errors(options: TrackingOptions, disparity: f64) -> Vec<f64> {
        let (mut tracker, ids) = two_keyframes(options, disparity);
        for id in ids {
            tracker.align_observations(id);
        }
        tracker.map.check().unwrap();
        let second = tracker.map.keyframe(ids[1]);
        let mut errors: Vec<f64> = (0..)
            .zip(&second.points)
            .filter_map(|(feature, point)| {
                let position = tracker.map.point((*point)?).position;
                let pixel = tracker
                    .camera
                    .project(&(second.camera_from_world * position))?;
                Some((pixel - second.view.pixel(feature)).norm())
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors.len() > 150, "{}", errors.len());
        errors
    }

    #[test]
    fn observations_move_to_where_the_first_keyframe_saw_them() {
        let median = |options| {
            let errors = errors(options, 7.4);
            errors[errors.len() / 2]
        };
        let aligned = median(TrackingOptions::monocular());
        let as_found = median(TrackingOptions {
            aligns_matches: false,
            ..TrackingOptions::monocular()
        });
        assert!(aligned < 0.05 && as_found > 0.15, "{aligned} {as_found}");
    }

    #[test]
    fn dropped_patches_are_not_missed() {
        let (mut tracker, [first, second]) = two_keyframes(TrackingOptions::monocular(), 7.4);
        tracker.map.keyframe_mut(second).drop_images();
        let keyframe = tracker.map.keyframe(second);
        for (feature, point) in (0..).zip(&keyframe.points) {
            assert_eq!(keyframe.view.patch(feature).is_some(), point.is_some());
        }
        let dropped = (0..).zip(&keyframe.points).filter(|(_, p)| p.is_none());
        assert!(dropped.count() > 20);
        let of_point = |(at, point): (usize, &Option<PointId>)| Some((at, (*point)?));
        let (feature, point) = (keyframe.points.iter().enumerate())
            .find_map(of_point)
            .unwrap();
        let in_first = tracker.map.point(point).feature_in(first).unwrap();
        tracker.map.keyframe_mut(first).view.patches[in_first as usize] = None;
        for id in [first, second] {
            tracker.align_observations(id);
        }
        // The second is the first that has a patch.
        let alignment = |id, feature| tracker.map.keyframe(id).view.alignment(feature);
        assert_eq!(alignment(first, in_first), Alignment::Failed);
        assert_eq!(
            alignment(second, feature as u32),
            Alignment::Found([0.0; 2])
        );
    }
}
