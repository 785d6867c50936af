//! Commits a transaction.

use std::time::{Duration, Instant};

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::affected::Affected;
use super::error::TransactionError;
use super::points::{NO_VERTEX, Points};
use super::transaction::{PendingChange, Plan, PlannedRays, Transaction};
use super::{Carver, Labeling};
use crate::surface::{Hull, SurfaceDelta};
use crate::tetrahedralization::{
    CellId, Changes, Edit, Insertion, Move, Tetrahedralization, VertexId, spatial_order,
};
use crate::visibility::rays::Rays;
use crate::visibility::{Cells, ObservationId, RayVisibility, Space, Views};

/// Number of list entries below which the lists are never built again as a whole.
const MANY_ENTRIES: u64 = 1 << 14;

/// The effect of a transaction.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CommitReport {
    /// The change of the surface.
    pub surface: SurfaceDelta,
    /// Number of new points at the position of another point; they share its vertex.
    pub duplicates: usize,
    /// Cells destroyed, ghost cells included.
    pub destroyed_cells: usize,
    /// Cells created, ghost cells included.
    pub created_cells: usize,
    /// Time spent, by part.
    pub times: CommitTimes,
}

/// Time spent by a commit, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CommitTimes {
    /// Inserting, removing and moving vertices.
    pub tetrahedra: Duration,
    /// Visibility: walking rays.
    pub carving: Duration,
    /// Labels and surface.
    pub surface: Duration,
}

/// Commits a transaction, or refuses it as a whole.
pub(super) fn commit(transaction: Transaction<'_>) -> Result<CommitReport, TransactionError> {
    let Transaction { carver, mut plan } = transaction;
    plan.drop_idle_changes(carver);
    let affected = plan.affected(carver);
    plan.check_lengths(carver, &affected.rays)?;
    let changed = plan.points.len() + plan.new_points.len();
    let has_room = match carver.is_deferred {
        true => Tetrahedralization::new().has_room_for(carver.points.len() + changed),
        false => carver.tetrahedra.has_room_for(changed),
    };
    if !has_room {
        return Err(TransactionError::Full);
    }
    Ok(match carver.is_deferred {
        true => carver.make_deferred(&plan, affected),
        false => carver.make(&plan, affected),
    })
}

/// Entries of a map in the order of their keys, so that hash order stays inside.
pub(super) fn sorted(map: &FxHashMap<u32, PendingChange>) -> Vec<(u32, PendingChange)> {
    let mut entries: Vec<(u32, PendingChange)> =
        map.iter().map(|(&id, &change)| (id, change)).collect();
    entries.sort_unstable_by_key(|(id, _)| *id);
    entries
}

impl Plan {
    /// Removes affected observations from the cells, unless all lists are built again anyway, and those that end from the
    /// table. Returns the others, some of them under other numbers.
    pub(super) fn withdraw(
        &self,
        rays: &mut RayVisibility,
        space: &mut Space<'_>,
        (affected, is_rebuilt): (Vec<ObservationId>, bool),
    ) -> Vec<ObservationId> {
        let mut remaining = affected;
        if !is_rebuilt {
            rays.remove(space, &mut remaining);
        }
        remaining.retain(|&id| {
            let is_removed = self.removes(rays.table(), id);
            if is_removed {
                rays.table_mut().remove(id);
            }
            !is_removed
        });
        remaining
    }
}

impl PlannedRays {
    /// Updates the withdrawn observations in the table, inserts the new ones and appends them to `ids`: those that are to be
    /// added to cells.
    pub(super) fn enter(
        &self,
        table: &mut Rays,
        (views, points): (&Views, &Points),
        first_new_view: u32,
        ids: &mut Vec<ObservationId>,
    ) {
        for &id in &*ids {
            if let Some(Some(weight)) = self.get(table.view(id), table.point(id)) {
                table.set_weight(id, weight);
            }
        }
        for (view, point, weight) in self.iter() {
            let Some(weight) = weight else { continue };
            let is_valid = views.is_alive(view) && points.get(point).is_some();
            // A new view has no observations in the table.
            if is_valid && (view >= first_new_view || table.find(view, point).is_none()) {
                ids.push(table.insert(view, point, weight));
            }
        }
        enter_ends(table, points, ids);
    }
}

/// Enters the total weights of the rays to these points into the table for the rays among `changed`. Returns the others whose total weight
/// is another one now.
pub(super) fn enter_support(
    table: &mut Rays,
    points: &[u32],
    changed: &[ObservationId],
) -> Vec<ObservationId> {
    let changed: FxHashSet<u32> = changed.iter().map(|ray| ray.0).collect();
    let mut listed = Vec::new();
    let mut rays: Vec<ObservationId> = Vec::new();
    for &point in points {
        let support = table.total_weight(point);
        rays.clear();
        rays.extend(table.of_point(point));
        for &ray in &rays {
            if table.support(ray) == support {
                continue;
            }
            match changed.contains(&ray.0) {
                true => table.set_support(ray, support),
                false => listed.push(ray),
            }
        }
    }
    listed
}

/// Enters the vertices and deviations of points into the table of rays.
pub(super) fn enter_ends(table: &mut Rays, points: &Points, ids: &[ObservationId]) {
    for &id in ids {
        let point = table.point(id);
        let vertex = points.get(point).map_or(NO_VERTEX, |record| record.vertex);
        table.set_end(id, vertex, points.sigma(point));
    }
}

impl Carver {
    /// The rays, and the state that they are walked through.
    pub(super) fn visibility(&mut self) -> (Space<'_>, &mut RayVisibility) {
        let space = Space {
            tetrahedra: &self.tetrahedra,
            views: &self.views,
            cells: &mut self.cells,
        };
        (space, &mut self.rays)
    }

    /// Makes the changes of a valid transaction.
    fn make(&mut self, plan: &Plan, affected: Affected) -> CommitReport {
        let mut report = CommitReport::default();
        let start = Instant::now();
        let first_new_view = self.views.capacity() as u32;
        // When most rays change, or there were no cells to list them, all lists are built again.
        let mut is_rebuilt =
            self.tetrahedra.dimension() < 3 || affected.rays.len() > self.rays.table().len() / 2;
        let sigmas = &plan.sigmas;
        let sigma = |point: u32| sigmas.get(&point).copied().flatten();
        let (mut space, rays) = self.visibility();
        match is_rebuilt {
            true => {
                let table = rays.table_mut();
                for &ray in &affected.resoftened {
                    table.set_end(ray, table.vertex(ray), sigma(table.point(ray)));
                }
            }
            false => rays.resoften(&mut space, &affected.resoftened, sigma),
        }
        let Affected {
            rays: affected_rays,
            supported,
            ..
        } = affected;
        let mut changed_rays = plan.withdraw(rays, &mut space, (affected_rays, is_rebuilt));
        self.update_views(plan);
        report.times.carving += start.elapsed();

        let start = Instant::now();
        let mut changes = std::mem::take(&mut self.changes);
        self.update_points(plan, &mut changes, &mut report);
        for (&point, &sigma) in &plan.sigmas {
            self.points.set_sigma(point, sigma);
        }
        report.destroyed_cells = changes.destroyed.len();
        report.created_cells = changes.created.len();
        report.times.tetrahedra += start.elapsed();

        let start = Instant::now();
        let ends = (&self.views, &self.points);
        let table = self.rays.table_mut();
        plan.rays
            .enter(table, ends, first_new_view, &mut changed_rays);
        let reweighed = enter_support(table, &supported, &changed_rays);
        // Walking again inside half of the lists costs as much as walking all rays.
        let crossings = self.rays.crossings();
        let destroyed = changes.destroyed.iter();
        let listed: u64 = destroyed.map(|&cell| crossings.listed(cell)).sum();
        is_rebuilt |= listed > (crossings.total() / 2).max(MANY_ENTRIES);
        if is_rebuilt {
            self.rays.clear();
            self.cells.clear();
            changed_rays.clear();
            changed_rays.extend(self.rays.table().all());
            let table = self.rays.table_mut();
            reweighed.iter().for_each(|ray| table.update_support(*ray));
        }
        self.cells.begin_update(&self.tetrahedra, &changes);
        self.views.locate_stale(&self.tetrahedra, |cell| {
            self.cells.is_new(cell) || !self.tetrahedra.is_cell(cell)
        });
        let (mut space, rays) = self.visibility();
        rays.rewalk(&mut space, &changes);
        space.cells.end_update(&changes);
        if !is_rebuilt {
            rays.reweigh(&mut space, &reweighed);
        }
        rays.add(&mut space, &mut changed_rays);
        self.update_samples(plan, &changes, is_rebuilt);
        report.times.carving += start.elapsed();
        self.update_surface(changes, is_rebuilt, &mut report);
        report
    }

    /// Brings labels and surface up to date after `changes` of the cells and of what passes through them; of all cells, if all
    /// lists were built again.
    pub(super) fn update_surface(
        &mut self,
        changes: Changes,
        is_rebuilt: bool,
        report: &mut CommitReport,
    ) {
        let start = Instant::now();
        let mut flipped = std::mem::take(self.cells.flipped());
        if is_rebuilt {
            flipped.clear();
            flipped.extend(self.tetrahedra.cells());
        }
        if let Labeling::Cut(cut) = &mut self.labels {
            if is_rebuilt {
                for &cell in &flipped {
                    self.cells.evidence.touch(cell);
                }
            }
            cut.update(&self.tetrahedra, &changes, &mut self.cells.evidence);
            flipped.extend(cut.flipped());
        }
        let (tetrahedra, cells, labels) = (&self.tetrahedra, &self.cells, &self.labels);
        let hull = self.facets.hull();
        self.facets.update(
            tetrahedra,
            &changes,
            &flipped,
            |cell| match tetrahedra.is_ghost(cell) {
                true => hull == Hull::Free,
                false => labels.is_free(cell, cells),
            },
            &mut report.surface,
        );
        flipped.clear();
        *self.cells.flipped() = flipped;
        self.changes = changes;
        report.times.surface += start.elapsed();
    }

    pub(super) fn update_views(&mut self, plan: &Plan) {
        for (view, change) in sorted(&plan.views) {
            match change {
                PendingChange::Removed => self.views.remove(view),
                PendingChange::Moved(center) => self.views.move_to(view, center),
            }
        }
        for center in &plan.new_views {
            // The id is used even if the view was removed again.
            let view = self.views.add(center.unwrap_or_default());
            if center.is_none() {
                self.views.remove(view);
            }
        }
    }

    /// Changes the vertices and lists the net effect on the cells.
    fn update_points(&mut self, plan: &Plan, changes: &mut Changes, report: &mut CommitReport) {
        let mut vertices = Vertices {
            edit: self.tetrahedra.edit(changes),
            before: FxHashMap::default(),
        };
        let pending = sorted(&plan.points);
        for &(point, change) in &pending {
            if change == PendingChange::Removed
                && let Some((vertex, 0)) = self.points.detach(point)
            {
                vertices.remove(vertex);
            }
        }
        for &(point, change) in &pending {
            let PendingChange::Moved(position) = change else {
                continue;
            };
            if let Some((vertex, users)) = self.points.detach(point) {
                let vertex = if users == 0 {
                    vertices.move_to(vertex, position)
                } else {
                    vertices.insert(position).0
                };
                self.points.attach(point, position, vertex);
            }
        }
        let first = self.points.capacity() as u32;
        let (ids, positions): (Vec<u32>, Vec<Point3<f64>>) = (first..)
            .zip(&plan.new_points)
            .filter_map(|(id, position)| position.map(|p| (id, Point3::from(p))))
            .unzip();
        for _ in &plan.new_points {
            self.points.reserve_id();
        }
        vertices.edit.reserve(positions.len());
        for index in spatial_order(&positions) {
            let position = positions[index as usize].into();
            let (vertex, is_new) = vertices.insert(position);
            report.duplicates += usize::from(!is_new);
            self.points.attach(ids[index as usize], position, vertex);
        }
        let before = vertices.finish();
        report.surface.moved = before
            .into_iter()
            .map(|(vertex, position)| (VertexId::from_index(vertex as usize), position))
            .filter(|(vertex, position)| {
                self.tetrahedra.is_vertex(*vertex)
                    && self.tetrahedra.coordinates(*vertex) != position
            })
            .map(|(vertex, _)| vertex)
            .collect();
        report.surface.moved.sort_unstable();
    }
}

impl Labeling {
    /// Whether a finite cell is free.
    pub(super) fn is_free(&self, cell: CellId, cells: &Cells) -> bool {
        match self {
            Labeling::Votes(votes) => votes.is_free(cells.weight(cell)),
            Labeling::Cut(cut) => cut.is_free(cell),
        }
    }
}

/// Vertices under edit, with the positions that they had before.
struct Vertices<'a> {
    edit: Edit<'a>,
    before: FxHashMap<u32, [f64; 3]>,
}

impl Vertices<'_> {
    fn tetrahedra(&self) -> &Tetrahedralization {
        self.edit.tetrahedra()
    }

    fn remember(&mut self, vertex: VertexId) {
        let position = *self.tetrahedra().coordinates(vertex);
        self.before.entry(vertex.index() as u32).or_insert(position);
    }

    fn remove(&mut self, vertex: u32) {
        let vertex = VertexId::from_index(vertex as usize);
        self.remember(vertex);
        self.edit
            .remove(vertex)
            .expect("the vertex of a point is in use");
    }

    /// The vertex at a position, and whether it is new.
    fn insert(&mut self, position: [f64; 3]) -> (u32, bool) {
        let outcome = self
            .edit
            .insert(Point3::from(position), None)
            .expect("positions were accepted, and room checked, when the event was");
        let is_new = matches!(outcome, Insertion::Inserted(_));
        (outcome.vertex().index() as u32, is_new)
    }

    /// Moves a vertex that no other point uses; returns the one that is at the position then.
    fn move_to(&mut self, vertex: u32, position: [f64; 3]) -> u32 {
        let id = VertexId::from_index(vertex as usize);
        self.remember(id);
        let outcome = self
            .edit
            .move_vertex(id, Point3::from(position))
            .expect("positions were accepted, and room checked, when the event was");
        match outcome {
            Move::InPlace | Move::Reinserted => vertex,
            Move::Duplicate(taken) => {
                self.remove(vertex);
                taken.index() as u32
            }
        }
    }

    fn finish(self) -> FxHashMap<u32, [f64; 3]> {
        self.edit.finish();
        self.before
    }
}
