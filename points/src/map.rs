//! The map of points, one keyframe after another.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};

use super::changes::MapChange;
use super::features::Features;
use super::keyframe::MapKeyframe;
use super::lens::LOOK_AT;
use super::options::{MapPointOptions, PointOptionsError};
use super::point::{MapObservation, MapPoint, MapPointId};
use crate::pose_correction::{CorrectedLens, PoseCorrectionOptions};
use linecarve_sequence::{ModelObservation, ModelPoint, ModelView, SparseModel};

/// Points that several keyframes see, found in their images under known poses.
///
/// Each keyframe is taken through the same steps, after those of local mapping in ORB-SLAM2: points whose projection falls
/// on a feature like them are seen again; features that are no point yet are matched with those of the keyframes that share
/// most points, and triangulated; points touched are refined, wrong sightings dropped; points that too few keyframes see
/// are given up.
///
/// Poses are corrected by the points, each within what it may be wrong by, unless that is switched off; then only points move.
/// The same keyframes give the same map.
///
/// # Complexity
/// A keyframe costs a projection of every living point; what else it costs depends on the points in view. Memory: some
/// 100 kB a keyframe of 2000 features, for its descriptors.
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, "ORB-SLAM2: an open-source SLAM system for monocular, stereo and RGB-D cameras", IEEE
/// Transactions on Robotics 33(5), 2017, and "ORB-SLAM", 31(5), 2015, section VI. *Differs:* poses are given, so features
/// are matched along whole epipolar lines, not within words of a vocabulary, and directions are compared with what the
/// poses say, not with a histogram; a sighting must agree within the deviation of point, feature and pose together; a
/// point's position must be known to a share of its distance.
#[derive(Debug, Clone)]
pub struct PointMap {
    pub(super) options: MapPointOptions,
    pub(super) correction: PoseCorrectionOptions,
    /// The pinhole in whose pixels the features of keyframes are.
    pub(super) camera: Camera,
    /// The camera of the images.
    pub(super) lens: CorrectedLens,
    /// Width and height of the images.
    pub(super) size: [f64; 2],
    pub(super) keyframes: Vec<MapKeyframe>,
    /// By id; what is gone leaves `None`.
    pub(super) points: Vec<Option<Box<MapPoint>>>,
    /// Ids of the points there are, ascending.
    pub(super) living: Vec<MapPointId>,
    /// Those of them that may yet be given up.
    pub(super) on_probation: Vec<MapPointId>,
    /// Points to be refined.
    pub(super) dirty: Vec<MapPointId>,
    /// Points of which something may have to be told.
    pub(super) touched: Vec<MapPointId>,
    /// Points that were told of and are gone.
    pub(super) withdrawn: Vec<MapPointId>,
    pub(super) changes: Vec<MapChange>,
}

/// What a keyframe did to the map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Features in the image.
    pub features: usize,
    /// Points that were seen again.
    pub observed_again: usize,
    /// Points that are new, good or not.
    pub created: usize,
    /// Points that were given up.
    pub removed: usize,
    /// Points that are carved, after this keyframe.
    pub established: usize,
}

/// How well points and pixels agree.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MapQuality {
    /// Points that are carved.
    pub points: usize,
    /// Sightings of them.
    pub observations: usize,
    /// Root of the mean squared distance of their projections from their features, in pixels of the image.
    pub reprojection_rms_px: f64,
    /// Median of those distances.
    pub reprojection_median_px: f64,
}

impl PointMap {
    /// An empty map for images of `camera`, a pinhole, of `width` by `height` pixels. Poses are corrected as `correction` says;
    /// [`PoseCorrectionOptions::off`] takes them as they are.
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
        })
    }

    /// Adds a keyframe; what that changes is then in [`changes`](Self::changes).
    ///
    /// A pose that is not finite sees nothing: the keyframe is counted, and no point refers to it.
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
        new.straighten(self.lens.camera(), &self.camera);
        self.keyframes.push(new);
        if is_finite {
            if self.correction.enabled {
                self.correct_new(number);
            }
            counts.observed_again = self.observe(number);
            self.refine_dirty();
            counts.created = self.create(number);
            self.refine_dirty();
            if self.correction.enabled {
                let was_known = self.is_corrected(number);
                self.adjust_around(number);
                self.refine_dirty();
                if !was_known && self.is_corrected(number) {
                    // What was matched under a poor pose is matched again under a good one.
                    counts.created += self.create(number);
                    self.refine_dirty();
                }
                if self.correction.lens && LOOK_AT.contains(&self.keyframes.len()) {
                    self.find_lens();
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

    /// How points are made.
    pub fn options(&self) -> &MapPointOptions {
        &self.options
    }

    /// What the last keyframe changed in the points that are carved, in the order of application.
    pub fn changes(&self) -> &[MapChange] {
        &self.changes
    }

    /// The keyframes in their order.
    pub fn keyframes(&self) -> &[MapKeyframe] {
        &self.keyframes
    }

    /// A point; `None` when it is gone.
    pub fn point(&self, id: MapPointId) -> Option<&MapPoint> {
        self.points.get(id.0 as usize)?.as_deref()
    }

    /// The points that are carved, by id.
    pub fn established(&self) -> impl Iterator<Item = (MapPointId, &MapPoint)> {
        self.living
            .iter()
            .filter_map(|&id| Some((id, self.point(id)?)))
            .filter(|(_, point)| point.is_established)
    }

    /// Median depth of the points that are carved in the keyframes that see them; `None` without one.
    pub fn median_depth(&self) -> Option<f64> {
        let mut depths: Vec<f64> = self
            .established()
            .flat_map(|(_, point)| {
                point.observations.iter().map(|sighting| {
                    let keyframe = &self.keyframes[sighting.keyframe as usize];
                    (keyframe.camera_from_world() * point.point_in_world).z
                })
            })
            .collect();
        let middle = depths.len() / 2;
        (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f64::total_cmp).1)
    }

    /// How well points and pixels agree.
    pub fn quality(&self) -> MapQuality {
        let mut distances = Vec::new();
        let mut points = 0;
        for (_, point) in self.established() {
            points += 1;
            distances.extend(point.observations.iter().filter_map(|sighting| {
                let keyframe = &self.keyframes[sighting.keyframe as usize];
                let pixel = self
                    .camera
                    .project(&(keyframe.camera_from_world() * point.point_in_world))?;
                Some((pixel - keyframe.pixel(sighting.feature)).norm())
            }));
        }
        let sightings = distances.len();
        if sightings == 0 {
            return MapQuality::default();
        }
        let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
        let median = *distances
            .select_nth_unstable_by(sightings / 2, f64::total_cmp)
            .1;
        MapQuality {
            points,
            observations: sightings,
            reprojection_rms_px: (squares / sightings as f64).sqrt(),
            reprojection_median_px: median,
        }
    }

    /// The points that are carved and who sees them, as a model; `name` names a keyframe by its number. Points are where
    /// the carver has them.
    pub fn model(&self, name: impl Fn(usize) -> String) -> SparseModel {
        let views = self
            .keyframes
            .iter()
            .enumerate()
            .map(|(number, keyframe)| ModelView {
                name: name(number),
                world_from_camera: *keyframe.pose.world_from_camera(),
                camera: Some(self.camera.clone()),
                size_px: None,
            })
            .collect();
        let points = self
            .established()
            .map(|(_, point)| {
                let sightings = point.observations.iter().map(|sighting| {
                    let keyframe = &self.keyframes[sighting.keyframe as usize];
                    ModelObservation {
                        view: sighting.keyframe,
                        pixel: Some(keyframe.pixel(sighting.feature).into()),
                    }
                });
                let first = point.observations[0];
                let grey =
                    self.keyframes[first.keyframe as usize].features.grey[first.feature as usize];
                let carved = point.published.as_ref();
                ModelPoint {
                    point_in_world: carved.map_or(point.point_in_world, |p| p.point_in_world),
                    color: Some([grey; 3]),
                    observations: sightings.collect(),
                }
            })
            .collect();
        SparseModel { views, points }
    }

    /// Adds a point that no feature is yet.
    pub(super) fn insert(&mut self, point: MapPoint) -> MapPointId {
        let id = MapPointId(self.points.len() as u32);
        for sighting in &point.observations {
            self.assign(*sighting, Some(id));
        }
        self.points.push(Some(Box::new(point)));
        self.living.push(id);
        self.on_probation.push(id);
        self.dirty.push(id);
        id
    }

    /// Removes a point from the map and from its features.
    pub(super) fn remove(&mut self, id: MapPointId) {
        let Some(point) = self.points[id.0 as usize].take() else {
            return;
        };
        for sighting in &point.observations {
            self.assign(*sighting, None);
        }
        if point.published.is_some() {
            self.withdrawn.push(id);
        }
    }

    /// Lets a keyframe see a point that it does not see yet.
    pub(super) fn add_sighting(&mut self, id: MapPointId, sighting: MapObservation) {
        if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
            point.add_sighting(sighting);
            self.assign(sighting, Some(id));
            self.dirty.push(id);
        }
    }

    pub(super) fn assign(&mut self, sighting: MapObservation, point: Option<MapPointId>) {
        let keyframe = &mut self.keyframes[sighting.keyframe as usize];
        keyframe.points[sighting.feature as usize] = point;
    }

    pub(super) fn center(&self, keyframe: u32) -> Point3<f64> {
        self.keyframes[keyframe as usize].center()
    }
}

#[cfg(test)]
mod tests;
