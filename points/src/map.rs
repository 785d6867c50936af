//! The incremental map of points.

use linecarve_lines::camera::Camera;
use linecarve_lines::upper_median;
use nalgebra::{Isometry3, Point3};

use super::changes::MapChange;
use super::estimate_lens::LENS_KEYFRAMES;
use super::explanation::HeldBackErrors;
use super::features::Features;
use super::keyframe::MapKeyframe;
use super::options::{MapPointOptions, PointOptionsError};
use super::point::{MapObservation, MapPoint, MapPointId};
use super::rolling_shutter::CameraMotion;
use crate::pose_correction::{CorrectedLens, PoseCorrectionOptions};

/// Map points of keyframes with known poses, built keyframe by keyframe.
///
/// [`push`](Self::push) follows the local mapping of ORB-SLAM2. Known points are matched with features near their projections.
/// Features without a point are matched along epipolar lines with the keyframes that share most points, and triangulated.
/// Affected points are refined and outliers dropped. Points with too few observations are culled.
///
/// Poses are corrected by the points within their uncertainty, unless pose correction is off. The same keyframes give the same
/// map.
///
/// # Complexity
/// A keyframe projects every point of the map; all other work depends on the points in view. Memory: about 100 kB per keyframe
/// of 2000 features.
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, "ORB-SLAM2: an open-source SLAM system for monocular, stereo and RGB-D cameras", IEEE
/// Transactions on Robotics 33(5), 2017, and "ORB-SLAM", 31(5), 2015, section VI. *Differs:* poses are given, so matching uses
/// whole epipolar lines in place of a vocabulary, and predicted orientations in place of a histogram. An inlier must agree
/// within the joint uncertainty of point, feature and pose. The relative uncertainty of a point is bounded.
#[derive(Debug, Clone)]
pub struct PointMap {
    pub(super) options: MapPointOptions,
    pub(super) correction: PoseCorrectionOptions,
    /// The pinhole camera of undistorted features.
    pub(super) camera: Camera,
    /// The camera of the images, with distortion.
    pub(super) lens: CorrectedLens,
    /// Width and height of the images.
    pub(super) size: [f64; 2],
    pub(super) keyframes: Vec<MapKeyframe>,
    /// Points by id; `None` after removal.
    pub(super) points: Vec<Option<Box<MapPoint>>>,
    /// Ids of the existing points, ascending.
    pub(super) living: Vec<MapPointId>,
    /// Young points that may still be culled.
    pub(super) on_probation: Vec<MapPointId>,
    /// Points to be refined.
    pub(super) dirty: Vec<MapPointId>,
    /// Points that may differ from their published state.
    pub(super) touched: Vec<MapPointId>,
    /// Published points that were removed.
    pub(super) withdrawn: Vec<MapPointId>,
    pub(super) changes: Vec<MapChange>,
    /// Motion of the camera at each keyframe, where it is known.
    pub(super) motions: Vec<Option<CameraMotion>>,
    /// Readout of a rolling shutter that was recognised.
    pub(super) readout: Option<f64>,
    /// Errors of the rival explanations of the images; `None` before the adjustment of all keyframes.
    pub(super) held_back_errors: Option<HeldBackErrors>,
}

/// Effect of one keyframe on the map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Features of the image.
    pub features: usize,
    /// Known points observed again.
    pub observed_again: usize,
    /// New points.
    pub created: usize,
    /// Culled points.
    pub removed: usize,
    /// Established points after this keyframe.
    pub established: usize,
}

/// Reprojection errors of the established points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MapQuality {
    /// Established points.
    pub points: usize,
    /// Observations of these points.
    pub observations: usize,
    /// Root mean square of their reprojection errors.
    pub reprojection_rms_px: f64,
    /// Median of their reprojection errors.
    pub reprojection_median_px: f64,
}

impl PointMap {
    /// An empty map for images of `width` by `height` pixels of a pinhole `camera`. [`PoseCorrectionOptions::off`] keeps poses as
    /// given.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        options: MapPointOptions,
        correction: PoseCorrectionOptions,
        camera: &Camera,
        width: usize,
        height: usize,
    ) -> Result<Self, PointOptionsError> {
        options.validate()?;
        correction.validate()?;
        Ok(Self {
            options,
            correction,
            camera: camera.clone(),
            lens: CorrectedLens::new(camera.clone()),
            size: [width as f64, height as f64],
            keyframes: Vec::new(),
            points: Vec::new(),
            living: Vec::new(),
            on_probation: Vec::new(),
            dirty: Vec::new(),
            touched: Vec::new(),
            withdrawn: Vec::new(),
            changes: Vec::new(),
            motions: Vec::new(),
            readout: None,
            held_back_errors: None,
        })
    }

    /// Adds a keyframe. [`changes`](Self::changes) then holds the changes of established points.
    ///
    /// A keyframe whose pose is not finite is counted but has no observations.
    pub fn push(
        &mut self,
        world_from_camera: &Isometry3<f64>,
        mut features: Features,
    ) -> PointCounts {
        let number = self.keyframes.len() as u32;
        let is_finite = world_from_camera
            .to_homogeneous()
            .iter()
            .all(|x| x.is_finite());
        if !is_finite {
            features = Features::default();
        }
        let mut counts = PointCounts {
            features: features.len(),
            ..PointCounts::default()
        };
        let pose_sigma_px = if self.correction.enabled {
            self.correction.sigma_px
        } else {
            self.options.pose_sigma_px
        };
        let mut new = MapKeyframe::new(*world_from_camera, features, pose_sigma_px);
        new.undistort(self.lens.camera(), &self.camera);
        self.keyframes.push(new);
        self.motions.push(None);
        if is_finite {
            if self.correction.enabled {
                self.correct_new_pose(number);
            }
            counts.observed_again = self.match_known_points(number);
            self.refine_dirty();
            counts.created = self.create_points(number);
            self.refine_dirty();
            if self.correction.enabled {
                let was_known = self.is_corrected(number);
                self.adjust_local(number);
                self.refine_dirty();
                if !was_known && self.is_corrected(number) {
                    // Match again under the corrected pose.
                    counts.created += self.create_points(number);
                    self.refine_dirty();
                }
                if self.correction.lens && LENS_KEYFRAMES.contains(&self.keyframes.len()) {
                    self.estimate_lens();
                }
            }
        }
        let before = self.living.len();
        self.cull(number);
        self.living
            .retain(|id| self.points[id.0 as usize].is_some());
        counts.removed = before - self.living.len();
        self.publish();
        counts.established = self.established().count();
        counts
    }

    /// Says how the camera moved at a keyframe, so that a rolling shutter can be recognised.
    pub fn set_motion(&mut self, keyframe: u32, motion: CameraMotion) {
        self.motions[keyframe as usize] = motion.iter().all(|x| x.is_finite()).then_some(motion);
    }

    /// The options of the map.
    pub fn options(&self) -> &MapPointOptions {
        &self.options
    }

    /// Changes by the last keyframe or adjustment, in their order.
    pub fn changes(&self) -> &[MapChange] {
        &self.changes
    }

    /// The keyframes, in order.
    pub fn keyframes(&self) -> &[MapKeyframe] {
        &self.keyframes
    }

    /// A point; `None` after its removal.
    pub fn point(&self, id: MapPointId) -> Option<&MapPoint> {
        self.points.get(id.0 as usize)?.as_deref()
    }

    /// The established points, by id.
    pub fn established(&self) -> impl Iterator<Item = (MapPointId, &MapPoint)> {
        self.living
            .iter()
            .filter_map(|&id| Some((id, self.point(id)?)))
            .filter(|(_, point)| point.is_established)
    }

    /// Median depth of the established points in the keyframes that observe them; `None` without points.
    pub fn median_depth(&self) -> Option<f64> {
        let mut depths: Vec<f64> = self
            .established()
            .flat_map(|(_, point)| {
                point.observations.iter().map(|observation| {
                    let keyframe = &self.keyframes[observation.keyframe as usize];
                    (keyframe.camera_from_world() * point.point_in_world).z
                })
            })
            .collect();
        upper_median(&mut depths, f64::total_cmp)
    }

    /// Reprojection errors of the established points.
    pub fn quality(&self) -> MapQuality {
        let mut distances = Vec::new();
        let mut points = 0;
        for (_, point) in self.established() {
            points += 1;
            distances.extend(point.observations.iter().filter_map(|observation| {
                let keyframe = &self.keyframes[observation.keyframe as usize];
                let pixel = self
                    .camera
                    .project(&(keyframe.camera_from_world() * point.point_in_world))?;
                Some((pixel - keyframe.pixel(observation.feature)).norm())
            }));
        }
        let observations = distances.len();
        if observations == 0 {
            return MapQuality::default();
        }
        let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
        MapQuality {
            points,
            observations,
            reprojection_rms_px: (squares / observations as f64).sqrt(),
            reprojection_median_px: upper_median(&mut distances, f64::total_cmp).unwrap_or(0.0),
        }
    }

    /// The established points where the carver has them, each with the grey value of its first feature.
    pub fn carved_points(&self) -> impl Iterator<Item = (Point3<f64>, u8)> {
        self.established().map(|(_, point)| {
            let first = point.observations[0];
            let features = &self.keyframes[first.keyframe as usize].features;
            let carved = point.published.as_ref();
            let position = carved.map_or(point.point_in_world, |p| p.point_in_world);
            (position, features.grey[first.feature as usize])
        })
    }

    /// Adds a point and assigns its features.
    pub(super) fn insert(&mut self, point: MapPoint) -> MapPointId {
        let id = MapPointId(self.points.len() as u32);
        for observation in &point.observations {
            self.assign(*observation, Some(id));
        }
        self.points.push(Some(Box::new(point)));
        self.living.push(id);
        self.on_probation.push(id);
        self.dirty.push(id);
        id
    }

    /// Removes a point and unassigns its features.
    pub(super) fn remove(&mut self, id: MapPointId) {
        let Some(point) = self.points[id.0 as usize].take() else {
            return;
        };
        for observation in &point.observations {
            self.assign(*observation, None);
        }
        if point.published.is_some() {
            self.withdrawn.push(id);
        }
    }

    /// Adds an observation to a point.
    pub(super) fn add_observation(&mut self, id: MapPointId, observation: MapObservation) {
        if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
            point.add_observation(observation);
            self.assign(observation, Some(id));
            self.dirty.push(id);
        }
    }

    pub(super) fn assign(&mut self, observation: MapObservation, point: Option<MapPointId>) {
        let keyframe = &mut self.keyframes[observation.keyframe as usize];
        keyframe.points[observation.feature as usize] = point;
    }

    pub(super) fn center(&self, keyframe: u32) -> Point3<f64> {
        self.keyframes[keyframe as usize].center()
    }
}

#[cfg(test)]
mod tests;
