//! The state, transactions that change it, and its checks.

mod affected;
mod check;
mod commit;
mod deferred;
mod error;
mod ids;
mod points;
mod samples;
#[cfg(any(test, feature = "internals"))]
mod snapshot;
mod transaction;

pub use check::CarverViolation;
pub use commit::{CommitReport, CommitTimes};
pub use error::TransactionError;
pub use ids::{PointId, SampleId, ViewId};
#[cfg(any(test, feature = "internals"))]
pub use snapshot::{CarvedCell, Snapshot};
pub use transaction::Transaction;

use nalgebra::Point3;

use crate::labels::{Cut, Labels, Votes};
use crate::surface::{
    Carved, ExportOptions, Facets, Hull, IncrementalMesh, IndexedMesh, Triangle, TriangleRole,
    VertexOrigin,
};
use crate::tetrahedralization::{CellId, Changes, IncidentCells, Tetrahedralization, VertexId};
use crate::visibility::{Cells, RayVisibility, Samples, Views};

use points::{NO_VERTEX, Points};

/// Options of a [`Carver`], fixed for its life.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
#[non_exhaustive]
pub struct CarverOptions {
    /// How cells are labelled; by default by a minimum cut.
    pub labels: Labels,
    /// Whether facets between free cells and the outside of the hull are part of the surface.
    pub hull: Hull,
}

impl CarverOptions {
    /// These labels, and this rule for the hull.
    pub fn new(labels: Labels, hull: Hull) -> Self {
        Self { labels, hull }
    }

    /// These labels; facets on the hull are dropped.
    pub fn with_labels(labels: Labels) -> Self {
        Self::new(labels, Hull::default())
    }

    /// The default labels, and this rule for the hull.
    pub fn with_hull(hull: Hull) -> Self {
        Self::new(Labels::default(), hull)
    }
}

/// Labels and their state.
#[derive(Clone, Debug)]
enum Labeling {
    Votes(Votes),
    Cut(Box<Cut>),
}

/// A tetrahedralisation carved by rays; the [crate](crate) page has an example.
///
/// The state consists of points with positions, views with centres, observations (a view and a point) and samples with positions,
/// the last two with integer weights. A [`Transaction`] changes it. After any sequence of changes tetrahedra, labels and
/// surface are identical to those built from scratch from the final state in any order.
///
/// Ids of points and views are never given out twice. Points at equal positions share a vertex and keep rays of their own.
///
/// *Non-guarantees:* [`Labels::Votes`] does not reject wrong points: a wrong point carves the space before it. Labels are free
/// and occupied only; unobserved space is occupied.
#[derive(Clone, Debug)]
pub struct Carver {
    /// Whether cells, labels and surface are made by [`carve`](Self::carve) alone.
    is_deferred: bool,
    labels: Labeling,
    tetrahedra: Tetrahedralization,
    points: Points,
    views: Views,
    rays: RayVisibility,
    samples: Samples,
    cells: Cells,
    facets: Facets,
    changes: Changes,
}

impl Default for Carver {
    fn default() -> Self {
        Self::new(CarverOptions::default())
    }
}

impl Carver {
    /// An empty carver.
    pub fn new(options: CarverOptions) -> Self {
        Self::with_lists(options, true)
    }

    fn with_lists(options: CarverOptions, has_lists: bool) -> Self {
        let (labels, threshold, softness) = match options.labels {
            Labels::Votes(votes) => (Labeling::Votes(votes), votes.threshold.get(), None),
            Labels::Cut(cut) => {
                let labels = Labeling::Cut(Box::new(Cut::new(cut)));
                (labels, u64::MAX, Some(cut.softness()))
            }
        };
        Self {
            is_deferred: !has_lists,
            labels,
            tetrahedra: Tetrahedralization::new(),
            points: Points::default(),
            views: Views::default(),
            rays: RayVisibility::new(softness, has_lists),
            samples: Samples::new(softness.is_some()),
            cells: Cells::new(threshold, softness.is_some()),
            facets: Facets::new(options.hull),
            changes: Changes::new(),
        }
    }

    /// The options.
    pub fn options(&self) -> CarverOptions {
        CarverOptions {
            labels: match &self.labels {
                Labeling::Votes(votes) => Labels::Votes(*votes),
                Labeling::Cut(cut) => Labels::Cut(cut.options()),
            },
            hull: self.facets.hull(),
        }
    }

    /// The tetrahedra of all points.
    pub fn tetrahedra(&self) -> &Tetrahedralization {
        &self.tetrahedra
    }

    /// Number of points; points that share a vertex count each.
    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// Number of views.
    pub fn view_count(&self) -> usize {
        self.views.ids().count()
    }

    /// Number of observations.
    pub fn ray_count(&self) -> usize {
        self.rays.table().len()
    }

    /// Number of pairs of a ray and a cell, finite or ghost, that it crosses or in whose boundary it runs. Unless the carver is
    /// [deferred](Self::deferred), each is an entry in the list of its cell.
    pub fn crossing_count(&self) -> u64 {
        self.rays.crossings().total()
    }

    /// Bytes of the crossing lists of rays and of the weights, the largest part of the memory.
    pub fn crossing_bytes(&self) -> usize {
        self.rays.crossings().bytes() + self.cells.weight_bytes()
    }

    /// Position of a point; `None` if it was removed or never added.
    pub fn point(&self, point: PointId) -> Option<Point3<f64>> {
        self.points
            .get(point.0)
            .map(|record| Point3::from(record.position))
    }

    /// Vertex of a point; shared by all points at the same position. `None` if it was removed or never added, and in a
    /// [deferred](Self::deferred) carver until it carves.
    pub fn vertex_of(&self, point: PointId) -> Option<VertexId> {
        let vertex = self.points.get(point.0)?.vertex;
        (vertex != NO_VERTEX).then(|| VertexId::from_index(vertex as usize))
    }

    /// Standard deviation of a point along its rays, where it was set.
    pub fn sigma(&self, point: PointId) -> Option<f64> {
        self.points.sigma(point.0)
    }

    /// Centre of a view; `None` if it was removed or never added.
    pub fn view(&self, view: ViewId) -> Option<Point3<f64>> {
        self.views
            .is_alive(view.0)
            .then(|| Point3::from(*self.views.center(view.0)))
    }

    /// Weight of an observation; `None` if there is none.
    pub fn observation(&self, view: ViewId, point: PointId) -> Option<u32> {
        let rays = self.rays.table();
        rays.find(view.0, point.0).map(|ray| rays.weight(ray))
    }

    /// The views that see a point, in no particular order; none if it was removed or never added.
    pub fn views_of(&self, point: PointId) -> impl Iterator<Item = ViewId> + '_ {
        let rays = self.rays.table();
        rays.of_point(point.0).map(|ray| ViewId(rays.view(ray)))
    }

    /// All observations with their weights, by view; within a view in no particular order.
    pub fn observations(&self) -> impl Iterator<Item = (ViewId, PointId, u32)> + '_ {
        let rays = self.rays.table();
        rays.all().map(|ray| {
            let point = rays.point(ray);
            (ViewId(rays.view(ray)), PointId(point), rays.weight(ray))
        })
    }

    /// Ids of all points, increasing.
    pub fn points(&self) -> impl Iterator<Item = PointId> + '_ {
        self.points.ids().map(PointId)
    }

    /// Ids of all views, increasing.
    pub fn views(&self) -> impl Iterator<Item = ViewId> + '_ {
        self.views.ids().map(ViewId)
    }

    /// Whether a cell is free. Ghost cells, the space outside the hull, are with [`Hull::Free`] alone.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn is_free(&self, cell: CellId) -> bool {
        self.facets.is_free(cell)
    }

    /// Total weight of the rays that cross a cell. For a ghost cell: of the rays that enter the hull through its facet.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn weight(&self, cell: CellId) -> u64 {
        self.cells.weight(cell)
    }

    /// The observations whose rays cross a cell, in no particular order. A [deferred](Self::deferred) carver tests all of
    /// them.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn rays_across(&self, cell: CellId) -> impl Iterator<Item = (ViewId, PointId)> + '_ {
        let rays = self.rays.table();
        let crossings = self.rays.crossings();
        let has_lists = crossings.has_lists();
        let listed = has_lists.then(|| crossings.of(cell));
        let others = (!has_lists).then(|| rays.all());
        (listed.into_iter().flatten())
            .chain(others.into_iter().flatten())
            .filter(move |&ray| {
                has_lists && !rays.is_degenerate(ray)
                    || self.rays.crosses(&self.tetrahedra, &self.views, ray, cell)
            })
            .map(|ray| {
                let point = rays.point(ray);
                (ViewId(rays.view(ray)), PointId(point))
            })
    }

    /// Number of surface triangles.
    pub fn triangle_count(&self) -> usize {
        self.facets.len()
    }

    /// All surface triangles, in no particular order; positions are those of
    /// [`tetrahedra`](Self::tetrahedra)`().position(vertex)`.
    pub fn triangles(&self) -> impl Iterator<Item = Triangle> + '_ {
        self.facets
            .iter()
            .map(|(cell, facet)| crate::surface::triangle(&self.tetrahedra, cell, facet))
    }

    /// Appends the [`triangles`](Self::triangles) with a corner at `vertex`, each once and in no particular order.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells around the vertex; `scratch` is reused memory.
    pub fn triangles_around(
        &self,
        vertex: VertexId,
        scratch: &mut IncidentCells,
        found: &mut Vec<Triangle>,
    ) {
        self.facets.around(&self.tetrahedra, vertex, scratch, found);
    }

    /// Whether no edge of a triangle is longer than `longest`.
    pub fn has_edges_within(&self, triangle: &Triangle, longest: f64) -> bool {
        crate::surface::has_edges_within(&self.tetrahedra, triangle, longest)
    }

    /// A copy of the surface, in an order that depends on the surface alone.
    ///
    /// # Complexity
    ///
    /// `n log n` in the number of triangles, and a scan of one byte a cell.
    pub fn mesh(&self, options: &ExportOptions) -> IndexedMesh {
        self.mesh_where(options, |_| TriangleRole::Exported).0
    }

    /// The same where `role` says how a triangle is exported. Those that are left out before repair count for the size of their
    /// component. Also returns for each vertex of the mesh what it is, by vertices of [`tetrahedra`](Self::tetrahedra).
    ///
    /// # Complexity
    ///
    /// As [`mesh`](Self::mesh), and one call of `role` for each triangle.
    pub fn mesh_where(
        &self,
        options: &ExportOptions,
        role: impl Fn(&Triangle) -> TriangleRole,
    ) -> (IndexedMesh, Vec<VertexOrigin<VertexId>>) {
        crate::surface::extract(&self.tetrahedra, &self.facets, options, role)
    }

    /// Brings a mesh up to date with the surface. `deltas` are those of all commits since its last update, in order, `touched`
    /// the other triangles whose role may have changed; `role` says how a triangle is exported. A new mesh takes over the
    /// surface by a delta with all [`triangles`](Self::triangles) added.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells around the vertices of all triangles that changed or came to be exported or left out.
    pub fn update_mesh(
        &self,
        mesh: &mut IncrementalMesh,
        deltas: &[crate::surface::SurfaceDelta],
        touched: &[Triangle],
        role: impl Fn(&Triangle) -> TriangleRole,
    ) {
        let carved = Carved {
            tetrahedra: &self.tetrahedra,
            facets: &self.facets,
        };
        mesh.update(carved, deltas, touched, role);
    }

    /// Begins a transaction: changes that take effect together.
    pub fn transaction(&mut self) -> Transaction<'_> {
        Transaction::new(self)
    }

    /// The id of the next point to be added.
    pub fn next_point(&self) -> PointId {
        PointId(self.points.capacity() as u32)
    }

    /// The id of the next view to be added.
    pub fn next_view(&self) -> ViewId {
        ViewId(self.views.capacity() as u32)
    }
}

#[cfg(test)]
mod tests;
