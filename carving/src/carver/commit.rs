//! Making the changes of a transaction.

use std::time::{Duration, Instant};

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::concerned::Concerned;
use super::events::EventError;
use super::transaction::{Fate, Plan, Transaction};
use super::{Carver, Labeling};
use crate::surface::SurfaceDelta;
use crate::tetrahedralization::{
    CellId, Changes, Edit, Insertion, Move, Tetrahedralization, VertexId, spatial_order,
};
use crate::visibility::{Crossings, RayId, Rewalk, Sheet, SheetWalk};

/// Entries of crossing lists below which the way that they are brought up to date does not matter.
const MANY_ENTRIES: u64 = 1 << 14;

/// What a transaction did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CommitReport {
    /// The change of the surface.
    pub surface: SurfaceDelta,
    /// New points whose position was taken; they share the vertex there.
    pub duplicates: usize,
    /// Cells destroyed, ghost cells included.
    pub destroyed_cells: usize,
    /// Cells created, ghost cells included.
    pub created_cells: usize,
    /// Where the time went.
    pub times: CommitTimes,
}

/// Time spent by a commit, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommitTimes {
    /// Inserting, removing and moving vertices.
    pub tetrahedra: Duration,
    /// Walking rays.
    pub carving: Duration,
    /// Labels and surface.
    pub surface: Duration,
}

/// Makes the changes of a transaction, or none.
pub(super) fn commit(transaction: Transaction<'_>) -> Result<CommitReport, EventError> {
    let Transaction { carver, mut plan } = transaction;
    plan.drop_idle_moves(carver);
    let concerned = plan.concerned(carver);
    plan.check_lengths(carver, &concerned.rays)?;
    if !carver
        .tetrahedra
        .has_room_for(plan.points.len() + plan.new_points.len())
    {
        return Err(EventError::Full);
    }
    Ok(carver.make(&plan, &concerned))
}

/// Entries of a map in the order of their keys, so that hash order stays inside.
fn sorted(map: &FxHashMap<u32, Fate>) -> Vec<(u32, Fate)> {
    let mut entries: Vec<(u32, Fate)> = map.iter().map(|(&id, &fate)| (id, fate)).collect();
    entries.sort_unstable_by_key(|(id, _)| *id);
    entries
}

impl Carver {
    fn rewalk(&mut self) -> Rewalk<'_> {
        Rewalk {
            tetrahedra: &self.tetrahedra,
            views: &mut self.views,
            rays: &mut self.rays,
            crossings: &mut self.crossings,
            evidence: &mut self.evidence,
            scratch: &mut self.scratch,
        }
    }

    fn sheet_walk(&mut self) -> SheetWalk<'_> {
        SheetWalk {
            tetrahedra: &self.tetrahedra,
            views: &self.views,
            sheets: &mut self.sheets,
            lists: &mut self.meetings,
            weights: &mut self.crossings,
            evidence: &mut self.evidence,
            scratch: &mut self.sheet_scratch,
        }
    }

    /// Makes changes that have been found valid.
    fn make(&mut self, plan: &Plan, concerned: &Concerned) -> CommitReport {
        let mut report = CommitReport::default();
        let start = Instant::now();
        let first_new_view = self.views.capacity() as u32;
        // When most rays change, or there were no cells to list them, all are walked anew.
        let mut anew =
            self.tetrahedra.dimension() < 3 || concerned.rays.len() > self.rays.len() / 2;
        let mut again = Vec::with_capacity(concerned.rays.len());
        let mut sheets_again = Vec::with_capacity(concerned.sheets.len());
        if !anew {
            self.rewalk().remove(&concerned.rays);
            self.sheet_walk().remove(&concerned.sheets);
        }
        for &ray in &concerned.rays {
            if plan.ends(self, ray) {
                self.rays.remove(ray);
            } else {
                again.push(ray);
            }
        }
        for &sheet in &concerned.sheets {
            if plan.ends_sheet(self, sheet) {
                self.sheets.remove(sheet);
            } else {
                sheets_again.push(sheet);
            }
        }
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
        for &ray in &again {
            let point = self.rays.point(ray);
            if let Some(record) = self.points.get(point) {
                self.rays.set_vertex(ray, record.vertex);
            }
            if let Some(Some(weight)) = plan.observations.get(&(self.rays.view(ray), point)) {
                self.rays.set_weight(ray, *weight);
            }
        }
        self.add_rays(plan, first_new_view, &mut again);
        // Walking again inside half of the lists costs as much as walking all rays.
        let destroyed = changes.destroyed.iter();
        let listed: u64 = destroyed.map(|&cell| self.crossings.listed(cell)).sum();
        anew |= listed > (self.crossings.total() / 2).max(MANY_ENTRIES);
        for &ray in &again {
            let sigma = self.points.sigma(self.rays.point(ray));
            self.evidence.describe(ray, sigma);
        }
        self.update_sheets(plan, &mut sheets_again);
        if anew {
            self.crossings.clear();
            self.meetings.clear();
            self.evidence.clear();
        }
        self.rewalk().update(&changes);
        self.sheet_walk().update(&changes);
        if anew {
            again.clear();
            again.extend(self.rays.all());
            sheets_again.clear();
            sheets_again.extend(self.sheets.all());
        }
        self.rewalk().add_all(&mut again);
        self.sheet_walk().add_all(&sheets_again);
        report.times.carving += start.elapsed();

        let start = Instant::now();
        let mut flipped = std::mem::take(self.crossings.flipped());
        if anew {
            flipped.clear();
            flipped.extend(self.tetrahedra.cells());
        }
        if let Labeling::Cut(cut) = &mut self.labels {
            if anew {
                for &cell in &flipped {
                    self.evidence.touch(cell);
                }
            }
            cut.update(&self.tetrahedra, &changes, &mut self.evidence);
            flipped.extend(cut.flipped());
        }
        let (tetrahedra, crossings, labels) = (&self.tetrahedra, &self.crossings, &self.labels);
        self.facets.update(
            tetrahedra,
            &changes,
            &flipped,
            |cell| !tetrahedra.is_ghost(cell) && labels.is_free(cell, crossings),
            &mut report.surface,
        );
        flipped.clear();
        *self.crossings.flipped() = flipped;
        self.changes = changes;
        report.times.surface += start.elapsed();
        report
    }

    fn update_views(&mut self, plan: &Plan) {
        for (view, fate) in sorted(&plan.views) {
            match fate {
                Fate::Removed => self.views.remove(view),
                Fate::Moved(center) => self.views.move_to(view, center),
            }
        }
        for center in &plan.new_views {
            // The id is used up even if the view was removed again.
            let view = self.views.add(center.unwrap_or_default());
            if center.is_none() {
                self.views.remove(view);
            }
        }
    }

    /// Adds the rays of new observations and lists them in `added`.
    fn add_rays(&mut self, plan: &Plan, first_new_view: u32, added: &mut Vec<RayId>) {
        for key in &plan.order {
            let Some(weight) = plan.observations[key] else {
                continue;
            };
            let &(view, point) = key;
            let Some(record) = self.points.get(point) else {
                continue;
            };
            let vertex = record.vertex;
            let is_new = view >= first_new_view || self.rays.find(view, point).is_none();
            if self.views.is_alive(view) && is_new {
                added.push(self.rays.add(view, point, vertex, weight));
            }
        }
    }

    /// Gives changed segments their vertices, weights and deviations, adds the new ones and lists them in `added`.
    fn update_sheets(&mut self, plan: &Plan, added: &mut Vec<RayId>) {
        for &sheet in added.iter() {
            let Sheet { view, points, .. } = *self.sheets.get(sheet);
            let vertices = points.map(|point| self.points.get(point).map(|record| record.vertex));
            let record = self.sheets.get_mut(sheet);
            if let [Some(a), Some(b)] = vertices {
                record.vertices = [a, b];
            }
            if let Some(Some(weight)) = plan.segments.get(&(view, points)) {
                record.weight = *weight;
            }
        }
        for key in &plan.segment_order {
            let &(view, points) = key;
            let vertices = points.map(|point| self.points.get(point).map(|record| record.vertex));
            let (Some(weight), [Some(a), Some(b)]) = (plan.segments[key], vertices) else {
                continue;
            };
            if self.views.is_alive(view) && self.sheets.find(view, points).is_none() {
                added.push(self.sheets.add(view, points, [a, b], weight));
            }
        }
        for &sheet in added.iter() {
            let record = self.sheets.get_mut(sheet);
            record.sigmas = record.points.map(|point| self.points.sigma(point));
        }
    }

    /// Changes the vertices and lists the net effect on the cells.
    fn update_points(&mut self, plan: &Plan, changes: &mut Changes, report: &mut CommitReport) {
        let mut vertices = Vertices {
            edit: self.tetrahedra.edit(changes),
            before: FxHashMap::default(),
        };
        let fates = sorted(&plan.points);
        for &(point, fate) in &fates {
            if fate == Fate::Removed
                && let Some((vertex, 0)) = self.points.detach(point)
            {
                vertices.remove(vertex);
            }
        }
        for &(point, fate) in &fates {
            let Fate::Moved(position) = fate else {
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
    pub(super) fn is_free(&self, cell: CellId, crossings: &Crossings) -> bool {
        match self {
            Labeling::Votes(votes) => votes.is_free(crossings.weight(cell)),
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
