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
use crate::surface::Facets;
use crate::tetrahedralization::{Changes, Insertion, Tetrahedralization};
use crate::visibility::ObservationId;

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
        let start = Instant::now();
        self.forget_cells();
        self.insert_points(&mut report);
        let changes = Changes {
            created: self.tetrahedra.cells().collect(),
            ..Changes::default()
        };
        report.created_cells = changes.created.len();
        report.times.tetrahedra += start.elapsed();

        let start = Instant::now();
        let table = self.rays.table_mut();
        let mut rays: Vec<ObservationId> = table.all().collect();
        enter_ends(table, &self.points, &rays);
        self.cells.begin_update(&self.tetrahedra, &changes);
        self.cells.end_update(&changes);
        self.views.locate_stale(&self.tetrahedra, |_| true);
        self.cells.evidence.list_changes(false);
        let (mut space, ray_visibility) = self.visibility();
        ray_visibility.add(&mut space, &mut rays);
        self.samples
            .locate(&self.tetrahedra, &mut self.cells.evidence, false);
        self.cells.evidence.list_changes(true);
        report.times.carving += start.elapsed();
        self.update_surface(changes, false, &mut report);
        self.changes = Changes::default();
        report
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
