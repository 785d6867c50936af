//! Which existing observations a transaction affects, and whether its final state is valid.

use super::Carver;
use super::error::TransactionError;
use super::ids::{PointId, ViewId};
use super::transaction::{PendingChange, Plan};
use crate::visibility::ObservationId;
use crate::visibility::rays::Rays;

/// Existing observations that the transaction removes or modifies, sorted.
pub(super) struct Affected {
    pub(super) rays: Vec<ObservationId>,
    /// Points whose rays change, sorted: old ones by their old rays, and those of new rays.
    pub(super) supported: Vec<u32>,
    /// Rays of which nothing changes but the standard deviation of their point; not among `rays`.
    pub(super) resoftened: Vec<ObservationId>,
}

impl Plan {
    pub(super) fn affected(&self, carver: &Carver) -> Affected {
        let rays = self.affected_rays(carver);
        let mut resoftened = self.resoftened_rays(carver);
        resoftened.retain(|ray| rays.binary_search(ray).is_err());
        let supported = self.supported_points(carver, &rays);
        Affected {
            rays,
            resoftened,
            supported,
        }
    }

    /// Existing rays with another deviation of their point; sorted.
    fn resoftened_rays(&self, carver: &Carver) -> Vec<ObservationId> {
        if !carver.cells.evidence.is_on() {
            return Vec::new();
        }
        let table = carver.rays.table();
        let points = self.sigmas.keys();
        let mut resoftened: Vec<_> = points.flat_map(|&point| table.of_point(point)).collect();
        resoftened.sort_unstable();
        resoftened.dedup();
        resoftened
    }

    /// Points of which the total weight of rays may change; sorted.
    fn supported_points(&self, carver: &Carver, rays: &[ObservationId]) -> Vec<u32> {
        if !carver.cells.evidence.is_on() {
            return Vec::new();
        }
        let table = carver.rays.table();
        let old = rays.iter().map(|&ray| table.point(ray));
        let new = self.rays.iter().map(|(_, point, _)| point);
        let mut points: Vec<u32> = old.chain(new).collect();
        points.sort_unstable();
        points.dedup();
        points
    }

    /// Existing rays that end, or whose position or weight changes; sorted.
    fn affected_rays(&self, carver: &Carver) -> Vec<ObservationId> {
        let table = carver.rays.table();
        let mut affected = Vec::new();
        for &point in self.points.keys() {
            affected.extend(table.of_point(point));
        }
        for &view in self.views.keys() {
            affected.extend(table.of_view(view));
        }
        let old_views = carver.views.capacity() as u32;
        let old = self.rays.iter().filter(|(view, ..)| *view < old_views);
        affected.extend(old.filter_map(|(view, point, _)| table.find(view, point)));
        affected.sort_unstable();
        affected.dedup();
        affected
    }

    /// Drops moves of points and views to where they are, and deviations that are set already.
    pub(super) fn drop_idle_changes(&mut self, carver: &Carver) {
        self.points.retain(|&point, change| {
            carver
                .points
                .get(point)
                .is_none_or(|old| *change != PendingChange::Moved(old.position))
        });
        self.views
            .retain(|&view, change| *change != PendingChange::Moved(*carver.views.center(view)));
        self.sigmas
            .retain(|&point, sigma| carver.points.sigma(point) != *sigma);
    }

    /// Position of a point after the transaction.
    fn final_point(&self, carver: &Carver, point: u32) -> Option<[f64; 3]> {
        match (point as usize).checked_sub(carver.points.capacity()) {
            Some(new) => self.new_points[new],
            None => match self.points.get(&point) {
                Some(PendingChange::Removed) => None,
                Some(PendingChange::Moved(position)) => Some(*position),
                None => carver.points.get(point).map(|record| record.position),
            },
        }
    }

    /// Centre of a view after the transaction.
    fn final_view(&self, carver: &Carver, view: u32) -> Option<[f64; 3]> {
        match (view as usize).checked_sub(carver.views.capacity()) {
            Some(new) => self.new_views[new],
            None => match self.views.get(&view) {
                Some(PendingChange::Removed) => None,
                Some(PendingChange::Moved(center)) => Some(*center),
                None => carver
                    .views
                    .is_alive(view)
                    .then(|| *carver.views.center(view)),
            },
        }
    }

    /// Whether the transaction removes an existing observation.
    pub(super) fn removes(&self, table: &Rays, id: ObservationId) -> bool {
        let (view, point) = (table.view(id), table.point(id));
        self.rays.get(view, point) == Some(None)
            || self.views.get(&view) == Some(&PendingChange::Removed)
            || self.points.get(&point) == Some(&PendingChange::Removed)
    }

    /// Refuses rays of length zero.
    pub(super) fn check_lengths(
        &self,
        carver: &Carver,
        affected: &[ObservationId],
    ) -> Result<(), TransactionError> {
        let check = |view: u32, point: u32| {
            let ends = (
                self.final_view(carver, view),
                self.final_point(carver, point),
            );
            match ends {
                (Some(center), Some(position)) if center == position => {
                    let (view, point) = (ViewId(view), PointId(point));
                    Err(TransactionError::ZeroLengthRay { view, point })
                }
                _ => Ok(()),
            }
        };
        for (view, point, weight) in self.rays.iter() {
            if weight.is_some() {
                check(view, point)?;
            }
        }
        let rays = carver.rays.table();
        for &ray in affected {
            if !self.removes(rays, ray) {
                check(rays.view(ray), rays.point(ray))?;
            }
        }
        Ok(())
    }
}
