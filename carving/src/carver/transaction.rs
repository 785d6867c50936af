//! Changes that take effect together.

use std::collections::hash_map::Entry;

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::Carver;
use super::commit::CommitReport;
use super::error::TransactionError;
use super::ids::{PointId, ViewId};
use super::samples::PlannedSamples;
use crate::tetrahedralization::accept_position;
use crate::visibility::RayVisibility;
use crate::visibility::rays::Rays;

/// Largest number of points of a carver.
const MAX_POINTS: usize = 1 << 26;

/// The pending change of a point or view that existed before the transaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PendingChange {
    Removed,
    Moved([f64; 3]),
}

/// The net effect of the changes of a transaction.
#[derive(Clone, Debug, Default)]
pub(super) struct Plan {
    /// New points in order of their ids; `None` if removed again.
    pub(super) new_points: Vec<Option<[f64; 3]>>,
    /// New views in order of their ids; `None` if removed again.
    pub(super) new_views: Vec<Option<[f64; 3]>>,
    pub(super) points: FxHashMap<u32, PendingChange>,
    pub(super) views: FxHashMap<u32, PendingChange>,
    /// New standard deviations, of points old and new.
    pub(super) sigmas: FxHashMap<u32, Option<f64>>,
    pub(super) rays: PlannedRays,
    pub(super) samples: PlannedSamples,
}

/// The net effect of a transaction on observations.
#[derive(Clone, Debug, Default)]
pub(super) struct PlannedRays {
    /// The observations mentioned, in order, with their final weights: `None` if one is removed. It is removed as well when
    /// its view or its point is.
    entries: Vec<(u32, u32, Option<u32>)>,
    /// Where each is among them.
    indices: FxHashMap<(u32, u32), u32>,
}

impl PlannedRays {
    fn set(&mut self, view: u32, point: u32, weight: Option<u32>) {
        match self.indices.entry((view, point)) {
            Entry::Occupied(entry) => self.entries[*entry.get() as usize].2 = weight,
            Entry::Vacant(entry) => {
                entry.insert(self.entries.len() as u32);
                self.entries.push((view, point, weight));
            }
        }
    }

    /// Final weight of an observation that is mentioned.
    pub(super) fn get(&self, view: u32, point: u32) -> Option<Option<u32>> {
        let index = self.indices.get(&(view, point))?;
        Some(self.entries[*index as usize].2)
    }

    /// The observations mentioned with their final weights, in order of first mention.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, u32, Option<u32>)> + '_ {
        self.entries.iter().copied()
    }

    fn len(&self) -> usize {
        self.entries.len()
    }
}

/// A set of changes to a [`Carver`] that take effect together on [`commit`](Self::commit); dropped without, it leaves the
/// carver as it was.
///
/// Every change is checked against the state after the changes before it. The effect on cells, labels and surface is computed
/// once for all of them: a ray is walked again once, however many points around it move.
#[derive(Debug)]
pub struct Transaction<'a> {
    pub(super) carver: &'a mut Carver,
    pub(super) plan: Plan,
}

impl<'a> Transaction<'a> {
    pub(super) fn new(carver: &'a mut Carver) -> Self {
        Self {
            carver,
            plan: Plan::default(),
        }
    }

    /// The carver without the changes of this transaction.
    pub fn before(&self) -> &Carver {
        self.carver
    }

    fn require_point(&self, point: PointId) -> Result<(), TransactionError> {
        let old = self.carver.points.capacity();
        let exists = match (point.0 as usize).checked_sub(old) {
            Some(new) => matches!(self.plan.new_points.get(new), Some(Some(_))),
            None => {
                self.carver.points.get(point.0).is_some()
                    && self.plan.points.get(&point.0) != Some(&PendingChange::Removed)
            }
        };
        exists
            .then_some(())
            .ok_or(TransactionError::UnknownPoint { point })
    }

    fn require_view(&self, view: ViewId) -> Result<(), TransactionError> {
        let old = self.carver.views.capacity();
        let exists = match (view.0 as usize).checked_sub(old) {
            Some(new) => matches!(self.plan.new_views.get(new), Some(Some(_))),
            None => {
                self.carver.views.is_alive(view.0)
                    && self.plan.views.get(&view.0) != Some(&PendingChange::Removed)
            }
        };
        exists
            .then_some(())
            .ok_or(TransactionError::UnknownView { view })
    }

    /// Current weight of an observation whose ends exist.
    fn weight(&self, view: ViewId, point: PointId) -> Option<u32> {
        match self.plan.rays.get(view.0, point.0) {
            Some(weight) => weight,
            // A new view has seen nothing before.
            None if view >= self.carver.next_view() => None,
            None => self.carver.observation(view, point),
        }
    }

    /// Adds a view.
    ///
    /// # Errors
    ///
    /// [`TransactionError::Position`] when the centre is NaN or out of range; [`TransactionError::Full`].
    pub fn add_view(&mut self, center: Point3<f64>) -> Result<ViewId, TransactionError> {
        let center = accept_position(&center)?;
        let id = self.carver.views.capacity() + self.plan.new_views.len();
        if id >= Rays::MAX_VIEWS {
            return Err(TransactionError::Full);
        }
        self.plan.new_views.push(Some(center));
        Ok(ViewId(id as u32))
    }

    /// Adds a point. Points at the same position share a vertex.
    ///
    /// # Errors
    ///
    /// [`TransactionError::Position`] when the position is NaN or out of range; [`TransactionError::Full`].
    pub fn add_point(&mut self, position: Point3<f64>) -> Result<PointId, TransactionError> {
        let position = accept_position(&position)?;
        let id = self.carver.points.capacity() + self.plan.new_points.len();
        let alive = self.carver.points.len() + self.plan.new_points.len();
        if id >= u32::MAX as usize || alive >= MAX_POINTS {
            return Err(TransactionError::Full);
        }
        self.plan.new_points.push(Some(position));
        Ok(PointId(id as u32))
    }

    /// Sets the standard deviation of a point along the rays to it, in units of the coordinates. Without one (`None`, the value
    /// of new points) [`CutOptions::relative_sigma`](crate::CutOptions::relative_sigma) applies. Votes ignore it.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownPoint`]; [`TransactionError::Sigma`] when the value is negative, NaN or infinite.
    pub fn set_sigma(
        &mut self,
        point: PointId,
        sigma: Option<f64>,
    ) -> Result<(), TransactionError> {
        self.require_point(point)?;
        if let Some(sigma) = sigma
            && !(sigma.is_finite() && sigma >= 0.0)
        {
            return Err(TransactionError::Sigma { point, sigma });
        }
        self.plan.sigmas.insert(point.0, sigma);
        Ok(())
    }

    /// Adds an observation of a point by a view. Weights of repeated observations add up.
    ///
    /// # Errors
    ///
    /// [`TransactionError`] when the view or point does not exist, the weight is zero or the sum exceeds 32 bits.
    pub fn add_observation(
        &mut self,
        view: ViewId,
        point: PointId,
        weight: u32,
    ) -> Result<(), TransactionError> {
        self.require_view(view)?;
        self.require_point(point)?;
        if weight == 0 {
            return Err(TransactionError::ZeroWeight { view, point });
        }
        if self.carver.rays.table().capacity() + self.plan.rays.len() >= RayVisibility::MAX_RAYS {
            return Err(TransactionError::Full);
        }
        let before = self.weight(view, point).unwrap_or(0);
        let weight = before
            .checked_add(weight)
            .ok_or(TransactionError::WeightOverflow { view, point })?;
        self.plan.rays.set(view.0, point.0, Some(weight));
        Ok(())
    }

    /// Removes a view with all its observations.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownView`].
    pub fn remove_view(&mut self, view: ViewId) -> Result<(), TransactionError> {
        self.require_view(view)?;
        match (view.0 as usize).checked_sub(self.carver.views.capacity()) {
            Some(new) => self.plan.new_views[new] = None,
            None => {
                self.plan.views.insert(view.0, PendingChange::Removed);
            }
        }
        Ok(())
    }

    /// Removes a point with all its observations.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownPoint`].
    pub fn remove_point(&mut self, point: PointId) -> Result<(), TransactionError> {
        self.require_point(point)?;
        match (point.0 as usize).checked_sub(self.carver.points.capacity()) {
            Some(new) => self.plan.new_points[new] = None,
            None => {
                self.plan.points.insert(point.0, PendingChange::Removed);
            }
        }
        Ok(())
    }

    /// Removes an observation, whatever its weight.
    ///
    /// # Errors
    ///
    /// [`TransactionError`] when view, point or observation does not exist.
    pub fn remove_observation(
        &mut self,
        view: ViewId,
        point: PointId,
    ) -> Result<(), TransactionError> {
        self.require_view(view)?;
        self.require_point(point)?;
        if self.weight(view, point).is_none() {
            return Err(TransactionError::UnknownObservation { view, point });
        }
        self.plan.rays.set(view.0, point.0, None);
        Ok(())
    }

    /// Moves a view; its observations stay.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownView`]; [`TransactionError::Position`] when the centre is NaN or out of range.
    pub fn move_view(&mut self, view: ViewId, center: Point3<f64>) -> Result<(), TransactionError> {
        self.require_view(view)?;
        let center = accept_position(&center)?;
        match (view.0 as usize).checked_sub(self.carver.views.capacity()) {
            Some(new) => self.plan.new_views[new] = Some(center),
            None => {
                self.plan.views.insert(view.0, PendingChange::Moved(center));
            }
        }
        Ok(())
    }

    /// Moves a point; its observations stay.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownPoint`]; [`TransactionError::Position`] when the position is NaN or out of range.
    pub fn move_point(
        &mut self,
        point: PointId,
        position: Point3<f64>,
    ) -> Result<(), TransactionError> {
        self.require_point(point)?;
        let position = accept_position(&position)?;
        match (point.0 as usize).checked_sub(self.carver.points.capacity()) {
            Some(new) => self.plan.new_points[new] = Some(position),
            None => {
                self.plan
                    .points
                    .insert(point.0, PendingChange::Moved(position));
            }
        }
        Ok(())
    }

    /// Makes the changes; see [`CommitReport`].
    ///
    /// # Errors
    ///
    /// [`TransactionError::ZeroLengthRay`] when a view would see a point at its very centre; nothing is changed.
    ///
    /// # Complexity
    ///
    /// Per ray that is new, or whose point or view moved: the cells that it crosses. Per cell replaced: the rays across
    /// it and the samples in it. Independent of the rest of the map, apart from one test per view.
    pub fn commit(self) -> Result<CommitReport, TransactionError> {
        super::commit::commit(self)
    }
}
