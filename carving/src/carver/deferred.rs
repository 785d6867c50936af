//! A carver that carves once: sums in place of lists.
//!
//! While changes of points, views, observations and samples come in, nothing but their tables follows. [`Carver::carve`] then
//! inserts all points, walks each ray and locates each sample once, and adds what they say to the sums
//! of the cells. Sums are integers, so they are those that the lists of an incremental carver lead to; labels and surface follow
//! from them by the same functions.

use std::time::Instant;

use nalgebra::Point3;

use super::affected::Affected;
use super::commit::{CommitReport, enter_ends, enter_support, sorted};
use super::transaction::{PendingChange, Plan};
use super::{Carver, CarverOptions, Labeling};
use crate::labels::Cut;
use crate::surface::{Facets, Hull};
use crate::tetrahedralization::{Changes, Insertion, Tetrahedralization};
use crate::visibility::{ObservationId, Samples, Viewpoint};

impl Carver {
    /// An empty carver whose cells, labels and surface are made by [`carve`](Self::carve) and by nothing else. Transactions change
    /// points, views, observations and samples, and cost no more than that.
    ///
    /// The state after [`carve`](Self::carve) is that of any other carver with the same points, views, observations and samples.
    /// Without lists of rays it takes a fraction of the memory and, where only the last state is of interest, of the time.
    pub fn deferred(options: CarverOptions) -> Self {
        Self::with_lists(options, false)
    }

    /// Whether the carver was made by [`deferred`](Self::deferred).
    pub fn is_deferred(&self) -> bool {
        self.is_deferred
    }

    /// Makes cells, labels and surface of a [deferred](Self::deferred) carver from its points, views, observations and samples. They
    /// stay as they are until the next call, which begins anew. Does nothing in other carvers.
    ///
    /// The report is that of a change from the empty state; ids of cells and vertices are new.
    ///
    /// # Complexity
    ///
    /// That of the tetrahedralisation of all points, per observation the cells that it passes through, and the sort of all
    /// samples along a curve.
    pub fn carve(&mut self) -> CommitReport {
        let mut report = CommitReport::default();
        if !self.is_deferred {
            return report;
        }
        let changes = self.make_cells(&mut report);
        self.begin_cells(&changes);
        self.walk_all(&mut report);
        self.update_surface(changes, false, &mut report);
        self.changes = Changes::default();
        report
    }

    /// [Carves](Self::carve) and forgets all observations and samples, to need less memory. Cells, labels and surface stay until the next
    /// call; the report lists no triangles. Does nothing in carvers that are not [deferred](Self::deferred).
    ///
    /// # Complexity
    ///
    /// As [`carve`](Self::carve).
    pub fn carve_and_forget(&mut self) -> CommitReport {
        self.carve_last(|carver| carver.facets.hull())
    }

    /// As [`carve_and_forget`](Self::carve_and_forget), with a closed surface: where most rays come from outside the hull, that of the
    /// occupied cells ([`Hull::Free`]); otherwise that of the free cells ([`Hull::Keep`]).
    pub fn carve_closed(&mut self) -> CommitReport {
        self.carve_last(
            |carver| match 2 * carver.outside_rays() > carver.ray_count() {
                true => Hull::Free,
                false => Hull::Keep,
            },
        )
    }

    /// Number of rays that begin outside the hull.
    fn outside_rays(&self) -> usize {
        let is_outside = |view: &u32| matches!(self.views.viewpoint(*view), Viewpoint::Outside(_));
        let table = self.rays.table();
        let views = self.views.ids().filter(is_outside);
        views.map(|view| table.of_view(view).count()).sum()
    }

    /// Carves and forgets; `hull` chooses what happens at the hull, once the rays have been walked.
    fn carve_last(&mut self, hull: impl FnOnce(&Self) -> Hull) -> CommitReport {
        let mut report = CommitReport::default();
        if !self.is_deferred {
            return report;
        }
        let changes = self.make_cells(&mut report);
        self.begin_cells(&changes);
        drop(changes);
        self.walk_all(&mut report);
        let start = Instant::now();
        let hull = hull(self);
        self.rays.forget();
        self.samples = Samples::new(self.cells.evidence.is_on());
        if let Labeling::Cut(cut) = &mut self.labels {
            self.cells.forget_weights();
            cut.solve_once(&self.tetrahedra, &mut self.cells.evidence);
        }
        let (tetrahedra, cells, labels) = (&self.tetrahedra, &self.cells, &self.labels);
        self.facets = Facets::new(hull);
        self.facets
            .fill(tetrahedra, |cell| match tetrahedra.is_ghost(cell) {
                true => hull == Hull::Free,
                false => labels.is_free(cell, cells),
            });
        if let Labeling::Cut(cut) = &mut self.labels {
            **cut = Cut::new(cut.options());
        }
        report.times.surface += start.elapsed();
        report
    }

    /// Chooses what happens at the hull, before a [deferred](Self::deferred) carver carves; does nothing in others.
    pub fn set_hull(&mut self, hull: Hull) {
        if self.is_deferred {
            self.facets = Facets::new(hull);
        }
    }

    /// Makes the cells of all points.
    fn make_cells(&mut self, report: &mut CommitReport) -> Changes {
        let start = Instant::now();
        self.forget_cells();
        self.insert_points(report);
        let mut created = Vec::with_capacity(self.tetrahedra.cells().count());
        created.extend(self.tetrahedra.cells());
        report.created_cells = created.len();
        report.times.tetrahedra += start.elapsed();
        Changes {
            created,
            ..Changes::default()
        }
    }

    /// Makes room for what observations and samples say of the new cells.
    fn begin_cells(&mut self, changes: &Changes) {
        self.cells.begin_update(&self.tetrahedra, changes);
        self.cells.end_update(changes);
    }

    /// Walks all rays, and locates all samples.
    fn walk_all(&mut self, report: &mut CommitReport) {
        let start = Instant::now();
        let table = self.rays.table_mut();
        let mut rays: Vec<ObservationId> = Vec::with_capacity(table.len());
        rays.extend(table.all());
        enter_ends(table, &self.points, &rays);
        self.views.locate_stale(&self.tetrahedra, |_| true);
        self.cells.evidence.list_changes(false);
        let (mut space, ray_visibility) = self.visibility();
        ray_visibility.add(&mut space, &mut rays);
        self.samples
            .locate(&self.tetrahedra, &mut self.cells.evidence, false);
        self.cells.evidence.list_changes(true);
        report.times.carving += start.elapsed();
    }

    /// Back to no cells.
    fn forget_cells(&mut self) {
        self.tetrahedra = Tetrahedralization::new();
        self.points.forget_vertices();
        self.rays.clear();
        self.samples.forget_cells();
        self.cells.forget();
        self.facets = Facets::new(self.facets.hull());
        if let Labeling::Cut(cut) = &mut self.labels {
            **cut = Cut::new(cut.options());
        }
    }

    /// Inserts all points in spatial order.
    fn insert_points(&mut self, report: &mut CommitReport) {
        let (ids, positions): (Vec<u32>, Vec<Point3<f64>>) = (self.points.ids())
            .filter_map(|id| Some((id, Point3::from(self.points.get(id)?.position))))
            .unzip();
        let (tetrahedra, outcomes) = Tetrahedralization::from_points(&positions)
            .expect("positions were accepted, and room checked, when they came");
        for (id, outcome) in ids.into_iter().zip(outcomes) {
            let is_new = matches!(outcome, Insertion::Inserted(_));
            report.duplicates += usize::from(!is_new);
            self.points.set_vertex(id, outcome.vertex().index() as u32);
        }
        self.tetrahedra = tetrahedra;
    }

    /// Changes points, views, observations and samples, and nothing that follows from them.
    pub(super) fn make_deferred(&mut self, plan: &Plan, affected: Affected) -> CommitReport {
        let first_new_view = self.views.capacity() as u32;
        let (mut space, rays) = self.visibility();
        // As if all lists were built again: there are none to withdraw from.
        let mut rays = plan.withdraw(rays, &mut space, (affected.rays, true));
        self.update_views(plan);
        for (point, change) in sorted(&plan.points) {
            self.points.remove(point);
            if let PendingChange::Moved(position) = change {
                self.points.put(point, position);
            }
        }
        for position in &plan.new_points {
            let point = self.points.reserve_id();
            if let Some(position) = *position {
                self.points.put(point, position);
            }
        }
        for (&point, &sigma) in &plan.sigmas {
            self.points.set_sigma(point, sigma);
        }
        let ends = (&self.views, &self.points);
        let table = self.rays.table_mut();
        plan.rays.enter(table, ends, first_new_view, &mut rays);
        for ray in enter_support(table, &affected.supported, &[]) {
            table.update_support(ray);
        }
        self.enter_samples(plan, true);
        CommitReport::default()
    }
}
