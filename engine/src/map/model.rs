//! A map of the points of a model or of a dense cloud, which bring their observations. No image is read.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use linecarve_carving::{Carver, Hull, PointId, Transaction, TransactionError, ViewId};
use linecarve_sequence::SparseModel;
use nalgebra::Point3;

use super::cloud::{CloudSurface, JoinedPoint};
use super::error::MapError;
use super::selection::{ModelCounts, SelectedPoints};
use super::update::MapUpdate;
use crate::options::Options;

/// Points of one transaction.
const POINTS_AT_ONCE: usize = 1 << 14;

/// Points, and what the surface needs of them.
#[derive(Default)]
pub(super) struct ModelMap {
    /// Empty where points come [one by one](Self::add).
    model: Arc<SparseModel>,
    counts: ModelCounts,
    /// Points whose views come one after the other.
    points: Vec<JoinedPoint>,
    /// Points that each view observes, ascending.
    points_of_view: Vec<Vec<u32>>,
    /// The carver's id of each point.
    ids: Vec<Option<PointId>>,
    median_depth: Option<f64>,
    surface: CloudSurface,
    is_dense: bool,
}

impl ModelMap {
    /// The points of a model that are [selected](SelectedPoints), whose views come with [`push`](Self::push).
    ///
    /// # Errors
    /// When an observation names a view that does not exist.
    pub(super) fn new(model: Arc<SparseModel>, options: &Options) -> Result<Self, MapError> {
        let selected = SelectedPoints::of(&model, options)?;
        let points = selected.points;
        let mut points_of_view = vec![Vec::new(); model.views.len()];
        for (index, point) in (0..).zip(&points) {
            for [view, _] in &point.rays {
                points_of_view[*view as usize].push(index);
            }
        }
        let is_dense = points.iter().any(|point| point.is_dense);
        let known = points.iter().filter(|_| is_dense);
        Ok(Self {
            model,
            counts: selected.counts,
            points_of_view,
            ids: vec![None; points.len()],
            median_depth: selected.median_depth,
            surface: CloudSurface::of(known, selected.centers),
            points,
            is_dense,
        })
    }

    /// No points; all views are in the carver, which is empty before.
    ///
    /// # Errors
    /// When the carver rejects a view.
    pub(super) fn of_views(
        carver: &mut Carver,
        centers: Vec<Point3<f64>>,
    ) -> Result<Self, MapError> {
        let mut transaction = carver.transaction();
        for center in &centers {
            transaction.add_view(*center).map_err(rejected)?;
        }
        transaction.commit().map_err(rejected)?;
        Ok(Self {
            surface: CloudSurface::of([].iter(), centers),
            ..Self::default()
        })
    }

    /// Adds points with all their observations, and keeps what the surface needs of them.
    ///
    /// # Errors
    /// When the carver rejects a point.
    pub(super) fn add(
        &mut self,
        carver: &mut Carver,
        points: &[JoinedPoint],
    ) -> Result<(), MapError> {
        let views: Vec<ViewId> = carver.views().collect();
        for block in points.chunks(POINTS_AT_ONCE) {
            let mut transaction = carver.transaction();
            for point in block {
                self.is_dense |= point.is_dense;
                self.surface.add_point(point);
                let view_of = |view: u32| views.get(view as usize).copied();
                enter(&mut transaction, None, point, view_of).map_err(rejected)?;
            }
            transaction.commit().map_err(rejected)?;
        }
        Ok(())
    }

    /// Carves a deferred carver once, and forgets the rays. A closed surface goes on along the hull of the points.
    pub(super) fn carve_last(&mut self, carver: &mut Carver, is_closed: bool) {
        if !self.is_dense {
            self.surface = CloudSurface::default();
        }
        if is_closed {
            self.surface.support_all();
            carver.carve_closed();
            return;
        }
        if self.is_dense {
            // Which triangles on the hull are surface, points and views say.
            carver.set_hull(Hull::Keep);
        }
        carver.carve_and_forget();
    }

    /// What is known of the points of a dense cloud; `None` for other models.
    pub(super) fn cloud(&self) -> Option<&CloudSurface> {
        self.is_dense.then_some(&self.surface)
    }

    /// Adds views and their points in one transaction, and carves where the carver is deferred.
    ///
    /// # Errors
    /// When the carver rejects a view or one of its points.
    pub(super) fn push(
        &mut self,
        carver: &mut Carver,
        views: Range<usize>,
    ) -> Result<MapUpdate, MapError> {
        let start = Instant::now();
        let mut update = MapUpdate::default();
        let mut transaction = carver.transaction();
        let mut ids = Vec::with_capacity(views.len());
        for view in views.clone() {
            let center = self.surface.centers()[view];
            let id = transaction.add_view(center);
            ids.push(id.map_err(|source| MapError::View {
                name: self.model.views[view].name.clone(),
                source,
            })?);
        }
        let mut seen: Vec<u32> = self.points_of_view[views.clone()].concat();
        let rays = seen.len();
        seen.sort_unstable();
        seen.dedup();
        let view_of = |view: u32| ids.get((view as usize).checked_sub(views.start)?).copied();
        for index in seen {
            let (point, id) = (&self.points[index as usize], &mut self.ids[index as usize]);
            update.new_points += usize::from(id.is_none());
            *id = Some(enter(&mut transaction, *id, point, view_of).map_err(rejected)?);
        }
        update.observed_again = rays - update.new_points;
        let mut report = transaction.commit().map_err(rejected)?;
        if carver.is_deferred() {
            report = carver.carve();
        }
        update.deltas.push(report.surface);
        update.times.carving = start.elapsed();
        Ok(update)
    }

    /// The view with the most carved points, the first of equals; `None` without views.
    pub(super) fn richest_view(&self) -> Option<usize> {
        (0..self.points_of_view.len())
            .max_by_key(|&view| (self.points_of_view[view].len(), std::cmp::Reverse(view)))
    }

    /// The model.
    pub(super) fn model(&self) -> &SparseModel {
        &self.model
    }

    /// Numbers of carved and rejected points.
    pub(super) fn counts(&self) -> ModelCounts {
        self.counts
    }

    /// Median depth of the points in their views; `None` without points.
    pub(super) fn median_depth(&self) -> Option<f64> {
        self.median_depth
    }

    /// Positions and colours of the points carved so far.
    pub(super) fn carved(&self) -> impl Iterator<Item = (Point3<f64>, Option<[u8; 3]>)> {
        let points = self.ids.iter().zip(&self.points);
        points
            .filter(|(id, _)| id.is_some())
            .map(|(_, point)| (point.position, point.color))
    }
}

fn rejected(source: TransactionError) -> MapError {
    MapError::Observations { source }
}

/// Adds the rays of a point from some views, and the point where it is new.
fn enter(
    transaction: &mut Transaction<'_>,
    known: Option<PointId>,
    point: &JoinedPoint,
    view_of: impl Fn(u32) -> Option<ViewId>,
) -> Result<PointId, TransactionError> {
    let id = match known {
        Some(id) => id,
        None => {
            let id = transaction.add_point(point.position)?;
            transaction.set_sigma(id, point.sigma)?;
            id
        }
    };
    for [view, weight] in &point.rays {
        if let Some(view) = view_of(*view) {
            transaction.add_observation(view, id, *weight)?;
        }
    }
    Ok(id)
}

#[cfg(test)]
mod tests;
