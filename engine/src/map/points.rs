//! A map of points triangulated from features. The carver follows its changes.

use std::time::Instant;

use linecarve_carving::{Carver, PointId, TransactionError, ViewId};
use linecarve_points::{MapChange, PointMap};
use linecarve_sequence::Sequence;

use super::error::MapError;
use super::update::MapUpdate;
use crate::front_end::{FeatureKeyframe, empty_point_map};
use crate::options::Options;

/// Feature points and their ids in the carver.
pub(super) struct FeatureMap {
    map: PointMap,
    views: Vec<ViewId>,
    /// The carver's id of each carved point.
    points: Vec<Option<PointId>>,
    /// Factor on standard deviations for the carver.
    sigma_factor: f64,
}

impl FeatureMap {
    /// An empty map for keyframes of `sequence`.
    ///
    /// # Errors
    /// When an option is out of range.
    pub(super) fn new(options: &Options, sequence: &Sequence) -> Result<Self, MapError> {
        Ok(Self {
            map: empty_point_map(sequence, options)?,
            views: Vec::new(),
            points: Vec::new(),
            sigma_factor: options.carving.cut.sigma_factor,
        })
    }

    /// Adds keyframe `number`.
    ///
    /// # Errors
    /// When the carver rejects its position or one of its points.
    pub(super) fn push(
        &mut self,
        carver: &mut Carver,
        keyframe: &FeatureKeyframe,
        number: usize,
    ) -> Result<MapUpdate, MapError> {
        let start = Instant::now();
        let counts = self
            .map
            .push(&keyframe.world_from_camera, keyframe.features.clone());
        let mut update = MapUpdate {
            observed_again: counts.observed_again,
            features: Some(counts),
            ..MapUpdate::default()
        };
        update.times.matching = start.elapsed();
        self.apply_changes(carver, &mut update)
            .map_err(|source| MapError::Keyframe {
                keyframe: number,
                source,
            })?;
        update.times.carving = start.elapsed() - update.times.matching;
        Ok(update)
    }

    /// Adjusts all keyframes and points together, after the last of `count` keyframes. Changes nothing when poses are not
    /// corrected.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub(super) fn finish(
        &mut self,
        carver: &mut Carver,
        count: usize,
    ) -> Result<MapUpdate, MapError> {
        let keyframe = count.saturating_sub(1);
        self.map.adjust_all();
        let mut update = MapUpdate::default();
        self.apply_changes(carver, &mut update)
            .map_err(|source| MapError::Keyframe { keyframe, source })?;
        Ok(update)
    }

    /// Applies the changes of the points to the carver.
    fn apply_changes(
        &mut self,
        carver: &mut Carver,
        update: &mut MapUpdate,
    ) -> Result<(), TransactionError> {
        let mut transaction = carver.transaction();
        for new in &self.map.keyframes()[self.views.len()..] {
            self.views.push(transaction.add_view(new.center())?);
        }
        for change in self.map.changes() {
            // Changes refer to carved points and known keyframes.
            let carved = |points: &[Option<PointId>], point: u32| {
                points
                    .get(point as usize)
                    .copied()
                    .flatten()
                    .expect("a point that changes is carved")
            };
            match *change {
                MapChange::AddPoint {
                    point,
                    point_in_world,
                } => {
                    let index = point.0 as usize;
                    if self.points.len() <= index {
                        self.points.resize(index + 1, None);
                    }
                    let id = transaction.add_point(point_in_world)?;
                    self.points[index] = Some(id);
                    update.new_points += 1;
                }
                MapChange::MovePoint {
                    point,
                    point_in_world,
                } => {
                    transaction.move_point(carved(&self.points, point.0), point_in_world)?;
                    update.moved_points += 1;
                }
                MapChange::SetSigma { point, sigma } => {
                    let sigma = self.sigma_factor * sigma;
                    transaction.set_sigma(carved(&self.points, point.0), Some(sigma))?;
                }
                MapChange::MoveKeyframe { keyframe, center } => {
                    transaction.move_view(self.views[keyframe as usize], center)?;
                }
                MapChange::RemovePoint { point } => {
                    transaction.remove_point(carved(&self.points, point.0))?;
                    self.points[point.0 as usize] = None;
                    update.removed_points += 1;
                }
                MapChange::AddObservation { keyframe, point } => transaction.add_observation(
                    self.views[keyframe as usize],
                    carved(&self.points, point.0),
                    1,
                )?,
                MapChange::RemoveObservation { keyframe, point } => transaction
                    .remove_observation(
                        self.views[keyframe as usize],
                        carved(&self.points, point.0),
                    )?,
            }
        }
        let report = transaction.commit()?;
        update.deltas.push(report.surface);
        Ok(())
    }

    /// The feature points.
    pub(super) fn points(&self) -> &PointMap {
        &self.map
    }
}
