//! What a transaction does to what was there before it: which rays it concerns, and whether it may be made.

use super::Carver;
use super::events::EventError;
use super::ids::{PointId, ViewId};
use super::transaction::{Fate, Plan};
use crate::visibility::{RayId, Sheet};

/// What of before the transaction ends or changes; sorted.
pub(super) struct Concerned {
    pub(super) rays: Vec<RayId>,
    pub(super) sheets: Vec<RayId>,
}

impl Plan {
    /// What of before the transaction ends or changes.
    pub(super) fn concerned(&self, carver: &Carver) -> Concerned {
        Concerned {
            rays: self.concerned_rays(carver),
            sheets: self.concerned_sheets(carver),
        }
    }

    /// Forgets moves to where things are.
    pub(super) fn drop_idle_moves(&mut self, carver: &Carver) {
        self.points.retain(|&point, fate| {
            carver
                .points
                .get(point)
                .is_none_or(|old| *fate != Fate::Moved(old.position))
        });
        self.views
            .retain(|&view, fate| *fate != Fate::Moved(*carver.views.center(view)));
        self.sigmas
            .retain(|&point, sigma| carver.points.sigma(point) != *sigma);
    }

    /// Where a point is after the transaction.
    fn final_point(&self, carver: &Carver, point: u32) -> Option<[f64; 3]> {
        match (point as usize).checked_sub(carver.points.capacity()) {
            Some(new) => self.new_points[new],
            None => match self.points.get(&point) {
                Some(Fate::Removed) => None,
                Some(Fate::Moved(position)) => Some(*position),
                None => carver.points.get(point).map(|record| record.position),
            },
        }
    }

    /// Where a view is after the transaction.
    fn final_view(&self, carver: &Carver, view: u32) -> Option<[f64; 3]> {
        match (view as usize).checked_sub(carver.views.capacity()) {
            Some(new) => self.new_views[new],
            None => match self.views.get(&view) {
                Some(Fate::Removed) => None,
                Some(Fate::Moved(center)) => Some(*center),
                None => carver
                    .views
                    .is_alive(view)
                    .then(|| *carver.views.center(view)),
            },
        }
    }

    /// Whether an observation of before the transaction is not there after it.
    pub(super) fn ends(&self, carver: &Carver, ray: RayId) -> bool {
        let (view, point) = (carver.rays.view(ray), carver.rays.point(ray));
        self.observations.get(&(view, point)) == Some(&None)
            || self.views.get(&view) == Some(&Fate::Removed)
            || self.points.get(&point) == Some(&Fate::Removed)
    }

    /// Observations of before the transaction that end, or whose ray or weight changes; sorted.
    fn concerned_rays(&self, carver: &Carver) -> Vec<RayId> {
        let rays = &carver.rays;
        let mut concerned: Vec<RayId> = Vec::new();
        for &point in self.points.keys() {
            concerned.extend(rays.of_point(point));
        }
        if carver.evidence.is_on() {
            for &point in self.sigmas.keys() {
                concerned.extend(rays.of_point(point));
            }
        }
        for &view in self.views.keys() {
            concerned.extend(rays.of_view(view));
        }
        let views = carver.views.capacity() as u32;
        let old = self.order.iter().filter(|(view, _)| *view < views);
        concerned.extend(old.filter_map(|&(view, point)| rays.find(view, point)));
        concerned.sort_unstable();
        concerned.dedup();
        concerned
    }

    /// Whether a segment of before the transaction is not there after it.
    pub(super) fn ends_sheet(&self, carver: &Carver, sheet: RayId) -> bool {
        let &Sheet { view, points, .. } = carver.sheets.get(sheet);
        let is_removed = |point| self.points.get(point) == Some(&Fate::Removed);
        self.segments.get(&(view, points)) == Some(&None)
            || self.views.get(&view) == Some(&Fate::Removed)
            || points.iter().any(is_removed)
    }

    /// Segments of before the transaction that end, or whose triangle or weight changes; sorted.
    fn concerned_sheets(&self, carver: &Carver) -> Vec<RayId> {
        let sheets = &carver.sheets;
        let mut concerned: Vec<RayId> = Vec::new();
        for &point in self.points.keys() {
            concerned.extend(sheets.of_point(point));
        }
        if carver.evidence.is_on() {
            for &point in self.sigmas.keys() {
                concerned.extend(sheets.of_point(point));
            }
        }
        for &view in self.views.keys() {
            concerned.extend(sheets.of_view(view));
        }
        concerned.extend(
            self.segment_order
                .iter()
                .filter_map(|&(view, points)| sheets.find(view, points)),
        );
        concerned.sort_unstable();
        concerned.dedup();
        concerned
    }

    /// No observation may end where it begins.
    pub(super) fn check_lengths(
        &self,
        carver: &Carver,
        concerned: &[RayId],
    ) -> Result<(), EventError> {
        let check = |view: u32, point: u32| {
            let ends = (
                self.final_view(carver, view),
                self.final_point(carver, point),
            );
            match ends {
                (Some(center), Some(position)) if center == position => {
                    let (view, point) = (ViewId(view), PointId(point));
                    Err(EventError::ZeroLengthRay { view, point })
                }
                _ => Ok(()),
            }
        };
        for key in &self.order {
            if self.observations[key].is_some() {
                check(key.0, key.1)?;
            }
        }
        for &ray in concerned {
            if !self.ends(carver, ray) {
                check(carver.rays.view(ray), carver.rays.point(ray))?;
            }
        }
        Ok(())
    }
}
