//! A map of points that somebody else estimates: a SLAM system sends them, with the views that observe them, and corrects both.

use std::collections::BTreeSet;
use std::time::Instant;

use linecarve_carving::{Carver, PointId, Transaction, TransactionError, ViewId};
use linecarve_lines::upper_median;
use linecarve_sequence::{ModelObservation, ModelPoint, ModelView, SparseModel};
use nalgebra::{Isometry3, Point3};

use super::selection::{ModelCounts, select_point, sigma_along_rays};
use super::update::MapUpdate;
use crate::options::PointModelOptions;

/// Which points of an [`ObservationChange`] are carved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PointKind {
    /// A point of its own: only where enough views with parallax observe it, as in a model.
    Single,
    /// A point on a line, which its image edge and the neighbours support: with any view before which it lies.
    OnLine,
}

/// A new or moved point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ObservedPoint {
    /// Number of the point; new ones follow the known ones without a gap.
    pub number: u32,
    /// Position in the frame of computation.
    pub position: Point3<f64>,
    /// Standard deviation along the view rays; without it that of the rays' directions counts.
    pub sigma: Option<f64>,
    /// Which rule decides whether it is carved.
    pub kind: PointKind,
}

/// Changes of views, points and observations that take effect together, in the order of the fields.
#[derive(Debug, Clone, Default)]
pub(crate) struct ObservationChange {
    /// New views, numbered on from the known ones, in the frame of computation.
    pub views: Vec<ModelView>,
    /// New poses of views, in the frame of computation.
    pub moved_views: Vec<(u32, Isometry3<f64>)>,
    /// Views that go with their observations.
    pub removed_views: Vec<u32>,
    /// Points that are new or move.
    pub points: Vec<ObservedPoint>,
    /// Points that go with their observations.
    pub removed_points: Vec<u32>,
    /// New observations by view and point. Known ones are repeated without effect.
    pub observations: Vec<[u32; 2]>,
    /// Observations by view and point that go.
    pub removed_observations: Vec<[u32; 2]>,
}

/// A point and what the carver knows of it.
struct Record {
    point: ModelPoint,
    kind: PointKind,
    /// The standard deviation that came with it.
    given_sigma: Option<f64>,
    carved: Option<Carved>,
}

/// A point in the carver.
struct Carved {
    id: PointId,
    position: Point3<f64>,
    /// Ascending.
    views: Vec<u32>,
}

/// Views and points with their observations; the carver holds those that pass the filter of models.
pub(super) struct ObservedMap {
    /// Views; its points are not used.
    model: SparseModel,
    /// The carver's id of each view, `None` where it was removed.
    views: Vec<Option<ViewId>>,
    points_of_view: Vec<BTreeSet<u32>>,
    records: Vec<Record>,
    options: PointModelOptions,
    sigma_factor: f64,
    median_depth: Option<f64>,
    /// Number of carved observations, now and when the median depth was last measured.
    observations: usize,
    measured_at: usize,
}

impl ObservedMap {
    pub(super) fn new(options: &PointModelOptions, sigma_factor: f64) -> Self {
        Self {
            model: SparseModel {
                views: Vec::new(),
                points: Vec::new(),
            },
            views: Vec::new(),
            points_of_view: Vec::new(),
            records: Vec::new(),
            options: PointModelOptions {
                // All points are not known from the beginning.
                min_views: match options.min_views {
                    0 => 3,
                    given => given,
                },
                ..*options
            },
            sigma_factor,
            median_depth: None,
            observations: 0,
            measured_at: 0,
        }
    }

    /// Makes changes in one transaction.
    ///
    /// # Errors
    /// When the carver rejects a position.
    ///
    /// # Complexity
    /// The points concerned and the views that observe them, and the carver's. The median depth is measured whenever the observations
    /// have grown by an eighth.
    pub(super) fn apply(
        &mut self,
        carver: &mut Carver,
        change: &ObservationChange,
    ) -> Result<MapUpdate, TransactionError> {
        let start = Instant::now();
        let mut update = MapUpdate::default();
        let mut transaction = carver.transaction();
        let touched = self.note(&mut transaction, change)?;
        for point in touched {
            self.carve(&mut transaction, point, &mut update)?;
        }
        update.times.matching = start.elapsed();
        let report = transaction.commit()?;
        update.deltas.push(report.surface);
        update.times.carving = start.elapsed() - update.times.matching;
        if 8 * self.observations > 9 * self.measured_at || 2 * self.observations < self.measured_at
        {
            self.measure_depth();
        }
        Ok(update)
    }

    /// Notes the changes, and returns the points that they concern.
    fn note(
        &mut self,
        transaction: &mut Transaction<'_>,
        change: &ObservationChange,
    ) -> Result<BTreeSet<u32>, TransactionError> {
        let mut touched = BTreeSet::new();
        for view in &change.views {
            let center = Point3::from(view.world_from_camera.translation.vector);
            self.views.push(Some(transaction.add_view(center)?));
            self.model.views.push(view.clone());
            self.points_of_view.push(BTreeSet::new());
        }
        for (view, pose) in &change.moved_views {
            if let Some(id) = self.views[*view as usize] {
                transaction.move_view(id, pose.translation.vector.into())?;
            }
            self.model.views[*view as usize].world_from_camera = *pose;
            touched.extend(&self.points_of_view[*view as usize]);
        }
        for view in &change.removed_views {
            if let Some(id) = self.views[*view as usize].take() {
                transaction.remove_view(id)?;
            }
            for point in std::mem::take(&mut self.points_of_view[*view as usize]) {
                let observations = &mut self.records[point as usize].point.observations;
                observations.retain(|observation| observation.view != *view);
                touched.insert(point);
            }
        }
        for point in &change.points {
            if point.number as usize == self.records.len() {
                self.records.push(Record {
                    point: ModelPoint {
                        point_in_world: point.position,
                        color: None,
                        observations: Vec::new(),
                    },
                    kind: point.kind,
                    given_sigma: None,
                    carved: None,
                });
            }
            let record = &mut self.records[point.number as usize];
            record.point.point_in_world = point.position;
            record.given_sigma = point.sigma;
            record.kind = point.kind;
            touched.insert(point.number);
        }
        for point in &change.removed_points {
            let observations = &mut self.records[*point as usize].point.observations;
            for observation in std::mem::take(observations) {
                self.points_of_view[observation.view as usize].remove(point);
            }
            touched.insert(*point);
        }
        for [view, point] in &change.observations {
            if self.points_of_view[*view as usize].insert(*point) {
                let observations = &mut self.records[*point as usize].point.observations;
                let place = observations.partition_point(|other| other.view < *view);
                let (view, pixel) = (*view, None);
                observations.insert(place, ModelObservation { view, pixel });
                touched.insert(*point);
            }
        }
        for [view, point] in &change.removed_observations {
            if self.points_of_view[*view as usize].remove(point) {
                let observations = &mut self.records[*point as usize].point.observations;
                observations.retain(|other| other.view != *view);
                touched.insert(*point);
            }
        }
        Ok(touched)
    }

    /// Brings a point in the carver up to date.
    fn carve(
        &mut self,
        transaction: &mut Transaction<'_>,
        number: u32,
        update: &mut MapUpdate,
    ) -> Result<(), TransactionError> {
        let record = &mut self.records[number as usize];
        let mut views = Vec::new();
        let is_carved = match record.kind {
            PointKind::Single => select_point(
                &self.model.views,
                &record.point,
                &self.options,
                (&mut views, &mut Vec::new(), &mut ModelCounts::default()),
            ),
            PointKind::OnLine => {
                let observations = record.point.observations.iter();
                let place = record.point.point_in_world;
                let is_before = |view: &u32| {
                    let pose = &self.model.views[*view as usize].world_from_camera;
                    pose.inverse_transform_point(&place).z > 0.0
                };
                let seen = observations.map(|observation| observation.view);
                views.extend(seen.filter(is_before));
                !views.is_empty()
            }
        };
        let before = record.carved.take();
        self.observations -= before.as_ref().map_or(0, |carved| carved.views.len());
        if !is_carved {
            if let Some(carved) = before {
                transaction.remove_point(carved.id)?;
                update.removed_points += 1;
            }
            return Ok(());
        }
        let position = record.point.point_in_world;
        let known = before.is_some();
        let mut carved = match before {
            Some(carved) => carved,
            None => {
                update.new_points += 1;
                let id = transaction.add_point(position)?;
                let views = Vec::new();
                Carved {
                    id,
                    position,
                    views,
                }
            }
        };
        if carved.position != position {
            transaction.move_point(carved.id, position)?;
            carved.position = position;
            update.moved_points += 1;
        }
        let seen_from = views.iter().map(|view| &self.model.views[*view as usize]);
        let sigma = record
            .given_sigma
            .or_else(|| sigma_along_rays(&position, seen_from));
        transaction.set_sigma(carved.id, sigma.map(|sigma| self.sigma_factor * sigma))?;
        for view in &carved.views {
            if let Some(id) = self.views[*view as usize]
                && views.binary_search(view).is_err()
            {
                transaction.remove_observation(id, carved.id)?;
            }
        }
        for view in &views {
            if let Some(id) = self.views[*view as usize]
                && carved.views.binary_search(view).is_err()
            {
                transaction.add_observation(id, carved.id, 1)?;
                update.observed_again += usize::from(known);
            }
        }
        self.observations += views.len();
        carved.views = views;
        record.carved = Some(carved);
        Ok(())
    }

    /// Measures the median depth of the carved points in their views.
    pub(super) fn measure_depth(&mut self) {
        let mut depths = Vec::with_capacity(self.observations);
        for record in &self.records {
            for view in record.carved.iter().flat_map(|carved| &carved.views) {
                let pose = &self.model.views[*view as usize].world_from_camera;
                depths.push(pose.inverse_transform_point(&record.point.point_in_world).z);
            }
        }
        self.median_depth = upper_median(&mut depths, f64::total_cmp);
        self.measured_at = self.observations;
    }

    /// Median depth of the carved points in their views when it was last measured; `None` without points.
    pub(super) fn median_depth(&self) -> Option<f64> {
        self.median_depth
    }
}

#[cfg(test)]
mod tests;
